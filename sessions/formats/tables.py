"""Tables of loggers and spreadsheets (CSV) as text: header, what it states, where the times are.

A header line names the columns, with their units in brackets or in a line below it; lines above it are
skipped. Two makers write their own (their manuals, and public programs that read such files):

- Campbell Scientific (TOA5): a line on the logger, names, units, how each value was made (``Avg``, ``Smp``).
  TOACI1 has the names alone, which end in unit and process as Short Cut gives them (``T109_C_Avg``).
- Onset (HOBOware): a title, then cells like ``Temp, °C (LGR S/N: 1, SEN S/N: 2, LBL: bed)`` and the zone in
  that of the time, ``Date Time, GMT+09:00``.
"""

from __future__ import annotations

import codecs
import csv
import io
import math
import re
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import tzinfo
from functools import lru_cache
from itertools import islice, pairwise, takewhile
from pathlib import Path
from typing import NamedTuple

from fieldkit.disk import unpacked
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.model.quantities import is_unit, short_cut_unit, split_label
from fieldkit.sessions.formats.containers import Contents, is_container, read_contents
from fieldkit.sessions.formats.imported import explained, free_name
from fieldkit.sessions.formats.logger_clock import Keep
from fieldkit.sessions.formats.time_columns import SAMPLE, Kind, cell_of, first_time, time_places, time_text
from fieldkit.sessions.formats.times import is_unix
from fieldkit.sessions.formats.zones import Statement, is_label, statements

_MAX_BYTES = 100_000_000
_UNREADABLE, _SAVE = "cannot be read as a table", "save it as CSV, UTF-8"
_DELIMITERS = ";\t,"

_ZEROS = re.compile("[^\\n]*\0{4,}[^\\n]*")
_SERIAL_MONITOR = re.compile(r"(?m)^(\d\d:\d\d:\d\d\.\d{3}) -> (?=(\w?))")  # Arduino's, with time stamps
_ERASED = re.compile(rb"[^\n]*\xff{8,}\Z")
DEFAULT_ENCODING = "utf-8-sig"
_MARKS = {codecs.BOM_UTF8: DEFAULT_ENCODING, codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}
_NAME_ENCODING = Argument("encoding", "cp1252") + " (Western Windows), cp932 (Japanese), utf-16 or utf-16-le"

SAMPLED, AVERAGED = ("", "Smp"), ("Avg", "WVc")  # WVc: a mean of wind vectors
_PROCESSES = ("Smp", *AVERAGED, "Max", "Min", "Std", "Tot", "Med", "TMx", "TMn", "Cov", "Mom", "Hst", "FFT")
_PROCESS = re.compile(rf"_({'|'.join(_PROCESSES)})(?=$|_\d+$|\(\d+\)$)")
_MOST_ZONES = 3  # a column of more values is of something else
_UNIT_COLUMN = re.compile(
    r"(?i)(?<![a-z])units?(?![a-z])|(?-i:(?<=[a-z])Unit)|einheit|unité|unidad|unità|eenheid|enhet|jednot|uom|単位|单位"
)
_UNIT_LINE = re.compile(r"\bunits?\b\W*(.*\w)", re.IGNORECASE)  # above the header
VALUE = re.compile(r"value|wert|valeur|valor|reading|state|payload|mean|測定値|数值", re.IGNORECASE)
THING = re.compile(
    r"(?i)_?(?:entity|sensor|device|dev|node|station|channel|ch|probe|module|logger|serial|mac|statistic)"
    r"[ _.]?(?:id|ids|name|no|nr|num|number|eui|addr|address)?|[\w.]*[_.](?:id|eui)|id|topic|_?field|table"
    r"|input|_?measurement|metric|parameter|variable|series|quantity|(?:friendly_)?name|addr|address|tag|source"
    r"|host|label|item|signal|datastream|type|no\.?|nr\.?|#|kanal|fühler|messstelle|messgröße|capteur|canal"
    r"|センサー?|(?P<place>point|location|site|place|room|plot|bed|spot|surface|material|sample|position|ort|sonda|测点)"
)
"""Labels of columns that tell the thing of a row; a place by its name, not by a number."""
_TIME_COLUMN = re.compile(r"time|date|zeit|datum|stamp|heure|fecha|hora|data|日|時|时", re.IGNORECASE)
_CAMPBELL = ("TOA5", "TOACI1")
_ONSET_TIME = re.compile(r"[^,]+, ?(GMT|UTC) ?[+\-−]\d\d:?\d\d")
_ONSET = re.compile(r"(?P<name>[^,(]+?)(?:, ?(?P<unit>[^,(]+?))?(?: ?\((?P<more>[^():]+: ?[^()]*)\))?")

_BELOW_TIME = re.compile(r"TS|(?:UTC|GMT|[ymdhsf]|[\W\d_])*", re.IGNORECASE)  # such as yyyy-mm-dd hh:mm:ss

# in round brackets anything may stand, such as a place or a number: short words and signs of units are units
_BRACKETS = re.compile(r"\s*(?:\[\s*(?P<square>[^\[\]]+?)\s*\]|\(\s*(?P<round>[^()]+?)\s*\))\s*$")
_LIKE_A_UNIT = re.compile(r"[A-Za-zµμΩ]{1,4}|[^%°/²³µμΩ^]*[%°/²³µμΩ^].*|volts|knots|degrees|percent|counts")


@dataclass(frozen=True, slots=True)
class LogOptions:
    """Facts that a table does not state itself: zone and format of its times, units, columns, encoding.

    `zone` is of times without one; `time_format` of date and time of day together where they stand in two
    columns; `offset_ns` is added to the times; `keep` decides where the clock stepped back;
    `start` is the moment of 0 of times that count, `date` the day of the first of times of day. Without
    `time_columns` the first that looks like a time is it, without `columns` all others with a unit are read.
    `unit` is of columns that state none; `measures` the component of radiation (``ghi``, ``dni``, ``dhi``) of
    the one column whose name does not give it, or of columns by their names.
    """

    zone: tzinfo | None = None
    time_format: str | None = None
    offset_ns: int = 0
    unit: str = ""
    columns: tuple[str, ...] = ()
    time_columns: tuple[str, ...] = ()
    encoding: str = DEFAULT_ENCODING
    measures: str | Mapping[str, str] = ""
    keep: Keep | None = None
    sheet: str = ""
    start: str | None = None
    date: str | None = None


AS_WRITTEN = LogOptions()


class Row(NamedTuple):
    """A row, and the number of its line in the file, the first being 1."""

    number: int
    cells: list[str]


class Column(NamedTuple):
    """A column as the header states it: name with unit, name, unit, process; ``""`` where it does not.

    `unit_at` is the column with the unit of each row, as in ``Ch1_Value,Ch1_Unit``, or the column itself
    where its cells have units, as ``21.5 °C``; -1 without one.
    """

    head: str
    label: str
    unit: str = ""
    process: str = ""
    unit_at: int = -1


@dataclass(frozen=True, slots=True)
class Table:
    """Columns, rows, and the places of the time: one column, or date, time of day, fraction of the second.

    It is of the file at `path`, whose user gave `options`.
    `has_decimal_commas`: a comma in a number is its decimal point; `stated` is what the file says of the
    zone of its times. Without `has_end` the file ends within its last line. `kind` is what the times are,
    `dates` what lines above say of their start and date, or examples. One that was made of a `long` table has
    the thing of each row by its number, and words `about` them; `units` stand above the header.
    """

    path: Path
    options: LogOptions
    columns: list[Column]
    rows: list[Row]
    time_at: tuple[int, ...]
    has_decimal_commas: bool
    stated: Sequence[Statement] = ()
    has_end: bool = True
    kind: Kind = "moment"
    dates: Mapping[str, str] = field(default_factory=dict)
    long: Table | None = None
    things: Mapping[int, str] = field(default_factory=dict)
    about: str = ""
    units: Sequence[str] = ()
    notes: tuple[str, ...] = ()
    losses: tuple[str, ...] = ()

    @property
    def free(self) -> list[int]:
        """The columns that may hold values: not those of times, units and Campbell's record numbers."""
        units = (column.unit_at for at, column in enumerate(self.columns) if column.unit_at != at)
        others = {*self.time_at, *units}
        return [at for at, column in enumerate(self.columns) if at not in others and column.unit != "RN"]

    def named(self, place: int) -> str:
        """Place of an error: a column of the file."""
        return f"{self.path}, column {self.columns[place].head!r}"

    def has_numbers(self, place: int) -> bool:
        """True if a column has numbers, and not times or those of the rows before their time."""
        cells = [number_at(row.cells, place) for row in self.rows]
        numbers = [number_of(cell) for cell in cells]
        are_in_turn = all(later == earlier + 1.0 for earlier, later in pairwise(numbers))
        is_numbering = are_in_turn and place < min(self.time_at)
        return not (all(map(math.isnan, numbers)) or is_numbering or all(map(is_unix, cells)))

    def time_text(self, row: Row) -> str:
        """The cells of a row's time as one text."""
        labels = [self.columns[place].label for place in self.time_at]
        cells = [cell_of(row.cells, place) for place in self.time_at]
        return time_text(labels, cells, has_format=self.options.time_format is not None)


def read_table(path: Path, options: LogOptions = AS_WRITTEN) -> Table:
    """The table of a file, of the forms above, or in a container such as a workbook. Raises `ConfigError`."""
    time_names, time_format = options.time_columns, options.time_format
    is_packed = is_container(path)
    text, notes = read_contents(path, options.sheet) if is_packed else _text(path, options.encoding)
    with explained(path, _UNREADABLE, _SAVE, csv.Error):
        delimiter = _delimiter(text)
        text = _SERIAL_MONITOR.sub(lambda at: ("time" if at[2].isalpha() else at[1]) + delimiter, text)
        rows = [row for row in _rows(text, delimiter) if any(row.cells)]
    cells = [row.cells for row in rows]
    named_first = _place_of_name(rows, time_names[0]) if time_names else None
    date, first, kind = first_time(cells, named_first, time_format)
    kind = "moment" if len(time_names) > 1 else kind  # a count has one column
    names, below = _header(rows[:first], date)
    if len(names) < 2 or first >= len(rows):
        fix = "keep the header line, with the unit of each column in brackets"
        raise ConfigError("no table with a header line and rows", place=path, fix=fix)
    columns = _columns(names, below, is_campbell=rows[0].cells[0] in _CAMPBELL)
    body = [row for row in rows[first:] if not row.cells[0].startswith("#")]  # comments, annotations
    for row in body:
        refuse_swallowed(path, row.number, row.cells, len(names), delimiter)
    body, losses = _whole(body, names, below, date, text)
    named_at = tuple(place_of(path, columns, name) for name in time_names)
    labels = [column.label for column in columns]
    cells = [row.cells for row in body]
    time_at = named_at or (time_places(path, labels, cells, date) if kind == "moment" else (date,))
    head = [cell_of(cells, place) for cells in (names, *below) for place in time_at]
    others = [Column("", "") if place in time_at else column for place, column in enumerate(columns)]
    stated = statements(head, list(_zone_fields(rows[: first - len(below) - 1], others, body)))
    units = [match[1] for row in rows[:first] if (match := _UNIT_LINE.search(" ".join(row.cells)))]
    has_end, dates = bool(losses) or text.endswith(("\n", "\r")), _dates(rows[:first])
    has_commas = delimiter != ","
    table = Table(path, options, columns, body, time_at, has_commas, stated, has_end, kind, dates)
    return replace(table, columns=_with_unit_columns(table), units=units, notes=notes, losses=losses)


def place_of(path: Path, columns: Sequence[Column], name: str) -> int:
    """Place of the column of that name; raises `ConfigError`."""
    for place, column in enumerate(columns):
        if name in (column.head, column.label):
            return place
    fix = f"name one of its columns: {', '.join(column.head for column in columns)}"
    raise ConfigError(f"no column {name!r}", place=path, fix=fix)


# --- from bytes to rows


def _text(path: Path, encoding: str) -> Contents:
    """The text of a file without lines that a power cut has left as zeros, or an erased flash as ones."""
    with explained(path, _UNREADABLE, _SAVE, OSError, EOFError, zlib.error):
        data = unpacked(path, _MAX_BYTES + 1)
    if len(data) > _MAX_BYTES:
        problem, fix = f"larger than {_MAX_BYTES // 10**6} MB", "split the table into parts"
        raise ConfigError(problem, place=path, fix=fix)
    try:
        stated = _stated_encoding(path, data[:3], encoding)
        # a character that was cut off at the end is none
        text = codecs.getincrementaldecoder(stated)().decode(_ERASED.sub(b"", data))
    except UnicodeDecodeError as error:
        problem = f"not in {error.encoding}: byte {error.object[error.start]:#04x} at {error.start}"
        raise ConfigError(problem, place=path, fix=_NAME_ENCODING) from error
    except LookupError as error:
        place = Argument("encoding", encoding)
        raise ConfigError("no such encoding", place=place, fix=_NAME_ENCODING) from error
    except UnicodeError as error:
        raise ConfigError(f"{_UNREADABLE} ({error})", place=path, fix=_SAVE) from error
    text, count = _ZEROS.subn("", text)
    if "\0" in text:
        raise ConfigError(f"not in {stated}: it has bytes of zero", place=path, fix=_NAME_ENCODING)
    lines = "1 line of zeros, as a power cut leaves" if count == 1 else f"{count} lines with zeros"
    return Contents(text.removeprefix("\ufeff"), (f"{lines}, excluded",) if count else ())


def _stated_encoding(path: Path, start: bytes, given: str) -> str:
    """The encoding given, or that of the mark at the beginning of the file."""
    stated = next((name for mark, name in _MARKS.items() if start.startswith(mark)), given)
    if given != DEFAULT_ENCODING and codecs.lookup(given).name[:6] != codecs.lookup(stated).name[:6]:
        fix = "omit " + Argument("encoding")
        raise ConfigError(f"begins as {stated}, not as {given}", place=path, fix=fix)
    return stated


def refuse_swallowed(path: Path, line: int, cells: Iterable[str], width: int, delimiter: str) -> None:
    """Raise `ConfigError` where a quote that nothing closed has made whole rows part of a cell.

    `cells` are of the row that ends at `line`, of a table `width` columns wide.
    """
    for after in (after for cell in cells for after in cell.splitlines()[1:]):
        if after.count(delimiter) >= max(1, width - 2):  # rows may end before their last cell
            problem = f"a quote opens a cell that goes on to line {line}, over whole rows"
            fix = f"close the quote before the row {after.strip()[:40]!r}, or delete it"
            raise ConfigError(problem, place=path, fix=fix)


def _rows(text: str, delimiter: str) -> Iterator[Row]:
    lines = io.StringIO(text, newline="")  # `str.splitlines` would end lines at U+2028 and its like too
    reader = csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
    return (Row(reader.line_num, [cell.strip() for cell in cells]) for cells in reader)


def _delimiter(text: str) -> str:
    """Separator of the columns: a first line ``sep=;`` states it, else it makes most rows equally long.

    Blanks part columns only where no other mark does.
    """
    stated = re.match(f"sep=([{_DELIMITERS}])\\s", text, re.IGNORECASE)
    if stated:
        return stated[1]
    alike = {mark: _alike(_rows(text, mark)) for mark in _DELIMITERS}
    return max(alike, key=alike.__getitem__) if any(alike.values()) else " "


def _alike(rows: Iterator[Row]) -> int:
    widths = Counter(len(row.cells) for row in islice(rows, SAMPLE))
    return max((count for width, count in widths.items() if width > 1), default=0)


# --- where the times are, and which line is the header


def _place_of_name(rows: Sequence[Row], name: str) -> int | None:
    heads = ((place, cell) for row in rows[:SAMPLE] for place, cell in enumerate(row.cells))
    return next((place for place, cell in heads if name in (cell, split_head(cell)[0])), None)


def _header(above: Sequence[Row], place: int) -> tuple[list[str], list[list[str]]]:
    """The cells of the header, and of the lines of units and processes below it."""
    at = len(above) - 1
    while at > 0 and _is_below_names(above[at].cells, above[at - 1].cells, place):
        at -= 1
    names, before = (above[at].cells if above else []), above[max(at - 1, 0)].cells if above else []
    is_of_units = at > 0 and len(before) <= len(names) and _are_units(before, place)
    return names, [*([before] if is_of_units else []), *(row.cells for row in above[at + 1 :])]


def _are_units(cells: Sequence[str], place: int) -> bool:
    others = [cell for at, cell in enumerate(cells) if cell and at != place]
    return bool(others) and all(map(is_unit, others))


def _is_below_names(cells: Sequence[str], names: Sequence[str], place: int) -> bool:
    width = len([cell for cell in cells if cell])
    is_table = width > 0 and len(cells) > 1 and len([name for name in names if name]) >= max(width, 2)
    others = [cell for at, cell in enumerate(cells) if cell and at != place]
    is_of_units = any(is_unit(cell.strip("[]() ")) for cell in others) and not any(map(is_unit, names))
    is_below_time = is_of_units and _TIME_COLUMN.search(cell_of(names, place))
    return is_table and bool(is_below_time or _BELOW_TIME.fullmatch(cell_of(cells, place)))


def _whole(
    rows: list[Row], names: list[str], below: list[list[str]], place: int, text: str
) -> tuple[list[Row], tuple[str, ...]]:
    """The rows of the first table, without a last one that was cut off; what is left out, in words."""
    for at in range(1, len(rows)):
        if _is_another_header(rows, at, names, below, place):
            numbers = f"rows {rows[at].number} to {rows[-1].number}"
            return rows[:at], (f"{numbers} are another table: import them on their own",)
    if not text.endswith(("\n", "\r")) and len(rows) > 2 and _is_cut([row.cells for row in rows]):
        return rows[:-1], (f"row {rows[-1].number} is cut off, and excluded",)
    return rows, ()


def _is_another_header(
    rows: Sequence[Row], at: int, names: list[str], below: list[list[str]], place: int
) -> bool:
    """True if a row names other columns, or others are its units; the same header again is only no time."""
    cells = rows[at].cells
    if re.search(r"\d\W\d", cell_of(cells, place)) or not any(map(_TIME_COLUMN.search, cells)):
        return False
    if cell_of(cells, place) != cell_of(names, place) and not any(split_head(cell)[1] for cell in cells):
        return False
    after = [row.cells for row in rows[at + 1 : at + 1 + len(below)]]
    units = list(takewhile(lambda cells: not re.search(r"\d", cell_of(cells, place)), after))
    return cells != names or bool(units and units != below)


def _is_cut(rows: Sequence[Sequence[str]]) -> bool:
    """True if the last row has fewer cells than the others, or fewer decimals in the last."""
    *others, last = rows[-SAMPLE:]
    numbers = [re.split("[.,]", cell_of(row, len(last) - 1)) for row in others]
    decimals = {len(parts[-1]) for parts in numbers if len(parts) > 1}
    own = len((re.split("[.,]", last[-1])[1:] or [""])[0])
    return len(last) < min(map(len, others)) or (len(decimals) == 1 and own < decimals.pop())


def _dates(above: Sequence[Row]) -> dict[str, str]:
    """A start and a date, the first that stand above a table; else examples."""
    lines = (" ".join(cell for cell in row.cells if cell[:1].isdigit()) for row in above)
    dated = next((line for line in lines if re.match(r"\d{4}-\d\d-\d\d", line)), "2026-12-11T12:00:00")
    return {"start": dated, "date": dated[:10]}


def _zone_fields(above: Sequence[Row], columns: Sequence[Column], rows: Sequence[Row]) -> Iterator[str]:
    """What lines above the table say of a zone, beside or below the word for it, and columns of it."""
    for row, below in zip(above, [*above[1:], Row(0, [])], strict=False):
        for place, cell in enumerate(row.cells):
            if is_label(cell):
                values = [value for value in row.cells[place + 1 :] if value]
                is_whole = ":" in cell or not values
                yield ", ".join([cell, *values]) if is_whole else f"{cell}: {' '.join(values)}"
                if len(row.cells) == len(below.cells) > 2:
                    yield f"{cell}: {cell_of(below.cells, place)}"
    for place, column in enumerate(columns):
        zones = {cell_of(row.cells, place) for row in rows} if is_label(column.label) else set()
        if len(zones) <= _MOST_ZONES:
            yield from (f"{column.label}: {zone}" for zone in sorted(zones) if re.search("[A-Za-z:]", zone))


# --- what the header states of each column


def split_head(head: str) -> tuple[str, str]:
    """Name and unit of a header's cell: ``T1 [C]``, ``Temp - °C``, ``temp_c``; the unit ``""`` without one.

    A name of one word stays whole: others may be as the unit they end in.
    """
    name, unit = split_label(head)
    if unit:
        return (head if re.fullmatch(r"[\w.]+", head, re.ASCII) else name), unit
    brackets = _BRACKETS.search(head)
    if brackets is None or not head[: brackets.start()]:
        return head, ""
    unit = brackets["square"] or brackets["round"]
    is_glued = head[brackets.start()] == "(" and len(unit) == 1  # Gb(n)
    is_stated = brackets["square"] or (_LIKE_A_UNIT.fullmatch(unit) and not is_glued)
    return (head[: brackets.start()], unit) if is_stated and not unit.isdigit() else (head, "")


_WITH_UNIT = re.compile(r"([+\-−]?\s*\d[\d.,'’\s]*(?:[eE][+-]?\d+)?)([^\W\d_].*|[°º˚%℃℉*(\[?'].*)", re.DOTALL)


@lru_cache(1 << 16)
def split_cell(cell: str) -> tuple[str, str]:
    """Number and unit of a cell, as ``21.5 °C``; the unit ``""`` where it has none that is known."""
    match = _WITH_UNIT.fullmatch(cell)
    return (match[1].strip(), match[2].strip()) if match and is_unit(match[2].strip()) else (cell, "")


# with the other mark behind them, or where there are two, marks can only be of thousands
BY_COMMAS = re.compile(r"[+-]?\d{1,3}((,\d{3})+\.\d*|(,\d{3}){2,})")
_BY_POINTS = re.compile(r"[+-]?\d{1,3}((\.\d{3})+,\d*|(\.\d{3}){2,})")
_GROUPED = re.compile(r"[+-]?\d{1,3}([ \u00a0\u2009\u202f'’´`]\d{3})+([.,]\d*)?")


@lru_cache(1 << 16)
def number_text(cell: str) -> str:
    """A cell without its unit, marks of thousands that are no decimals, and the blank in ``+ 20.081``."""
    text = split_cell(cell)[0].replace("−", "-")
    text = text[0] + text[1:].lstrip() if text.startswith(("+", "-")) else text
    return re.sub(r"[^\d.+-]", "", text.replace(",", ".")) if _GROUPED.fullmatch(text) else text


def number_at(cells: Sequence[str], place: int) -> str:
    """The `number_text` of a row's cell."""
    return number_text(cell_of(cells, place))


def number_of(text: str) -> float:
    """The number of a cell's `number_text`, NaN where it has none."""
    try:
        if BY_COMMAS.fullmatch(text):
            return float(text.replace(",", ""))
        if _BY_POINTS.fullmatch(text):
            text = text.replace(".", "")
        return float(text.replace(",", "."))
    except ValueError:
        return math.nan


def written_unit(cells: Sequence[str], place: int, unit_at: int) -> str:
    """The unit of a row's value, in its cell or in a column of units; "" without one."""
    if unit_at < 0:
        return ""
    return split_cell(cell_of(cells, place))[1] if unit_at == place else cell_of(cells, unit_at)


def _columns(names: list[str], below: Sequence[list[str]], *, is_campbell: bool) -> list[Column]:
    processes = next((row for row in below if _has_processes(row)), [])
    units = next((row for row in below if not _has_processes(row)), [])
    columns: list[Column] = []
    for place, name in enumerate(_of_onset(names)):
        letters = {other[-1:] for other in names if other[:-1] == name[:-1]}
        is_letter = name[-1:].isascii() and name[-1:].isalpha() and split_head(name)[1] == name[-1:]
        if is_letter and not letters <= set("CFKcfk"):  # T_a, T_b, T_c
            columns.append(Column(name, name, cell_of(units, place).strip("[]() ")))
            continue
        column = _column(name, cell_of(units, place), cell_of(processes, place), is_campbell=is_campbell)
        label = free_name(column.label, [other.label for other in columns], "{} {}")
        columns.append(column._replace(label=label))
    return columns


def _with_unit_columns(table: Table) -> list[Column]:
    """The columns with the places of their units: the column's own, or one of units beside it."""
    paired, units = list(table.columns), dict[int, str]()
    for place, column in enumerate(table.columns):
        cells = {cell_of(row.cells, place) for row in table.rows} - {"", column.head, column.label}
        if place in table.time_at or not cells:
            continue
        if any(split_cell(cell)[1] for cell in cells):
            paired[place] = column._replace(unit_at=place)
        elif not any(cell[:1].isdigit() for cell in cells) and (
            _UNIT_COLUMN.search(column.label) or (all(map(is_unit, cells)) and max(map(len, cells)) > 1)
        ):
            units[place] = column.label
    values = [at for at in table.free if at not in units and table.has_numbers(at)]
    for unit_at, label in units.items():
        if values:
            nearest = min(values, key=lambda at: _distance(paired[at].label, label, at - unit_at))
            paired[nearest] = paired[nearest]._replace(unit_at=unit_at)
            values.remove(nearest)
    return paired


def _distance(label: str, of_units: str, places: int) -> tuple[bool, bool, int, bool, bool]:
    """How far a column is from one of units: by the beginning of their names, places between, its name."""
    stem, is_thing = _UNIT_COLUMN.sub("", of_units).strip("_ "), THING.fullmatch(label) is not None
    return stem not in label, is_thing, abs(places), not VALUE.search(label), places > 0


def _has_processes(cells: Sequence[str]) -> bool:
    return not set(_PROCESSES).isdisjoint(cells)


def _column(name: str, unit: str, process: str, *, is_campbell: bool) -> Column:
    label, own_unit = split_head(name)
    if is_campbell and not process and (match := _PROCESS.search(name)):
        process = match[1]
    unit = unit.strip("[]() ") or own_unit or (short_cut_unit(_PROCESS.sub("", name)) if is_campbell else "")
    return Column(name if unit == own_unit else f"{label} [{unit}]", label, unit, process)


def _of_onset(names: list[str]) -> list[str]:
    """HOBOware's headers, in any language, as ``name [unit]``: a sensor's label, or quantity and number."""
    parts = [_parts(name) for name in names]
    if not any(_ONSET_TIME.fullmatch(name) for name in names) and not any(serial for _, _, serial in parts):
        return names
    count = Counter(name for name, _, _ in parts)
    return [
        (f"{name} {serial}" if count[name] > 1 and serial else name) + (f" [{unit}]" if unit else "")
        for name, unit, serial in parts
    ]


def _parts(cell: str) -> tuple[str, str, str]:
    """Name, unit and serial number of the sensor, as far as the cell of a header has them."""
    match = _ONSET.fullmatch(cell)
    if match is None or _ONSET_TIME.fullmatch(cell):
        return cell, "", ""
    values = re.findall(r": ?([^,]+)", match["more"] or "")  # serial numbers of logger and sensor, the label
    serials = [value for value in values if re.fullmatch(r"\d[\w-]*", value)]
    label = next((value.strip() for value in values[1:] if value not in serials), match["name"])
    return label, match["unit"] or "", serials[-1] if serials else ""
