"""PCE-174, Extech HD450 and HD400 light meters.

9600 8N1 behind a CP2102 adapter; ``87 83 11`` requests the live record of 18 bytes. All of it rests on one
public description, the maker's paper corrected by trying.

====== ==========================================================================
offset content
====== ==========================================================================
0-2    AA DD 00
3-9    year, weekday, month, day, hour, minute, second, each two BCD digits
10-11  value, 100 x high + low, plain binary 0-99 each
12-13  in relative mode another value, the same
14     bit 7 auto power off is off, 6 hold, 5-3 mode (0 normal, 2 peak min, 3 peak max,
       4 max, 5 min, 6 relative), 2 foot-candle (else lux), 1-0 range
15     bit 5 low battery, 4 minus
16-17  record count, cursor
====== ==========================================================================

In relative mode the public program takes bytes 10-11 for the light, its author's later description bytes
12-13: neither is used, the mode has no value. There is neither a check nor an overload flag; a value at
the end of the largest range is flagged.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from fieldkit.drivers.decoding import Layout, Parsed, Record, Rejected, Value, skip_to
from fieldkit.drivers.framing import Line
from fieldkit.drivers.meters import meter
from fieldkit.drivers.ports import Probe, SerialDriver, open_port
from fieldkit.model.clock import Clock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.samples import Quality

LENGTH = 18
LINE = Line(9600)
KINDS = ((0x10C4, 0xEA60),)
ASK_LIVE = bytes.fromhex("87 83 11")
FULL_SCALE = {"lx": (400_000, 400, 4_000, 40_000), "fc": (40_000, 40, 400, 4_000)}
STEPS = 4000  # counts that fill a range: 400 klx comes in steps of 100 lx
MODES = ("", "mode_1", "peak_minimum", "peak_maximum", "maximum", "minimum", "relative", "mode_7")
EXTREMES, RELATIVE = (2, 3, 4, 5), 6
_START = b"\xaa\xdd\x00"
_HINT = "switch the meter on and its USB output too"


def parse(buffer: bytes) -> Parsed:
    """The record at the start of `buffer`, by the table above."""
    if not buffer.startswith(_START[: len(buffer)]):
        return Rejected(skip_to(_START[:1], buffer), "does not begin with AA DD 00")
    if len(buffer) < LENGTH:
        return None
    if max(buffer[10:14]) > 99:
        return Rejected(skip_to(_START[:1], buffer), "a half of the value is above 99")
    clock = buffer[3:10].hex()
    if not clock.isdigit():
        return Rejected(skip_to(_START[:1], buffer), "the meter's clock is not decimal")
    year, _, month, day, hour, minute, second = (clock[start : start + 2] for start in range(0, 14, 2))
    note = f"meter's clock 20{year}-{month}-{day} {hour}:{minute}:{second}"
    return Record.of(LENGTH, (_value(buffer),), note)


def _value(buffer: bytes) -> Value:
    state, second = buffer[14], buffer[15]
    mode = state >> 3 & 7
    unit = "fc" if state & 0x04 else "lx"
    full_scale = FULL_SCALE[unit][state & 3]
    value = (100 * buffer[10] + buffer[11]) * full_scale / STEPS
    quality = Quality.STALE if state & 0x40 or mode in EXTREMES else Quality.GOOD  # not the current value
    if mode == RELATIVE:
        value, quality = math.nan, quality | Quality.NO_VALUE
    elif value >= full_scale - full_scale / STEPS:
        quality |= Quality.OVERRANGE
    possible = ((state & 0x40, "hold"), (mode, MODES[mode]), (second & 0x20, "low_battery"))
    states = tuple(word for present, word in possible if present)
    return Value(-value if second & 0x10 else value, unit, "illuminance", quality, states)


LAYOUT = Layout(parse, LENGTH)


class Pce174(SerialDriver):
    """Driver of the PCE-174 and the HD450; options are those of every meter."""

    name = "pce-174"
    title = "PCE-174, Extech HD450 light meter"
    quantity = "illuminance"
    options: tuple[str, ...] = meter.OPTIONS
    layout = LAYOUT
    kinds = KINDS
    probes: Sequence[Probe] = (Probe(LINE, ASK_LIVE),)

    def open(self, settings: DeviceSettings, clock: Clock) -> meter.Meter:
        """Open the port and wait for one record."""
        port = open_port(settings, LINE, clock, kinds=KINDS)
        meter.first_reply(port, ASK_LIVE, LAYOUT, settings.name, _HINT)
        info = meter.describe(settings, port, LAYOUT, "illuminance", "lx", ("lux",))
        poll = meter.PollSettings(ASK_LIVE, settings.every_s)
        return meter.Meter(info, port, LAYOUT, clock, ("illuminance",), poll=poll)
