"""The likelihood of each pixel's normal, and what follows from it: standard uncertainties and risk.

In the plane of the sun's motion a pixel's likelihood is an ellipse (`pixel_slopes`); a point of that plane
has one normal on either side of it, which the misfit across the plane weighs against each other. Points of a
Fibonacci lattice [1]_, as normal deviates, stand for the ellipse; they are weighted by the prior of the map,
uniform in tilt and azimuth up to the tilt limit.

.. [1] H. Niederreiter, "Random number generation and quasi-Monte Carlo methods", SIAM 1992, section 5.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from fieldkit.estimation.distributions import normal_quantile
from fieldkit.model.arrays import AnyArray, BoolArray, FloatArray, IndexArray, SingleArray

Measure = Callable[[AnyArray], AnyArray]
"""A number of every unit normal: (..., 3) to (...)."""

NODES, GENERATOR = 55, 34
"""Points of the lattice: probabilities are good to about 0.03."""
PIECE = 2048  # pixels at a time: every one has a lattice of normals
LEAST_ACROSS = 0.05
"""Least distance from the plane of the sun's motion, where the sphere stands square to it."""
LEAST_SINE = 0.01
"""Sine of the least tilt that the prior tells from flat."""
NO_SECOND = 0.01
"""Weight below which the second branch is excluded."""
TAIL = 0.1
"""Share of the steepest tilts that the conditional value at risk is the mean of."""


@dataclass(frozen=True, slots=True)
class PixelPosterior:
    """Likelihood of the normals of a map, in the axes of the sun's motion.

    `known` (rows, cols) are the pixels with a slope, m in all. `at` (m, 3) are their normals along the mean
    sun, along its motion and across both, the rows of `axes` (3, 3); `covariance` (m, 2, 2) is of the first
    two. `second` (m,) is the likelihood of the branch on the other side over that of the chosen one,
    `tilt_limit_deg` the largest tilt considered.
    """

    known: BoolArray
    at: FloatArray
    covariance: FloatArray
    second: FloatArray
    axes: FloatArray
    tilt_limit_deg: float

    def pieces(self) -> Iterator[tuple[IndexArray, SingleArray, SingleArray]]:
        """Some pixels at a time: their numbers (p,), normals (k, p, 3) and weights (k, p) that sum to 1."""
        has_two = self.second > NO_SECOND
        for pixels, sides in ((np.flatnonzero(~has_two), 1), (np.flatnonzero(has_two), 2)):
            for begin in range(0, pixels.size, PIECE):
                some = pixels[begin : begin + PIECE]
                yield some, *self._nodes(some, sides)

    def _nodes(self, pixels: IndexArray, sides: int) -> tuple[SingleArray, SingleArray]:
        half_axes = np.linalg.cholesky(self.covariance[pixels]).astype(np.float32)
        plane = np.moveaxis(half_axes @ _lattice().T, 2, 0) + self.at[pixels, :2].astype(np.float32)
        # beyond the unit circle there is no normal: the nearest one is on it
        plane /= np.maximum(np.hypot(plane[..., 0], plane[..., 1]), np.float32(1.0))[..., np.newaxis]
        across = np.sqrt(np.maximum(np.float32(1.0) - (plane * plane).sum(axis=-1), np.float32(0.0)))
        across *= np.where(self.at[pixels, 2] < 0.0, -1.0, 1.0).astype(np.float32)
        parts = [np.concatenate([plane, sign * across[..., np.newaxis]], axis=-1) for sign in (1, -1)[:sides]]
        normals = np.concatenate(parts) @ self.axes.astype(np.float32)
        weights = _prior(normals, self.tilt_limit_deg)
        # the likelihood is over the plane, the prior per solid angle, which is dA / |across|
        weights /= np.maximum(np.abs(np.tile(across, (sides, 1))), LEAST_ACROSS)
        weights[NODES:] *= self.second[pixels].astype(np.float32)
        return normals, weights / weights.sum(axis=0)

    def deviations(
        self, measures: Mapping[str, Measure], *, cyclic: frozenset[str] = frozenset()
    ) -> dict[str, SingleArray]:
        """Standard uncertainties of numbers that follow from the normal, by name, (rows, cols); NaN without a
        slope.

        Root mean square deviations from the mapped value; angles in degrees named in `cyclic` begin anew
        after a turn.
        """
        best = (self.at @ self.axes).astype(np.float32)
        by_measure = {name: np.full(len(best), np.nan, np.float32) for name in measures}
        for pixels, normals, weights in self.pieces():
            for name, measure in measures.items():
                off = measure(normals) - measure(best[pixels])
                if name in cyclic:
                    off = (off + 180.0) % 360.0 - 180.0
                by_measure[name][pixels] = np.sqrt((weights * off * off).sum(axis=0))
        return {name: self._on_map(values) for name, values in by_measure.items()}

    def risk(self, limit_deg: float) -> tuple[SingleArray, SingleArray]:
        """P(tilt > limit) of each pixel, and the mean of the steepest tenth of the tilts that fit, in
        degrees.

        Shape (rows, cols) each, NaN without a slope. The mean is the conditional value at risk.
        """
        steeper, worst = (np.full(len(self.at), np.nan, np.float32) for _ in range(2))
        for pixels, normals, weights in self.pieces():
            up = normals[..., 2]
            steep = (weights * (up < np.cos(np.radians(limit_deg)))).sum(axis=0)
            steeper[pixels] = np.minimum(steep, 1.0)  # their sum rounds to more
            # the mean tilt of the weight `TAIL` with the least upward components
            order = np.argsort(up, axis=0)
            tilt = np.degrees(np.arccos(np.clip(np.take_along_axis(up, order, 0), -1.0, 1.0)))
            weight = np.take_along_axis(weights, order, 0)
            tail = np.clip(TAIL - (np.cumsum(weight, axis=0) - weight), 0.0, weight)
            worst[pixels] = (tail * tilt).sum(axis=0) / tail.sum(axis=0)
        return self._on_map(steeper), self._on_map(worst)

    def _on_map(self, values: SingleArray) -> SingleArray:
        plane = np.full(self.known.shape, np.nan, np.float32)
        plane[self.known] = values
        return plane


def _lattice() -> SingleArray:
    """Pairs of independent standard normal deviates, shape (NODES, 2)."""
    steps = np.arange(NODES)
    shares = np.column_stack([steps, steps * GENERATOR % NODES]) + 0.5
    return normal_quantile(shares / NODES).astype(np.float32)


def _prior(normals: SingleArray, limit_deg: float) -> SingleArray:
    """Per solid angle, uniform in tilt and azimuth; beyond the limit as good as none."""
    up = normals[..., 2]
    sine = np.sqrt(np.maximum(1.0 - up * up, LEAST_SINE**2))
    return np.asarray(np.where(up < np.cos(np.radians(limit_deg)), 1e-6, 1.0) / sine, np.float32)
