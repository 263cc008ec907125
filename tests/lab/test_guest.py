"""The guest itself: what it computes can be trusted."""

import random


def test_the_guests_processor_sorts_as_any_other(lab):
    for seed in range(5):
        draw = random.Random(seed)
        values = [draw.gauss() for _ in range(5000)]
        order = lab.guest.call("inside_guest.arithmetic:order", values=values)
        assert [values[place] for place in order] == sorted(values)
