"""Position and time of an NMEA 0183 receiver.

4800 or 9600 8N1; ``$`` ... ``*`` check CR LF. RMC, GGA and ZDA are read (by pynmeagps), the others let by.
A sentence without its check, or one the receiver itself calls invalid or not measured, gives no value. The
moment a sentence arrives is off by up to 0.7 s and wanders, so its time is recorded as the device's own and
never sets a clock.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, date, datetime, time
from functools import reduce
from operator import xor
from typing import Any

from fieldkit.drivers.decoding import Layout, Parsed, Record, Rejected, Value
from fieldkit.drivers.framing import Line, Port
from fieldkit.drivers.meters import meter
from fieldkit.drivers.ports import Probe, SerialDriver, baud, open_port
from fieldkit.model.clock import Clock, utc_ns
from fieldkit.model.device import DeviceSettings
from fieldkit.model.samples import Quality

LONGEST = 120  # the standard has 82, receivers send more
LONGEST_KEPT = 2048  # a TPV of gpsd with all of its fields has 1100 bytes
LINE = Line(9600)
CHANNELS = (("latitude", "°"), ("longitude", "°"), ("altitude", "m"))
READ = ("RMC", "GGA", "ZDA")
NOT_MEASURED = ("E", "M", "S", "N")
QUALITY_NOT_MEASURED = (0, 6, 7, 8)
"""Modes of RMC and qualities of GGA that are no fix: none, estimated, entered by hand, simulated."""

_SENTENCE = re.compile(rb"\$([A-Z0-9]{3,}(?:,[\x20-\x7e]*?)?)\*([0-9A-Fa-f]{2})")
_HINT = "give the receiver a view of the sky; baud = 4800 for older ones"


def parse(buffer: bytes) -> Parsed:
    """The sentence at the start of `buffer`, up to its line end."""
    if not buffer.startswith(b"$"):
        start = buffer.find(b"$")
        return Rejected(start if start > 0 else len(buffer), "does not begin with $")
    end, again = buffer.find(b"\n"), buffer.find(b"$", 1)
    if again > 0 and (end < 0 or again < end):
        return Rejected(again, "a sentence begins before this one ends")
    if end < 0:
        return None if len(buffer) < LONGEST else Rejected(1, "no line end in sight")
    sentence = _SENTENCE.fullmatch(buffer[:end].rstrip(b"\r"))
    if sentence is None:
        return Rejected(end + 1, "not of the form $...*check")
    return _sentence_record(sentence, end + 1)


def _sentence_record(sentence: re.Match[bytes], length: int) -> Parsed:
    body, check = sentence.groups()
    expected = reduce(xor, body, 0)
    if int(check, 16) != expected:
        return Rejected(length, f"check is {check.decode()}, should be {expected:02X}")
    name = body.split(b",")[0].decode()
    if name[2:] not in READ or name.startswith("P"):  # P: a maker's own, such as $PGRMC
        return Record(length, note=f"{name}: not read")
    import pynmeagps as nmea  # a quarter of a second

    errors = nmea.NMEAParseError, nmea.NMEAMessageError, nmea.NMEATypeError
    try:
        return _meaning(nmea.NMEAReader.parse(sentence.group(0) + b"\r\n"), length)
    except (*errors, ValueError, AttributeError, TypeError) as error:
        return Rejected(length, f"{name}: {error}")


def _meaning(message: Any, length: int) -> Parsed:
    if message.msgID == "GGA":
        return _gga(message, length)
    is_measured = getattr(message, "posMode", "") not in NOT_MEASURED  # absent before NMEA 2.3
    valid = message.msgID == "ZDA" or (message.status == "A" and is_measured)
    place = () if message.msgID == "ZDA" else position(message.lat, message.lon, valid)
    moment = _moment(message)
    if moment is None:
        return Record.of(length, place, f"{message.msgID} without a time")
    when = (Value(moment.timestamp(), "s since 1970", "utc"),) if valid else ()
    note = f"{message.msgID} {moment:%Y-%m-%d %H:%M:%S.%f} UTC"
    return Record.of(length, (*place, *when), note, utc_ns(moment))


def _moment(message: Any) -> datetime | None:
    """The time of an RMC or ZDA; None while the receiver has none, whose fields are empty then."""
    if not isinstance(message.time, time):
        return None
    if message.msgID == "ZDA":
        return datetime.combine(date(message.year, message.month, message.day), message.time, tzinfo=UTC)
    is_dated = isinstance(message.date, date)
    return datetime.combine(message.date, message.time, tzinfo=UTC) if is_dated else None


def _gga(message: Any, length: int) -> Record:
    valid = message.quality not in ("", *QUALITY_NOT_MEASURED)
    counts = (Value(_number(message.quality), "", "fix"), Value(_number(message.numSV), "", "satellites"))
    place, height = position(message.lat, message.lon, valid), altitude(message.alt, valid)
    return Record.of(length, (*place, height, *counts), "GGA")


def position(latitude: Any, longitude: Any, valid: bool) -> tuple[Value, Value]:
    """Latitude and longitude as reported, without a value unless both are; raises `ValueError`."""
    numbers = [_number(number) if valid else math.nan for number in (latitude, longitude)]
    is_measured = all(map(math.isfinite, numbers))
    if is_measured and not (abs(numbers[0]) <= 90 and abs(numbers[1]) <= 180):
        raise ValueError("position is not on the Earth")
    return _value(numbers[0], "°", "latitude", is_measured), _value(numbers[1], "°", "longitude", is_measured)


def altitude(number: Any, valid: bool) -> Value:
    """The altitude as reported; raises `ValueError`."""
    height_m = _number(number)
    return _value(height_m, "m", "altitude", valid and math.isfinite(height_m))


def _number(text: Any) -> float:
    return math.nan if text in ("", None) else float(text)


def _value(number: float, unit: str, name: str, is_measured: bool) -> Value:
    return Value(number, unit, name) if is_measured else Value(math.nan, unit, name, Quality.NO_VALUE)


LAYOUT = Layout(parse, LONGEST)


class Nmea(SerialDriver):
    """Driver of NMEA receivers; options: `baud` (9600) and those of every meter."""

    name = "nmea"
    title = "NMEA 0183 receiver (position, time)"
    quantity = "position"
    options: tuple[str, ...] = (*meter.OPTIONS, "baud")
    probes: Sequence[Probe] = (Probe(LINE),)
    layout = LAYOUT

    def open(self, settings: DeviceSettings, clock: Clock) -> meter.Meter:
        """Open the port and wait for the first sentence."""
        port = open_port(settings, Line(baud(settings, LINE.baud)), clock)
        meter.first_record(port, LAYOUT, settings.name, _HINT, settings.every_s)
        return receiver(settings, port, LAYOUT, clock, CHANNELS)


def receiver(
    settings: DeviceSettings, port: Port, layout: Layout, clock: Clock, channels: Sequence[tuple[str, str]]
) -> meter.Meter:
    """An opened receiver with these channels and their units."""
    keys, units = zip(*channels, strict=True)
    unit = " ".join(units).replace("°", "degree")
    info = meter.describe(settings, port, layout, "position", unit, keys)
    info = replace(info, device_time_unit="ns since 1970 UTC", raw_bytes=min(layout.longest, LONGEST_KEPT))
    return meter.Meter(info, port, layout, clock, keys, units=units)
