r"""Lines of text from a microcontroller board (Arduino, ESP32, ...).

There is no standard; this is fieldkit's. A line ends with LF, CR LF or CR and is one of

* names with values and units, separated by commas, semicolons, tabs or spaces: ``T1=21.56 C, lux=98760 lx``,
  ``Light: 54612.5 lx``, ``Temp(C): 23.1``
* values separated by commas, semicolons, tabs or spaces, named by a header line (``ms,temp_c,lux``) or by
  the option `columns`; a name may end in its unit: ``_c``, ``_f``, ``_k``, ``_lx``, ``_w_m2``, ``(C)``
* a JSON object or array: ``{"temp_c": 21.56, "sky": {"lux": 98760}}`` gives ``temp_c`` and ``sky.lux``
* a comment, beginning with ``#``

A time at the beginning of a line is skipped. Any other line (``LUX 980.2`` without a sign between name and
value, a checksum at the end) is another format and needs a driver of its own.

A field that is not a number is no value of its channel alone: ``nan``, ``OL``, ``---``, an empty field,
garbled digits below a name; so are the numbers of the option `no_value` (for a DS18B20: -127 disconnected, 85
just powered on). The option `sensor` reads what the example of a sensor's library prints
(`fieldkit.drivers.meters.board_sensors`). Radiation is used by its name, ``ghi_w_m2`` or ``DNI=712 W/m2``; of
any other column in W/m2 the configuration must state what it measures (`fieldkit.model.radiation`). ``ms`` is
the board's own clock, which wraps after 49.7 days.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from fieldkit.drivers import options
from fieldkit.drivers.decoding import Decoded, Layout, Parsed, Record, Rejected, Value, decode_records
from fieldkit.drivers.framing import Line, Port
from fieldkit.drivers.meters import meter
from fieldkit.drivers.meters.board_sensors import SENSORS, Sensor
from fieldkit.drivers.options import decoding_settings
from fieldkit.drivers.ports import SerialDriver, baud, open_port
from fieldkit.model.channels import components_named
from fieldkit.model.clock import Clock, time_left
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import DecodeError
from fieldkit.model.quantities import (
    OTHER_UNITS,
    POWER,
    Quantity,
    meaning_of,
    split_label,
    unit_of,
    unknown_meaning,
)
from fieldkit.model.samples import NO_COUNTER, Quality

LONGEST = 512
BLOCK_LONGEST = 2048
LINE = Line(115_200)
PREAMBLE_S = 15.0  # comments, headers and messages of a board that has just restarted
FORMS = (
    'T1=21.56 C, lux=98760 lx | Light: 98760 lx | 21.56,98760 below a header temp_c,lux | {"temp_c": 21.56}'
)
_DIGITS = r"[+-]?(?!0[xX])(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d{1,3})?"
_UNIT = r"(?:deg(?:ree)?s?\.? ?)?[^\s\d,;|=:+.-][^\s,;|=:]{0,11}(?: m-2)?"
_FIELD = re.compile(rf"({_DIGITS})\s*({_UNIT})?")
_BEFORE = re.compile(rf"^\s*{_FIELD.pattern}")
_KEY = re.compile(
    r"(?<![^\s,;|])((?:[^\W\d]|[(\[%])[^\s=:,;|]*|[^\W\d][^\s=:,;|]* \d+(?=\s*=|:\s))\s*[=:](?!//)"
)
_NAME = re.compile(r"[^\W\d][\w .°%µ²/^()\[\]-]{0,31}")
_SEPARATOR = re.compile(r"[,;|\t]")
_LINE_END = re.compile(rb"\r\n|\r|\n")
_DAY = r"(?:\d{4}[-/.]\d\d?[-/.]\d\d?|\d\d?[-/.]\d\d?[-/.]\d{4})"
_TIME = r"\d\d?:\d\d(?::\d\d(?:\.\d+)?)?(?:Z|[+-]\d\d:\d\d| ?[AP]M\b)?"
_STAMP = re.compile(rf"[\[(]?(?:{_DAY}(?:[T ,;\t]\s*{_TIME})?|{_TIME})[\])]?\s*(?:[-=]>|[,;|]|[:-]\s)?\s*")
_NOT_ASCII = frozenset("°ºµ²³")  # what a board writes in Latin-1
_NO_VALUES = re.compile(
    "|nan?|inf(inity)?|nul+|none|nc|[o0]l|ov(f|l|er(flow|range|load)?)|open|short|err(or)?|fail(ed)?|fault"
    "|invalid|disconnected|missing|no(data|value)"
)
_COLUMNS = "columns "
_LONGEST_NAME = 32
_LONGEST_CLOCK = 18  # digits: 64 bits hold them, and boards restart within thirty million years
_HINT = (
    "does the board print lines? boards restart when the port opens and need two seconds; "
    "state an interval of more than 5 s as every_s"
)


class _Field(NamedTuple):
    """A field of a line, with its name and the unit that stands elsewhere than behind the number."""

    name: str
    text: str
    unit: str = ""


@dataclass(frozen=True, slots=True)
class Grammar:
    """Rules for a board's lines: names of bare numbers, their unit, what is no value; or a sensor."""

    columns: tuple[str, ...] = ()
    unit: str = ""
    no_value: tuple[float, ...] = ()
    sensor: Sensor | None = None

    def parse(self, buffer: bytes) -> Parsed:
        """The line at the start of `buffer`."""
        end = _LINE_END.search(buffer)
        if end is None:
            reason = f"{_start(buffer)}: no line end in {LONGEST} bytes"
            return None if len(buffer) < LONGEST else Rejected(len(buffer), reason)
        if self.sensor and self.sensor.last and re.match(self.sensor.value.encode(), buffer):
            return self._block(self.sensor, buffer)
        line = _line_of(buffer[: end.start()])
        if line is None:
            return Rejected(end.end(), f"{_start(buffer)}: not text: wrong baud rate?")
        record = Record(0, note=line) if not line or line.startswith("#") else self._line(line)
        if isinstance(record, Record):
            return record._replace(length=end.end())
        return Rejected(end.end(), f"{line[:60]!r}: {record}")

    def _line(self, line: str) -> Record | str:
        """A record without its length, or why the line is none."""
        if self.sensor:
            return self._of_sensor(self.sensor, line)
        stamp = _STAMP.match(line)
        body = line[stamp.end() :] if stamp else line
        if body.startswith(("{", "[")):
            return self._json(body)
        keys = list(_KEY.finditer(body))
        if keys:
            return self._named_values(body, keys)
        if "," in body and (";" in body or "\t" in body):  # 21,5;98760 would become three numbers
            return "two separators, or decimal commas: print numbers with a point"
        fields = _split(body)
        names = [field for field in fields if field]
        if names and not any(map(_is_value, names)) and all(map(_NAME.fullmatch, names)):
            return _heading(names, line)
        return self._row(fields, has_stamp=stamp is not None)

    def _of_sensor(self, sensor: Sensor, line: str) -> Record | str:
        text = sensor.reading(line)
        if text is None:
            return "not a line of this sensor's example; without the option sensor other lines are read"
        return self._record([_Field(sensor.channel, text, sensor.unit)]) if text else Record(0, note=line)

    def _block(self, sensor: Sensor, buffer: bytes) -> Parsed:
        """A record of several lines, once the line behind them is complete."""
        last = re.search(rb"(?:^|[\r\n])" + sensor.last.encode() + rb"(?:\r\n|\r|\n)", buffer)
        if last is None:
            reason = f"{_start(buffer)}: no end of a record in {BLOCK_LONGEST} bytes"
            return None if len(buffer) < BLOCK_LONGEST else Rejected(len(buffer), reason)
        lines = [_line_of(line) for line in _LINE_END.split(buffer[: last.start()])]
        readings = sensor.channels([line or "" for line in lines]) if None not in lines else None
        fields = [_Field(channel, value, sensor.unit) for channel, value in readings or ()]
        record = self._record(fields) if fields else "a line that is not of this sensor's example"
        if isinstance(record, Record):
            return record._replace(length=last.end())
        return Rejected(last.end(), f"{_start(buffer)}: {record}")

    def _json(self, body: str) -> Record | str:
        try:
            document = json.loads(body, parse_int=str, parse_float=str, parse_constant=str)
        except (ValueError, RecursionError) as error:
            return f"not JSON: {error}"
        if isinstance(document, list) and not any(isinstance(item, dict | list) for item in document):
            return self._row([_json_text(item) for item in document], has_stamp=False)
        return self._record(list(_leaves(document)))

    def _named_values(self, body: str, keys: Sequence[re.Match[str]]) -> Record | str:
        """Values behind their names; what stands between may also be the first words of the next name."""
        fields, first = [], _SEPARATOR.split(body[: keys[0].start()])[-1]
        for key, following in zip(keys, [*keys[1:], None], strict=True):
            between = body[key.end() : following.start() if following else len(body)].strip()
            if not between and following:  # a word before the names, as in "bed: T=21.5 C"
                first = ""
                continue
            text, *unnamed = _SEPARATOR.split(between)
            if any(_FIELD.match(part.strip()) for part in unnamed):
                return "a number without a name, or a decimal comma: print numbers with a point"
            name = " ".join([*_BEFORE.sub("", first).split(), key[1]])[-_LONGEST_NAME:]
            text, first = _value_and_rest(text, is_last=bool(unnamed) or following is None)
            first = unnamed[-1] if unnamed else first
            fields.append(_Field(name, text))
        return self._record(fields)

    def _row(self, fields: Sequence[str], *, has_stamp: bool) -> Record | str:
        names = self.columns or tuple(f"column {place + 1}" for place in range(len(fields)))
        if has_stamp and 0 < len(names) - len(fields) <= 2:
            names = names[len(names) - len(fields) :]  # those of date and time are not needed
        if len(fields) == len(names) + 1 and not fields[-1]:  # a separator at the end
            fields = fields[:-1]
        if len(fields) != len(names):
            return f"{len(fields)} fields, {len(names)} columns"
        unknown = [field for field in fields if not (_is_value(field) or self.columns)]
        if unknown:
            return f"{unknown[0][:20]!r} is not a number; lines may be {FORMS}"
        return self._record([_Field(name, field) for name, field in zip(names, fields, strict=True)])

    def _record(self, fields: Sequence[_Field]) -> Record | str:
        """A record of at least one field that is a number or is known to mean none."""
        clock = next((field.text for field in fields if field.name == "ms"), "")
        if len(clock) > _LONGEST_CLOCK:
            return f"{clock[:20]!r} is not a time in milliseconds"
        measurements = [field for field in fields if field.name != "ms"]
        if not any(_is_value(field.text) for field in measurements):
            return f"no number in it; lines may be {FORMS}"
        values = [self._value(field) for field in measurements]
        return Record.of(0, _distinct(values), device_time=int(clock) if clock.isdecimal() else NO_COUNTER)

    def _value(self, field: _Field) -> Value:
        match = _FIELD.fullmatch(field.text.strip())
        name, unit_of_name = _name_and_unit(field.name)
        unit_of_name = _unit(field.unit) or unit_of_name or self.unit
        unit_of_value = _unit(match[2] or "") if match else ""
        number = float(match[1]) if match else math.nan
        is_garbled = (
            bool(unit_of_name and unit_of_value) and meaning_of(unit_of_value) is None
        )  # 2x.5 below temp_c
        if is_garbled or not math.isfinite(number) or number in self.no_value:
            return Value(math.nan, unit_of_name, name, Quality.NO_VALUE)
        return Value(number, unit_of_value or unit_of_name, name)

    @property
    def layout(self) -> Layout:
        """For a port."""
        return Layout(self.parse, BLOCK_LONGEST if self.sensor and self.sensor.last else LONGEST)


def _start(buffer: bytes) -> str:
    return repr(buffer[:40])[1:]


def _line_of(raw: bytes) -> str | None:
    """A line as text, or None; of Latin-1 only the letters of units, or any noise would be text."""
    try:
        line = raw.decode("utf-8")
    except UnicodeDecodeError:
        line = raw.decode("latin-1")
        if not {letter for letter in line if not letter.isascii()} <= _NOT_ASCII:
            return None
    line = line.strip("\ufeff \t").replace("\N{MINUS SIGN}", "-")
    return line if line.replace("\t", " ").isprintable() else None


def _split(line: str) -> list[str]:
    """Fields of a line without names; without another separator, spaces part values."""
    if _SEPARATOR.search(line):
        return [field.strip(' "') for field in _SEPARATOR.split(line)]
    words: list[str] = []
    for word in line.split():
        if words and _is_unit(word):
            words[-1] += f" {word}"
        else:
            words.append(word)
    return words if all(map(_is_value, words)) else [line]


def _is_value(text: str) -> bool:
    """True if a field is a number, with or without a unit, or is known to mean that there is none."""
    if _FIELD.fullmatch(text.strip()) or text.lstrip().startswith(("<", ">")):
        return True
    words = text.lower().split()
    if words[1:] and _is_unit(words[-1]):
        del words[-1]
    return _NO_VALUES.fullmatch(re.sub(r"[-*?._/!]", "", "".join(words))) is not None


def _value_and_rest(text: str, *, is_last: bool) -> tuple[str, str]:
    """A value with its unit, and the words behind it that begin the next name."""
    match = _FIELD.match(text)
    if match is None:
        word, _, rest = (text, "", "") if is_last else text.partition(" ")
        return word, rest
    unit, rest = match[2] or "", text[match.end() :]
    is_behind = not unit.isalpha() or not text[match.end(1)].isspace() or unit.lower() in OTHER_UNITS
    if not (is_behind or unit_of(unit) or (is_last and not rest)):
        unit, rest = "", text[match.end(1) :]
    if rest[:1].strip() or (not unit and rest.strip()[:1].isdigit()):  # 12:30, or 12 345
        return text, ""
    return text.removesuffix(rest), rest.strip()


def _leaves(body: Any, before: str = "", depth: int = 1) -> Iterator[_Field]:
    """The values of a JSON object or array, one level down with both names: ``sky.lux``."""
    pairs = body.items() if isinstance(body, dict) else enumerate(body, 1) if isinstance(body, list) else ()
    unit = body.get("unit") if isinstance(body, dict) else ""
    for key, value in pairs:
        text = _json_text(value)
        if isinstance(value, dict | list):
            yield from _leaves(value, f"{before}{key}.", depth - 1) if depth else ()
        elif not isinstance(value, bool) and _is_value(text):  # else a name, such as of the board
            yield _Field(f"{before}{key}", text, unit if isinstance(unit, str) else "")


def _json_text(value: Any) -> str:
    return value if isinstance(value, str) else ""


def _heading(names: Sequence[str], line: str) -> Record | str:
    """A header that names columns; a word alone without a unit is a message."""
    if len(names) > 1 or _name_and_unit(names[0])[1]:
        return Record(0, note=_COLUMNS + ",".join(names))
    return f"lines may be {FORMS}" if re.search(r"\d", line) else Record(0, note=line)


def _distinct(values: Sequence[Value]) -> Iterator[Value]:
    """The values with names of their own: ``Temp``, ``Temp 2``."""
    counts: dict[str, int] = {}
    for value in values:
        counts[value.channel] = count = counts.get(value.channel, 0) + 1
        yield value if count == 1 else value._replace(channel=f"{value.channel} {count}")


def _unit(text: str) -> str:
    """A unit in fieldkit's spelling, if it is a known one."""
    meaning = meaning_of(text)
    return meaning.unit.shown if meaning else text


def _is_unit(text: str) -> bool:
    return meaning_of(text) is not None


def _name_and_unit(name: str) -> tuple[str, str]:
    """A channel's name without a unit in brackets, and the unit that the name states, if any."""
    bare, unit = split_label(name)
    return bare if "(" in name or "[" in name else name, _unit(unit) if _is_unit(unit) else ""


def header(notes: Sequence[str]) -> tuple[str, ...]:
    """The columns that the last header line among a decoder's notes names, empty if there is none."""
    headers = [note.removeprefix(_COLUMNS) for note in notes if note.startswith(_COLUMNS)]
    return tuple(headers[-1].split(",")) if headers else ()


class Text(SerialDriver):
    """Driver of boards that print lines.

    Options: `columns`, `no_value`, `baud` (115200), `unit` (what a line without units means), `sensor` (whose
    library's example the board runs) and those of every meter. The stream takes the columns that have the
    unit of the first value.
    """

    name = "text"
    title = "lines of text from a microcontroller board"
    quantity = "temperature"
    options: tuple[str, ...] = (*meter.OPTIONS, "columns", "no_value", "baud", "unit", "sensor")
    caveat = "any adapter: only its lines decide"
    needs: Mapping[str, Sequence[str]] = {"unit": ("C", "F", "K", "lx", "klx", "W/m2", "m/s")}

    def decode(self, data: bytes, options: Mapping[str, Any]) -> Decoded:
        """Explain bytes; see `fieldkit.drivers.decoding.Decodes`. The header may stand anywhere in them."""
        names = options.get("columns", ())
        with_columns = {**options, "columns": names.split(",") if isinstance(names, str) else names}
        grammar = _grammar(_with_sensor_options(decoding_settings(self.name, with_columns)))
        if not grammar.columns:
            grammar = replace(grammar, columns=header(decode_records(data, grammar.layout).notes))
        return decode_records(data, grammar.layout)

    def open(self, settings: DeviceSettings, clock: Clock) -> meter.Meter:
        """Open the port (the board restarts) and wait for the first line with values.

        Raises `DecodeError` where only comments and headers come for `PREAMBLE_S`.
        """
        settings = _with_sensor_options(settings)
        grammar = _grammar(settings)
        port = open_port(settings, Line(baud(settings, LINE.baud)), clock)
        grammar, first = _first_values(port, grammar, settings, clock)
        unit_shown = _first_unit(first) or first.channels[0].unit
        of_unit = [channel.name for channel in first.channels if channel.unit == unit_shown]
        quantity = _quantity(unit_shown, of_unit[0])
        keys = [name for name in of_unit if _quantity(unit_shown, name) == quantity]
        unit = quantity.units.stored
        info = meter.describe(settings, port, grammar.layout, quantity.name, unit, keys, model="text")
        components = components_named(info.channels) or components_named(keys[: info.shape[0]])
        info = replace(
            info,
            measures=components if unit == POWER.stored else (),
            device_time_unit="ms" if first.device_time != NO_COUNTER else "",
        )
        return meter.Meter(info, port, grammar.layout, clock, keys)


def _first_values(
    port: Port, grammar: Grammar, settings: DeviceSettings, clock: Clock
) -> tuple[Grammar, Record]:
    """The first line with values, and how to read those after it: by the header before it.

    Without a known unit it may be a message of a board that starts: two alike are taken for values. A line
    that was being printed when the port was opened lacks its first channels, so the first of all is not taken
    but from a board that prints rarely.
    """
    within_s, configured_columns, before = max(PREAMBLE_S, 3.0 * settings.every_s), grammar.columns, Record(0)
    is_whole = settings.every_s > meter.SLOW_S
    for _ in time_left(clock, within_s):
        first = _next(port, grammar, settings)
        is_whole = is_whole or port.framer.rejected > 0
        has_value = is_whole and any(Quality.NO_VALUE not in channel.quality for channel in first.channels)
        if has_value and (_first_unit(first) or first.channels == before.channels):
            return grammar, first
        before, is_whole = first, True
        grammar = replace(grammar, columns=configured_columns or header([first.note]) or grammar.columns)
    raise DecodeError(
        f"only comments and headers from {port.path}, the last one {before.note[:60]!r}",
        raw=before.note.encode(),
        place=settings.name,
        fix=f"print lines with values every few seconds: {FORMS}",
    )


def _next(port: Port, grammar: Grammar, settings: DeviceSettings) -> Record:
    try:
        return meter.first_record(port, grammar.layout, settings.name, _HINT, settings.every_s).record
    except DecodeError as error:
        fix = f"print lines such as {FORMS}"
        raise DecodeError(error.problem, raw=error.raw, place=settings.name, fix=fix) from error


def _quantity(unit: str, channel: str) -> Quantity:
    return (meaning_of(unit, channel) or unknown_meaning(unit)).quantity


def _first_unit(record: Record) -> str:
    """The first unit of a record that fieldkit knows, empty for none."""
    return next((channel.unit for channel in record.channels if _is_unit(channel.unit)), "")


def _with_sensor_options(settings: DeviceSettings) -> DeviceSettings:
    """The settings with the options of their sensor, where they give none themselves."""
    name = options.text(settings, "sensor", "", ("", *SENSORS))
    return replace(settings, options={**SENSORS[name].options, **settings.options}) if name else settings


def _grammar(settings: DeviceSettings) -> Grammar:
    columns, no_value = settings.options.get("columns", ()), settings.options.get("no_value", ())
    if not isinstance(columns, list | tuple) or not all(isinstance(name, str) for name in columns):
        raise options.wrong(settings, "columns", columns, 'a list of names such as ["ms", "temp_c"]')
    if not isinstance(no_value, list | tuple) or not all(isinstance(n, int | float) for n in no_value):
        raise options.wrong(settings, "no_value", no_value, "a list of numbers such as [-127, 85]")
    unit = options.text(settings, "unit", "")
    sensor = SENSORS.get(options.text(settings, "sensor", ""))
    return Grammar(tuple(columns), _unit(unit), tuple(float(number) for number in no_value), sensor)
