"""The paper's method: a table of radiation differences, contours through it, and a contour score per cell.

For each minute bin the table contains ``S (n . s - reference . s)`` for all slopes of a grid. The paper
scores each cell "on the contour" of the measured difference and takes the cell of highest score, but states
neither how near is on the contour nor how ties are resolved. Here a cell is on the contour within a stated
tolerance, tied cells are averaged as normals (never as azimuths), the column 360 that repeats column 0 is
omitted, and the winner needs a stated share of all minute bins.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fieldkit.model.arrays import FloatArray, IndexArray, IntArray
from fieldkit.physics.facet import normal

# the steps of the paper's own table: another grid would be another method
TILT_STEP_DEG = 0.5
AZIMUTH_STEP_DEG = 1.0


def slope_grid(tilt_limit_deg: float = 30.0) -> FloatArray:
    """Normals (cells, 3) of the paper's grid: tilt 0 to the limit by 0.5, azimuth 0 to 359 by 1 degree."""
    tilts = np.arange(0.0, tilt_limit_deg + TILT_STEP_DEG / 2, TILT_STEP_DEG)
    return normal(tilts[:, np.newaxis], np.arange(0.0, 360.0, AZIMUTH_STEP_DEG)).reshape(-1, 3)


@dataclass(frozen=True, slots=True)
class ContourWinners:
    """Mean normal of the winning cells of m slopes (m, 3), their score (m,) and number of ties (m,).

    The normal is NaN where no cell reached the threshold.
    """

    normals: FloatArray
    best: IntArray
    tied: IntArray


class RadiationTable:
    """Radiation differences (times, cells) of the paper's section 3, W/m2, ready for scoring.

    Of the grid's normals (cells, 3), sun vectors times DNI (times, 3) and the reference's normal (3,).
    """

    def __init__(self, cells: FloatArray, design: FloatArray, reference: FloatArray) -> None:
        self.cells = cells
        self._design, self._away = design, cells - reference

    def _row(self, time: int) -> FloatArray:
        """The table's row (cells,) of one time: rounded alike whether the table is kept or not."""
        return np.asarray(self._away @ self._design[time])

    @cached_property
    def values(self) -> FloatArray:
        """The whole table (times, cells)."""
        return np.stack([self._row(time) for time in range(len(self._design))])

    @cached_property
    def _by_cell(self) -> FloatArray:
        return np.ascontiguousarray(self.values.T)

    def scores(self, difference_w_m2: FloatArray, tolerance_w_m2: float | FloatArray) -> IntArray:
        """Contour score (cells,) of every cell for one slope: the paper's Fig. 8.

        Measured differences (times,) that are NaN score nowhere; the tolerance, half the width of the
        contours, is one for all or (times,).
        """
        # row by row: the table of a day's minute bins would fill a small computer's memory
        score = np.zeros(len(self.cells), np.int64)
        tolerances = np.broadcast_to(tolerance_w_m2, difference_w_m2.shape)
        for time, (measured, tolerance) in enumerate(zip(difference_w_m2, tolerances, strict=True)):
            score += np.abs(self._row(time) - measured) <= tolerance
        return score

    def winner(
        self, difference_w_m2: FloatArray, tolerance_w_m2: float | FloatArray, threshold: float = 0.5
    ) -> ContourWinners:
        """Winning cells of one slope with measured differences (times,), scoring all cells."""
        scores = self.scores(difference_w_m2, tolerance_w_m2)
        best = int(scores.max())
        cells = np.flatnonzero(scores == best) if best else np.array([], np.intp)
        total = self.cells[cells].sum(axis=0)
        needed = threshold * difference_w_m2.size
        return _winning(total[np.newaxis], np.array([best]), np.array([cells.size]), needed)

    @cached_property
    def _order(self) -> IndexArray:
        """Cells of every time (times, cells), sorted by value."""
        return np.argsort(self.values, axis=1)

    def winners(
        self, differences_w_m2: FloatArray, tolerance_w_m2: float | FloatArray, threshold: float = 0.5
    ) -> ContourWinners:
        """Winning cells of m slopes with measured differences (m, times), without scoring all cells.

        Winners, scores and ties are those of `scores`: a cell with at most j misses lies on at least one of
        any j + 1 contours. So the cells of the shortest contours are scored first, and more contours are
        added only while the winner has more misses than that.
        """
        slopes, times = differences_w_m2.shape
        tolerance = np.broadcast_to(np.asarray(tolerance_w_m2, np.float64), (times,))
        best, tied = np.zeros(slopes, np.int64), np.zeros(slopes, np.int64)
        sums = np.zeros((slopes, 3))
        low, high = self._bands(differences_w_m2, tolerance)
        shortest = np.argsort(high - low, axis=1, kind="stable")
        open_slopes, contours = np.arange(slopes), 1
        while open_slopes.size:
            for part in np.array_split(open_slopes, 1 + open_slopes.size * contours // 2000):
                chosen = shortest[part, :contours]
                winners = self._winners(differences_w_m2[part], tolerance, low[part], high[part], chosen)
                best[part], tied[part], sums[part] = winners
            settled = best[open_slopes] >= times - contours + 1
            open_slopes = open_slopes[~settled] if contours < times else open_slopes[:0]
            contours = min(2 * contours, times)
        return _winning(sums, best, tied, threshold * times)

    def _bands(self, differences: FloatArray, tolerance: FloatArray) -> tuple[IndexArray, IndexArray]:
        """Begin and end of each contour (m, times) among the cells sorted by their value."""
        low, high = np.zeros((2, *differences.shape), np.intp)
        # slightly wider than the tolerance: the comparison that scores decides on rounding
        reach = tolerance * (1.0 + 1e-9) + 1e-9
        for time, row in enumerate(np.take_along_axis(self.values, self._order, axis=1)):
            low[:, time] = np.searchsorted(row, differences[:, time] - reach[time])
            high[:, time] = np.searchsorted(row, differences[:, time] + reach[time], side="right")
            blank = np.isnan(differences[:, time])
            high[blank, time] = low[blank, time]
        return low, high

    def _winners(
        self,
        differences: FloatArray,
        tolerance: FloatArray,
        low: IndexArray,
        high: IndexArray,
        chosen: IndexArray,
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Best score, ties and sum of the tied normals among the cells of the chosen contours."""
        slope, cell = self._candidates(low, high, chosen)
        score = np.count_nonzero(np.abs(self._by_cell[cell] - differences[slope]) <= tolerance, axis=1)
        best = np.zeros(len(differences), np.int64)
        np.maximum.at(best, slope, score)
        winners = (score == best[slope]) & (score > 0)
        slope, cell = slope[winners], cell[winners]
        tied = np.bincount(slope, minlength=best.size)
        sums = [np.bincount(slope, self.cells[cell, axis], best.size) for axis in range(3)]
        return best, tied, np.column_stack(sums)

    def _candidates(
        self, low: IndexArray, high: IndexArray, chosen: IndexArray
    ) -> tuple[IndexArray, IndexArray]:
        """Pairs (slope, cell), each once, of all cells on the chosen contours (m, contours)."""
        slopes = np.arange(len(chosen))[:, np.newaxis]
        start, count = low[slopes, chosen], (high - low)[slopes, chosen]
        total = count.ravel()
        owner = np.repeat(np.broadcast_to(slopes, chosen.shape).ravel(), total)
        time = np.repeat(chosen.ravel(), total)
        within = np.arange(total.sum()) - np.repeat(np.cumsum(total) - total, total)
        cell = self._order[time, np.repeat(start.ravel(), total) + within]
        if chosen.shape[1] == 1:
            return owner, cell
        pairs = np.unique(owner * len(self.cells) + cell)
        return pairs // len(self.cells), pairs % len(self.cells)


def _winning(sums: FloatArray, best: IntArray, tied: IntArray, needed: float) -> ContourWinners:
    """Mean normals from the sums (m, 3) over the tied cells, NaN below the score needed."""
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    enough = ((best > 0) & (best >= needed))[:, np.newaxis]
    return ContourWinners(np.where(enough, sums / np.where(length > 0.0, length, 1.0), np.nan), best, tied)
