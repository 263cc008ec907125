"""Posterior mean of a slope where some minutes are outliers, by Student-t residuals.

K. Lange, R. Little and J. Taylor, "Robust statistical modeling using the t distribution", Journal of the
American Statistical Association 84, 1989.
"""

from __future__ import annotations

import numpy as np

from fieldkit.estimation.likelihood import Patches, patches
from fieldkit.estimation.normal import Branches, Misfit, solve
from fieldkit.model.arrays import FloatArray
from fieldkit.physics.facet import tilt_azimuth

STUDENT_FREEDOM = 8.0
"""Degrees of freedom of the Student-t residuals: heavy tails, at 2 % loss of efficiency without outliers."""
POSTERIOR_DROP = 18.0
"""Misfit above the least at which a normal's share of the posterior (1e-4) is neglected."""
ROUNDS = 30
LEAST_TILT_DEG = 0.25
"""The prior is cut off here, where all azimuths meet."""


def posterior(design: FloatArray, y: FloatArray, weights: FloatArray, tilt_limit_deg: float) -> FloatArray:
    """Posterior mean (3,) of a slope where some minute bins are outliers: Student-t residuals.

    `design` (n, 3) and the measured cosines `y` (n,) are finite, the inverse variances `weights` (n,)
    positive. The prior is uniform in tilt and azimuth up to the tilt limit: gentle slopes are more common
    than steep ones, per solid angle as 1 / sin(tilt). One grid covers each branch; the plane of the sun's
    motion divides the sphere between them. The mean is of the branch with more probability: between two
    branches lies no slope that fits.
    """
    robust, branches = _reweight(design, y, weights)
    information = Misfit.of_rows(design, y, robust).H
    across = np.linalg.eigh(information)[1][:, 0]

    def misfit(normals: FloatArray) -> FloatArray:
        squares = (normals @ design.T - y) ** 2 * weights
        return np.asarray((STUDENT_FREEDOM + 1.0) * np.sum(np.log1p(squares / STUDENT_FREEDOM), axis=-1))

    starts = [branches.first] if branches.merged else [branches.first, branches.second]
    every, normals = np.broadcast_to(information, (len(starts), 3, 3)), np.stack(starts)
    bound = misfit(normals) + POSTERIOR_DROP
    around = patches(
        lambda grid: misfit(grid.normals()), every, normals, bound, POSTERIOR_DROP, heights=21, turns=121
    )
    floor = float(around.misfit.min())
    # patches of two branches may overlap: each counts on its own side of the fold only
    sides = [np.zeros(3) if branches.merged else across * np.sign(start @ across) for start in starts]
    moments = [_moments(around, branch, floor, tilt_limit_deg, side) for branch, side in enumerate(sides)]
    mass, mean = max(moments, key=lambda moment: moment[0])
    return mean if mass > 0.0 else branches.first


def _reweight(design: FloatArray, y: FloatArray, weights: FloatArray) -> tuple[FloatArray, Branches]:
    """Weights of the t distribution at its mode, by iteratively reweighted least squares."""
    robust = weights
    branches = solve(Misfit.of_rows(design, y, robust))
    for _ in range(ROUNDS):
        squares = (design @ branches.first - y) ** 2 * weights
        updated = weights * (STUDENT_FREEDOM + 1.0) / (STUDENT_FREEDOM + squares)
        if np.allclose(updated, robust, rtol=1e-6):
            break
        robust = updated
        branches = solve(Misfit.of_rows(design, y, robust))
    return robust, branches


def _moments(
    around: Patches, branch: int, floor: float, tilt_limit_deg: float, side: FloatArray
) -> tuple[float, FloatArray]:
    """Mass and mean normal of the part of a patch within the tilt limit and on its own side of the fold."""
    normals = around.grid.normals()[branch].reshape(-1, 3)
    tilts = tilt_azimuth(normals)[0]
    allowed = (tilts <= tilt_limit_deg) & (normals @ side >= 0.0)
    prior = 1.0 / np.sin(np.radians(np.maximum(tilts, LEAST_TILT_DEG)))
    mass = np.where(allowed, prior * np.exp(-0.5 * (around.misfit[branch].ravel() - floor)), 0.0)
    mean = mass @ normals
    length = float(np.linalg.norm(mean))
    total = float(mass.sum() * around.solid_angle[branch])
    return total, mean / length if length > 0.0 else np.full(3, np.nan)
