"""Downloads of the Japan Meteorological Agency's "obsdl" page (CSV) as streams.

The headers' length depends on what was chosen; a value column of each item is followed by columns of
its quality (8 is normal; nothing else is taken) and homogeneity. Sums belong to the hour or day that
*ends* at the stamp and become means in its middle; other hourly values are of the stamp itself, daily
ones are put at noon. (JMA: obsdl/top/help3 and help4.)
"""

from __future__ import annotations

import csv
import math
import re
from calendar import monthrange
from collections.abc import Iterator, Sequence
from contextlib import suppress
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import NamedTuple

from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.model.quantities import QUANTITIES, Meaning, Unit, unit_of
from fieldkit.model.samples import Reading, Severity
from fieldkit.sessions.formats import imported
from fieldkit.sessions.formats.imported import ImportedRecording, explained, free_name, imported_reading
from fieldkit.sessions.formats.time_columns import Cells
from fieldkit.sessions.formats.times import utc_ns

JST = timezone(timedelta(hours=9), "JST")

VENDOR = "Japan Meteorological Agency"

_MOST_BYTES = 100_000_000
_NOT_AS = f"not as the {VENDOR} writes it"
_ANEW = "download it anew and leave name and encoding (Shift_JIS) as they are"


# --- downloads of the "obsdl" page (CSV)

_FIRST_CELL = "ダウンロードした時刻"

_VAPOUR = "蒸気圧"  # ends like 気圧, the pressure of the air, and has its unit

_TIME_OF_DAY = "時分"  # how the tables of ten-minute values begin, which have no date

_BEGINNING = re.compile(rf"{_FIRST_CELL}|{_TIME_OF_DAY}[^\n]*\n[0-9][0-9]?:[0-9][0-9]")

_QUALITY, _HOMOGENEITY = "品質情報", "均質番号"

_NORMAL = "8"

_DATE = re.compile(
    r"(\d{4})[/年](\d{1,2})[/月](\d{1,2})日?"
    r"(?:\s*(\d{1,2})(?::(\d{2})(?::\d{2})?|時(?:(\d{1,2})分)?))?"
)

_YEAR = "年"

_DAY = timedelta(days=1)


_SUM = Unit("MJ/㎡")

Body = Sequence[tuple[datetime, list[str]]]
"""The rows of a download with their stamps."""


class _Item(NamedTuple):
    """One value column: where it stands, where its quality and homogeneity number do (-1: nowhere)."""

    label: str
    kind: Meaning
    value: int
    quality: int
    homogeneity: int


def is_obsdl(path: Path) -> bool:
    """True if a file begins as a download of obsdl does, or as a table of the agency without a date."""
    try:
        with path.open("rb") as file:
            start = file.read(4096)
        return any(_BEGINNING.match(start.decode(code, "ignore")) for code in ("cp932", "utf-8-sig"))
    except OSError:
        return False


def is_of_one_day(path: Path) -> bool:
    """True if a file is a table of ten-minute values, whose day it does not name."""
    return _text(path).startswith(_TIME_OF_DAY)


def read_obsdl(path: Path, name: str) -> ImportedRecording:
    """A download as streams ``NAME-global``, ``NAME-air``, ``NAME-wind``, ``NAME-pressure`` (of the station),
    ``NAME-sea-level-pressure``.

    Raises `ConfigError` where the file does not follow the agency's layout.
    """
    with explained(path, _NOT_AS, _ANEW, OverflowError, ValueError, csv.Error):
        return _obsdl(path, [row for row in csv.reader(_text(path).splitlines()) if row], name)


def _obsdl(path: Path, rows: list[list[str]], name: str) -> ImportedRecording:
    if rows and rows[0][0] == _TIME_OF_DAY:
        problem = f"times of day ({_TIME_OF_DAY}) but no date"
        raise ConfigError(problem, place=path, fix=Argument("date", "2026-07-05"))
    at = _names_at(rows)
    if at is None:
        raise _not_understood(path, f"no row names the items, beginning with {_YEAR}")
    if rows[at][0] and rows[at].count(rows[at][0]) > 1:  # 集計開始 and 集計終了
        problem = "values of periods of several days, from one date to another"
        raise ConfigError(problem, place=path, fix="choose hourly or daily values (時別値, 日別値) at obsdl")
    hourly = _is_hourly(rows[at], rows[at + 1 :])
    below = [(_stamp(row, is_split=rows[at][0] == _YEAR, hourly=hourly), row) for row in rows[at + 1 :]]
    body = [(stamp, row) for stamp, row in below if stamp is not None]
    if not body:
        raise ConfigError("no row that begins with a date", place=path, fix="choose hourly values at obsdl")
    items = _items(rows[:at], rows[at], [row for stamp, row in below if stamp is None])
    if not items:
        have = ", ".join(row.of_jma for row in QUANTITIES.values() if row.of_jma)
        raise ConfigError("no item that fieldkit takes", place=path, fix=f"name one of these: {have}")
    return _recording(path, name, items, body, timedelta(hours=1 if hourly else 24))


def _names_at(rows: Sequence[Sequence[str]]) -> int | None:
    """The row that names the items: its first cells name the date, or nothing where that is in words."""
    with_date = (n for n, row in enumerate(rows) if row[0].startswith(_YEAR))
    unnamed = (n for n, row in enumerate(rows) if not row[0] and any(map(_kind, row)))
    return next(with_date, next(unnamed, None))


def _is_hourly(names: Sequence[str], below: Sequence[Sequence[str]]) -> bool:
    """True if the dates have an hour, by their names or themselves; an item like 日照時間 is none of them."""
    if names[0]:
        return "時" in names[0] or "時" in names[:4]
    return any((date := _DATE.fullmatch(row[0].strip())) and date[4] for row in below)


def _recording(
    path: Path, name: str, items: Sequence[_Item], body: Body, step: timedelta
) -> ImportedRecording:
    streams, readings = [], []
    for quantity in dict.fromkeys(item.kind.quantity for item in items):
        ours = [item for item in items if item.kind.quantity == quantity]
        labels = [item.label for item in ours]
        info = imported.station_stream(name, quantity, 1.0 / step.total_seconds(), labels, vendor=VENDOR)
        streams.append(info)
        for stamp, row in body:
            time_ns = utc_ns(stamp + _to_middle(ours[0].kind, step))
            values = tuple(_value(item, row, step) for item in ours)
            readings.append(imported_reading(info.name, time_ns, values))
    readings.sort(key=lambda reading: reading.time_ns)
    return ImportedRecording(tuple(streams), readings, tuple(_notes(path, items, body, step)))


def _to_middle(kind: Meaning, step: timedelta) -> timedelta:
    """From a row's stamp to what its values are of; days are stamped at their beginning."""
    if step >= _DAY:
        return step / 2
    return -step / 2 if kind.unit == _SUM else timedelta(0)


def _notes(path: Path, items: Sequence[_Item], body: Body, step: timedelta) -> Iterator[tuple[Severity, str]]:
    values = "hourly" if step < _DAY else "daily"
    yield Severity.INFO, f"{path.name}: {len(body)} {values} rows, times of Japan (UTC+9)"
    for item in items:
        filled = [row for _, row in body if _cell(row, item.value)]
        normal = [row for row in filled if _is_normal(item, row)]
        if doubtful := len(filled) - len(normal):
            yield Severity.WARNING, f"{item.label}: {doubtful} values whose quality is not 8 were excluded"
        marked = [_cell(row, item.value) for row in normal if math.isnan(_value(item, row, step))]
        if marked:
            words = f"{len(marked)} cells that are not plain numbers were excluded, the first {marked[0]!r}"
            yield Severity.WARNING, f"{item.label}: {words}"
        if len({_cell(row, item.homogeneity) for _, row in body if item.homogeneity >= 0} - {""}) > 1:
            yield Severity.WARNING, f"{item.label}: station or instrument changed within the file (均質番号)"


def _stamp(row: Sequence[str], *, is_split: bool, hourly: bool) -> datetime | None:
    """The time of a row: one cell, or year, month, day and hour in cells of their own; None in the header."""
    if is_split:
        cells = row[: 4 if hourly else 3]
        if len(row) < 4 or not all(cell.isdigit() for cell in cells):
            return None
        year, month, day, hour, minute = (*map(int, cells), 0, 0)[:5]
    else:
        date = _DATE.fullmatch(row[0].strip())
        if date is None:
            return None
        year, month, day, hour, *minutes = map(int, date.groups(default="0"))
        minute = sum(minutes)  # after a colon, or before 分
    return datetime(year, month, day, tzinfo=JST) + timedelta(hours=hour, minutes=minute)


def _items(above: Cells, names: Sequence[str], below: Cells) -> list[_Item]:
    """The value columns that count, from the row that names the items and the header rows around it."""
    stations = above[-1] if above else []
    several = len({cell for cell in stations if cell}) > 1
    items: list[_Item] = []
    for place, cell in enumerate(names):
        kind = _kind(cell)
        if kind is not None and not any(_cell(row, place) for row in below):
            item = cell.rsplit("(", 1)[0]
            label = f"{_cell(stations, place)} {item}" if several else item
            label = free_name(label, [other.label for other in items], "{} ({})")  # stations of one name
            more = _companions(names, below, place)
            items.append(_Item(label, kind, place, more.get(_QUALITY, -1), more.get(_HOMOGENEITY, -1)))
    return items


def _kind(cell: str) -> Meaning | None:
    """Meaning of an item's values, such as 気温(℃)."""
    item, _, written = cell.removesuffix(")").rpartition("(")
    row = next((row for row in QUANTITIES.values() if row.of_jma and row.of_jma in item), None)
    unit = _SUM if written == _SUM.shown else unit_of(written)
    return Meaning(row, unit) if row and unit and _VAPOUR not in item else None


def _companions(items: Sequence[str], below: Sequence[Sequence[str]], place: int) -> dict[str, int]:
    """Places of the columns that qualify the value at `place`: up to the next value but a direction."""
    places: dict[str, int] = {}
    for column in range(place + 1, len(items)):
        is_named = items[column].startswith((_QUALITY, _HOMOGENEITY))  # beside the item, not below it
        words = {items[column][:4]} if is_named else {_cell(row, column) for row in below} - {""}
        if not words or not (is_named or items[column] == items[place]):
            break
        for word in words & {_QUALITY, _HOMOGENEITY}:
            places.setdefault(word, column)
    return places


def _cell(row: Sequence[str], place: int) -> str:
    return row[place].strip() if 0 <= place < len(row) else ""


def _is_normal(item: _Item, row: Sequence[str]) -> bool:
    return item.quality < 0 or _cell(row, item.quality) == _NORMAL


def _value(item: _Item, row: Sequence[str], step: timedelta) -> float:
    try:
        number = float(_cell(row, item.value)) if _is_normal(item, row) else math.nan
    except ValueError:
        return math.nan
    is_sum = item.kind.unit == _SUM
    return number * 1e6 / step.total_seconds() if is_sum else item.kind.in_stream_unit(number)


# --- radiation tables: one quantity of one month, a row a day
#
# A row has the day, 24 hourly sums in 0.01 MJ/m² without a decimal point, and their sum; ``XXX`` is missing,
# ``]`` marks an incomplete sum. The hours end at the full hour of Japan's time; means are put at half past.
# The file's name gives the quantity: DR direct, DF diffuse, DL downward longwave. (JMA:
# env/radiation/format_rad, and the names of the tables there, as ``DR202406_tat.txt``.)

_NAME = re.compile(r"(DR|DF|DL)(\d{4})(0[1-9]|1[0-2])_(\w+)\.txt", re.IGNORECASE)

_COMPONENTS = {"DR": "dni", "DF": "dhi", "DL": "longwave_down"}

_HOURS = [f"{hour:02}" for hour in range(1, 25)]  # a heading, not the first of the month

_W_PER_M2 = 1e4 / 3600.0  # of 0.01 MJ/m² in an hour


def is_radiation_table(path: Path) -> bool:
    """True if a file has the name of such a table."""
    return _NAME.fullmatch(path.name) is not None


def read_radiation_table(path: Path, name: str) -> ImportedRecording:
    """A table as a stream ``NAME-direct``, ``NAME-diffuse`` or ``NAME-longwave-down`` in W/m².

    Raises `ConfigError` where the file does not follow the agency's layout.
    """
    match = _NAME.fullmatch(path.name)
    if match is None:
        raise _not_understood(path, "its name does not give quantity and month, like DR202406_tat.txt")
    quantity = QUANTITIES[_COMPONENTS[match[1].upper()]]
    info = imported.station_stream(name, quantity, 1 / 3600, vendor=VENDOR, model=f"station {match[4]}")
    with explained(path, _NOT_AS, _ANEW, OverflowError):
        first = datetime(int(match[2]), int(match[3]), 1, tzinfo=JST)
        days = [day for line in _text(path).splitlines() if (day := _day(path, line)) is not None]
        readings = _readings(path, info.name, first, days)
    note = f"{path.name}: hourly sums of {len(days)} days as means, stamped at half past, from Japan's time"
    return ImportedRecording((info,), readings, ((Severity.INFO, note),))


def _readings(path: Path, stream: str, first: datetime, days: list[tuple[int, list[float]]]) -> list[Reading]:
    if not days or [number for number, _ in days] != list(range(1, len(days) + 1)):
        raise _not_understood(path, "no rows of days, one after another from the first of the month")
    if days[-1][0] > monthrange(first.year, first.month)[1]:
        raise _not_understood(path, f"it has {days[-1][0]} days, more than its month {first:%Y-%m}")
    return [
        imported_reading(stream, utc_ns(first + timedelta(days=number - 1, hours=hour, minutes=30)), (value,))
        for number, hours in days
        for hour, value in enumerate(hours)
    ]


def _day(path: Path, line: str) -> tuple[int, list[float]] | None:
    """Number of the day and its hours in W/m², of a row of the table; None for any other line.

    The row's own daily sum proves that the numbers were taken for the right hours.
    """
    words = line.replace("]", " ").split()
    if not words or not re.fullmatch(r"[1-9]|[0-3]\d", words[0]) or words[:24] == _HOURS:
        return None
    if len(words) != 26 or not all(re.fullmatch(r"\d+|X+", word) for word in words[1:]):
        raise _not_understood(path, f"the row {line.strip()[:40]!r} does not have 24 hours and their sum")
    hours = [math.nan if "X" in word else float(word) for word in words[1:25]]
    numbers = [hour for hour in hours if hour == hour]
    if "X" not in words[25] and abs(sum(numbers) - float(words[25])) > 0.5 * len(numbers) + 1:
        raise _not_understood(path, f"the hours of day {words[0]} do not add up to its sum")
    return int(words[0]), [hour * _W_PER_M2 for hour in hours]


# --- both


def _text(path: Path) -> str:
    """The text of such a file; raises `ConfigError`."""
    with explained(path, _NOT_AS, _ANEW, OSError, UnicodeDecodeError):
        imported.refuse_large(path, _MOST_BYTES)
        return path.read_bytes().decode(encoding_of(path))


def encoding_of(path: Path) -> str:
    """Shift_JIS, or UTF-8 of a file that was saved again, which Japanese in Shift_JIS is not by chance."""
    with suppress(UnicodeDecodeError):
        path.read_bytes().decode("utf-8-sig")
        return "utf-8-sig"
    return "cp932"


def _not_understood(path: Path, why: str) -> ConfigError:
    """The error of a file that is laid out otherwise."""
    return ConfigError(f"{_NOT_AS} ({why})", place=path, fix=_ANEW)
