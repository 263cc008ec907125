"""A serial adapter as fieldkit opens it."""

from __future__ import annotations

import os
from pathlib import Path

import usb.core
import usb.util

from fieldkit.drivers.framing import Line
from fieldkit.drivers.ports import SerialPort
from fieldkit.model.clock import HostClock

GET_LATENCY_TIMER = 0x0A
"""Vendor request of FTDI's chips, by libftdi and the kernel's ftdi_sio.h."""


def latency(path: str) -> dict[str, object]:
    """Milliseconds of the latency timer: by udev's rule, by the port without it, and by the chip."""
    sysfs = Path("/sys/class/tty", os.path.basename(os.path.realpath(path)), "device/latency_timer")
    by_rule_ms = int(sysfs.read_text())
    sysfs.write_text("16")  # as the chip comes
    port = SerialPort(path, Line(), HostClock())
    chip = usb.core.find(idVendor=0x0403, idProduct=0x6001)
    try:
        (chip_ms,) = chip.ctrl_transfer(0xC0, GET_LATENCY_TIMER, 0, 0, 1)
    finally:
        usb.util.dispose_resources(chip)
        port.close()
    return {"by_rule_ms": by_rule_ms, "stated_ms": port.facts["usb_latency_ms"], "chip_ms": chip_ms}
