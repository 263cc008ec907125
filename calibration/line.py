"""A straight line through points with errors in both axes, through the origin or with an intercept.

Maximum likelihood by effective variances ``sd_y**2 + (slope sd_x)**2`` (Deming; D. York et al., "Unified
equations for the slope, intercept, and standard errors of the best straight line", Am. J. Phys. 72, 2004).
Ordinary regression takes x for exact and finds too flat a line.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import optimize

from fieldkit.model.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class Points:
    """Points (n,) and the standard uncertainties of their coordinates, independent from point to point."""

    x: FloatArray
    y: FloatArray
    x_sd: FloatArray
    y_sd: FloatArray

    def variance(self, slope: float) -> FloatArray:
        """Variance of ``y - slope x`` of each point."""
        return np.asarray(self.y_sd**2 + (slope * self.x_sd) ** 2)


@dataclass(frozen=True, slots=True)
class Line:
    """A fitted line; `residuals` (n,) are ``y - intercept - slope x``."""

    slope: float
    slope_sd: float
    intercept: float
    chi_square: float
    freedom: int
    residuals: FloatArray


def fit_line(points: Points, *, origin: bool) -> Line:
    """Most likely straight line through points with errors in both coordinates.

    Two points or more (three for a line with an intercept), not all at one place; the line has n - 1 or n - 2
    degrees of freedom (doi:10.1119/1.1632486).
    """

    def intercept(slope: float) -> float:
        weights = 1.0 / points.variance(slope)
        return 0.0 if origin else float(np.average(points.y - slope * points.x, weights=weights))

    def misfit(slope: float) -> float:
        residuals = points.y - slope * points.x - intercept(slope)
        return float(np.sum(residuals**2 / points.variance(slope)))

    guess = _ordinary(points, origin)
    minimum = optimize.minimize_scalar(misfit, bracket=(0.9 * guess, 1.1 * guess), options={"xtol": 1e-10})
    slope = float(minimum.x)
    step = 1e-3 * abs(guess)
    curvature = (misfit(slope + step) - 2.0 * misfit(slope) + misfit(slope - step)) / step**2
    return Line(
        slope=slope,
        slope_sd=float(np.sqrt(2.0 / curvature)) if curvature > 0.0 else float("inf"),
        intercept=intercept(slope),
        chi_square=misfit(slope),
        freedom=points.x.size - (1 if origin else 2),
        residuals=np.asarray(points.y - slope * points.x - intercept(slope)),
    )


def _ordinary(points: Points, origin: bool) -> float:
    """Slope by ordinary least squares, as a first guess."""
    x, y = (points.x, points.y) if origin else (points.x - points.x.mean(), points.y - points.y.mean())
    slope = float(x @ y) / max(float(x @ x), 1e-300)
    return slope if slope != 0.0 else 1e-3
