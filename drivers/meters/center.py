"""Center thermometers and their brandings: two records, 45 bytes for four thermocouples, 8 for one or two.

9600 8N1, driven by single letters: ``K`` returns the model (three digits and CR), ``A`` one record. There is
no checksum; a record whose channels lie outside what thermocouples can show is rejected.

**45 bytes**: Center 304 and 309, Voltcraft K204, Omega HH309. Source: the vendor's protocol sheets, sigrok's
description, a public class for the K204.

====== ===================================================================================
offset content
====== ===================================================================================
0      02
1      bit 7 °C (else °F), 6 low battery, 5 hold, 4 REL, 3 T1-T2, 2-1 max/min, 0 recording
2      bit 7 auto power off, bit 0 memory full
7-14   T1..T4, 16 bit, big-endian, two's complement
39     overload bits of T1..T4 (bit 0 = T1)
43     bit n: channel n has no decimal; else tenths
44     03
====== ===================================================================================

Offsets 15-38 repeat the layout for REL, MIN and MAX and are not read: offsets 7-14 are the current
temperatures, whichever of them the display shows. All of the table is certain but the sign, which rests on
one source: below
0 °C is unproven. 02 and 03 occur inside a record. An open probe shows as overload, as 7FFF or as 8000.

**8 bytes**: Center 300-303, Voltcraft 300-302, HH303, KEW301, TC0301. Source: the vendor's protocol text in
several brandings, one origin.

====== =====================================================================================
offset content
====== =====================================================================================
0      02
1      bit 7 °C (else °F), 6 low battery, 5 hold, 4 REL, 3 type J (else K), 2-0 max/min
2      bits 0-2 main: overload, minus, no decimal; 3-5 the same for sub; 7-6 what they are
3-4    main, four BCD digits
5-6    sub, four BCD digits
7      03
====== =====================================================================================

Bits 7-6 of offset 2: 00 T1-T2 and T1, 01 T1-T2 and T2, 10 T1 and T2, 11 T2 and T1. A channel has no fixed
place. Leading digits may be blank (B; one program, against a real meter). A relative display (REL) shows
differences from an unnamed temperature: it has no value. The three bits of max/min are not documented; with
any of them set, the display does not show the current temperature. The models 300 and 302 have one probe:
their sub is a timer, MM:SS with bit 4 of offset 2, else HH:MM.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from functools import lru_cache
from operator import truediv
from types import MappingProxyType
from typing import Any

from fieldkit.drivers.decoding import Channel, Layout, Parsed, Record, Rejected, Value, skip_to
from fieldkit.drivers.framing import Line, Port
from fieldkit.drivers.meters import meter
from fieldkit.drivers.ports import Probe, SerialDriver, open_port
from fieldkit.model.clock import Clock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import DeviceNotFoundError
from fieldkit.model.samples import Quality

LENGTH = 45
LINE = Line(9600)
CHANNELS = ("T1", "T2", "T3", "T4")
OPEN_PROBE = (0x7FFF, -0x8000)
DRIVERS = {
    **dict.fromkeys(("300", "301", "302", "303"), "center-303"),
    **dict.fromkeys(("304", "309"), "center-309"),
    **dict.fromkeys(("305", "306"), ""),
}
"""The driver of each model that a thermometer may report; empty for the ten-byte record."""

LIMITS = {"°C": (-210.0, 1800.0), "°F": (-346.0, 3272.0)}  # widest of the vendor's thermocouple types
_START = b"\x02"
_STATES = ((0x40, "low_battery"), (0x10, "relative"), (0x08, "difference"), (0x01, "recording"))
_COUNTS = struct.Struct(">4h")
_ALL_MEASURE = (False,) * 4
_EXTREMES = {0x00: "", 0x02: "maximum", 0x04: "minimum", 0x06: "max_min_background"}
_HINT = "switch the thermometer on and check its cable; it replies only while no menu is open"


def parse(buffer: bytes) -> Parsed:
    """The record at the start of `buffer`, by the table above."""
    if len(buffer) < LENGTH or buffer[0] != 0x02 or buffer[44] != 0x03:
        return _no_record(buffer, LENGTH)
    counts = _COUNTS.unpack_from(buffer, 7)
    is_open = OPEN_PROBE[0] in counts or OPEN_PROBE[1] in counts
    without = tuple([count in OPEN_PROBE for count in counts]) if is_open else _ALL_MEASURE
    channels, divisors, low, high = _meaning(buffer[1], buffer[2], buffer[39], buffer[43], without)
    numbers = tuple(map(truediv, counts, divisors))
    for number in numbers:
        if number < low or number > high:
            channel = channels[numbers.index(number)]
            return _beyond(buffer, channel.name, number, channel.unit)
    return Record(LENGTH, numbers, channels)


def _beyond(buffer: bytes, channel: str, number: float, unit: str) -> Rejected:
    reason = f"{channel} = {number:g} {unit} is beyond any thermocouple"
    return Rejected(skip_to(_START, buffer), reason)


def _no_record(buffer: bytes, length: int) -> Rejected | None:
    if not buffer.startswith(_START):
        return Rejected(skip_to(_START, buffer), "does not begin with 02")
    if len(buffer) < length:
        return None
    return Rejected(skip_to(_START, buffer), f"no 03 at the end of {length} bytes")


Meaning = tuple[tuple[Channel, ...], tuple[float, ...], float, float]
"""The flags decoded: the channels, the divisor of each count (NaN for no value), the limits of the unit."""


@lru_cache(maxsize=64)
def _meaning(first: int, second: int, overload: int, whole: int, without: tuple[bool, ...]) -> Meaning:
    """Decode the four bytes of flags and the channels without a probe; they rarely change."""
    unit = "°C" if first & 0x80 else "°F"
    quality = Quality.STALE if first & 0x20 else Quality.GOOD
    states = _states(first, second)
    channels, divisors = [], []
    for place, name in enumerate(CHANNELS):
        if overload >> place & 1 or without[place]:
            channels.append(Channel(name, unit, quality | Quality.NO_VALUE, ("overload", *states)))
            divisors.append(math.nan)
        else:
            channels.append(Channel(name, unit, quality, states))
            divisors.append(1.0 if whole >> place & 1 else 10.0)
    return tuple(channels), tuple(divisors), *LIMITS[unit]


def _states(first: int, second: int) -> tuple[str, ...]:
    states = [word for bit, word in _STATES if first & bit]
    states += ["hold"] * bool(first & 0x20) + [_EXTREMES[first & 0x06]]
    states += ["auto_power_off"] * bool(second & 0x80) + ["memory_full"] * bool(second & 0x01)
    return tuple(word for word in states if word)


def parse_model(buffer: bytes) -> Parsed:
    """The reply to ``K`` at the start of `buffer`: three digits and CR."""
    if not buffer[:3].isdigit():
        return Rejected(1, "not three digits") if len(buffer) >= 3 or not buffer.isdigit() else None
    if len(buffer) < 4:
        return None
    if buffer[3] != 0x0D:
        return Rejected(1, "three digits without CR")
    return Record(4, (float(buffer[:3]),), (Channel("model", ""),))


LAYOUT = Layout(parse, LENGTH)
MODEL = Layout(parse_model, 4)


class Center309(SerialDriver):
    """Driver of the four-channel thermometers with the 45-byte record.

    Options: `labels` (names of T1..T4) and those of every meter.
    """

    name = "center-309"
    title = "Center 304/309, K204, HH309 thermometer"
    quantity = "temperature"
    options: tuple[str, ...] = meter.OPTIONS
    layout = LAYOUT
    probes: Sequence[Probe] = (Probe(LINE, b"A"),)

    def open(self, settings: DeviceSettings, clock: Clock) -> meter.Meter:
        """Open the port, request the model, and wait for one record."""
        return open_thermometer(settings, clock, (LAYOUT, CHANNELS))


Kind = tuple[Layout, Sequence[str]]
"""The layout of a model's records, and the channels in them."""


def open_thermometer(
    settings: DeviceSettings, clock: Clock, usual: Kind, others: Mapping[str, Kind] = MappingProxyType({})
) -> meter.Meter:
    """Open a thermometer that replies to ``K`` and ``A``; another driver's model is an error.

    `others` are models whose records are not the `usual` ones.
    """
    port = open_port(settings, LINE, clock)
    model = configured_model(settings.options) or ask_model(port)
    layout, channels = others.get(model, usual)
    driver = DRIVERS.get(model, settings.driver)
    if driver != settings.driver:
        raise DeviceNotFoundError(
            f"the meter at {port.path} is a Center {model}",
            place=settings.name,
            fix=f'set driver = "{driver}" for it'
            if driver
            else "use another meter: this model has no driver",
        )
    meter.first_reply(port, b"A", layout, settings.name, _HINT)
    info = meter.describe(settings, port, layout, "temperature", "K", channels, model)
    poll = meter.PollSettings(b"A", settings.every_s)
    return meter.Meter(info, port, layout, clock, channels, poll=poll)


def configured_model(options: Mapping[str, Any]) -> str:
    """The option `model`, as a number or as text; empty if it is not given."""
    return str(options.get("model", ""))


def ask_model(port: Port) -> str:
    """The model by ``K``, empty for a sibling that does not support the request."""
    reply = port.read(MODEL, meter.REPLY_TIMEOUT_S, b"K")
    return reply.raw[:3].decode() if reply else ""


# --- one or two probes: the 8-byte record

SHORT_LENGTH = 8
TWO_CHANNELS = ("T1", "T2")
WINDOWS = (("T1-T2", "T1"), ("T1-T2", "T2"), ("T1", "T2"), ("T2", "T1"))
ONE_PROBE = ("300", "302")
HOLD, RELATIVE, EXTREME = 0x20, 0x10, 0x07
_BLANK = "b"


def parse_two_probes(buffer: bytes) -> Parsed:
    """The record of a model with two probes at the start of `buffer`, by the table above."""
    return _parse_short(buffer, 2)


def parse_one_probe(buffer: bytes) -> Parsed:
    """The record of a model with one probe: its main value is T1."""
    return _parse_short(buffer, 1)


def _parse_short(buffer: bytes, probes: int) -> Parsed:
    if len(buffer) < SHORT_LENGTH or buffer[0] != 0x02 or buffer[7] != 0x03:
        return _no_record(buffer, SHORT_LENGTH)
    names = WINDOWS[buffer[2] >> 6] if probes == 2 else ("T1",)
    values = [_value(buffer, place, name) for place, name in enumerate(names)]
    present = [value for value in values if value is not None]
    if len(present) < len(values):
        return Rejected(skip_to(_START, buffer), "digits are not decimal")
    for value in present:
        low, high = LIMITS[value.unit]
        if not math.isnan(value.value) and not low <= value.value <= high:
            return _beyond(buffer, value.channel, value.value, value.unit)
    return Record.of(SHORT_LENGTH, present, f"type {'J' if buffer[1] & 0x08 else 'K'}")


def _value(buffer: bytes, place: int, channel: str) -> Value | None:
    """The main (0) or sub (1) value; None if its digits are not decimal."""
    flags = buffer[2] >> 3 * place
    unit = "°C" if buffer[1] & 0x80 else "°F"
    quality = Quality.STALE if buffer[1] & (HOLD | EXTREME) else Quality.GOOD
    states = _short_states(buffer[1])
    if flags & 1:
        return Value(math.nan, unit, channel, quality | Quality.NO_VALUE, ("overload", *states))
    digits = buffer[3 + 2 * place : 5 + 2 * place].hex().lstrip(_BLANK)
    if not digits.isdigit():
        return None
    if buffer[1] & RELATIVE:
        return Value(math.nan, unit, channel, quality | Quality.NO_VALUE, states)
    number = int(digits) / (1 if flags & 4 else 10)
    return Value(-number if flags & 2 else number, unit, channel, quality, states)


def _short_states(first: int) -> tuple[str, ...]:
    states = ((0x40, "low_battery"), (HOLD, "hold"), (RELATIVE, "relative"), (EXTREME, "max_min"))
    return tuple(word for bits, word in states if first & bits)


TWO_PROBE_LAYOUT = Layout(parse_two_probes, SHORT_LENGTH)
ONE_PROBE_LAYOUT = Layout(parse_one_probe, SHORT_LENGTH)


class Center303(SerialDriver):
    """Driver of the one- and two-channel thermometers with the 8-byte record.

    Options: `labels` (names of T1, T2), `model` (of a meter that does not report it) and those of every
    meter. A difference T1-T2 on the display is not recorded, nor is a timer.
    """

    name = "center-303"
    title = "Center 300-303, HH303, KEW301, TC0301 thermometer"
    quantity = "temperature"
    options: tuple[str, ...] = (*meter.OPTIONS, "model")
    probes: Sequence[Probe] = (Probe(LINE, b"A"),)

    def layout_for(self, options: Mapping[str, Any]) -> Layout:
        """That of one probe for the `model` 300 or 302."""
        return ONE_PROBE_LAYOUT if configured_model(options) in ONE_PROBE else TWO_PROBE_LAYOUT

    def open(self, settings: DeviceSettings, clock: Clock) -> meter.Meter:
        """Open the port, request the model, and wait for one record."""
        others = dict.fromkeys(ONE_PROBE, (ONE_PROBE_LAYOUT, TWO_CHANNELS[:1]))
        return open_thermometer(settings, clock, (TWO_PROBE_LAYOUT, TWO_CHANNELS), others)
