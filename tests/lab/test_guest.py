"""The guest itself: what it computes can be trusted."""

from __future__ import annotations

from usblab.lab import Lab

VALUES = [float(pow(11, power, 1009)) for power in range(1008)]
"""1 ... 1008 in a shuffled order, because 11 is a primitive root modulo the prime 1009."""


def test_the_guests_processor_sorts_as_any_other(lab: Lab):
    order = lab.guest.call("inside_guest.arithmetic:order", values=VALUES)
    assert [VALUES[place] for place in order] == sorted(VALUES)
