"""Lutron, Extech and relatives: the 16-character stream of light meters and thermometers.

The meter sends on its own, about once or twice a second; a meter with several displays
sends them in turn. Source: the vendor's manuals (YK-2005LX, TM-947SD, DS-2013SD and others)
and two independent public readers. 9600 8N1; DTR powers the transmitter, so it stays asserted.

====== ======================================================
offset content
====== ======================================================
0      02
1      ``4``
2      display or channel: ``1``-``9``, ``A``, ``B``, ``C``
3-4    unit, two digits
5      polarity, ``0`` or ``1`` (negative)
6      decimals, ``0``-``3``
7-14   eight digits; 18 among them: no value
15     0D
====== ======================================================

Certain: the record, codes 01 and 02. From one manual: the other codes. There is no checksum, so a
record must satisfy every line of the table. The mark of an overload or open probe (18) has one
reader, and was captured on an SDL200 with its probe out.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

from fieldkit.drivers.decoding import Channel, Layout, Parsed, Record, Rejected, skip_to
from fieldkit.drivers.framing import Line, Port, Stamped
from fieldkit.drivers.meters import meter
from fieldkit.drivers.ports import Probe, SerialDriver, open_port
from fieldkit.model.clock import Clock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import DecodeError
from fieldkit.model.samples import Quality

LENGTH = 16
LINE = Line(9600)
UNITS = {"01": "°C", "02": "°F", "03": "%", "15": "lx", "16": "fc", "17": "dB", "19": "ppm", "57": "g"}
LIGHT, TEMPERATURE = ("lx", "fc"), ("°C", "°F")
_START = b"\x02"
_HEAD = re.compile(rb"\x024([1-9ABC])([0-9]{2})([01])([0-3])")
_END = 0x0D
_OVERLOAD = b"\x18"
_HINT = (
    "switch on the meter and its RS-232 output; the plug's DTR pin must be wired, it powers the transmitter"
)


def parse(buffer: bytes) -> Parsed:
    """The record at the start of `buffer`, by the table above."""
    if not buffer.startswith(_START):
        return Rejected(skip_to(_START, buffer), "does not begin with 02")
    if len(buffer) < LENGTH:
        return None
    head, digits = _head(buffer[:7]), buffer[7:15]
    if head is not None and buffer[15] == _END:
        if digits.isdigit():
            return Record(LENGTH, (int(digits) / head.divisor,), head.channels)
        if _OVERLOAD in digits and digits.replace(_OVERLOAD, b"0").isdigit():
            return Record(LENGTH, (math.nan,), head.overload)
    return Rejected(skip_to(_START, buffer), "not of the form 02 '4' display unit sign decimals digits 0D")


class Head(NamedTuple):
    """Characters before the digits: signed divisor, and the channel of a number and of an overload."""

    divisor: int
    channels: tuple[Channel, ...]
    overload: tuple[Channel, ...]


@lru_cache(maxsize=64)
def _head(start: bytes) -> Head | None:
    """The meaning of all but the digits, which rarely changes; None if it is not valid."""
    match = _HEAD.fullmatch(start)
    if match is None:
        return None
    display, code, polarity, decimals = (part.decode() for part in match.groups())
    unit = UNITS.get(code, f"code {code}")
    states = () if code in UNITS else ("unknown_unit",)
    divisor = 10 ** int(decimals) * (-1 if polarity == "1" else 1)
    overload = Channel(display, unit, Quality.NO_VALUE, ("overload", *states))
    return Head(divisor, (Channel(display, unit, Quality.GOOD, states),), (overload,))


LAYOUT = Layout(parse, LENGTH)


def _unit_shown(port: Port, first: Stamped) -> str:
    """The unit that decides what is recorded: light before temperature, as a light meter may show both."""
    units: dict[str, str] = {}
    stamped: Stamped | None = first
    while stamped is not None and (x := stamped.record.channels[0]).name not in units:
        units[x.name] = x.unit
        stamped = port.read(LAYOUT, meter.FIRST_RECORD_S) if x.unit not in LIGHT else None
    return min(units.values(), key=lambda unit: (unit not in LIGHT, unit not in TEMPERATURE))


class Lutron(SerialDriver):
    """Driver of meters with the 16-character stream.

    Options: `labels` (one name per display) and those of every meter.
    """

    name = "lutron"
    title = "Lutron / Extech 16-character stream"
    quantity = "illuminance"
    options: tuple[str, ...] = meter.OPTIONS
    layout = LAYOUT
    probes: Sequence[Probe] = (Probe(LINE),)

    def open(self, settings: DeviceSettings, clock: Clock) -> meter.Meter:
        """Open the port and wait for the records of all displays, which show what the meter measures."""
        port = open_port(settings, LINE, clock)
        first = meter.first_record(port, LAYOUT, settings.name, _HINT, settings.every_s)
        unit = _unit_shown(port, first)
        if unit in LIGHT:
            info = meter.describe(settings, port, LAYOUT, "illuminance", "lx", ("lux",))
        elif unit in TEMPERATURE:
            info = meter.describe(settings, port, LAYOUT, "temperature", "K", ("T1", "T2", "T3", "T4"))
        else:
            raise DecodeError(
                f"the meter sends {unit}, neither light nor temperature",
                raw=first.raw,
                place=settings.name,
                fix="switch the meter to lux, foot-candle, °C or °F",
            )
        return meter.Meter(info, port, LAYOUT, clock, "123456789ABC")
