"""Tables of loggers and spreadsheets (CSV) as streams: thermometers, light, anything with a time and numbers.

Zone and clock offset of the logger are given by the user, never guessed; the unit stands in
the column's header (``T1 [C]``, ``lux (lx)``) or is given.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import timedelta, timezone, tzinfo
from itertools import chain
from pathlib import Path
from typing import NamedTuple

from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError
from fieldkit.model.radiation import UNIT, how_to_state, named
from fieldkit.model.samples import Reading, Severity
from fieldkit.model.units import CELSIUS_ZERO_K, FAHRENHEIT_TO_K, FOOT2_M2
from fieldkit.sessions.formats.imported import ImportedRecording, parse_times_ns, plausible_ns, usual_rate_hz

_TEMPERATURE, _LIGHT, _POWER = ("K", "temperature"), ("lx", "illuminance"), ("W m-2", "irradiance")
_SPEED = ("m s-1", "speed")

_UNITS = {  # as they are written, in small letters: the stream's, what to add, what to divide the sum by
    **dict.fromkeys(("c", "°c", "degc", "deg c", "celsius"), (*_TEMPERATURE, CELSIUS_ZERO_K, 1.0)),
    **dict.fromkeys(("f", "°f", "degf", "deg f", "fahrenheit"), (*_TEMPERATURE, *FAHRENHEIT_TO_K)),
    **dict.fromkeys(("k", "kelvin"), (*_TEMPERATURE, 0.0, 1.0)),
    **dict.fromkeys(("lx", "lux"), (*_LIGHT, 0.0, 1.0)),
    **dict.fromkeys(("klx", "klux", "kilolux"), (*_LIGHT, 0.0, 1e-3)),
    **dict.fromkeys(("fc", "ftc", "foot-candle", "foot-candles"), (*_LIGHT, 0.0, FOOT2_M2)),
    **dict.fromkeys(("w m-2", "w/m2", "w/m²", "w/m^2"), (*_POWER, 0.0, 1.0)),
    **dict.fromkeys(("m/s", "m s-1", "meters/second"), (*_SPEED, 0.0, 1.0)),
    **dict.fromkeys(("kw m-2", "kw/m2", "kw/m²", "kw/m^2"), (*_POWER, 0.0, 1e-3)),
}

_KNOWN = "C, F, K, lx, klx, fc, W/m2, kW/m2, m/s"
_NO_VALUE = {-999.0, -999.9, -9999.0, -9999.9}
_TOO_HOT = {9999.0, 9999.9}  # no value of a temperature, but a light may have it
_WITH_COMMA = re.compile(r"[+-]?\d+(,\d+)+(\.\d*)?")

# with the other mark behind them, or where there are two, marks can only be of thousands
_BY_COMMAS = re.compile(r"[+-]?\d{1,3}((,\d{3})+\.\d*|(,\d{3}){2,})")

_BY_POINTS = re.compile(r"[+-]?\d{1,3}((\.\d{3})+,\d*|(\.\d{3}){2,})")

_ANY_POINT = re.compile(r"[+-]?[1-9]\d{0,2}\.\d{3}")  # 12.345 may be twelve, or twelve thousand

_DECIMAL_POINT = re.compile(r"[+-]?\d*\.\d*([eE][+-]?\d+)?")

_DATE_DIGITS = 8  # 20260512; what has more has a time of day, or counts seconds

_CLOCK = re.compile(r"\d{1,2}:\d{2}(:\d{2}([.,]\d+)?)?( ?[AP]M)?", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class LogColumns:
    """Which columns count: where empty, the first for `time`, all others with a unit for `values`."""

    time: str = ""
    values: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class LogOptions:
    """What a table does not give itself: zone and format of its times, units, columns, encoding.

    `zone` is of times without one, where the table does not give it either; `time_format` of date and
    time of day together where they stand in two columns; `offset_ns` is added to the times. `unit` is of
    columns whose header has none; `measures` the component of radiation (``ghi``, ``dni``, ``dhi``), where
    the column names do not give it.
    """

    zone: tzinfo | None = None
    time_format: str | None = None
    offset_ns: int = 0
    unit: str = ""
    columns: LogColumns = LogColumns()
    encoding: str = "utf-8-sig"
    measures: str = ""


AS_WRITTEN = LogOptions()


def read_log(path: Path, name: str, options: LogOptions = AS_WRITTEN) -> ImportedRecording:
    """Read a logger's table: one stream for each quantity in it.

    Parameters
    ----------
    path : Path
        The table, with one header line; those of Campbell (TOA5) and HOBOware are recognised.
    name : str
        Name of the stream, or of the streams with their quantity behind it.
    options : LogOptions
        What the table does not give; by default the time and every column with a known unit are read.

    Returns
    -------
    ImportedRecording
        Readings in order of time; cells without a number are NaN.

    Raises
    ------
    ConfigError
        The table is ambiguous or cannot be read; the message has what was found.
    """
    table, unit = read_table(path, options.encoding), options.unit
    head, rows = table.head, table.rows
    time_at = _place(path, head, options.columns.time) if options.columns.time else table.time_at
    stamps, behind = _stamps(path, rows, time_at)
    others = [place for place in range(len(head)) if place not in range(time_at, behind)]
    named_places = [_place(path, head, one) for one in options.columns.values]
    places = named_places or _with_units(path, head, others, unit)
    read = [_column(path, place, head[place], unit) for place in places]
    refuse = _refuse_points if table.has_decimal_commas else _refuse_commas
    refuse(path, head, rows, places)
    times_ns = _times_ns(stamps, options.zone or table.zone, options)
    rate_hz = usual_rate_hz(sorted(times_ns))
    infos = _infos(name, read, options.measures, rate_hz)
    readings = [
        _reading(info, time_ns, row, [column for column in read if column.quantity == info.quantity])
        for info in infos
        for time_ns, row in zip(times_ns, rows, strict=True)
    ]
    ordered = sorted(readings, key=lambda reading: reading.time_ns)
    applied = f", clock offset {options.offset_ns / 1e9:+g} s applied" if options.offset_ns else ""
    note = f"{path.name}: {len(rows)} rows{applied}"
    unknown = [] if named_places else [head[at] for at in others if at not in places and _unit(head[at])]
    warnings = [
        *_warnings(*_without_value(rows, read), unknown, rate_hz if table.averages else 0.0),
        *chain.from_iterable(map(_unmeasured, infos)),
    ]
    return ImportedRecording(infos, ordered, ((Severity.INFO, note), *warnings))


def _times_ns(stamps: Sequence[str], zone: tzinfo | None, options: LogOptions) -> list[int]:
    stamped = parse_times_ns(stamps, zone, options.time_format)
    return [plausible_ns(stamp_ns + options.offset_ns) for stamp_ns in stamped]


class _Column(NamedTuple):
    """A column of a table that counts: its place and label, its stream's unit, and the way there."""

    place: int
    label: str
    unit: str
    quantity: str
    add: float
    by: float


def _column(path: Path, place: int, head: str, unit: str) -> _Column:
    """The entry of `_UNITS` for a column; raises `ConfigError`."""
    written = unit or _unit(head)
    meaning = _UNITS.get(written.lower())
    if meaning is None:
        raise ConfigError(f"{path}: column {head!r} has the unit {written!r}", fix=f"--unit of {_KNOWN}")
    return _Column(place, _label(head), *meaning)


def _infos(name: str, columns: Sequence[_Column], measures: str, rate_hz: float) -> tuple[StreamInfo, ...]:
    """A stream for each quantity, in the order of the columns."""
    quantities = list(dict.fromkeys(column.quantity for column in columns))
    return tuple(
        _info(
            name if len(quantities) == 1 else f"{name}-{quantity}",
            [column for column in columns if column.quantity == quantity], measures, rate_hz,
        )
        for quantity in quantities
    )  # fmt: skip


def _info(name: str, columns: Sequence[_Column], measures: str, rate_hz: float) -> StreamInfo:
    labels, first = tuple(column.label for column in columns), columns[0]
    components = ((measures,) * len(labels) if measures else named(labels)) if first.unit == UNIT else ()
    return StreamInfo(
        name, first.quantity, first.unit, (len(labels),), channels=labels, measures=components,
        rate_hz=rate_hz, driver="import", raw_bytes=255,
    )  # fmt: skip


def _reading(info: StreamInfo, time_ns: int, row: Sequence[str], columns: Sequence[_Column]) -> Reading:
    values = tuple(
        (_number(_cell(row, column.place), column.quantity) + column.add) / column.by for column in columns
    )
    return Reading(info.name, time_ns, time_ns, values, ",".join(row).encode()[:255])


def _without_value(rows: Sequence[Sequence[str]], columns: Sequence[_Column]) -> tuple[int, list[str]]:
    """How many cells stand for no value, and those that are not numbers at all."""
    cells = [(cell, one.quantity) for row in rows for one in columns if (cell := _cell(row, one.place))]
    missing = sum(_stands_for_none(_as_number(cell), quantity) for cell, quantity in cells)
    return missing, [cell for cell, _ in cells if math.isnan(_as_number(cell)) and cell.lower() != "nan"]


def _place(path: Path, head: Sequence[str], name: str) -> int:
    for place, cell in enumerate(head):
        if name in (cell, _label(cell)):
            return place
    raise ConfigError(f"{path} has no column {name!r}", fix=f"it has: {', '.join(head)}")


def _stamps(path: Path, rows: Sequence[Sequence[str]], time_at: int) -> tuple[list[str], int]:
    """The time of each row as text, and the first column behind it; raises `ConfigError`."""
    stamps, behind = [_cell(row, time_at) for row in rows], time_at + 1
    if any(":" in stamp or sum(map(str.isdigit, stamp)) > _DATE_DIGITS for stamp in stamps):
        return stamps, behind
    clocks = [_cell(row, behind) for row in rows]
    if all(map(_CLOCK.fullmatch, clocks)):
        return [f"{date} {clock}" for date, clock in zip(stamps, clocks, strict=True)], behind + 1
    if len(set(stamps)) < len(stamps):  # all of them would be put at midnight
        raise ConfigError(
            f"{path}: several rows have the date {Counter(stamps).most_common(1)[0][0]!r} and no time of day",
            fix="put the time of day into the column after the date, like 15:30:46",
        )
    return stamps, behind


def _with_units(path: Path, head: Sequence[str], others: Sequence[int], unit: str) -> list[int]:
    found = list(others) if unit else [place for place in others if _unit(head[place]).lower() in _UNITS]
    if not found:
        raise ConfigError(f"{path}: no column has a unit", fix='--unit C, or headers like "T1 [C]"')
    return found


def _refuse_commas(
    path: Path, head: Sequence[str], rows: Sequence[Sequence[str]], places: Sequence[int]
) -> None:
    """Where commas part the columns, one in a number may be of thousands or of decimals: not guessed."""
    for row in rows:
        for place in places:
            cell = _cell(row, place)
            if _WITH_COMMA.fullmatch(cell) and not _BY_COMMAS.fullmatch(cell):
                raise ConfigError(
                    f"{path}: {cell!r} in column {head[place]!r} has a comma, of thousands or of decimals",
                    fix="export it with points as decimals and without separators of thousands",
                )


def _refuse_points(
    path: Path, head: Sequence[str], rows: Sequence[Sequence[str]], places: Sequence[int]
) -> None:
    """Where commas do not part the columns, a point may be of thousands: not guessed.

    It is of decimals if other numbers show that it must be, and none has a comma.
    """
    cells = [(_cell(row, place), head[place]) for row in rows for place in places]
    doubtful = next((found for found in cells if _ANY_POINT.fullmatch(found[0])), None)
    if doubtful is None:
        return
    has_commas = any("," in cell for cell, _ in cells)
    if has_commas or not any(_DECIMAL_POINT.fullmatch(c) and not _ANY_POINT.fullmatch(c) for c, _ in cells):
        raise ConfigError(
            f"{path}: {doubtful[0]!r} in column {doubtful[1]!r} has a point, of thousands or of decimals",
            fix="export it with commas between the columns and points as decimals",
        )


def _warnings(
    missing: int, words: Sequence[str], unknown: Sequence[str], means_hz: float
) -> Iterator[tuple[Severity, str]]:
    """What is reported of cells without a value, columns of unknown units, and means stamped late."""
    if missing:
        yield Severity.WARNING, f"{missing} cells stand for no value (like -9999 or inf)"
    if words:
        yield (
            Severity.WARNING,
            f"{len(words)} cells are not numbers and have no value, such as {words[0][:20]!r}",
        )
    if unknown:
        yield Severity.WARNING, f"excluded for their unit: {', '.join(unknown)}; known units: {_KNOWN}"
    if means_hz > 0:
        half_s = 0.5 / means_hz
        note = "means are stamped at their end; if no clock is wrong, import them with"
        yield Severity.WARNING, f"{note} --offset -{half_s:g}s"


def _unmeasured(info: StreamInfo) -> Iterator[tuple[Severity, str]]:
    if info.unit == UNIT and not info.measures:
        note = f"what {', '.join(info.channels)} measures is not known, so slopes cannot use it"
        yield Severity.WARNING, f"{note}: import it with --measures ghi, or {how_to_state(info.name)}"


def _unit(cell: str) -> str:
    found = re.search(r"[\[(]\s*([^\])]+?)\s*[\])]\s*$", cell)
    return found[1] if found else ""


def _label(cell: str) -> str:
    return re.sub(r"\s*[\[(][^\])]*[\])]\s*$", "", cell) or cell


def _cell(row: Sequence[str], place: int) -> str:
    return row[place].strip() if place < len(row) else ""


def _number(cell: str, quantity: str) -> float:
    """The number of a cell, NaN where it has none or one that stands for none."""
    number = _as_number(cell)
    return float("nan") if _stands_for_none(number, quantity) else number


def _as_number(cell: str) -> float:
    try:
        if _BY_COMMAS.fullmatch(cell):
            return float(cell.replace(",", ""))
        if _BY_POINTS.fullmatch(cell):
            cell = cell.replace(".", "")
        return float(cell.replace(",", "."))
    except ValueError:
        return float("nan")


def _stands_for_none(number: float, quantity: str) -> bool:
    return math.isinf(number) or number in (_NO_VALUE | (_TOO_HOT if quantity == "temperature" else set()))


# Tables have one header line with the unit of a column in brackets. Two makers write their own
# (their manuals, and public programs that read such files):
#
# - Campbell Scientific (TOA5): a line on the logger, names, units, how each value was made (``Avg``,
#   ``Smp``).
# - Onset (HOBOware): a title, then cells like ``Temp, °C (LGR S/N: 1, SEN S/N: 2, LBL: bed)`` and the zone in
#   that of the time, ``Date Time, GMT+09:00``.
_MAX_BYTES = 100_000_000
_TOA5_LINES = 4
_GMT = re.compile(r"\bGMT ?([+-])(\d{2}):?(\d{2})\b")

_HOBO = re.compile(r"(?P<name>[^,(]+?)(?:, (?P<unit>[^,(]+?))?(?: \((?P<more>(?:LGR|SEN|LBL).*)\))?")


@dataclass(frozen=True, slots=True)
class Table:
    """Cells of `head` are ``name`` or ``name [unit]``; `time_at` is the place of the time or the date.

    `has_decimal_commas`: a comma in a number is its decimal point; `averages` that values are means
    up to the time of their row; `zone` is of the times, where the file gives it.
    """

    head: list[str]
    rows: list[list[str]]
    has_decimal_commas: bool
    time_at: int = 0
    averages: bool = False
    zone: tzinfo | None = None


def read_table(path: Path, encoding: str) -> Table:
    """The table of a file, of the forms above; raises `ConfigError`."""
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise ConfigError(f"{path} is larger than {_MAX_BYTES // 10**6} MB", fix="split it")
        text = path.read_text(encoding=encoding)
        dialect = csv.Sniffer().sniff(text[:4096], delimiters=",;\t")
        ended = io.StringIO(text, newline="")  # `str.splitlines` would end lines at U+2028 and its like too
        lines = [row for row in csv.reader(ended, dialect) if any(cell.strip() for cell in row)]
    except UnicodeDecodeError as error:
        raise ConfigError(
            f"{path} is not in {error.encoding}: byte {error.object[error.start]:#04x} at {error.start}",
            fix="name its encoding: --encoding cp1252 (Western Windows), cp932 (Japanese), utf-16",
        ) from error
    except LookupError as error:
        raise ConfigError(f"{error}", fix="--encoding utf-8, cp1252, cp932 or utf-16") from error
    except (OSError, UnicodeError, csv.Error) as error:
        raise ConfigError(
            f"{path} cannot be read as a table: {error}", fix="save it as CSV, UTF-8"
        ) from error
    rows = [[cell.strip() for cell in line] for line in lines]
    table = _of_campbell(rows) or _of_onset(rows, dialect.delimiter) or _plain(rows, dialect.delimiter)
    if not table.rows or len(table.head) < 2:
        raise ConfigError(
            f"{path} has no table with a header line and rows",
            fix="keep the header line, with the unit of each column in brackets",
        )
    return table


def _plain(rows: list[list[str]], delimiter: str) -> Table:
    return Table(rows[0] if rows else [], rows[1:], delimiter != ",")


def _of_campbell(rows: list[list[str]]) -> Table | None:
    if len(rows) < _TOA5_LINES or rows[0][0] != "TOA5":
        return None
    _, names, units, made = rows[:_TOA5_LINES]
    head = [f"{name} [{unit}]" for name, unit in zip(names, units, strict=False)]
    head[:2] = names[:2]  # the time and the number of the record, whose units are TS and RN
    return Table(head, rows[_TOA5_LINES:], False, averages="Avg" in made)


def _of_onset(rows: list[list[str]], delimiter: str) -> Table | None:
    """HOBOware writes its title or leaves it out, and numbers the rows or does not."""
    for line, cells in enumerate(rows[:2]):
        zones = [found for found in map(_GMT.search, cells) if found]
        dates = [place for place, cell in enumerate(cells) if cell.startswith("Date")]
        if zones and dates:
            sign, hours, minutes = zones[0].groups()
            ahead = timedelta(hours=int(hours), minutes=int(minutes)) * (-1 if sign == "-" else 1)
            return Table(_named(cells), rows[line + 1 :], delimiter != ",", dates[0], zone=timezone(ahead))
    return None


def _named(cells: list[str]) -> list[str]:
    """Headers as ``name [unit]``: the label of a sensor, or what it measures, with its number if need be."""
    parts = [_parts(cell) for cell in cells]
    count = Counter(name for name, _, _ in parts)
    return [
        (f"{name} {serial}" if count[name] > 1 and serial else name) + (f" [{unit}]" if unit else "")
        for name, unit, serial in parts
    ]


def _parts(cell: str) -> tuple[str, str, str]:
    """Name, unit and serial number of the sensor, as far as the cell of a header has them."""
    found = _HOBO.fullmatch(cell)
    if found is None or _GMT.search(cell):
        return cell, "", ""
    more = found["more"] or ""
    label, serial = re.search(r"LBL: ([^,]+)", more), re.search(r"SEN S/N: (\w+)", more)
    return (
        label[1].strip() if label else found["name"],
        found["unit"] or "",
        serial[1] if serial else "",
    )
