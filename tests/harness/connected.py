"""What is plugged into this computer, as far as drivers and discovery see."""

from __future__ import annotations

from collections.abc import Collection

import pytest

from fieldkit.drivers.identity import UsbIdentity

Found = tuple[str, UsbIdentity]


def plugged_in(
    patch: pytest.MonkeyPatch, *, cameras: Collection[Found] = (), serial_ports: Collection[Found] = ()
) -> None:
    """Let these cameras and serial ports be connected, and no other; a list may grow later.

    The kernel alone makes nodes under /dev, and what is connected to the computer of the test does not count.
    """
    for module, name, found in (
        ("discovery", "cameras", cameras),
        ("cameras.source", "cameras", cameras),
        ("discovery", "serial_ports", serial_ports),
        ("ports", "serial_ports", serial_ports),
        ("cameras.tcam", "announced", ()),
    ):
        patch.setattr(f"fieldkit.drivers.{module}.{name}", lambda *_, found=found: list(found))
