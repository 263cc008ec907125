"""Likelihood of a slope: profile misfits, likelihood regions, along a free or a known azimuth.

Two kinds of systematic effects do not average away and are known only by their standard uncertainties: the
scale kappa (irradiance, albedo, exchange: measured ``delta S / S`` is kappa times the true one) and additive
ones such as a temperature offset between regions. Both are nuisance parameters: each takes its best value for
a given normal, penalised by its prior (profile likelihood). For the additive ones that is a Schur complement,
for kappa a parabola: no iteration, any number of normals at once.

The region ``q(n) - min q <= misfit_drop`` is a strip 0.1 degree thin and many degrees long, which a fixed
grid would step over. The grid therefore lies in the likelihood's own axes: the height over the plane square
to the mean sun, and the rotation about the mean sun.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from fieldkit.estimation.normal import Misfit
from fieldkit.model.arrays import BoolArray, FloatArray, IntArray
from fieldkit.physics.facet import VERTICAL, angle_between_deg, normal, tilt_azimuth

TILTS = 2001
"""Tilts on the grid along a known azimuth: steps of 0.02 degrees up to the default limit."""


@dataclass(frozen=True, slots=True)
class Grid:
    """Normals of m slopes around the poles of `axes` (m, 3, 3), whose last column is the mean sun.

    At every height over the plane square to the pole, `height` (m, k), and every turn about it, `turn`
    (m, l), in radians.
    """

    axes: FloatArray
    height: FloatArray
    turn: FloatArray

    @property
    def level(self) -> FloatArray:
        """Distances from the pole's axis (m, k)."""
        return np.sqrt(np.maximum(1.0 - self.height**2, 0.0))

    @property
    def ring(self) -> FloatArray:
        """Directions square to the pole (m, l, 3)."""
        return np.stack([np.cos(self.turn), np.sin(self.turn)], axis=-1) @ np.swapaxes(self.axes, 1, 2)[:, :2]

    def normals(self) -> FloatArray:
        """All of them (m, k, l, 3)."""
        around = self.level[:, :, np.newaxis, np.newaxis] * self.ring[:, np.newaxis]
        upwards = self.height[..., np.newaxis] * self.axes[:, np.newaxis, :, 2]
        return np.asarray(around + upwards[:, :, np.newaxis])

    def quadratic(self, H: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
        """``n'Hn - 2 b'n + c`` (m, k, l), for matrices (m, 3, 3), vectors (m, 3) and numbers (m,)."""
        ring, pole, height, level = self.ring, self.axes[:, :, 2], self.height, self.level
        pulled = (pole[:, np.newaxis] @ H)[:, 0]
        constant = height**2 * _dot(pole, pulled)[:, np.newaxis] + c[:, np.newaxis]
        constant -= 2.0 * height * _dot(pole, b)[:, np.newaxis]
        around = _dot(ring @ H, ring)
        return _products(
            (level**2, around),
            (level * height, 2.0 * _dot(ring, pulled[:, np.newaxis])),
            (level, -2.0 * _dot(ring, b[:, np.newaxis])),
            (constant, np.ones_like(around)),
        )


def _dot(one: FloatArray, other: FloatArray) -> FloatArray:
    return np.asarray((one * other) @ np.ones(3))


def _products(*pairs: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Sum of the outer products (m, k, l) of pairs (m, k) and (m, l)."""
    heights, turns = zip(*pairs, strict=True)
    return np.asarray(np.stack(heights, axis=2) @ np.stack(turns, axis=1))


OnGrid = Callable[[Grid], FloatArray]
"""Misfits (m, k, l) of the normals of a grid."""


@dataclass(frozen=True)
class ProfileMisfit:
    """Misfit of normals with the scale and what is uncertain of the light profiled out.

    The effects of these are linear in ``(n - reference, 1)`` and so depend on the slope. `gram`, of one slope
    or many, sums the weighted products of the rows' columns (..., 4 + 4 q, 4 + 4 q), the additive effects
    already profiled out: design (3), cosine, then the four of each property of the light. `reference` (3,) is
    the normal that differences refer to, `scale_sd` the standard uncertainty of the scale.
    """

    gram: FloatArray
    reference: FloatArray
    scale_sd: float

    @classmethod
    def of(cls, misfit: Misfit, reference: FloatArray, scale_sd: float) -> ProfileMisfit:
        """With a light that is certain; `misfit` already includes the additive effects."""
        b, c = misfit.b[..., np.newaxis], np.asarray(misfit.c)[..., np.newaxis, np.newaxis]
        H = np.broadcast_to(misfit.H, (*b.shape[:-1], 3))
        return cls(np.block([[H, b], [np.swapaxes(b, -1, -2), c]]), reference, scale_sd)

    def __call__(self, normals: FloatArray) -> FloatArray:
        """Misfit of normals (..., 3) at the best scale and light for each, with their penalties."""
        return self._profile(lambda form: form(normals))

    def on_grid(self, grid: Grid) -> FloatArray:
        """The same of the normals of a grid, for many slopes."""
        return self._profile(lambda form: grid.quadratic(form.H, form.b, form.c))

    def _profile(self, value: Callable[[Misfit], FloatArray]) -> FloatArray:
        """Products of the residual (0) and the effects (1 ...), each of which is eliminated in turn."""
        products = {place: value(form) for place, form in self._forms.items()}
        # Schur complement, effect by effect: q - (r'e)^2 / (e'e + 1)
        for effect in range(len(self._columns) - 1, 0, -1):
            price = products[effect, effect] + 1.0  # in units of its own uncertainty
            for row, column in products:
                if row <= column < effect:
                    shared = products[row, effect] * products[column, effect]
                    products[row, column] = products[row, column] - shared / price
        return np.asarray(products[0, 0])

    @cached_property
    def _forms(self) -> dict[tuple[int, int], Misfit]:
        """Products of residual and effects, as quadratic forms of the normal."""
        columns = self._columns
        return {
            (row, column): self._form(columns[row].T @ self.gram @ columns[column])
            for row in range(len(columns))
            for column in range(row, len(columns))
        }

    @cached_property
    def _columns(self) -> list[FloatArray]:
        """Residual and effects, by ``(n - reference, 1)``, as combinations (4 + 4 q, 4) of the columns."""
        light = np.split(np.eye(self.gram.shape[-1]), self.gram.shape[-1] // 4, axis=1)
        residual, scale = light[0].copy(), self.scale_sd * light[0]
        # y - u'n = (y - u'r) - u'(n - r), with the reference r; the scale multiplies u'(n - r) alone
        residual[:3, 3] = -self.reference
        residual[:3, :3] *= -1.0
        scale[3, 3] = 0.0
        return [residual, *([scale] if self.scale_sd > 0.0 else []), *light[1:]]

    def _form(self, product: FloatArray) -> Misfit:
        """The quadratic form of (n - reference, 1), (..., 4, 4), as one of n."""
        product = (product + np.swapaxes(product, -1, -2)) / 2.0
        H, b, c = product[..., :3, :3], product[..., :3, 3], product[..., 3, 3]
        # (n - r)'H(n - r) + 2 b'(n - r) + c = n'Hn - 2 (Hr - b)'n + r'Hr - 2 b'r + c
        pulled = H @ self.reference
        whole = c + (pulled - 2.0 * b) @ self.reference
        return Misfit(H, pulled - b, whole, np.ones(whole.shape, np.int64))


def with_systematics(
    design: FloatArray, y: FloatArray, weights: FloatArray, systematics: FloatArray
) -> Misfit:
    """Misfit with additive systematic effects profiled out, each with a standard normal prior.

    Of design vectors (n, 3), measured cosines `y`, (n,) or (m, n) for m slopes, their inverse variances
    `weights`, zero to exclude a row, and the change of `y` for one standard uncertainty of each effect, (p,
    ...).
    """
    gram = profiled_gram([*design.T, y], weights, systematics)
    return Misfit(gram[..., :3, :3], gram[..., :3, 3], gram[..., 3, 3], np.count_nonzero(weights, axis=-1))


def profiled_gram(columns: Sequence[FloatArray], weights: FloatArray, systematics: FloatArray) -> FloatArray:
    """Weighted products of columns, (..., k, k), with additive effects profiled out as above."""
    table = np.stack([*np.broadcast_arrays(*columns), *systematics], axis=-1)
    gram, count = np.swapaxes(table * weights[..., np.newaxis], -1, -2) @ table, len(columns)
    # every effect is in units of its own uncertainty
    inner, outer = gram[..., count:, count:] + np.eye(len(systematics)), gram[..., count:, :count]
    return np.asarray(gram[..., :count, :count] - gram[..., :count, count:] @ np.linalg.solve(inner, outer))


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

    def bounds(self, prefix: str = "") -> dict[str, Any]:
        """The ends by their names in `SlopeEstimate`, such as ``tilt_low_deg``, after a prefix."""
        ends = asdict(self)
        del ends["vertical"]
        return {f"{prefix}{name}": end for name, end in ends.items()}


@dataclass(frozen=True, slots=True)
class Patches:
    """Grids over likelihood regions, with misfits (m, k, l); cells have equal solid angles (m,) in sr."""

    grid: Grid
    misfit: FloatArray
    solid_angle: FloatArray


@dataclass(frozen=True, slots=True)
class _Boxes:
    """Ranges (m, 2) of the height over the plane square to the mean sun, and of the turn about it, rad."""

    axes: FloatArray
    height: FloatArray
    turn: FloatArray

    def grid(self, heights: int, turns: int) -> Grid:
        """The centres of equal cells."""
        return Grid(self.axes, _centres(self.height, heights), _centres(self.turn, turns))

    def cell(self, heights: int, turns: int) -> FloatArray:
        """Solid angle of a cell: equal everywhere, since height and turn preserve area (Archimedes)."""
        return np.asarray(np.ptp(self.height, axis=1) / heights * np.ptp(self.turn, axis=1) / turns)

    def closer(self, inside: BoolArray) -> _Boxes:
        """The part of each box that contains its region (m, heights, turns), with a margin of a cell."""
        height = _closer(self.height, np.asarray(inside.any(axis=2)))
        return _Boxes(self.axes, height, _closer(self.turn, np.asarray(inside.any(axis=1))))


def _centres(spans: FloatArray, cells: int) -> FloatArray:
    width = spans[:, 1:] - spans[:, :1]
    return np.asarray(spans[:, :1] + width * (np.arange(cells) + 0.5) / cells)


def _closer(spans: FloatArray, lines: BoolArray) -> FloatArray:
    cells = lines.shape[1]
    step = (spans[:, 1] - spans[:, 0]) / cells
    first, last = np.argmax(lines, axis=1), cells - 1 - np.argmax(lines[:, ::-1], axis=1)
    low = np.maximum(spans[:, 0] + (first - 1) * step, spans[:, 0])
    high = np.minimum(spans[:, 0] + (last + 2) * step, spans[:, 1])
    return np.where(lines.any(axis=1, keepdims=True), np.stack([low, high], axis=1), spans)


def patches(
    misfit: OnGrid,
    information: FloatArray,
    best: FloatArray,
    bound: FloatArray,
    drop: float,
    *,
    heights: int = 17,
    turns: int = 81,
) -> Patches:
    """Grids over the connected regions ``q <= bound`` around `best` (m, 3), of many slopes at once.

    `information` (m, 3, 3) sets the axes and the first size only; a grid grows until the region lies inside,
    then shrinks to it. The bounds (m,) are misfits, `drop` above the least: a chi-square quantile. `heights`
    and `turns` are the cells of a grid along its two axes.
    """
    # the pole is what is known best, the mean sun: a thin region lies along a circle about it
    values, vectors = np.linalg.eigh(information)
    local = (best[:, np.newaxis] @ vectors)[:, 0]
    flip = np.where(local < 0.0, -1.0, 1.0)
    axes, local = vectors * flip[:, np.newaxis], local * flip
    height, turn = local[:, 2], np.arctan2(local[:, 1], local[:, 0])
    level = np.sqrt(np.maximum(1.0 - height**2, 1e-12))
    half = np.sqrt(drop / np.maximum(values, 1e-300))
    high, wide = np.minimum(1.2 * half[:, 2], 1.0), np.minimum(1.2 * half[:, 1] / level, np.pi)
    for _ in range(24):
        ends = np.clip(np.stack([height - high, height + high], axis=1), -1.0, 1.0)
        boxes = _Boxes(axes, ends, np.stack([turn - wide, turn + wide], axis=1))
        inside = misfit(boxes.grid(13, 33)) <= bound[:, np.newaxis, np.newaxis]
        up = _touch(inside, 2, ends[:, 0] > -1.0, ends[:, 1] < 1.0)
        around = _touch(inside, 1, wide < np.pi, wide < np.pi)
        if not (up | around).any():
            break
        high = np.where(up, 2.0 * high, high)
        wide = np.where(around, np.minimum(2.0 * wide, np.pi), wide)
    boxes = boxes.closer(inside)
    grid = boxes.grid(heights, turns)
    return Patches(grid, misfit(grid), boxes.cell(heights, turns))


def _touch(inside: BoolArray, axis: int, low: BoolArray, high: BoolArray) -> BoolArray:
    """True for regions (m, heights, turns) at an end of their box that may move, along the other axis."""
    lines = np.asarray(inside.any(axis=axis))
    return np.asarray((low & lines[:, 0]) | (high & lines[:, -1]))


def regions(
    misfit: ProfileMisfit, information: FloatArray, best: FloatArray, drop: float, tilt_limit_deg: float
) -> list[LikelihoodRegion]:
    """Projections of the likelihood regions around `best` on tilt and azimuth, within the tilt limit.

    The misfit is of m slopes; `information`, `best` and `drop` are as of `patches`.
    """
    bound = misfit(best) + drop
    patch = patches(misfit.on_grid, information, best, bound, drop)
    slope, height, turn = np.nonzero(patch.misfit <= bound[:, np.newaxis, np.newaxis])
    normals = patch.grid.normals()[slope, height, turn]
    is_flat = misfit(np.broadcast_to(VERTICAL, best.shape)) <= bound
    for whole in np.flatnonzero(is_flat):
        is_flat[whole] = _near(VERTICAL, best[whole], normals[slope == whole])
    # every region with its best normal, which may be the only one
    owner = np.concatenate([slope, np.arange(len(best))])
    order = np.argsort(owner, kind="stable")
    every = np.concatenate([normals, best])[order]
    starts = np.searchsorted(owner[order], np.arange(len(best)))
    projected = project(every, starts, best, is_flat, tilt_limit_deg)
    # a region that goes on beyond the limit ends there, not at the last cell before
    beyond = np.isin(np.arange(len(best)), slope[tilt_azimuth(normals)[0] > tilt_limit_deg])
    return [
        replace(whole, tilt_high_deg=tilt_limit_deg) if cut and np.isfinite(whole.tilt_high_deg) else whole
        for whole, cut in zip(projected, beyond, strict=True)
    ]


def _near(vertical: FloatArray, best: FloatArray, normals: FloatArray) -> bool:
    """True where the vertical belongs to this region, of normals (k, 3), not to that of the other branch."""
    reach = float(np.max(angle_between_deg(normals, best), initial=0.0))
    return bool(angle_between_deg(vertical, best) <= reach + 0.5)


def project(
    normals: FloatArray,
    starts: IntArray,
    best: FloatArray,
    flat: BoolArray,
    tilt_limit_deg: float,
) -> list[LikelihoodRegion]:
    """Ranges of tilt and azimuth of m regions, cut at the tilt limit.

    `normals` (k, 3) are one region's after the other's, each beginning at its one of `starts` (m,), around
    the best ones (m, 3); `flat` (m,): the region contains the vertical.
    """
    tilts, azimuths = tilt_azimuth(normals)
    centre = tilt_azimuth(best)[1]
    counts = np.diff(np.append(starts, len(normals)))
    turned = (azimuths - np.repeat(centre, counts) + 180.0) % 360.0 - 180.0
    allowed = tilts <= tilt_limit_deg
    lows = [np.minimum.reduceat(np.where(allowed, values, np.inf), starts) for values in (tilts, turned)]
    highs = [np.maximum.reduceat(np.where(allowed, values, -np.inf), starts) for values in (tilts, turned)]
    lows[0], lows[1] = np.where(flat, 0.0, lows[0]), centre + np.where(flat, -180.0, lows[1])
    highs[1] = centre + np.where(flat, 180.0, highs[1])
    bounds = np.stack([lows[0], highs[0], lows[1], highs[1]], axis=1)
    bounds[~np.logical_or.reduceat(allowed, starts)] = np.nan
    return [LikelihoodRegion(*row) for row in zip(*bounds.T.tolist(), flat.tolist(), strict=True)]


def regions_known_azimuth(
    misfit: ProfileMisfit, azimuth_deg: FloatArray, best: FloatArray, drop: float, tilt_limit_deg: float
) -> list[LikelihoodRegion]:
    """The connected intervals of tilts around `best`, each along its azimuth; parameters as of `regions`."""
    tilts, tilt = np.linspace(0.0, tilt_limit_deg, TILTS), tilt_azimuth(best)[0][:, np.newaxis]
    facing, across = normal(90.0, azimuth_deg), normal(90.0, azimuth_deg + 90.0)
    axes = np.stack([facing, across, np.broadcast_to(VERTICAL, facing.shape)], axis=2)
    height = np.broadcast_to(np.cos(np.radians(tilts)), (len(best), TILTS))
    grid = Grid(axes, height, np.zeros((len(best), 1)))
    excess = misfit.on_grid(grid)[..., 0] - misfit(best)[:, np.newaxis]
    root = np.sqrt(np.maximum(excess, 0.0) / drop)
    low = _ends(tilt, tilts[::-1], root[:, ::-1], tilts[::-1] < tilt)
    high = _ends(tilt, tilts, root, tilts > tilt)
    return [
        LikelihoodRegion(float(lowest), float(highest), azimuth, azimuth, bool(lowest == 0.0))
        for lowest, highest, azimuth in zip(low, high, (azimuth_deg % 360.0).tolist(), strict=True)
    ]


def _ends(start: FloatArray, tilts: FloatArray, root: FloatArray, beyond: BoolArray) -> FloatArray:
    """Tilts at which the root of the excess misfit, 0 at `start` (m, 1), first exceeds 1; else the last.

    `root` and `beyond`, the tilts on this side of the start, are (m, k) over `tilts` (k,).
    """
    # a misfit grows as a parabola, so its root is interpolated: the region may be narrower than one step
    outside = beyond & (root > 1.0)
    slopes, first = np.arange(len(root)), np.argmax(outside, axis=1)
    is_next = ~beyond[slopes, first - 1] | (first == 0)
    before = np.where(is_next, start[:, 0], tilts[first - 1])
    value, value_before = root[slopes, first], np.where(is_next, 0.0, root[slopes, first - 1])
    share = (1.0 - value_before) / np.where(outside.any(axis=1), value - value_before, 1.0)
    last = np.where(beyond.any(axis=1), tilts[-1], start[:, 0])
    return np.where(outside.any(axis=1), before + share * (tilts[first] - before), last)
