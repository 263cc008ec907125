"""Light of minutes without a reading: a line between the readings around, as uncertain as such lines are.

A minute waits for the next reading, `WAIT_MIN` at most, so that it has the same line live and in batch. After
that the last reading is held.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fieldkit.estimation.bins import History
from fieldkit.model.arrays import FloatArray

WAIT_MIN = 10
"""Longest time that a minute waits for light. [min]

Judged: because loggers write every one to ten minutes, and live slopes should not be older.
"""
USUAL_ERROR = 0.05
"""Error of a line as a share of the light, where the log shows none yet.

Judged: because light under broken cloud changes by so much from minute to minute.
"""
USUAL_COUNTS = 0.2
"""Number of lines that `USUAL_ERROR` counts for.

Judged: because a larger number took one gust for light in a log of even light.
"""


class GapLight(NamedTuple):
    """Direct normal and diffuse irradiance and longwave of a minute, NaN where never logged, in W/m2.

    `error_w_m2` is the standard deviation of the direct light.
    """

    direct_w_m2: float
    diffuse_w_m2: float
    longwave_w_m2: float
    error_w_m2: float = 0.0


def settled(history: History) -> int:
    """Number of rows, from the first on, that wait for no reading of the light any more."""
    has_light = np.isfinite(_direct(history))
    waits = ~has_light & (history.minute > history.minute[-1] - WAIT_MIN) if len(history) else has_light
    # a reading ends the waiting of all rows before it
    waits[: int(np.flatnonzero(has_light)[-1]) + 1 if has_light.any() else 0] = False
    return int(np.argmax(waits)) if waits.any() else len(history)


def light_at(history: History, row: int) -> GapLight:
    """Light of a row: as read, between two readings, or held from the last one; one must come before it."""
    direct = _direct(history)
    columns = direct, history.dhi_w_m2, history.longwave_down_w_m2
    held = GapLight(*(_last(column, row) for column in columns))
    if np.isfinite(direct[row]):
        return held
    within = history.minute <= history.minute[row] + WAIT_MIN
    readings = np.flatnonzero(np.isfinite(direct) & within)
    here, later = int(readings[readings < row][-1]), readings[readings > row]
    if not later.size:
        return held._replace(error_w_m2=_error(direct[: row + 1], row - here, None))
    there = int(later[0])
    times = history.minute[[here, there]]
    between = (float(np.interp(history.minute[row], times, column[[here, there]])) for column in columns)
    return GapLight(*between)._replace(error_w_m2=_error(direct[: there + 1], row - here, there - row))


def _direct(history: History) -> FloatArray:
    """Direct light (n,), which is none while the sun is down, W/m2."""
    return np.where(history.sun[:, 2] > 0.0, np.maximum(history.dni_w_m2, 0.0), 0.0)


def _last(values: FloatArray, row: int) -> float:
    """The last reading up to a row, NaN without any."""
    rows = np.flatnonzero(np.isfinite(values[: row + 1]))
    return float(values[rows[-1]]) if rows.size else float("nan")


def _error(direct: FloatArray, since: int, until: int | None) -> float:
    """Standard deviation of lines that begin so many rows before and end so many after, W/m2.

    By all such lines in the light so far; without an end, of light that is held.
    """
    middle = direct[since : None if until is None else direct.size - until]
    start = direct[: middle.size]
    end = start if until is None else direct[-middle.size :]
    share = 0.0 if until is None else since / (since + until)
    off = middle - (1.0 - share) * start - share * end
    off = off[np.isfinite(off)]
    usual = USUAL_ERROR * float(np.nanmax(direct))
    return float(np.sqrt((off @ off + USUAL_COUNTS * usual**2) / (off.size + USUAL_COUNTS)))
