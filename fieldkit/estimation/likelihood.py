"""Which normals the minutes allow: misfits with stated doubts, and the likelihood region.

Two doubts do not average away and are known beforehand only as standard deviations: the
scale kappa (irradiance, albedo, exchange: measured ``delta S / S`` is kappa times the true one)
and additive ones such as an offset of temperature between regions. `ProfileMisfit` lets
them take their best value at a price, which for additive ones is a Schur complement and for
kappa a parabola: no iteration, any number of normals at once.

The region of all normals with ``q(n) - min q <= 4.61`` is a strip 0.1 degree thin and many
degrees long. It is found on a grid in the likelihood's own axes: the height over the plane
square to the mean sun, and the turn around the mean sun.
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
"""The same with one: tilt alone, the azimuth being known."""
TILTS = 2001
"""Tilts tried along a known azimuth: steps of 0.02 degrees up to the usual limit."""
FREEDOM = 8.0
"""Degrees of freedom of the residuals: heavy tails, at 2 % loss where there are no outliers."""
REACH = 18.0
"""How far the misfit may rise before a normal's share of the posterior (1e-4) is left out."""
MisfitOf = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, slots=True)
class ProfileMisfit:
    """Misfit of normals when the scale is only known to `scale_sd`.

    `misfit` already carries the additive doubts (`with_systematics`); `reference` is the normal
    against which differences were taken.
    """

    misfit: Misfit
    reference: FloatArray
    scale_sd: float

    def __call__(self, normals: FloatArray) -> FloatArray:
        """Misfit of normals (..., 3) at the best scale for each, plus the price of that scale."""
        if self.scale_sd <= 0.0:
            return self.misfit(normals)
        away = normals - self.reference
        pull = self.misfit.b - self.reference @ self.misfit.H
        weight = 1.0 / self.scale_sd**2
        curvature = ((away @ self.misfit.H) * away) @ np.ones(3) + weight
        slope = away @ pull + weight
        return np.asarray(self.misfit(self.reference) + weight - slope**2 / curvature)

    def linearised(self, at: FloatArray) -> FloatArray:
        """The information matrix (3, 3) that is left near one normal."""
        if self.scale_sd <= 0.0:
            return self.misfit.H
        spread = self.misfit.H @ (at - self.reference)
        price = (at - self.reference) @ spread + 1.0 / self.scale_sd**2
        return np.asarray(self.misfit.H - np.outer(spread, spread) / price)


def with_systematics(
    design: FloatArray, y: FloatArray, weights: FloatArray, systematics: FloatArray
) -> Misfit:
    """Misfit of rows whose y may be off by ``t * doubt`` for each doubt, t of standard deviation 1.

    lamps (n, 3), y (n,), weights (n,), doubts (p, n). A doubt of zeros changes nothing.
    """
    table = np.column_stack([design, y, *systematics])
    gram = (table * weights[:, np.newaxis]).T @ table
    prices = np.eye(len(systematics))
    gram = gram[:4, :4] - gram[:4, 4:] @ np.linalg.solve(gram[4:, 4:] + prices, gram[4:, :4])
    return Misfit(gram[:3, :3], gram[:3, 3], gram[3, 3], np.asarray(np.count_nonzero(weights)))


@dataclass(frozen=True, slots=True)
class LikelihoodRegion:
    """Projections of a likelihood region on tilt and azimuth, degrees.

    Azimuths are unwrapped so that low <= estimate <= high: they may lie below 0 or above
    360. `vertical` where the region contains the vertical normal: then every azimuth fits.
    """

    tilt_low_deg: float
    tilt_high_deg: float
    azimuth_low_deg: float
    azimuth_high_deg: float
    vertical: bool


@dataclass(frozen=True, slots=True)
class Patch:
    """A grid of normals (k, 3) of equal solid angle that covers one likelihood region, with misfits."""

    normals: FloatArray
    misfit: FloatArray
    solid_angle: float


@dataclass(frozen=True, slots=True)
class _Box:
    """Ranges of height over the plane square to the mean sun, and of turn around it (radians)."""

    height: tuple[float, float]
    turn: tuple[float, float]

    def grid(self, axes: FloatArray, heights: int, turns: int) -> FloatArray:
        """Normals (heights, turns, 3) at the centres of equal cells."""
        height = _centres(self.height, heights)[:, np.newaxis]
        turn = _centres(self.turn, turns)[np.newaxis, :]
        level = np.sqrt(np.maximum(1.0 - height**2, 0.0))
        parts = [level * np.cos(turn), level * np.sin(turn), np.broadcast_to(height, (heights, turns))]
        return np.stack(parts, axis=-1) @ axes.T

    def cell(self, heights: int, turns: int) -> float:
        """Solid angle of a cell: equal everywhere in these coordinates (Archimedes)."""
        return (self.height[1] - self.height[0]) / heights * (self.turn[1] - self.turn[0]) / turns


def _centres(span: tuple[float, float], cells: int) -> FloatArray:
    return np.asarray(span[0] + (span[1] - span[0]) * (np.arange(cells) + 0.5) / cells)


def patch(
    misfit: MisfitOf,
    information: FloatArray,
    best: FloatArray,
    drop: float,
    *,
    heights: int = 17,
    turns: int = 81,
) -> Patch:
    """Grid over the connected region ``q <= q(best) + drop`` around `best`.

    `information` (3, 3) only steers the axes and the first size; the grid grows until the
    region lies inside and then closes in on it.
    """
    values, vectors = np.linalg.eigh(information)
    axes = vectors * np.where(vectors.T @ best < 0.0, -1.0, 1.0)
    height, turn = float(best @ axes[:, 2]), float(np.arctan2(best @ axes[:, 1], best @ axes[:, 0]))
    level = np.sqrt(max(1.0 - height**2, 1e-12))
    half = np.sqrt(drop / np.maximum(values, 1e-300))
    high, wide = float(min(1.2 * half[2], 1.0)), float(min(1.2 * half[1] / level, np.pi))
    floor = float(misfit(best))
    for _ in range(24):
        box = _Box((max(height - high, -1.0), min(height + high, 1.0)), (turn - wide, turn + wide))
        inside = misfit(box.grid(axes, 13, 33)) <= floor + drop
        up = _touches(np.any(inside, axis=1), box.height[0] > -1.0, box.height[1] < 1.0)
        around = _touches(np.any(inside, axis=0), wide < np.pi, wide < np.pi)
        if not (up or around):
            break
        high, wide = (2.0 * high if up else high), (min(2.0 * wide, np.pi) if around else wide)
    box = _closer(box, inside)
    grid = box.grid(axes, heights, turns)
    return Patch(grid.reshape(-1, 3), misfit(grid).ravel(), box.cell(heights, turns))


def _touches(line: NDArray[np.bool_], low: bool, high: bool) -> bool:
    return bool((low and line[0]) or (high and line[-1]))


def _closer(box: _Box, inside: NDArray[np.bool_]) -> _Box:
    """The part of the box that holds the region, with a cell around."""
    if not inside.any():
        return box
    spans = []
    for span, line in ((box.height, inside.any(axis=1)), (box.turn, inside.any(axis=0))):
        step = (span[1] - span[0]) / line.size
        hits = np.flatnonzero(line)
        low, high = span[0] + (hits[0] - 1) * step, span[0] + (hits[-1] + 2) * step
        spans.append((max(low, span[0]), min(high, span[1])))
    return _Box(spans[0], spans[1])


def region(
    misfit: MisfitOf, information: FloatArray, best: FloatArray, drop: float, tilt_limit_deg: float
) -> LikelihoodRegion:
    """Projections of the likelihood region around `best`, within the tilt limit."""
    found = patch(misfit, information, best, drop)
    least = float(misfit(best))
    inside = found.misfit <= least + drop
    flat = float(misfit(VERTICAL)) <= least + drop and _near(VERTICAL, best, found, inside)
    return project(np.vstack([found.normals[inside], best]), best, flat, tilt_limit_deg)


def _near(vertical: FloatArray, best: FloatArray, found: Patch, inside: NDArray[np.bool_]) -> bool:
    """Whether the vertical belongs to this region and not to one on the far branch."""
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
    """The unbroken stretch of tilts around `best` along one azimuth."""
    tilts, tilt = np.linspace(0.0, tilt_limit_deg, TILTS), float(tilt_azimuth(best)[0])
    rise = np.maximum(misfit(normal(tilts, azimuth_deg)) - float(misfit(best)), 0.0) / drop
    below, above = tilts < tilt, tilts > tilt
    low = _end(tilt, tilts[below][::-1], rise[below][::-1])
    high = _end(tilt, tilts[above], rise[above])
    azimuth = azimuth_deg % 360.0
    return LikelihoodRegion(low, high, azimuth, azimuth, low == 0.0)


def _end(start: float, tilts: FloatArray, rise: FloatArray) -> float:
    """The tilt at which the rise, 0 at `start`, first passes 1 along `tilts` (k,); the last if none does."""
    # a misfit rises as a parabola, so its root is interpolated; the whole region may be narrower than a step
    tilts, root = np.append(start, tilts), np.append(0.0, np.sqrt(rise))
    outside = np.flatnonzero(root > 1.0)
    if not outside.size:
        return float(tilts[-1])
    pair = slice(outside[0] - 1, outside[0] + 1)
    return float(np.interp(1.0, root[pair], tilts[pair]))


_ROUNDS = 30
_LEAST_TILT_DEG = 0.25  # the prior is cut off here, where all azimuths meet


@dataclass(frozen=True, slots=True)
class Posterior:
    """Mean normal (3,), the weights (n,) that the minutes kept, and each branch's share of the mass."""

    mean: FloatArray
    weights: FloatArray
    shares: tuple[float, float]


def posterior(design: FloatArray, y: FloatArray, weights: FloatArray, tilt_limit_deg: float) -> Posterior:
    """Posterior of one slope from rows (n,) with weights 1 / sigma**2, all positive.

    The mean is taken over the branch that holds more of the mass: between two branches
    lies no slope that fits.
    """
    robust, branches = _reweighted(design, y, weights)
    information = Misfit.of_rows(design, y, robust).H
    across = np.linalg.eigh(information)[1][:, 0]

    def misfit(normals: FloatArray) -> FloatArray:
        squares = (normals @ design.T - y) ** 2 * weights
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


def _reweighted(design: FloatArray, y: FloatArray, weights: FloatArray) -> tuple[FloatArray, Branches]:
    """Weights of the t distribution at its own mode, by repeated least squares."""
    robust = weights
    branches = solve(Misfit.of_rows(design, y, robust))
    for _ in range(_ROUNDS):
        squares = (design @ branches.first - y) ** 2 * weights
        fresh = weights * (FREEDOM + 1.0) / (FREEDOM + squares)
        if np.allclose(fresh, robust, rtol=1e-6):
            break
        robust = fresh
        branches = solve(Misfit.of_rows(design, y, robust))
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
