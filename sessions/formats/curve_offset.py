"""The offset between two clocks that recorded the same curve.

For each offset tried the reference is fitted by ``a + b * log(time - offset)``, b > 0, for two
sensors seldom agree in level and gain. The offset is where that fits best, if it does so distinctly
better than anywhere else; its uncertainty follows from leaving out one stretch after the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fieldkit.model.errors import NoAnswerError

FloatArray = NDArray[np.float64]

LONGEST_OFFSET_S = 15 * 3600.0  # wrong zones; date lines are not mistaken for clocks
_LEAST_FIT = 0.7  # of the variance
_DISTINCT = 2.0  # anywhere else, at least so much more must be left over
_LEFT_OVER = 0.005  # no two sensors agree better
_OF_A_STEP = 0.05  # between two readings the log is a straight line
_LEAST_POINTS, _COARSE_POINTS, _MOST_POINTS = 20, 400, 20_000
_MOST_PEAKS, _FINE_OFFSETS, _BLOCKS, _REACH = 8, 81, 10, 3.0
_LEAST_COARSE_S, _MOST_UNCERTAIN_S = 1.0, 60.0
_FIX = "a longer stretch with clouds or a shadow would tell; or say the offset: --offset +12s"


@dataclass(frozen=True, slots=True)
class Curve:
    """A measured quantity over time, in order: seconds since any moment, values in any unit."""

    time_s: FloatArray
    value: FloatArray

    @property
    def step_s(self) -> float:
        """The usual interval."""
        return float(np.median(np.diff(self.time_s)))


@dataclass(frozen=True, slots=True)
class Alignment:
    """What to add to a log's times: seconds, their expanded uncertainty (k=2), the correlation there."""

    offset_s: float
    uncertainty_s: float
    correlation: float


def best_offset(log: Curve, reference: Curve) -> Alignment:
    """The offset at which a log's curve lies on the reference's.

    Raises `NoAnswerError` where too little overlaps, nothing fits, or more than one offset does.
    """
    span = float(np.ptp(reference.time_s)) if reference.time_s.size else 0.0
    if min(log.time_s.size, reference.time_s.size) < _LEAST_POINTS:
        raise NoAnswerError(
            f"an offset needs {_LEAST_POINTS} points of both curves at least", fix="say it: --offset +12s"
        )
    finest = 2.0 * max(log.step_s, reference.step_s, span / _MOST_POINTS)
    coarse = max(finest, span / _COARSE_POINTS, _LEAST_COARSE_S)
    offsets = coarse * np.arange(
        _earliest(log, reference) // coarse, -_earliest(reference, log) // coarse + 1
    )
    fits = _fits(log, *_binned(reference, coarse), offsets, coarse)
    grid, y = _binned(reference, finest)
    tops = [_top(log, grid, y, float(offsets[place]), coarse, finest) for place in _peaks(fits)]
    offset, fit = _distinct(sorted(tops, key=lambda top: -top[1]), _REACH * coarse)
    uncertainty = 2.0 * max(_standard_deviation(log, grid, y, offset, coarse, finest), finest * _OF_A_STEP)
    if uncertainty > _MOST_UNCERTAIN_S:
        raise NoAnswerError(
            f"the offset is not distinct: {offset:+.0f} s fits best, to {uncertainty:.0f} s only", fix=_FIX
        )
    return Alignment(offset, uncertainty, float(np.sqrt(fit)))


def _earliest(log: Curve, reference: Curve) -> float:
    """The lowest offset worth trying, at which the log's end meets the reference's beginning."""
    return max(-LONGEST_OFFSET_S, float(reference.time_s[0] - log.time_s[-1]))


def _peaks(fits: FloatArray) -> list[int]:
    """The highest places that are higher than their neighbours."""
    fits = np.pad(fits, 1)  # a top at an end is one
    inner = np.flatnonzero((fits[1:-1] > 0) & (fits[1:-1] >= fits[:-2]) & (fits[1:-1] >= fits[2:]))
    return [int(place) for place in inner[np.argsort(-fits[inner + 1])][:_MOST_PEAKS]]


def _distinct(tops: Sequence[tuple[float, float]], reach: float) -> tuple[float, float]:
    """The best of (offset, fit), best first; raises `NoAnswerError` where it is none, or not the only one.

    Tops within `reach` of it are the same hill's.
    """
    if not tops or tops[0][1] < _LEAST_FIT:
        raise NoAnswerError(
            f"the two curves fit nowhere: at best {tops[0][1] if tops else 0.0:.0%} of the variance",
            fix="check that they are of the same thing, or say the offset: --offset +12s",
        )
    left_over = max(1 - tops[0][1], _LEFT_OVER)
    for offset, fit in tops[1:]:
        if abs(offset - tops[0][0]) > reach and 1 - fit < _DISTINCT * left_over:
            raise NoAnswerError(
                f"the offset is not distinct: {tops[0][0]:+.0f} s fits, and {offset:+.0f} s does as well",
                fix=_FIX,
            )
    return tops[0]


def _top(
    log: Curve, grid: FloatArray, y: FloatArray, near: float, coarse: float, step: float
) -> tuple[float, float]:
    """Offset and fit at the top around a coarse one: of a parabola through the upper third of the hill.

    Single fits go up and down with the noise of the few readings between which a curve is interpolated.
    """
    reach = _REACH * coarse
    for _ in range(2):
        offsets = near + np.linspace(-reach, reach, _FINE_OFFSETS)
        fits = _fits(log, grid, y, offsets, step)
        upper = fits >= fits.max() - np.ptp(fits) / 3
        near = float(offsets[upper].mean())
        reach = max(float(np.ptp(offsets[upper])), 2.0 * float(offsets[1] - offsets[0]))
    bend, lean, _ = np.polyfit(offsets[upper] - near, fits[upper], 2)
    aside = -lean / (2.0 * bend) if bend < 0 else 0.0
    return near + float(np.clip(aside, -reach, reach)), float(fits.max())


def _standard_deviation(
    log: Curve, grid: FloatArray, y: FloatArray, offset: float, coarse: float, step: float
) -> float:
    """How much the offset depends on single stretches of the curve: a delete-one-block jackknife, seconds."""
    found = []
    for block in np.array_split(np.arange(grid.size), _BLOCKS):
        without = y.copy()
        without[block] = np.nan
        found.append(_top(log, grid, without, offset, coarse, step)[0])
    return float(np.sqrt((_BLOCKS - 1) * np.var(found)))


def _fits(log: Curve, grid: FloatArray, y: FloatArray, offsets: FloatArray, step: float) -> FloatArray:
    """Share of the reference's variance that the log explains at each offset; 0 where it cannot."""
    least = max(_LEAST_POINTS // 2, int(0.5 * min(np.isfinite(y).sum(), np.ptp(log.time_s) / step)))
    return np.array([_fit(_shifted(log, grid, float(offset), step), y, least) for offset in offsets])


def _fit(x: FloatArray, y: FloatArray, least: int) -> float:
    known = np.isfinite(x) & np.isfinite(y)
    if np.count_nonzero(known) < least:
        return 0.0
    x, y = x[known] - x[known].mean(), y[known] - y[known].mean()
    scale = float(np.sum(x * x) * np.sum(y * y))
    correlation = float(np.sum(x * y)) / np.sqrt(scale) if scale > 0 else 0.0
    return max(correlation, 0.0) ** 2


def _binned(curve: Curve, step: float) -> tuple[FloatArray, FloatArray]:
    """Middles and means of bins of `step` seconds, NaN where nothing was measured."""
    place = np.floor((curve.time_s - curve.time_s[0]) / step).astype(np.int64)
    counts = np.bincount(place)
    with np.errstate(invalid="ignore"):
        means = np.bincount(place, curve.value) / counts
    middles = np.bincount(place, curve.time_s) / np.maximum(counts, 1)
    return np.where(counts > 0, middles, curve.time_s[0] + (np.arange(counts.size) + 0.5) * step), means


def _shifted(log: Curve, grid: FloatArray, offset: float, step: float) -> FloatArray:
    """The log at the moments of the grid, its times moved by `offset`; smoothed to the bins' width."""
    value = log.value
    width = 2 * (round(step / log.step_s) // 2) + 1  # odd, so that nothing moves
    if 1 < width <= value.size:
        value = np.convolve(np.pad(value, width // 2, "edge"), np.ones(width) / width, "valid")
    return np.interp(grid - offset, log.time_s, value, np.nan, np.nan)
