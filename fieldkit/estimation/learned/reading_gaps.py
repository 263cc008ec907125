"""Light and weather of minutes without a reading: a line between the readings around.

A line is as uncertain as such lines are in the log. A minute waits for the next reading, `WAIT_MIN` at most,
so that it has the same line live and in batch. After that the last reading is held.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fieldkit.estimation.bins import History
from fieldkit.model.arrays import BoolArray, FloatArray, IntArray

WAIT_MIN = 10
"""Longest time that a minute waits for a reading. [min]

Judged: because loggers write every one to ten minutes, and live slopes should not be older.
"""
USUAL_ERROR = 0.05
"""Error of a line as a share of the largest reading, where the log shows none yet.

Judged: because light under broken cloud changes by so much from minute to minute.
"""
USUAL_AIR_K = 0.3
"""The same of air temperatures.

Judged: because air over warm ground changes by tenths of a kelvin from minute to minute.
"""
USUAL_COUNTS = 0.2
"""Number of lines that the usual error counts for.

Judged: because a larger number took one gust for light in a log of even light.
"""
WEATHER = ("dhi_w_m2", "longwave_down_w_m2", "air_k", "wind_m_s")
"""Columns that minutes wait for no longer once `WAIT_MIN` have passed without a reading.

Direct light they wait for always: without it little can be learnt, while a thermometer may be gone for good.
"""


class GapReading(NamedTuple):
    """Value of a minute, NaN where there is none yet, and the standard deviation of a line or a held value.

    `held_min` is the age of a value that is held. [min]
    """

    value: float
    sd: float = 0.0
    held_min: float = 0.0


def settled(history: History) -> int:
    """Number of rows, from the first on, that wait for no reading any more."""
    waits = np.zeros(len(history), np.bool_)
    for name in ("dni_w_m2", *WEATHER):
        # a reading ends the waiting of all rows before it
        for last in np.flatnonzero(np.isfinite(_column(history, name)))[-1:].tolist():
            rows = np.arange(last + 1, len(history))
            is_recent = history.minute[rows] > history.minute[-1] - WAIT_MIN
            waits[rows] |= is_recent & ~_is_held(history, rows, last, name)
    return int(np.argmax(waits)) if waits.any() else len(history)


def reading_at(history: History, name: str, row: int) -> GapReading:
    """A column in a row: as read, on a line between two readings, or held from the nearest one."""
    values, minute = _column(history, name), history.minute
    if np.isfinite(values[row]):
        return GapReading(float(values[row]))
    # however far apart rows are, the next one may end the line
    until = minute[row : row + 2].max(initial=minute[row] + WAIT_MIN)
    readings = np.flatnonzero(np.isfinite(values) & (minute <= until))
    before, later = readings[readings < row], readings[readings > row]
    if not readings.size:
        return GapReading(float("nan"))
    here = int(before[-1] if before.size else later[0])
    usual = USUAL_AIR_K if name == "air_k" else USUAL_ERROR * float(np.nanmax(values[readings]))
    if not (before.size and later.size) or _is_held(history, row, here, name):
        seen = values[: max(row, here) + 1]
        age_min = max(float(minute[row] - minute[here]), 0.0)
        return GapReading(float(values[here]), _error(seen, abs(row - here), None, usual), age_min)
    there = int(later[0])
    line = np.interp(minute[row], minute[[here, there]], values[[here, there]])
    return GapReading(float(line), _error(values[: there + 1], row - here, there - row, usual))


def _is_held(history: History, rows: int | IntArray, last: int, name: str) -> BoolArray:
    """True where a column's last reading is too old for a row to wait for the next."""
    is_old = history.minute[rows] > history.minute[last] + WAIT_MIN
    return np.asarray((name in WEATHER) & is_old & (np.asarray(rows) > last + 1))


def _column(history: History, name: str) -> FloatArray:
    """The readings (n,) of a column; while the sun is down, no direct light is a reading."""
    values: FloatArray = getattr(history, name)
    if name == "dni_w_m2":
        return np.where(history.sun[:, 2] > 0.0, np.maximum(values, 0.0), 0.0)
    return values


def _error(values: FloatArray, since: int, until: int | None, usual: float) -> float:
    """Standard deviation of lines that begin so many rows before and end so many after.

    By all such lines in the log so far; without an end, of a value that is held.
    """
    middle = values[since : None if until is None else values.size - until]
    start = values[: middle.size]
    end = start if until is None else values[-middle.size :]
    share = 0.0 if until is None else since / (since + until)
    off = middle - (1.0 - share) * start - share * end
    off = off[np.isfinite(off)]
    return float(np.sqrt((off @ off + USUAL_COUNTS * usual**2) / (off.size + USUAL_COUNTS)))
