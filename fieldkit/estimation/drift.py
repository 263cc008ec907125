"""Whether one region alone left its own prediction: a drift, a shade that creeps in, a foot in the sand.

A slope of the minutes before the last twenty says what those twenty should have measured. What
clouds, wind and stored heat add, they add to all beds in much the same way; so a bed is
suspected when it is off by itself and against the others. Measured weather moves beds by
0.4 K at most in clear hours, so half a kelvin is the least that is told.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fieldkit.estimation.balance import Rows
from fieldkit.estimation.bounds import cramer_rao, tangents
from fieldkit.estimation.choice import choose
from fieldkit.estimation.normal import Misfit, solve
from fieldkit.physics.facet import FloatArray

RECENT_MINUTES = 20
LOOK_BACK_MINUTES = 120
LEAST_BEFORE = 40
LEAST_RECENT = 5
LEAST_K = 0.5
SIGMAS = 4.0


def drifts_k(
    rows: Rows, weights: FloatArray, minutes: NDArray[np.int64], tilt_limit_deg: float
) -> FloatArray:
    """Kelvin by which each target (m,) alone left its prediction lately; 0 for those that did not.

    `weights` (n, m) of the rows, zero for those that do not count, `minutes` (n,) theirs. All
    zeros where there are too few minutes to tell.
    """
    age = minutes[-1] - minutes
    lately = age < RECENT_MINUTES
    before = ~lately & (age < LOOK_BACK_MINUTES)
    recent = np.where(lately[:, np.newaxis], weights, 0.0).T
    past = Misfit.of_rows(rows.lamps, rows.y.T, np.where(before[:, np.newaxis], weights, 0.0).T)
    told = (past.count >= LEAST_BEFORE) & (np.count_nonzero(recent, axis=1) >= LEAST_RECENT)
    off, sd = np.full((2, told.size), np.nan)
    if told.any():
        chosen = choose(past, solve(past), tilt_limit_deg).best
        for target in np.flatnonzero(told):
            off[target], sd[target] = _left(rows, int(target), chosen[target], past.H, recent[target])
    others = np.array([_median(np.delete(off, target)) for target in range(off.size)])
    alone = np.minimum(np.abs(off), np.abs(off - others)) > LEAST_K + SIGMAS * sd
    return np.where(alone, off, 0.0)


def _left(
    rows: Rows, target: int, normal: FloatArray, information: FloatArray, weights: FloatArray
) -> tuple[float, float]:
    """Mean of what a target measured more than a normal explains, and its standard deviation, kelvin."""
    counted = weights > 0.0
    share = weights[counted] / weights[counted].sum()
    lamp, y = share @ rows.lamps[counted], share @ rows.y[counted, target]
    per_kelvin = share @ rows.per_kelvin[counted, target]
    H = information if information.ndim == 2 else information[target]
    towards = np.stack(tangents(normal)) @ lamp
    variance = towards @ cramer_rao(H, normal) @ towards + 1.0 / weights.sum()
    return float((y - normal @ lamp) / per_kelvin), float(np.sqrt(variance) / per_kelvin)


def _median(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else 0.0
