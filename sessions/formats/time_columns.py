"""Where a table has its times, and what they are: moments, times of day without a date, counts from zero."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from datetime import date, timedelta
from pathlib import Path
from typing import Literal

from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.model.units import SECOND_NS
from fieldkit.sessions.formats import times

Kind = Literal["moment", "clock", "count"]
Cells = Sequence[Sequence[str]]

SAMPLE = 200
"""Rows that show what parts the columns, and where the time is."""
_PARTS = {
    name: part
    for part, names in {
        "Y": "year years yyyy yr jahr año ano année annee anno år rok год 年",
        "m": "month months mm mon mo monat mes mois mese mês måned месяц 月",
        "d": "day days dd dom tag día dia jour giorno dag день 日",
        "j": "doy jday julian julianday dayofyear yday",
        "H": "hour hours hh hr hrs stunde hora heure ora uur час 時 时",
        "T": "hhmm hrmn",
        "M": "minute minutes min mi mn minuto minuut минута 分",
        "S": "second seconds sec ss sekunde segundo seconde secondo секунда 秒",
    }.items()
    for name in names.split()
}
_FRACTION_DIGITS = {"ms": 3, "msec": 3, "millis": 3, "millisecond": 3, "milliseconds": 3, "us": 6, "usec": 6}
_DIGITS = re.compile(r"\d{1,4}(\.0)?")
_TIME_OF_DAY = re.compile(r"time|hh|zeit|hora|heure|ora|tijd|時|时", re.IGNORECASE)
_COUNTED = re.compile(
    r"(?i)(?<![^\W_])(ms|msec|mill?i\w*|us|[µμ]s|micro\w*|min|minut\w*|s|se[ck]\w*|segundos|h|hrs?|hours?|stunden|horas"
    r"|heures|秒|分|d|days?)(?![^\W_])"
)
_SECONDS = {"ms": 1e-3, "mi": 60.0, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "h": 3600.0, "分": 60.0, "d": 86400.0}


def first_time(rows: Cells, named: int | None, time_format: str | None) -> tuple[int, int, Kind]:
    """The column of the time, the first row that has one, and what it is; else the first and the second."""
    parts = None if named is not None else _row_of_parts(rows)
    kinds: tuple[tuple[Callable[[str], bool], Kind], ...] = (
        (lambda cell: times.is_time(cell, time_format), "moment" if times.has_day(time_format) else "clock"),
        (times.is_dated, "moment"),
        (times.is_unix, "moment"),
        (times.is_clock, "clock"),
        (times.is_number, "count"),
    )
    for is_of_kind, kind in kinds:
        place = _place_where(rows[:SAMPLE], is_of_kind) if named is None else named
        if parts is not None and (place is None or kind != "moment"):
            return *parts, "moment"
        if kind == "count" and named is None:
            place = _counted(rows, place)
        is_row = [place is not None and len(row) > 1 and is_of_kind(cell_of(row, place)) for row in rows]
        # a date or two may stand above times of day or counts
        if place is not None and 4 * sum(is_row) > len(rows) - (is_row.index(True) if any(is_row) else 0):
            return place, _first_below_header(rows, is_row), kind
    return named or 0, 1, "moment"


def cell_of(cells: Sequence[str], place: int) -> str:
    """A cell; ``""`` where the row ends before it."""
    return cells[place] if place < len(cells) else ""


def _first_below_header(rows: Cells, is_row: Sequence[bool]) -> int:
    """The first row with a time below a line that names as many columns: dates of a preamble seldom are."""
    head, first = 0, -1
    rows_below: dict[int, int] = {}
    for number, row in enumerate(rows):
        width = sum(map(bool, row))
        if is_row[number]:
            first = first if first >= 0 else number
            rows_below[first] = rows_below.get(first, 0) + (head >= width)
        else:
            head, first = width if first >= 0 else max(head, width), -1
    enough = min(4, max(rows_below.values()))
    return next(number for number, count in rows_below.items() if count >= enough)


def _place_where(rows: Cells, is_of_kind: Callable[[str], bool]) -> int | None:
    """The first column of those whose cells look right in the most rows, a constant one last."""
    cells_by_place: dict[int, list[str]] = {}
    for row in rows:
        for place, cell in enumerate(row):
            if is_of_kind(cell):
                cells_by_place.setdefault(place, []).append(cell)
    most = max(map(len, cells_by_place.values()), default=0)
    usual = [place for place, cells in cells_by_place.items() if 2 * len(cells) > most]
    return min(usual, key=lambda place: (len(set(cells_by_place[place])) == 1, place), default=None)


def _counted(rows: Cells, first: int | None) -> int | None:
    """The first column below a name with a unit of time, else the first of the table if it has numbers."""
    heads = next((row for row in rows[:SAMPLE] if not any(map(times.is_number, row))), [])
    counted = (place for place, cell in enumerate(heads) if _COUNTED.search(cell))
    return next(counted, None if first else first)


def counted_ns(head: str) -> float:
    """Nanoseconds in the unit of time that a header has; 0 without one."""
    match = _COUNTED.search(head)
    word = match[1].lower() if match else ""
    if word.startswith(("mil", "mic")):
        word = {"l": "ms", "c": "us"}[word[2]]
    return (_SECONDS.get(word[:2], _SECONDS.get(word[:1], 1.0)) if word else 0.0) * SECOND_NS


# --- times in several columns


def parts_of(labels: Sequence[str]) -> dict[str, int]:
    """Places of year, month, day, hour ... by strptime's letters, as columns are called."""
    places: dict[str, int] = {}
    for place, label in enumerate(labels):
        word = re.sub(r"[(\[].*|[\W\d_]", "", label.lower())
        part = _PARTS.get(word, "")
        if part in places and word == "mm":  # months and minutes
            part = "M"
        if part:
            places.setdefault(part, place)
    if "Y" in places and "m" not in places and "d" in places:  # Campbell's day of the year
        places["j"] = places.pop("d")
    return {part: place for part, place in places.items() if "j" not in places or part not in "md"}


def _row_of_parts(rows: Cells) -> tuple[int, int] | None:
    """The column of the years and the first row below a header of year, month and day."""
    for number, row in enumerate(rows[:SAMPLE]):
        parts = parts_of(row)
        if "Y" in parts and ("j" in parts or {"m", "d"} <= parts.keys()):
            cells = [cell_of(row, parts["Y"])[:4] for row in rows[number + 1 :]]
            years = (below for below, cell in enumerate(cells, start=number + 1) if cell.isdigit())
            return next(((parts["Y"], below) for below in years), None)
    return None


def time_places(path: Path, labels: Sequence[str], rows: Cells, first: int) -> tuple[int, ...]:
    """The places of the time: one column, its parts, or date and time of day; a fraction of its second."""
    parts = parts_of(labels)
    is_split = parts.get("Y") == first
    places = tuple(parts[part] for part in "YjmdTHMS" if part in parts) if is_split else (first,)
    dates = [" ".join(cell_of(row, place) for place in places) for row in rows]
    without_time = 2 * sum(map(times.is_date_alone, dates)) > len(dates)
    is_day = not {"T", "H"} & parts.keys() if is_split else without_time
    if is_day and not all(map(times.is_number, dates)):
        places += _time_of_day(path, labels, rows, places, dates)
    after = places[-1] + 1
    digits = _FRACTION_DIGITS.get(labels[after].lower(), 0) if after < len(labels) else 0
    fractions = [cell for row in rows if (cell := cell_of(row, after)).isdigit() and len(cell) <= digits]
    is_fraction = 2 * len(fractions) > len(rows)
    return (*places, after) if is_fraction else places


def _time_of_day(
    path: Path, labels: Sequence[str], rows: Cells, of_date: tuple[int, ...], dates: Sequence[str]
) -> tuple[int, ...]:
    """The columns with the times of day beside those of dates; none where each date stands once."""
    first = of_date[-1]
    is_repeated = len(set(dates)) < len(dates)
    others = set(range(len(labels))) - set(of_date)
    near = sorted(others, key=lambda place: (abs(place - first), place < first))
    for place in near if is_repeated else [place for place in near if abs(place - first) == 1]:
        if 2 * sum(times.is_clock(cell_of(row, place)) for row in rows) > len(rows):
            return (place,)
    parts = {part: place for part, place in parts_of(labels).items() if part in "HMS"}
    named = [parts["H"]] if "H" in parts else [place for place in near if _TIME_OF_DAY.search(labels[place])]
    if not is_repeated:
        return ()
    for place in named:
        if 2 * sum(map(bool, map(_DIGITS.fullmatch, (cell_of(row, place) for row in rows)))) > len(rows):
            return tuple(parts.values()) if "H" in parts else (place,)
    # all of them would be put at midnight
    problem = f"several rows have the date {Counter(dates).most_common(1)[0][0]!r} and no time of day"
    fix = "name the column of the date, then that of the time of day: " + Argument("time_columns")
    raise ConfigError(problem, place=path, fix=fix)


def time_text(labels: Sequence[str], cells: Sequence[str], *, has_format: bool) -> str:
    """The cells of a time as one text, ISO 8601 where they are its parts and no format is given for them."""
    if digits := _FRACTION_DIGITS.get(labels[-1].lower(), 0) if len(labels) > 1 else 0:
        return f"{time_text(labels[:-1], cells[:-1], has_format=has_format)}.{cells[-1]:0>{digits}}"
    places = parts_of(labels)
    parts = {part: re.sub(r"\.0*$", "", cells[place]) for part, place in places.items()}
    is_split = "Y" in parts
    if has_format or len(cells) < 2 or not (is_split or "H" in parts or _DIGITS.fullmatch(cells[1])):
        return " ".join(cells)
    others = [cell for place, cell in enumerate(cells[not is_split :]) if place not in places.values()]
    unpadded = parts.get("T") or re.sub(r"\.0$", "", others[0] if others else "")
    hour = parts.get("H") or unpadded.zfill(3)
    if len(hour) > 2 and hour.isdigit():  # 100 is one o'clock
        hour = f"{hour[:-2]:0>2}:{hour[-2:]}"
    clock = hour if ":" in hour else f"{hour:0>2}:{parts.get('M', '0'):0>2}"
    if "S" in parts:
        second, point, fraction = parts["S"].partition(".")
        clock += f":{second:0>2}{point}{fraction}"
    return f"{_day(parts) if is_split else cells[0]} {clock}"


def _day(parts: dict[str, str]) -> str:
    if "j" in parts and parts["j"].isdigit() and parts["Y"].isdigit():
        return f"{date(int(parts['Y']), 1, 1) + timedelta(days=int(parts['j']) - 1)}"
    return f"{parts['Y']}-{parts.get('m', ''):0>2}-{parts.get('d', ''):0>2}"
