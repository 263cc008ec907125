"""UNI-T UT325 (UT32x) thermometer: 19 characters through a USB HID bridge that is not a serial port.

A CH9325 bridge (1a86:e008) with 2400 8N1 behind it. Sending 01 starts the live stream, two or three records
a second. Source: sigrok's description of meter and bridge, one source.

====== =====================================================================
offset content
====== =====================================================================
1-4    value in tenths, ``:`` blank, ``;`` minus, four ``;`` no probe
5      unit, ``1`` °C, ``2`` °F, ``3`` K
8      ``0``
13     channel, ``0`` T1, ``1`` T2, ``2`` ``3`` T1-T2
16     ``1``
17-18  0D 0A
====== =====================================================================

The bridge: a feature report of five bytes sets the speed; each report of eight bytes it sends begins with
F0 plus the number of characters in it; one sent to it begins with that number alone.
"""

from __future__ import annotations

import math
import re

from fieldkit.drivers.decoding import Layout, Parsed, Record, RecordDriver, Rejected, Value
from fieldkit.drivers.framing import Line, Port
from fieldkit.drivers.identity import candidates
from fieldkit.drivers.meters import meter
from fieldkit.drivers.opening import close_on_failure
from fieldkit.drivers.usb import pick_usb, read_until, usb_errors, usb_nodes
from fieldkit.model.clock import Clock
from fieldkit.model.device import DeviceSettings, DiscoveredDevice
from fieldkit.model.samples import Quality

LENGTH = 19
LINE = Line(2400)
KINDS = ((0x1A86, 0xE008),)
CHANNELS = ("T1", "T2")
NAMES = {b"0": "T1", b"1": "T2", b"2": "T1-T2", b"3": "T1-T2"}
UNITS = {b"1": "°C", b"2": "°F", b"3": "K"}
START_LIVE = b"\x01"
_NO_PROBE = b";;;;"
_END = b"\r\n"
_RECORD = re.compile(rb".(;{4}|(?=.{4}[123]):*;?:*[0-9]+)([123])..0.{4}([0-3])..1\r\n", re.DOTALL)
_READ_MS = 200
_HINT = "switch the thermometer on and press its USB key until the display shows it"


def parse(buffer: bytes) -> Parsed:
    """The record at the start of `buffer`, by the table above."""
    if len(buffer) < LENGTH:
        return None
    match = _RECORD.fullmatch(buffer[:LENGTH])
    if match is None:
        end = buffer.find(_END, 0, LENGTH)  # nothing before it can belong to the next record
        return Rejected(end + 2 if end >= 0 else 1, "not of the form value unit 0 channel 1 CR LF")
    digits, unit, channel = match.groups()
    if digits == _NO_PROBE:
        value = Value(math.nan, UNITS[unit], NAMES[channel], Quality.NO_VALUE, ("no_probe",))
    else:
        number = int(re.sub(rb"[:;]", b"", digits)) / 10
        value = Value(-number if b";" in digits else number, UNITS[unit], NAMES[channel])
    return Record.of(LENGTH, (value,))


LAYOUT = Layout(parse, LENGTH)


class HidBridge(Port):
    """The CH9325 as a port for meters. libusb waits by itself, in slices of a fifth of a second."""

    def __init__(self, settings: DeviceSettings, clock: Clock) -> None:
        self._unit, usb = pick_usb(settings, KINDS)
        facts = {"line": str(LINE), "backend": "pyusb"}
        super().__init__(f"usb:{usb.path}", facts, clock, LINE.byte_ns, usb.as_text())
        close_on_failure(self.close)
        with usb_errors(self.path):
            if self._unit.is_kernel_driver_active(0):
                self._unit.detach_kernel_driver(0)
            self._unit.set_configuration()
            speed = LINE.baud.to_bytes(2, "little") + b"\0\0\x03"
            self._unit.ctrl_transfer(0x21, 0x09, 0x0300, 0, speed)  # HID SET_REPORT, feature

    def write(self, data: bytes) -> None:
        """Send up to seven characters."""
        with usb_errors(self.path):
            self._unit.write(0x02, bytes([len(data)]) + data.ljust(7, b"\0"))

    def close(self) -> None:
        """Release the bridge; a second call does nothing."""
        import usb.util

        usb.util.dispose_resources(self._unit)

    def _receive(self, timeout_s: float) -> bytes:
        with usb_errors(self.path):
            return characters(read_until(self._unit, 0x82, 8, _READ_MS))


def characters(report: bytes) -> bytes:
    """Content of one report of the bridge."""
    return report[1 : 1 + (report[0] & 0x0F)] if report and report[0] & 0xF0 == 0xF0 else b""


class Ut325(RecordDriver):
    """Driver of the UT325; options: `labels` (names of T1, T2) and those of every meter."""

    name = "ut325"
    title = "UNI-T UT325 thermometer"
    quantity = "temperature"
    options: tuple[str, ...] = meter.OPTIONS
    layout = LAYOUT

    def find(self) -> list[DiscoveredDevice]:
        """CH9325 bridges; other UNI-T meters have the same, so each is only a candidate."""
        caveat = "other UNI-T meters use the same bridge"
        return candidates(self.name, self.title, usb_nodes(KINDS), None, caveat)

    def open(self, settings: DeviceSettings, clock: Clock) -> meter.Meter:
        """Open the bridge, start the live stream and wait for its first record."""
        port = HidBridge(settings, clock)
        port.write(START_LIVE)
        meter.first_record(port, LAYOUT, settings.name, _HINT, settings.every_s)
        info = meter.describe(settings, port, LAYOUT, "temperature", "K", CHANNELS, "UT325")
        return meter.Meter(info, port, LAYOUT, clock, CHANNELS)
