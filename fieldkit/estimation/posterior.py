"""The posterior of a slope when some minutes are simply wrong: Student-t residuals on a local grid.

The prior is uniform in tilt and in azimuth up to the tilt limit: gentle slopes are more
common than steep ones, per solid angle as 1 / sin(tilt). In twenty minutes the
likelihood is a strip 0.1 degree thin, which any fixed grid would step over, so the grid
lies along the likelihood's own axes (`likelihood.patch`), one around each branch; the
plane of the sun's motion divides the sphere between them.

K. Lange, R. Little and J. Taylor, "Robust statistical modeling using the t distribution",
Journal of the American Statistical Association 84, 1989.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fieldkit.estimation.likelihood import Patch, patch
from fieldkit.estimation.normal import Branches, Misfit, solve
from fieldkit.physics.facet import FloatArray, tilt_azimuth

FREEDOM = 8.0
"""Degrees of freedom of the residuals: heavy tails, at 2 % loss where there are no outliers."""
REACH = 18.0
"""How far the misfit may rise before a normal's share of the posterior (1e-4) is left out."""
_ROUNDS = 30
_LEAST_TILT_DEG = 0.25  # the prior is cut off here, where all azimuths meet


@dataclass(frozen=True, slots=True)
class Posterior:
    """Mean normal (3,), the weights (n,) that the minutes kept, and each branch's share of the mass."""

    mean: FloatArray
    weights: FloatArray
    shares: tuple[float, float]


def posterior(lamps: FloatArray, y: FloatArray, weights: FloatArray, tilt_limit_deg: float) -> Posterior:
    """Posterior of one slope from rows (n,) with weights 1 / sigma**2, all positive.

    The mean is taken over the branch that holds more of the mass: between two branches
    lies no slope that fits.
    """
    robust, branches = _reweighted(lamps, y, weights)
    information = Misfit.of_rows(lamps, y, robust).H
    across = np.linalg.eigh(information)[1][:, 0]

    def misfit(normals: FloatArray) -> FloatArray:
        squares = (normals @ lamps.T - y) ** 2 * weights
        return np.asarray((FREEDOM + 1.0) * np.sum(np.log1p(squares / FREEDOM), axis=-1))

    starts = [branches.first] if branches.merged else [branches.first, branches.second]
    patches = [patch(misfit, information, start, REACH, heights=21, turns=121) for start in starts]
    floor = min(float(found.misfit.min()) for found in patches)
    sides = [np.zeros(3) if branches.merged else across * np.sign(start @ across) for start in starts]
    moments = [
        _moments(found, floor, tilt_limit_deg, side) for found, side in zip(patches, sides, strict=True)
    ]
    masses = [mass for mass, _ in moments]
    total = sum(masses)
    if total == 0.0:
        return Posterior(branches.first, robust, (1.0, 0.0))
    shares = [mass / total for mass in masses] + [0.0]
    return Posterior(moments[int(np.argmax(masses))][1], robust, (shares[0], shares[1]))


def _reweighted(lamps: FloatArray, y: FloatArray, weights: FloatArray) -> tuple[FloatArray, Branches]:
    """Weights of the t distribution at its own mode, by repeated least squares."""
    robust = weights
    branches = solve(Misfit.of_rows(lamps, y, robust))
    for _ in range(_ROUNDS):
        squares = (lamps @ branches.first - y) ** 2 * weights
        fresh = weights * (FREEDOM + 1.0) / (FREEDOM + squares)
        if np.allclose(fresh, robust, rtol=1e-6):
            break
        robust = fresh
        branches = solve(Misfit.of_rows(lamps, y, robust))
    return robust, branches


def _moments(found: Patch, floor: float, tilt_limit_deg: float, side: FloatArray) -> tuple[float, FloatArray]:
    """Mass and mean normal of the part of a patch that is allowed and on its own side of the fold."""
    tilts = tilt_azimuth(found.normals)[0]
    allowed = (tilts <= tilt_limit_deg) & (found.normals @ side >= 0.0)
    prior = 1.0 / np.sin(np.radians(np.maximum(tilts, _LEAST_TILT_DEG)))
    mass = np.where(allowed, prior * np.exp(-0.5 * (found.misfit - floor)), 0.0)
    mean = mass @ found.normals
    length = float(np.linalg.norm(mean))
    total = float(mass.sum()) * found.solid_angle
    return total, mean / length if length > 0.0 else np.full(3, np.nan)
