r"""Lines of text from a microcontroller board (Arduino, ESP32, ...).

There is no standard; this is fieldkit's. A line ends with LF or CR LF and is one of

* ``name=value unit`` pairs, separated by commas or semicolons: ``T1=21.56 C, lux=98760 lx``
* numbers separated by commas, semicolons or tabs, named by a header line (``ms,temp_c,lux``) or by
  the option `columns`; a name may end in its unit: ``_c``, ``_f``, ``_k``, ``_lx``, ``_w_m2``
* a comment, beginning with ``#``

Any other line (``LUX 980.2`` without an equals sign, a checksum at the end) is another format and needs a
driver of its own.

``nan``, an empty field and the numbers of the option `no_value` (for a DS18B20: -127 disconnected, 85 just
powered on) are no value. Radiation is used by its name, ``ghi_w_m2`` or ``DNI=712 W/m2``; of any other column
in W/m2 the configuration must state what it measures (`fieldkit.model.radiation`). A column called ``ms`` is
the board's own clock; it wraps after 49.7 days.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from fieldkit.drivers import options
from fieldkit.drivers.decoding import Decoded, Layout, Parsed, Record, Rejected, Value, decode_records
from fieldkit.drivers.meters import meter
from fieldkit.drivers.meters.meter import STREAM_UNITS
from fieldkit.drivers.options import decoding_settings
from fieldkit.drivers.ports import Line, Port, find_ports, open_port
from fieldkit.model.clock import Clock
from fieldkit.model.device import DeviceSettings, DiscoveredDevice
from fieldkit.model.errors import ConfigError, DecodeError
from fieldkit.model.radiation import UNIT, named
from fieldkit.model.samples import NO_COUNTER, Quality

LONGEST = 512
LINE = Line(115_200)
PREAMBLE_S = 15.0  # comments and headers of a board that has just restarted
UNITS = {
    "c": "°C",
    "°c": "°C",
    "ºc": "°C",
    "*c": "°C",
    "degc": "°C",
    "f": "°F",
    "ºf": "°F",
    "degf": "°F",
    "k": "K",
    "°k": "K",
    "lx": "lx",
    "lux": "lx",
    "w/m2": "W/m²",
    "w/m^2": "W/m²",
    "w/m²": "W/m²",
    "m/s": "m s-1",
}
SUFFIXES = {"_c": "°C", "_f": "°F", "_k": "K", "_lx": "lx", "_w_m2": "W/m²", "_m_s": "m s-1"}
QUANTITIES = {"K": "temperature", "lx": "illuminance", "W m-2": "irradiance", "m s-1": "speed"}
_DIGITS = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d{1,2})?|nan"
_PAIR = re.compile(rf"\s*([A-Za-z][\w .-]{{0,31}}?)\s*=\s*({_DIGITS}|)\s*([^\s,;=]{{0,8}})\s*", re.IGNORECASE)
_NAME = re.compile(r"[A-Za-z][\w .-]{0,31}")
_NUMBER = re.compile(_DIGITS, re.IGNORECASE)
_COLUMNS = "columns "
_LONGEST_CLOCK = 18  # digits: 64 bits hold them, and boards restart within thirty million years
_HINT = "does the board print lines? boards restart when the port opens and need two seconds"


@dataclass(frozen=True, slots=True)
class Grammar:
    """How to read a board's lines: names of bare numbers, their unit, numbers that are no value."""

    columns: tuple[str, ...] = ()
    unit: str = ""
    no_value: tuple[float, ...] = ()

    def parse(self, buffer: bytes) -> Parsed:
        """The line at the start of `buffer`."""
        end = buffer.find(b"\n")
        if end < 0:
            return None if len(buffer) < LONGEST else Rejected(len(buffer), "no line end found")
        try:
            line = buffer[:end].decode("utf-8").strip()
        except UnicodeDecodeError:
            return Rejected(end + 1, "not text: wrong baud rate?")
        if not line or line.startswith("#"):
            return Record(end + 1, note=line)
        if "=" in line:
            return self._pairs(line, end + 1)
        if "," in line and (";" in line or "\t" in line):  # 21,5;98760 would become three numbers
            return Rejected(end + 1, "two separators, or decimal commas: print numbers with a point")
        fields = [field.strip() for field in re.split(r"[,;\t]", line)]
        if all(_NAME.fullmatch(field) and not _NUMBER.fullmatch(field) for field in fields):
            return Record(end + 1, note=_COLUMNS + ",".join(fields))
        return self._row(fields, end + 1)

    def _pairs(self, line: str, length: int) -> Parsed:
        values = []
        for part in re.split(r"[,;]", line):
            found = _PAIR.fullmatch(part)
            if found is None:
                return Rejected(length, f"{part.strip()!r} is not name=value unit")
            unit = UNITS.get(found[3].lower(), found[3])
            values.append(self._value(found[1], found[2], unit))
        return Record.of(length, values)

    def _row(self, fields: list[str], length: int) -> Parsed:
        names = self.columns or tuple(f"column {place + 1}" for place in range(len(fields)))
        if len(fields) != len(names):
            return Rejected(length, f"{len(fields)} fields, {len(names)} columns")
        wrong = [field for field in fields if not _is_number(field)]
        if wrong:
            return Rejected(length, f"{wrong[0][:20]!r} is not a number")
        row = dict(zip(names, fields, strict=True))
        clock = row.pop("ms", "")
        if len(clock) > _LONGEST_CLOCK:
            return Rejected(length, f"{clock[:20]!r} is not a time in milliseconds")
        values = tuple(self._value(name, field, _unit_of(name)) for name, field in row.items())
        return Record.of(length, values, device_time=int(clock) if clock.isdecimal() else NO_COUNTER)

    def _value(self, name: str, field: str, unit: str) -> Value:
        number = float(field or "nan")
        unit = unit or self.unit
        if not math.isfinite(number) or number in self.no_value:
            return Value(math.nan, unit, name, Quality.NO_VALUE)
        return Value(number, unit, name)

    @property
    def layout(self) -> Layout:
        """For a port."""
        return Layout(self.parse, LONGEST)


def _is_number(field: str) -> bool:
    return not field or _NUMBER.fullmatch(field) is not None


def _unit_of(name: str) -> str:
    return next((unit for suffix, unit in SUFFIXES.items() if name.lower().endswith(suffix)), "")


def header(notes: Sequence[str]) -> tuple[str, ...]:
    """The columns that the last header line among a decoder's notes names, empty if there is none."""
    found = [note.removeprefix(_COLUMNS) for note in notes if note.startswith(_COLUMNS)]
    return tuple(found[-1].split(",")) if found else ()


class Text:
    """Driver of boards that print lines.

    Options: `columns`, `no_value`, `baud` (115200), `unit` (what a line without units means), and those of
    every meter. The stream takes the columns that have the unit of the first value.
    """

    name = "text"
    title = "lines of text from a microcontroller board"
    quantity = "temperature"
    options: tuple[str, ...] = (*meter.OPTIONS, "columns", "no_value", "baud", "unit")

    def find(self) -> list[DiscoveredDevice]:
        """Serial ports; only the lines decide, so each is a candidate."""
        return find_ports(self.name, self.title, (), "any adapter: only its lines decide")

    def decode(self, data: bytes, options: Mapping[str, Any]) -> Decoded:
        """Explain bytes; see `fieldkit.drivers.decoding.Decodes`. The header may stand anywhere in them."""
        names = options.get("columns", ())
        given = {**options, "columns": names.split(",") if isinstance(names, str) else names}
        grammar = _grammar(decoding_settings(self.name, given))
        if not grammar.columns:
            grammar = replace(grammar, columns=header(decode_records(data, Grammar().layout).notes))
        return decode_records(data, grammar.layout)

    def open(self, settings: DeviceSettings, clock: Clock) -> meter.Meter:
        """Open the port (the board restarts) and wait for the first line with values.

        Raises `DecodeError` where only comments and headers come for `PREAMBLE_S`.
        """
        grammar = _grammar(settings)
        port = open_port(settings, Line(int(options.number(settings, "baud", LINE.baud))), clock)
        grammar, first = _first_values(port, grammar, settings.name, clock)
        shown = first.channels[0].unit
        keys = [channel.name for channel in first.channels if channel.unit == shown]
        unit = STREAM_UNITS.get(shown, shown)
        names = options.labels(settings, keys)
        info = meter.describe(
            settings, port, grammar.layout, QUANTITIES.get(unit, "number"), unit, names, model="text"
        )
        info = replace(
            info,
            measures=(named(names) or named(keys[: len(names)])) if unit == UNIT else (),
            device_time_unit="ms" if first.device_time != NO_COUNTER else "",
        )
        return meter.Meter(info, port, grammar.layout, clock, keys[: len(names)])


def _first_values(port: Port, grammar: Grammar, name: str, clock: Clock) -> tuple[Grammar, Record]:
    """The first line with values, and how to read those after it: by the header before it."""
    end_ns = clock.mono_ns() + int(PREAMBLE_S * 1e9)
    while clock.mono_ns() < end_ns:
        first = meter.first_record(port, grammar.layout, name, _HINT).record
        if first.channels:
            return grammar, first
        grammar = replace(grammar, columns=grammar.columns or header([first.note]))
    port.close()
    raise DecodeError(
        f"{name}: only comments and headers from {port.path}, the last one {first.note[:60]!r}",
        raw=first.note.encode(),
        fix="print lines with values too, such as T1=21.56 C, every few seconds",
    )


def _grammar(settings: DeviceSettings) -> Grammar:
    columns, no_value = settings.options.get("columns", ()), settings.options.get("no_value", ())
    if not isinstance(columns, list | tuple) or not all(isinstance(name, str) for name in columns):
        raise _wrong(settings, "columns", 'a list of names such as ["ms", "temp_c"]')
    if not isinstance(no_value, list | tuple) or not all(isinstance(one, int | float) for one in no_value):
        raise _wrong(settings, "no_value", "a list of numbers such as [-127, 85]")
    unit = options.text(settings, "unit", "")
    return Grammar(tuple(columns), UNITS.get(unit.lower(), unit), tuple(float(one) for one in no_value))


def _wrong(settings: DeviceSettings, key: str, expected: str) -> ConfigError:
    return ConfigError(
        f"{settings.name}: {key} = {settings.options[key]!r} is not {expected}", fix=f"give {expected}"
    )
