"""Likelihood of a slope: profile misfits, likelihood regions, and the posterior with robust weights.

Two kinds of systematic effects do not average away and are known only by their standard uncertainties: the
scale kappa (irradiance, albedo, exchange: measured ``delta S / S`` is kappa times the true one) and additive
ones such as a temperature offset between regions. Both are nuisance parameters: each takes its best value for
a given normal, penalised by its prior (profile likelihood). For the additive ones that is a Schur complement,
for kappa a parabola: no iteration, any number of normals at once.

The region ``q(n) - min q <= 4.61`` is a strip 0.1 degree thin and many degrees long, which a fixed grid would
step over. The grid therefore lies in the likelihood's own axes: the height over the plane square to the mean
sun, and the rotation about the mean sun.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fieldkit.estimation.normal import Branches, Misfit, solve
from fieldkit.physics.facet import VERTICAL, FloatArray, angle_between_deg, normal, tilt_azimuth

NINETY_PERCENT = 4.605
"""Chi-square quantile of 0.90 with two degrees of freedom."""
NINETY_PERCENT_ONE = 2.706
"""Chi-square quantile of 0.90 with one degree of freedom: tilt alone, azimuth known."""
TILTS = 2001
"""Tilts on the grid along a known azimuth: steps of 0.02 degrees up to the default limit."""
STUDENT_FREEDOM = 8.0
"""Degrees of freedom of the Student-t residuals: heavy tails, at 2 % loss of efficiency without outliers."""
POSTERIOR_DROP = 18.0
"""Misfit above the least at which a normal's share of the posterior (1e-4) is neglected."""
MisfitOf = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, slots=True)
class ProfileMisfit:
    """Misfit of normals with the scale profiled out, whose standard uncertainty is `scale_sd`.

    `misfit` already includes the additive effects (`with_systematics`); `reference` (3,) is the normal that
    differences refer to.
    """

    misfit: Misfit
    reference: FloatArray
    scale_sd: float

    def __call__(self, normals: FloatArray) -> FloatArray:
        """Misfit of normals (..., 3) at the best scale for each, with the penalty of that scale."""
        if self.scale_sd <= 0.0:
            return self.misfit(normals)
        away = normals - self.reference
        pull = self.misfit.b - self.reference @ self.misfit.H
        weight = 1.0 / self.scale_sd**2
        curvature = ((away @ self.misfit.H) * away) @ np.ones(3) + weight
        gradient = away @ pull + weight
        return np.asarray(self.misfit(self.reference) + weight - gradient**2 / curvature)

    def linearised(self, at: FloatArray) -> FloatArray:
        """Information matrix (3, 3) near one normal, after the scale has taken its part."""
        if self.scale_sd <= 0.0:
            return self.misfit.H
        spread = self.misfit.H @ (at - self.reference)
        curvature = (at - self.reference) @ spread + 1.0 / self.scale_sd**2
        return np.asarray(self.misfit.H - np.outer(spread, spread) / curvature)


def with_systematics(
    design: FloatArray, y: FloatArray, weights: FloatArray, systematics: FloatArray
) -> Misfit:
    """Misfit with additive systematic effects profiled out, each with a standard normal prior.

    Parameters
    ----------
    design
        Design vectors, shape (n, 3). [-]
    y
        Measured cosines of incidence, (n,). [-]
    weights
        Inverse variances of `y`, (n,); zero excludes a row. [-]
    systematics
        Change of `y` for one standard uncertainty of each effect, (p, n); zeros change nothing. [-]
    """
    table = np.column_stack([design, y, *systematics])
    gram = (table * weights[:, np.newaxis]).T @ table
    priors = np.eye(len(systematics))  # every effect is in units of its own uncertainty
    gram = gram[:4, :4] - gram[:4, 4:] @ np.linalg.solve(gram[4:, 4:] + priors, gram[4:, :4])
    return Misfit(gram[:3, :3], gram[:3, 3], gram[3, 3], np.asarray(np.count_nonzero(weights)))


@dataclass(frozen=True, slots=True)
class LikelihoodRegion:
    """Projections of a likelihood region on tilt and azimuth, degrees.

    Azimuths are unwrapped so that low <= estimate <= high: they may lie below 0 or above 360.
    `vertical`: the region contains the vertical normal, so every azimuth fits.
    """

    tilt_low_deg: float
    tilt_high_deg: float
    azimuth_low_deg: float
    azimuth_high_deg: float
    vertical: bool


@dataclass(frozen=True, slots=True)
class Patch:
    """Grid of normals (k, 3) of equal `solid_angle` [sr] over one likelihood region, with misfits (k,)."""

    normals: FloatArray
    misfit: FloatArray
    solid_angle: float


@dataclass(frozen=True, slots=True)
class _Box:
    """Ranges of the height over the plane square to the mean sun, and of the rotation about it, rad."""

    height: tuple[float, float]
    rotation: tuple[float, float]

    def grid(self, axes: FloatArray, heights: int, rotations: int) -> FloatArray:
        """Normals (heights, turns, 3) at the centres of equal cells."""
        height = _centres(self.height, heights)[:, np.newaxis]
        rotation = _centres(self.rotation, rotations)[np.newaxis, :]
        level = np.sqrt(np.maximum(1.0 - height**2, 0.0))
        parts = [
            level * np.cos(rotation),
            level * np.sin(rotation),
            np.broadcast_to(height, (heights, rotations)),
        ]
        return np.stack(parts, axis=-1) @ axes.T

    def cell(self, heights: int, rotations: int) -> float:
        """Solid angle of a cell: equal everywhere, since height and rotation preserve area (Archimedes)."""
        return (self.height[1] - self.height[0]) / heights * (self.rotation[1] - self.rotation[0]) / rotations


def _centres(span: tuple[float, float], cells: int) -> FloatArray:
    return np.asarray(span[0] + (span[1] - span[0]) * (np.arange(cells) + 0.5) / cells)


def patch(
    misfit: MisfitOf,
    information: FloatArray,
    best: FloatArray,
    drop: float,
    *,
    heights: int = 17,
    rotations: int = 81,
) -> Patch:
    """Grid over the connected region ``q <= q(best) + drop`` around `best`.

    Parameters
    ----------
    misfit
        Misfit of normals (..., 3).
    information
        Information matrix (3, 3): sets the axes and the first size only; the grid grows until the region lies
        inside, then shrinks to it.
    best
        Unit normal of least misfit, (3,).
    drop
        Misfit above the least that bounds the region: a chi-square quantile.
    heights, rotations
        Cells of the grid along its two axes.
    """
    values, vectors = np.linalg.eigh(information)
    axes = vectors * np.where(vectors.T @ best < 0.0, -1.0, 1.0)
    height, rotation = float(best @ axes[:, 2]), float(np.arctan2(best @ axes[:, 1], best @ axes[:, 0]))
    level = np.sqrt(max(1.0 - height**2, 1e-12))
    half = np.sqrt(drop / np.maximum(values, 1e-300))
    high, wide = float(min(1.2 * half[2], 1.0)), float(min(1.2 * half[1] / level, np.pi))
    floor = float(misfit(best))
    for _ in range(24):
        box = _Box((max(height - high, -1.0), min(height + high, 1.0)), (rotation - wide, rotation + wide))
        inside = misfit(box.grid(axes, 13, 33)) <= floor + drop
        up = _touches(np.any(inside, axis=1), box.height[0] > -1.0, box.height[1] < 1.0)
        around = _touches(np.any(inside, axis=0), wide < np.pi, wide < np.pi)
        if not (up or around):
            break
        high, wide = (2.0 * high if up else high), (min(2.0 * wide, np.pi) if around else wide)
    box = _closer(box, inside)
    grid = box.grid(axes, heights, rotations)
    return Patch(grid.reshape(-1, 3), misfit(grid).ravel(), box.cell(heights, rotations))


def _touches(line: NDArray[np.bool_], low: bool, high: bool) -> bool:
    return bool((low and line[0]) or (high and line[-1]))


def _closer(box: _Box, inside: NDArray[np.bool_]) -> _Box:
    """The part of the box that contains the region, with a margin of one cell."""
    if not inside.any():
        return box
    spans = []
    for span, line in ((box.height, inside.any(axis=1)), (box.rotation, inside.any(axis=0))):
        step = (span[1] - span[0]) / line.size
        hits = np.flatnonzero(line)
        low, high = span[0] + (hits[0] - 1) * step, span[0] + (hits[-1] + 2) * step
        spans.append((max(low, span[0]), min(high, span[1])))
    return _Box(spans[0], spans[1])


def region(
    misfit: MisfitOf, information: FloatArray, best: FloatArray, drop: float, tilt_limit_deg: float
) -> LikelihoodRegion:
    """Projections of the likelihood region around `best` on tilt and azimuth, within the tilt limit.

    Parameters as of `patch`; `tilt_limit_deg` in degrees.
    """
    found = patch(misfit, information, best, drop)
    least = float(misfit(best))
    inside = found.misfit <= least + drop
    flat = float(misfit(VERTICAL)) <= least + drop and _near(VERTICAL, best, found, inside)
    return project(np.vstack([found.normals[inside], best]), best, flat, tilt_limit_deg)


def _near(vertical: FloatArray, best: FloatArray, found: Patch, inside: NDArray[np.bool_]) -> bool:
    """Whether the vertical belongs to this region and not to that of the other branch."""
    reach = float(np.max(angle_between_deg(found.normals[inside], best), initial=0.0))
    return bool(angle_between_deg(vertical, best) <= reach + 0.5)


def project(normals: FloatArray, best: FloatArray, flat: bool, tilt_limit_deg: float) -> LikelihoodRegion:
    """Ranges of tilt and azimuth of normals (k, 3), cut at the tilt limit."""
    tilts, azimuths = tilt_azimuth(normals)
    allowed = tilts <= tilt_limit_deg
    if not allowed.any():
        return LikelihoodRegion(*(float("nan"),) * 4, flat)
    tilts, azimuths = tilts[allowed], azimuths[allowed]
    centre = float(tilt_azimuth(best)[1])
    if flat:
        return LikelihoodRegion(0.0, float(tilts.max()), centre - 180.0, centre + 180.0, True)
    turned = (azimuths - centre + 180.0) % 360.0 - 180.0
    return LikelihoodRegion(
        float(tilts.min()),
        float(tilts.max()),
        centre + float(turned.min()),
        centre + float(turned.max()),
        False,
    )


def region_known_azimuth(
    misfit: MisfitOf, azimuth_deg: float, best: FloatArray, drop: float, tilt_limit_deg: float
) -> LikelihoodRegion:
    """The connected interval of tilts around `best` along one azimuth, degrees; parameters as of `region`."""
    tilts, tilt = np.linspace(0.0, tilt_limit_deg, TILTS), float(tilt_azimuth(best)[0])
    excess = np.maximum(misfit(normal(tilts, azimuth_deg)) - float(misfit(best)), 0.0) / drop
    below, above = tilts < tilt, tilts > tilt
    low = _end(tilt, tilts[below][::-1], excess[below][::-1])
    high = _end(tilt, tilts[above], excess[above])
    azimuth = azimuth_deg % 360.0
    return LikelihoodRegion(low, high, azimuth, azimuth, low == 0.0)


def _end(start: float, tilts: FloatArray, excess: FloatArray) -> float:
    """Tilt at which the excess misfit, 0 at `start`, first exceeds 1 along `tilts` (k,); else the last."""
    # a misfit grows as a parabola, so its root is interpolated: the region may be narrower than one step
    tilts, root = np.append(start, tilts), np.append(0.0, np.sqrt(excess))
    outside = np.flatnonzero(root > 1.0)
    if not outside.size:
        return float(tilts[-1])
    pair = slice(outside[0] - 1, outside[0] + 1)
    return float(np.interp(1.0, root[pair], tilts[pair]))


_ROUNDS = 30
_LEAST_TILT_DEG = 0.25  # the prior is cut off here, where all azimuths meet


@dataclass(frozen=True, slots=True)
class Posterior:
    """Mean normal (3,), robust weights of the rows (n,), and each branch's share of the probability."""

    mean: FloatArray
    weights: FloatArray
    shares: tuple[float, float]


def posterior(design: FloatArray, y: FloatArray, weights: FloatArray, tilt_limit_deg: float) -> Posterior:
    """Posterior mean of a slope where some minute bins are outliers: Student-t residuals.

    The prior is uniform in tilt and azimuth up to the tilt limit: gentle slopes are more common than steep
    ones, per solid angle as 1 / sin(tilt). One grid covers each branch; the plane of the sun's motion divides
    the sphere between them. The mean is of the branch with more probability: between two branches lies no
    slope that fits.

    Parameters
    ----------
    design
        Design vectors, shape (n, 3). [-]
    y
        Measured cosines of incidence, (n,), finite. [-]
    weights
        Inverse variances of `y`, (n,), all positive. [-]
    tilt_limit_deg
        Largest tilt of the prior. [degrees]

    References
    ----------
    K. Lange, R. Little and J. Taylor, "Robust statistical modeling using the t distribution", Journal of the
    American Statistical Association 84, 1989.
    """
    robust, branches = _reweighted(design, y, weights)
    information = Misfit.of_rows(design, y, robust).H
    across = np.linalg.eigh(information)[1][:, 0]

    def misfit(normals: FloatArray) -> FloatArray:
        squares = (normals @ design.T - y) ** 2 * weights
        return np.asarray((STUDENT_FREEDOM + 1.0) * np.sum(np.log1p(squares / STUDENT_FREEDOM), axis=-1))

    starts = [branches.first] if branches.merged else [branches.first, branches.second]
    patches = [
        patch(misfit, information, start, POSTERIOR_DROP, heights=21, rotations=121) for start in starts
    ]
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


def _reweighted(design: FloatArray, y: FloatArray, weights: FloatArray) -> tuple[FloatArray, Branches]:
    """Weights of the t distribution at its mode, by iteratively reweighted least squares."""
    robust = weights
    branches = solve(Misfit.of_rows(design, y, robust))
    for _ in range(_ROUNDS):
        squares = (design @ branches.first - y) ** 2 * weights
        updated = weights * (STUDENT_FREEDOM + 1.0) / (STUDENT_FREEDOM + squares)
        if np.allclose(updated, robust, rtol=1e-6):
            break
        robust = updated
        branches = solve(Misfit.of_rows(design, y, robust))
    return robust, branches


def _moments(found: Patch, floor: float, tilt_limit_deg: float, side: FloatArray) -> tuple[float, FloatArray]:
    """Mass and mean normal of the part of a patch within the tilt limit and on its own side of the fold."""
    tilts = tilt_azimuth(found.normals)[0]
    allowed = (tilts <= tilt_limit_deg) & (found.normals @ side >= 0.0)
    prior = 1.0 / np.sin(np.radians(np.maximum(tilts, _LEAST_TILT_DEG)))
    mass = np.where(allowed, prior * np.exp(-0.5 * (found.misfit - floor)), 0.0)
    mean = mass @ found.normals
    length = float(np.linalg.norm(mean))
    total = float(mass.sum()) * found.solid_angle
    return total, mean / length if length > 0.0 else np.full(3, np.nan)
