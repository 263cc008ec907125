"""The rows of a logger in the order of its clock: rows far from the others, steps back, rows written twice.

A clock that was set back, or restarted, gives one time to two rows: which of them is right is never guessed.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from itertools import groupby, pairwise
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from fieldkit.model.durations import precise_duration
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.model.samples import Severity
from fieldkit.model.units import MINUTE_NS, SECOND_NS
from fieldkit.phrases import counted

Keep = Literal["first", "last"]
Notes = list[tuple[Severity, str]]

_YEAR_NS = 366 * 86_400 * 10**9
_FINE_NS = 10**9  # a clock of whole seconds repeats itself where rows are no further apart
_GAP = 10  # usual intervals


class TimedRow(NamedTuple):
    """A row of a table: the number of its line in the file, its time and its cells."""

    number: int
    time_ns: int
    cells: list[str]

    def __str__(self) -> str:
        time = datetime.fromtimestamp(self.time_ns // 10**9, UTC)
        return f"row {self.number} ({time:%Y-%m-%d %H:%M:%S} UTC)"


def in_clock_order(path: Path, rows: Sequence[TimedRow], keep: Keep | None) -> tuple[list[TimedRow], Notes]:
    """The rows, oldest first, without those that cannot be right, and notes that name these.

    Rows more than a year from the others are excluded, and copies of earlier rows, as in two downloads of one
    logger. Where the clock steps back, `keep` decides which rows of the times that come twice are kept.

    Raises `ConfigError` where it steps back and `keep` is not given.
    """
    near, far = _near(rows)
    ordered = _oldest_first(near)
    steps = [later.time_ns - earlier.time_ns for earlier, later in pairwise(ordered)]
    is_of_minutes = 3 * steps.count(0) >= len(steps) > 0 and not any(step % MINUTE_NS for step in steps)
    ordered, about_minutes = _spread(path, ordered) if is_of_minutes and keep is None else (ordered, [])
    least_ns = 0 if _usual_ns(ordered) <= _FINE_NS and not is_of_minutes else 1
    whole = _without_copies(ordered, least_ns)
    rising = _once(whole, least_ns, keep)
    if keep is None and len(rising) < len(whole):
        raise _step(path, whole, least_ns)
    copies, twice = _missing(ordered, whole), _missing(whole, rising)
    notes = [
        *_note(Severity.WARNING, far, "more than a year from the others"),
        *_note(Severity.INFO, copies, "copies of earlier ones"),
        *_note(Severity.WARNING, twice, f"as their times come twice ({keep} kept)"),
        *about_minutes,
        *_longest_gap(rising),
    ]
    if keep and not twice:
        notes.append((Severity.INFO, f"nothing to keep {keep}: no time comes twice"))
    return rising, notes


def _spread(path: Path, rows: Sequence[TimedRow]) -> tuple[list[TimedRow], Notes]:
    """Rows in whole minutes, as spreadsheets save them, evenly over these; raises `ConfigError` if uneven."""
    minutes = [list(group) for _, group in groupby(rows, key=lambda row: row.time_ns)]
    steps = [later[0].time_ns - earlier[0].time_ns for earlier, later in pairwise(minutes)]
    most, least = max(map(len, minutes)), min(map(len, minutes[1:-1]), default=0)
    if most != least or min(steps) <= 0:
        rows_each = f"{least} to {most} rows each"
        problem = f"its times are whole minutes, with {rows_each}, as a spreadsheet saves them"
        fix = "export it from the logger again, or use one row a minute: " + Argument("keep", "first")
        raise ConfigError(problem, place=path, fix=fix)
    step_ns, spread = min(steps), list[TimedRow]()
    for group in minutes:
        before = most - len(group) if group is minutes[0] else 0  # the log began within a minute
        for number, row in enumerate(group, start=before):
            spread.append(row._replace(time_ns=row.time_ns + number * step_ns // most))
    text = f"times are whole minutes, {most} rows each: spread evenly, {step_ns / most / SECOND_NS:g} s apart"
    return spread, [(Severity.WARNING, text)]


def _near(rows: Sequence[TimedRow]) -> tuple[list[TimedRow], list[TimedRow]]:
    """The rows around the median time, and those that more than a year without any parts from them."""
    times = np.sort([row.time_ns for row in rows])
    middle = times.size // 2  # of two halves the later: clocks restart in the past
    gaps = np.flatnonzero(np.diff(times) > _YEAR_NS) + 1  # the first rows after them
    first = times[max(gaps[gaps <= middle], default=0)]
    last = times[min(gaps[gaps > middle], default=times.size) - 1]
    near = [row for row in rows if first <= row.time_ns <= last]
    return near, [row for row in rows if not first <= row.time_ns <= last]


def _oldest_first(rows: list[TimedRow]) -> list[TimedRow]:
    falls = sum(later.time_ns < earlier.time_ns for earlier, later in pairwise(rows))
    return rows[::-1] if 2 * falls > len(rows) - 1 else rows


def _usual_ns(rows: Sequence[TimedRow]) -> int:
    intervals = sorted(abs(later.time_ns - earlier.time_ns) for earlier, later in pairwise(rows))
    return intervals[(len(intervals) - 1) // 2] if intervals else 0


def _without_copies(rows: Sequence[TimedRow], least_ns: int) -> list[TimedRow]:
    keys: set[tuple[int, tuple[str, ...]]] = set()
    rows_once: list[TimedRow] = []
    latest_ns = -1
    for row in rows:
        key = (row.time_ns, tuple(row.cells))
        if row.time_ns >= latest_ns + least_ns or key not in keys:
            rows_once.append(row)
        keys.add(key)
        latest_ns = max(latest_ns, row.time_ns)
    return rows_once


def _once(rows: Sequence[TimedRow], least_ns: int, keep: Keep | None) -> list[TimedRow]:
    """The rows whose times rise, each the first of its time, or the last."""
    sign = -1 if keep == "last" else 1
    rising: list[TimedRow] = []
    for row in rows[::sign]:
        if not rising or sign * (row.time_ns - rising[-1].time_ns) >= least_ns:
            rising.append(row)
    return rising[::sign]


def _step(path: Path, rows: Sequence[TimedRow], least_ns: int) -> ConfigError:
    steps = [pair for pair in pairwise(rows) if pair[1].time_ns - pair[0].time_ns < least_ns]
    before, after = steps[0]
    back = timedelta(microseconds=(before.time_ns - after.time_ns) // 1000)
    what = f"goes back by {back}" if back else "stands still"
    more = f", and {len(steps) - 1} more times" if len(steps) > 1 else ""
    fix = Argument("keep") + " first or last, or import each part; if summer time ended: " + Argument("zone")
    return ConfigError(f"the clock {what} from {before} to {after}{more}", place=path, fix=fix)


def _missing(rows: Sequence[TimedRow], kept: Sequence[TimedRow]) -> list[TimedRow]:
    numbers = {row.number for row in kept}
    return [row for row in rows if row.number not in numbers]


def _note(severity: Severity, rows: Sequence[TimedRow], why: str) -> Notes:
    return [(severity, f"{row_count(rows)} excluded, {why}: {listing(rows)}")] if rows else []


def row_count(rows: Sequence[object]) -> str:
    """Number of rows."""
    return counted(len(rows), "row")


def listing(rows: Sequence[object]) -> str:
    """The first three of them, and how many more there are."""
    more = f" and {len(rows) - 3} more" if len(rows) > 3 else ""
    return ", ".join(map(str, rows[:3])) + more


def _longest_gap(rows: Sequence[TimedRow]) -> Notes:
    """A gap may be a clock that was set forward: it cannot be seen which."""
    gaps = [(later.time_ns - earlier.time_ns, later) for earlier, later in pairwise(rows)]
    limit_ns = _GAP * _usual_ns(rows)
    long = [gap for gap in gaps if gap[0] > limit_ns > 0]
    if not long:
        return []
    gap_ns, row = max(long)
    lasts = precise_duration(gap_ns / SECOND_NS)
    which = f"a gap of {lasts}" if len(long) == 1 else f"{len(long)} gaps, the longest of {lasts},"
    return [(Severity.INFO, f"{which} before {row}: nothing recorded, or a clock set forward")]
