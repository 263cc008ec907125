r"""Lines of text from a microcontroller board (Arduino, ESP32, ...).

There is no standard; this is fieldkit's. A line ends with LF, CR LF or CR and is one of

* names with values and units, separated by commas, semicolons, tabs or spaces: ``T1=21.56 C, lux=98760 lx``,
  ``Light: 54612.5 lx``, ``Temp(C): 23.1``
* values separated by commas, semicolons, tabs or spaces, named by a header line (``ms,temp_c,lux``) or by
  the option `columns`; a name may end in its unit: ``_c``, ``_f``, ``_k``, ``_lx``, ``_w_m2``, ``(C)``
* names with values and known units, without a sign between: ``Ambient 24.1 C, Object 31.5 C``
* a JSON object or array, also behind words: ``{"temp_c": 21.56, "sky": {"lux": 98760}}`` gives ``temp_c`` and
  ``sky.lux``; or a tuple, ``(21.56, 98760)``
* a state in a log of ESPHome, whose other lines are notes: ``[D][sensor:093]: 'Bed': Sending state 21.5 °C``
* a variable of Teleplot with one value: ``>T1:21.56``, ``>T1:1627551892437:21.56§C``
* a comment, beginning with ``#``

A time at the beginning of a line is skipped. A decimal comma is read where nothing else can be meant:
``21,5;98760,0``, ``T=21,5 C``. Any other line (``LUX 980.2`` without a sign between name and
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
from fieldkit.drivers.framing import Line, Port, Stamped
from fieldkit.drivers.meters import meter
from fieldkit.drivers.meters.board_sensors import SENSORS, Sensor
from fieldkit.drivers.options import decoding_settings
from fieldkit.drivers.ports import Probe, SerialDriver, baud, open_port
from fieldkit.model import quantities
from fieldkit.model.channels import components_named
from fieldkit.model.clock import Clock, time_left
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import ConfigError, DecodeError
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
    r"(?<![^\s,;|])((?:[^\W\d]|[(\[%*°º])[^\s=:,;|]*|[^\W\d][^\s=:,;|]* \d+(?=\s*=|:\s))\s*[=:](?!//)"
)
_NAME = re.compile(r"[^\W\d][\w .*°%µ²/^()\[\]-]{0,31}")
_NAMED = re.compile(rf"([^\W\d].*?)\s+{_FIELD.pattern}")
_COMMA = re.compile(r"(?<![\w.,])([+-]?\d+),(\d+)(?![\d.,])")
_COLOUR = re.compile(rb"\x1b\[[\d;]*m")
_LOG = re.compile(r"(?:\[[\d:.]+\])?\[[A-Z]+\]\[[\w.]+(?::\w+)?\]:\s*(.*)")
_STATE = re.compile(
    r"'(.+)'(?:: Sending state| >>) (\S+)(?: (?!with \d)(.+?))?(?: with \d+ decimals of accuracy)?"
)
_VARIABLE = re.compile(r">([^\W\d][^:|§]*):(?:\d{10,}:)?([^:;|§]+)(?:§([^|]*))?(?:\|.*)?")
_SEPARATOR = re.compile(r"[,;|\t]")
_LINE_END = re.compile(rb"\r\n|\r|\n")
_DAY = r"(?:\d{4}[-/.]\d\d?[-/.]\d\d?|\d\d?[-/.]\d\d?[-/.]\d{4})"
_TIME = r"\d\d?:\d\d(?::\d\d(?:\.\d+)?)?(?:Z|[+-]\d\d:\d\d| ?[AP]M\b)?"
_STAMP = re.compile(rf"[\[(]?(?:{_DAY}(?:[T ,;\t]\s*{_TIME})?|{_TIME})[\])]?\s*(?:[-=]>|[,;|]|[:-]\s)?\s*")
_NOT_ASCII = frozenset("°ºµ²³§")  # what a board writes in Latin-1
_NO_VALUES = re.compile(
    "|nan?|inf(inity)?|nul+|none|nc|[o0]l|ov(f|l|er(flow|range|load)?)|open|short|err(or)?|fail(ed)?|fault"
    "|invalid|disconnected|missing|no(data|value)"
)
_SERIAL = re.compile(r"(?=.*[A-F])[0-9A-F]{8,}")  # 0316A27E1AFF is no number with a unit
_COLUMNS = "columns "
_LONGEST_NAME = 32
_IMAGE_ROW = 16  # of an MLX90641, the narrowest
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
        if (log := _LOG.fullmatch(line)) or re.match(r">[^\W\d]", line):
            state = _STATE.fullmatch(log[1]) if log else _VARIABLE.fullmatch(line)
            is_value = state is not None and _is_value(state[2])
            return self._record([_Field(*state.groups(""))]) if state and is_value else Record(0, note=line)
        stamp = _STAMP.match(line)
        body = line[stamp.end() :] if stamp else line
        if document := re.search(r"^[{[].*|\{.*\}$", body):
            return self._json(document[0])
        if body.startswith("(") and body.endswith(")"):
            body = body[1:-1].rstrip(",")
        body, reason = self._with_points(body)
        if reason:
            return reason
        keys = list(_KEY.finditer(body))
        if keys:
            return self._named_values(body, keys)
        if "," in body and (";" in body or "\t" in body):
            return "two separators, or decimal commas: print numbers with a point"
        fields = _split(body)
        named = [match for match in map(_NAMED.fullmatch, fields) if match and _is_name(match[1])]
        if len(named) == len(fields) and all(_is_unit(match[3] or "") for match in named):
            return self._record([_Field(match[1], match[2], match[3]) for match in named])
        names = [field for field in fields if field]
        if names and not any(map(_is_value, names)) and all(map(_is_name, names)):
            return _heading(names, line)
        if len(named) == len(fields):
            return f"neither a sign between name and number nor a known unit; lines may be {FORMS}"
        return self._row(fields, has_stamp=stamp is not None)

    def _with_points(self, body: str) -> tuple[str, str]:
        """A line with points for decimal commas, and why they may be something else, empty if they cannot."""
        numbers = _COMMA.findall(body)
        if not numbers or len(numbers) < body.count(","):
            return body, ""
        pointed = _COMMA.sub(r"\1.\2", body)
        if not re.search(r"[;\t=:]|\d\s+[+-]?\d", pointed) and len(self.columns) != 1:
            two = "one number with a decimal comma or two columns: print a point, or a header above"
            return body, "" if self.columns else two
        if all(len(decimals) == 3 and 0 < len(whole.lstrip("+-0")) < 4 for whole, decimals in numbers):
            return body, "a decimal comma or thousands: print numbers with a point"
        return pointed, ""

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
        if not self.columns and len(fields) >= _IMAGE_ROW:
            return "many numbers without names; rows of an image are read by the driver mlx90640"
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
        is_garbled = unit_of_name and unit_of_value and not _is_unit(unit_of_value)  # 2x.5 below temp_c
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
    raw = _COLOUR.sub(b"", raw)
    try:
        line = raw.decode("utf-8")
    except UnicodeDecodeError:
        line = raw.decode("latin-1")
        if not {letter for letter in line if not letter.isascii()} <= _NOT_ASCII:
            return None
    line = line.strip("\ufeff \t").replace("\N{MINUS SIGN}", "-")
    return line if line.replace("\t", " ").isprintable() else None


def _is_name(text: str) -> bool:
    """True for the name of a column, False for one with a number behind it (``Ambient 24.1``)."""
    return _NAME.fullmatch(text) is not None and not re.search(r"\d\.\d|\s-\d", text)


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
    is_behind = (
        not unit.isalpha() or not text[match.end(1)].isspace() or unit.lower() in quantities.OTHER_UNITS
    )
    if not (is_behind or quantities.unit_of(unit) or (is_last and not rest)):
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
        elif not isinstance(value, bool) and _is_value(text) and not _SERIAL.fullmatch(text):  # else a name
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
    meaning = quantities.meaning_of(text)
    return meaning.unit.shown if meaning else text


def _is_unit(text: str) -> bool:
    return quantities.meaning_of(text) is not None


def _name_and_unit(name: str) -> tuple[str, str]:
    """A channel's name without a unit in brackets, and the unit that the name states, if any."""
    bare, unit = quantities.split_label(name)
    return bare if "(" in name or "[" in name else name, _unit(unit) if _is_unit(unit) else ""


def header(notes: Sequence[str]) -> tuple[str, ...]:
    """The columns that the last header line among a decoder's notes names, empty if there is none."""
    headers = [note.removeprefix(_COLUMNS) for note in notes if note.startswith(_COLUMNS)]
    return tuple(headers[-1].split(",")) if headers else ()


class Text(SerialDriver):
    """Driver of boards that print lines.

    Options: `columns`, `no_value`, `baud` (115200), `unit` (what a line without units means), `sensor` (whose
    library's example the board runs) and those of every meter. The stream takes the columns that have the
    unit of the first value; its setting `not_recorded` names the others.
    """

    name = "text"
    title = "lines of text from a microcontroller board"
    quantity = "temperature"
    options: tuple[str, ...] = (*meter.OPTIONS, "columns", "no_value", "baud", "unit", "sensor")
    probes = (
        *(Probe(Line(it.options["baud"]), options={"sensor": name}) for name, it in SENSORS.items()),
        Probe(LINE),
    )
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
        others = ", ".join(channel.name for channel in first.channels if channel.name not in keys)
        info = replace(
            info,
            measures=components if unit == quantities.POWER.stored else (),
            device_time_unit="ms" if first.device_time != NO_COUNTER else "",
            settings={**info.settings, "not_recorded": others} if others else info.settings,
        )
        return meter.Meter(info, port, grammar.layout, clock, keys)


def _first_values(
    port: Port, grammar: Grammar, settings: DeviceSettings, clock: Clock
) -> tuple[Grammar, Record]:
    """The lines with values that a board prints in turn, as one record, and how to read those after it.

    What comes before the first line that is repeated may be messages of a board that starts, or a line that
    was being printed when the port was opened and lacks its first channels; so the first of all is not taken
    but from a board that prints rarely.
    """
    within_s, configured_columns = max(PREAMBLE_S, 3.0 * settings.every_s), grammar.columns
    lines: list[Record] = []
    raw, last = b"", Record(0)
    is_whole = is_slow = settings.every_s > meter.SLOW_S
    for _ in time_left(clock, within_s):
        stamped = _next(port, grammar, settings)
        raw, last = raw + stamped.raw, stamped.record
        is_whole = is_whole or port.framer.rejected > 0
        if is_whole and any(Quality.NO_VALUE not in channel.quality for channel in last.channels):
            names = {channel.name for channel in last.channels}
            turn = [names == {channel.name for channel in line.channels} for line in lines]
            lines.append(last)
            if any(turn) or (is_slow and _first_unit(last)):
                joined = _joined(lines[turn.index(True) : -1] if any(turn) else [last])
                if not _first_unit(joined) and (name := sensor_of(raw)):
                    example = f"the example for {name} prints no units"
                    raise ConfigError(example, place=settings.name, fix=f'set options.sensor = "{name}"')
                return grammar, joined
        is_whole = True
        grammar = replace(grammar, columns=configured_columns or header([last.note]) or grammar.columns)
    if lines and _first_unit(joined := _joined(lines)):
        return grammar, joined
    raise DecodeError(
        f"only comments and headers from {port.path}, the last one {last.note[:60]!r}",
        raw=last.note.encode(),
        place=settings.name,
        fix=f"print lines with values every few seconds: {FORMS}",
    )


def _joined(lines: Sequence[Record]) -> Record:
    """Lines as one record: each channel as it was first."""
    values = {value.channel: value for line in reversed(lines) for value in reversed(line.values)}
    return Record.of(0, reversed(values.values()), device_time=lines[0].device_time)


def _next(port: Port, grammar: Grammar, settings: DeviceSettings) -> Stamped:
    try:
        return meter.first_record(port, grammar.layout, settings.name, _HINT, settings.every_s)
    except DecodeError as error:
        name = sensor_of(error.raw)
        fix = f'set options.sensor = "{name}" to read them' if name else f"print lines such as {FORMS}"
        raise DecodeError(error.problem, raw=error.raw, place=settings.name, fix=fix) from error


def sensor_of(lines: bytes) -> str:
    """The sensor whose example prints these lines, by most of them; empty for none."""
    decoded = {name: decode_records(lines, Grammar(sensor=sensor).layout) for name, sensor in SENSORS.items()}
    name = min(decoded, key=lambda name: (decoded[name].refused, -len(decoded[name].values)))
    return name if decoded[name].values and 2 * decoded[name].refused < len(lines) else ""


def _quantity(unit: str, channel: str) -> quantities.Quantity:
    return (quantities.meaning_of(unit, channel) or quantities.unknown_meaning(unit)).quantity


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
