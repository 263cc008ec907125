"""Center 300-303, Voltcraft 300-302, HH303, KEW301, TC0301: one or two thermocouples in 8 bytes.

9600 8N1, asked like their four-channel siblings: ``K`` answers the model, ``A`` one record. Source: the
vendor's protocol text in several brandings, one origin.

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

Bits 7-6 of offset 2: 00 T1-T2 and T1, 01 T1-T2 and T2, 10 T1 and T2, 11 T2 and T1.
A channel has no fixed place. Leading digits may be blank (B; one program, against a real meter).
A relative display (REL) shows differences from a temperature it does not name: it has no value. What the
three bits of max/min mean is not said; any of them makes the display not that of now.
The models 300 and 302 have one probe: their sub is a timer, MM:SS with bit 4 of offset 2, else HH:MM.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from fieldkit.drivers.meters import meter
from fieldkit.drivers.meters.center_309 import LIMITS, open_thermometer, told_model
from fieldkit.drivers.options import for_bytes
from fieldkit.drivers.ports import find_ports
from fieldkit.drivers.records import Decoded, Layout, Record, Rejected, Taken, Value, decode_records, skip_to
from fieldkit.model.clock import Clock
from fieldkit.model.device import DeviceSettings, Found
from fieldkit.model.samples import Quality

LENGTH = 8
CHANNELS = ("T1", "T2")
WINDOWS = (("T1-T2", "T1"), ("T1-T2", "T2"), ("T1", "T2"), ("T2", "T1"))
ONE_PROBE = ("300", "302")
HOLD, RELATIVE, EXTREME = 0x20, 0x10, 0x07
_START, _BLANK = b"\x02", "b"


def take(buffer: bytes) -> Taken:
    """The record of a model with two probes at the start of `buffer`, by the table above."""
    return _take(buffer, 2)


def take_one(buffer: bytes) -> Taken:
    """The record of a model with one probe: its main value is T1."""
    return _take(buffer, 1)


def _take(buffer: bytes, probes: int) -> Taken:
    if not buffer.startswith(_START):
        return Rejected(skip_to(_START, buffer), "does not begin with 02")
    if len(buffer) < LENGTH:
        return None
    if buffer[7] != 0x03:
        return Rejected(skip_to(_START, buffer), "no 03 at the end of 8 bytes")
    names = WINDOWS[buffer[2] >> 6] if probes == 2 else ("T1",)
    values = [_value(buffer, place, name) for place, name in enumerate(names)]
    known = [value for value in values if value is not None]
    if len(known) < len(values):
        return Rejected(skip_to(_START, buffer), "digits are not decimal")
    for value in known:
        low, high = LIMITS[value.unit]
        if not math.isnan(value.value) and not low <= value.value <= high:
            reason = f"{value.channel} = {value.value:g} {value.unit} is beyond any thermocouple"
            return Rejected(skip_to(_START, buffer), reason)
    return Record.of(LENGTH, known, f"type {'J' if buffer[1] & 0x08 else 'K'}")


def _value(buffer: bytes, place: int, channel: str) -> Value | None:
    """The main (0) or sub (1) value; None if its digits are not decimal."""
    flags = buffer[2] >> 3 * place
    unit = "°C" if buffer[1] & 0x80 else "°F"
    quality = Quality.STALE if buffer[1] & (HOLD | EXTREME) else Quality.GOOD
    words = _words(buffer[1])
    if flags & 1:
        return Value(math.nan, unit, channel, quality | Quality.NO_VALUE, ("overload", *words))
    digits = buffer[3 + 2 * place : 5 + 2 * place].hex().lstrip(_BLANK)
    if not digits.isdigit():
        return None
    if buffer[1] & RELATIVE:
        return Value(math.nan, unit, channel, quality | Quality.NO_VALUE, words)
    number = int(digits) / (1 if flags & 4 else 10)
    return Value(-number if flags & 2 else number, unit, channel, quality, words)


def _words(first: int) -> tuple[str, ...]:
    states = ((0x40, "low_battery"), (HOLD, "hold"), (RELATIVE, "relative"), (EXTREME, "max_min"))
    return tuple(word for bits, word in states if first & bits)


LAYOUT, LAYOUT_ONE = Layout(take, LENGTH), Layout(take_one, LENGTH)


class Center303:
    """Driver of the one- and two-channel thermometers with the 8-byte record.

    Options: `labels` (names of T1, T2), `model` (of a meter that does not tell it) and those of every meter.
    A difference T1-T2 on the display is not recorded, nor is a timer.
    """

    name = "center-303"
    title = "Center 300-303, HH303, KEW301, TC0301 thermometer"
    quantity = "temperature"
    options = (*meter.OPTIONS, "model")

    def find(self) -> list[Found]:
        """Serial adapters; only asking ``K`` tells, so each is only a candidate."""
        return find_ports(self.name, self.title, (), "any adapter: only the meter's answer tells")

    def decode(self, data: bytes, options: Mapping[str, Any]) -> Decoded:
        """Explain bytes; option `model` for those of a 300 or 302, see `fieldkit.drivers.records.Decodes`."""
        is_one = told_model(for_bytes(self.name, options)) in ONE_PROBE
        return decode_records(data, LAYOUT_ONE if is_one else LAYOUT)

    def open(self, settings: DeviceSettings, clock: Clock) -> meter.Meter:
        """Open the port, ask for the model, and wait for one record."""
        others = dict.fromkeys(ONE_PROBE, (LAYOUT_ONE, CHANNELS[:1]))
        return open_thermometer(settings, clock, (LAYOUT, CHANNELS), others)
