"""Whether a region that is flagged as shaded cools: a mark is evidence, not a fact.

Boards are marked late, early, on the wrong region or without being there. What decides is the absorbed
sunlight of a region against that of the others, as `shade` derives it from the temperatures: under a board it
falls by what the board takes, else not at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np

from fieldkit.estimation.bins import History
from fieldkit.estimation.shade import LOSS_W_M2_K, MEMORY, NOMINAL
from fieldkit.model.arrays import BoolArray, FloatArray, IntArray
from fieldkit.physics.slab import conducted_flux

FLAG_IS_RIGHT = 0.95
"""Prior probability that a region is shaded where it is flagged, and in the sun where it is not.

Judged: because boards are marked wrongly about once in twenty times.
"""
DISPLACED_MIN = 10
"""Minutes around a flag in which the shade may have been instead. [min]

Judged: because who marks from memory is minutes off, not a quarter of an hour.
"""
LIT_MIN = 30
"""Time around a minute in which a region shows what it takes in the sun. [min]

Judged: because it is longer than most shade tests, and in it the sun moves on by 7 degrees.
"""
LEAST_LIT = 3
"""Judged: because of fewer minutes in the sun neither level nor scatter is known."""
ABSORBED = 0.75
"""Share of the light that ground absorbs, of which `DEPTH_SHARE` is the uncertainty."""
HIDDEN = 0.7
"""Share of the sky that a board hides.

Judged: because a board held over one bed covers most of its sky and leaves the rim.
"""
DEPTH_SHARE, RECOVERY_SHARE = 0.35, 0.1
"""Standard deviations of the fall under a board, and without one, as shares of that expected on level ground.

Judged: because a bed of 30 degrees takes up to 1.3 times as much light, other ground takes up heat otherwise
than nominal sand, and after a board it comes back to its level late.
"""
LEAST_SD_W_M2 = 25.0
"""Judged: because a gust over one bed that is ten kelvin warmer than the air changes its loss by so much."""
UNSTEADY_W_M2 = 100.0
"""Change of the light from which regions show how much more one of them takes of it.

Judged: because less is not seen behind `LEAST_SD_W_M2`.
"""
EDGE_SDS = 2.0
"""Fall, in standard deviations, beyond which a minute beside a shade is part of it.

Judged: because a board that shades ten seconds of a minute makes less of a fall, and less than gusts do.
"""


class DoubtfulShade(NamedTuple):
    """Shade that was marked, or found before, and that the temperatures contradict.

    `minute` is the first one, in minutes since 1970 UTC.
    """

    region: str
    minute: int

    @property
    def start(self) -> str:
        """Time of the first minute, such as ``19:05 UTC``."""
        return f"{datetime.fromtimestamp(60 * self.minute, UTC):%H:%M} UTC"

    def __str__(self) -> str:
        return f"{self.region} does not cool in the shade of {self.start}: is the mark right?"


def likely_shaded(flagged: BoolArray, history: History) -> BoolArray:
    """Regions in the shade by their flags and by whether they cool.

    Parameters
    ----------
    flagged
        Regions in the shade as marked or found, shape (n, regions).
    history
        The minutes, with the columns of these regions.

    Returns
    -------
    Shape (n, regions). Where neither shade nor sun can be seen, flags stay.
    """
    shaded, minute = flagged.copy(), history.minute
    rows = np.flatnonzero(flagged.any(axis=1))
    for span in np.split(rows, np.flatnonzero(np.diff(minute[rows]) > MEMORY) + 1) if rows.size else ():
        ends = minute[span[0]] - MEMORY, minute[span[-1]] + MEMORY
        part = slice(*np.searchsorted(minute, ends))
        shaded[part] = _judged(flagged[part], history.at(part))
    return shaded


def _judged(flagged: BoolArray, history: History) -> BoolArray:
    """As `likely_shaded`, of flags near each other."""
    minute, rows = history.minute, np.flatnonzero(flagged.any(axis=1))
    level = ABSORBED * history.dni_w_m2 * np.maximum(history.sun[:, 2], 0.0)
    depth = level + ABSORBED * HIDDEN * np.nan_to_num(history.dhi_w_m2)
    is_near = np.abs(minute[:, np.newaxis] - minute[rows]).min(axis=1) <= DISPLACED_MIN
    sunlight, shaded = _sunlight_w_m2(history), flagged.copy()
    sunlight -= _medians(np.delete(sunlight, rows, axis=0).T)  # each region has a level of its own
    unflagged = np.where(flagged, np.nan, sunlight)
    for region in range(flagged.shape[1]):
        over = sunlight[:, region] - _medians(np.delete(unflagged, region, axis=1))
        lit = np.setdiff1d(np.flatnonzero(np.isfinite(over + level)), rows)
        if lit.size >= LEAST_LIT:
            fall, sd = _fall(over, level, lit, minute)
            believed = flagged[:, region].copy()
            decided = _decided(believed, fall, depth, sd, is_near)
            # a mark is one hypothesis: where most of it is wrong the rest is no evidence
            for first, end in _contradicted(believed, decided):
                believed[first:end] = False
            shaded[:, region] = _decided(believed, fall, depth, sd, is_near)
    return shaded


def _sunlight_w_m2(history: History) -> FloatArray:
    """Absorbed sunlight of regions (n, regions) up to a constant of each, as of nominal sand."""
    minute, kelvin = history.minute, history.temperature_k
    even = np.arange(minute[0], minute[-1] + 1)
    filled = [
        np.interp(even, minute[seen], column[seen]) if seen.any() else even * np.nan
        for seen, column in zip(np.isfinite(kelvin).T, kelvin.T, strict=True)
    ]
    taken_up = conducted_flux(NOMINAL, np.column_stack(filled), 60.0)[minute - minute[0]]
    taken_up[0] = taken_up[min(1, len(minute) - 1)]  # there is no minute before to see the first one's flux
    return np.asarray(taken_up + LOSS_W_M2_K * kelvin)


def _medians(values: FloatArray) -> FloatArray:
    """Median of each row (n,) of values (n, m); NaN is skipped."""
    medians, has_any = np.full(len(values), np.nan), np.isfinite(values).any(axis=1)
    medians[has_any] = np.nanmedian(values[has_any], axis=1)
    return medians


def _fall(over: FloatArray, level: FloatArray, lit: IntArray, minute: IntArray) -> tuple[FloatArray, float]:
    """Fall of a region against the others (n,) by its minutes in the sun, and its deviation there, W/m2.

    Shade that was marked elsewhere is among these, so medians decide.
    """
    x, y = level[lit] - level[lit].mean(), over[lit] - over[lit].mean()
    # a bed that faces the sun takes more of its changes than the others
    share = float(x @ y) / (float(x @ x) + lit.size * UNSTEADY_W_M2**2)
    steady, half = over - share * level, lit.size // 2
    # the sun moves towards some beds: median of slopes, H. Theil, Indagationes Mathematicae 12, 1950
    per_minute = (steady[lit[-half:]] - steady[lit[:half]]) / (minute[lit[-half:]] - minute[lit[:half]])
    steady -= np.median(per_minute) * (minute - minute[0])
    around = np.abs(minute[:, np.newaxis] - minute[lit]) <= LIT_MIN
    fall = _medians(np.where(around, steady[lit], np.nan)) - steady
    # the median of the absolute value of a standard normal number is 0.6745
    return fall, max(float(np.median(np.abs(fall[lit]))) / 0.6745, LEAST_SD_W_M2)


def _decided(
    flagged: BoolArray, fall: FloatArray, depth: FloatArray, sd: float, is_near: BoolArray
) -> BoolArray:
    """Minutes (n,) in which shade is likelier than sun; flags stay where nothing can be seen."""
    fall = np.clip(fall, 0.0, depth)  # what is more than either is neither
    lit, shady = np.hypot(sd, RECOVERY_SHARE * depth), np.hypot(sd, DEPTH_SHARE * depth)
    prior = np.log(FLAG_IS_RIGHT / (1.0 - FLAG_IS_RIGHT)) * np.where(flagged, 1.0, -1.0)
    log_odds = prior + 0.5 * ((fall / lit) ** 2 - ((fall - depth) / shady) ** 2) - np.log(shady / lit)
    shaded = np.where(np.isnan(log_odds), flagged, is_near & (log_odds > 0.0))
    # a board comes and goes within minutes, of which it shades a part
    beside = np.append(shaded[1:], False) | np.append(False, shaded[:-1])
    return np.asarray(shaded | (beside & is_near & (fall > EDGE_SDS * lit)))


def _contradicted(flagged: BoolArray, shaded: BoolArray) -> list[tuple[int, int]]:
    """First row and end of flags (n,) that lasted for minutes of which most were in the sun."""
    edges = np.flatnonzero(np.diff(np.pad(flagged.astype(int), 1))).reshape(-1, 2).tolist()
    # the first minute is shaded in part
    return [
        (first, end) for first, end in edges if end - first > 1 and not shaded[first + 1 : end].mean() > 0.5
    ]


def doubtful_shades(flagged: BoolArray, history: History, names: Sequence[str]) -> list[DoubtfulShade]:
    """Flags of regions with these names that most of their minutes contradict, as in `likely_shaded`."""
    shaded = likely_shaded(flagged, history)
    return [
        DoubtfulShade(name, int(history.minute[first]))
        for region, name in enumerate(names)
        for first, _ in _contradicted(flagged[:, region], shaded[:, region])
    ]
