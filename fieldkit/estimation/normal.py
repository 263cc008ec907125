"""Unit normals by least squares: the sun moves, the normal stays, and lies on the unit sphere.

Every minute bin is one row ``y = n . u + error``: `u` points to the sun (or is the design vector of the full
surface model), `y` is the measured cosine of incidence. With weights ``w = 1 / sigma_y**2`` the misfit of a
normal is ``q(n) = n'Hn - 2 b'n + c``, so `Misfit` is a sufficient statistic of any number of rows.

The unconstrained solution ``H x = b`` is never used: below three hours its length is noise. Two circles on a
sphere meet in two points, so `solve` gives two branches, and `choose` prefers one of them.

Angles in degrees at every interface; vectors are east, north, up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.model.arrays import BoolArray, FloatArray, IntArray
from fieldkit.physics.facet import VERTICAL, normal, tilt_azimuth

LOWEST_COS_INCIDENCE = 0.03
"""Cosine of incidence below which a facet counts as self-shaded."""
POLISH_STEPS = 30  # a bound: most need three
_MERGED = 1e-5
"""Chord below which two branches are one: the slope lies on the fold."""
_ROUNDING_DEG = 1e-3
"""Margin of the tilt limit: a slope exactly on it must not be excluded by rounding."""
_ONES = np.ones(3)  # a product with it is faster than a sum over three components


@dataclass(frozen=True, slots=True)
class Misfit:
    """The misfit ``q(n) = n'Hn - 2 b'n + c`` of unit normals, for one slope or many.

    `H`, (3, 3) or (m, 3, 3), is the information matrix, shared where all slopes have the same weights; `b` is
    (3,) or (m, 3), `c` and `count` (rows with a weight) are () or (m,).
    """

    H: FloatArray
    b: FloatArray
    c: FloatArray
    count: IntArray

    @classmethod
    def of_rows(cls, design: ArrayLike, y: ArrayLike, weights: ArrayLike = 1.0) -> Misfit:
        """Sum rows: design vectors (n, 3), and measured cosines of incidence, (n,) or (m, n) for m slopes.

        NaN excludes a row, and so does a weight of zero: inverse variances that broadcast with `y`.
        """
        u, y = np.asarray(design, np.float64), np.asarray(y, np.float64)
        w = np.asarray(weights, np.float64)
        unknown = np.isnan(y)
        shared = y.ndim > 1 and w.ndim < 2 and not unknown.any()
        used = np.where(unknown, 0.0, w)
        common = used if y.ndim == 1 else np.broadcast_to(w, y.shape[-1:]) if shared else None
        if common is not None:
            H = (u * common[:, np.newaxis]).T @ u
        else:
            # slope by slope the same sums as of one slope alone: short windows show the last digits
            H = np.swapaxes(used[..., np.newaxis] * u, -1, -2) @ u
        y = np.where(unknown, 0.0, y)
        weighted = used * y
        return cls(
            H,
            (weighted[..., np.newaxis, :] @ u)[..., 0, :],
            np.sum(weighted * y, axis=-1),
            np.asarray(np.sum(used > 0.0, axis=-1)),
        )

    def __call__(self, normals: ArrayLike) -> FloatArray:
        """Misfit of normals (..., 3) that broadcast against the slopes."""
        n = np.asarray(normals, np.float64)
        pulled = (n @ self.H if self.H.ndim == 2 else _times(self.H, n)) - 2.0 * self.b
        return np.asarray((pulled * n) @ _ONES + self.c)


@dataclass(frozen=True, slots=True)
class Branches:
    """Both minima of a misfit on the sphere, (..., 3) each, the one of less misfit first.

    `merged`: they are one point, on the fold or where the circles around the sun do not meet.
    """

    first: FloatArray
    second: FloatArray
    first_misfit: FloatArray
    second_misfit: FloatArray
    merged: BoolArray


def solve(misfit: Misfit) -> Branches:
    """Both unit normals of locally least misfit; NaN where H or b is NaN or no row was summed.

    Starts in closed form, ``c1 e1 + c2 e2 +- sqrt(1 - c1**2 - c2**2) m`` in the eigenvectors of H, then
    Newton steps on the sphere. Exact without noise.
    """
    is_known = np.isfinite(misfit.b).all(axis=-1) & (misfit.count > 0)
    # unknown slopes are solved as level ones and set to NaN at the end
    H = misfit.H
    if H.ndim != 2 or not is_known.any():
        H = np.where(is_known[..., np.newaxis, np.newaxis], H, np.eye(3))
    values, vectors = np.linalg.eigh(H)
    shared = H.ndim == 2
    b = np.where(is_known[..., np.newaxis], misfit.b, VERTICAL)
    # components first from here on, slopes last: transposed, for there is one axis of slopes at most
    beta = (b @ vectors if shared else _times(np.swapaxes(vectors, -1, -2), b)).T
    lam = values.reshape(3, *([1] * (beta.ndim - 1))) if shared else values.T
    polished = _polish(lam[:, np.newaxis], beta[:, np.newaxis], np.stack(_starts(lam, beta), axis=1))
    both = polished[:, 0].T, polished[:, 1].T
    normals = np.stack([x @ vectors.T if shared else _times(vectors, x) for x in both])
    return _order(normals, np.stack([misfit(branch) for branch in normals]), is_known)


def _starts(lam: FloatArray, beta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Closed-form solutions in eigen-coordinates (3, ...), ascending eigenvalues: m, e2, e1."""
    # the two best-known components as if unconstrained; unit length gives the third, of either sign
    safe = np.where(lam > 0.0, lam, 1.0)
    c1 = np.clip(beta[2] / safe[2], -1.0, 1.0)
    room = np.sqrt(1.0 - c1**2)
    c2 = np.clip(beta[1] / safe[1], -room, room)
    across = np.sqrt(np.maximum(room**2 - c2**2, 0.0))
    return np.stack([across, c2, c1]), np.stack([-across, c2, c1])


def _polish(lam: FloatArray, beta: FloatArray, x: FloatArray) -> FloatArray:
    """Newton steps in the tangent plane for ``sum lam x**2 - 2 beta x`` on the unit sphere, (3, ...).

    The Hessian is shifted to be positive definite near the fold, where the sphere's curvature makes it
    indefinite; a step that does not improve is shortened.
    """
    shape = x.shape
    lam, beta = (np.broadcast_to(array, shape).reshape(3, -1) for array in (lam, beta))
    x = x.reshape(3, -1).copy()
    value = np.sum((lam * x - 2.0 * beta) * x, axis=0)
    # most converge in three steps: only the others are continued
    remaining, trust = np.arange(value.size), np.ones(value.size)
    for _ in range(POLISH_STEPS):
        here, pull = lam[:, remaining], beta[:, remaining]
        step = trust * _newton_step(here, pull, x[:, remaining])
        trial = x[:, remaining] + step
        trial = trial / np.sqrt(np.sum(trial**2, axis=0))
        trial_value = np.sum((here * trial - 2.0 * pull) * trial, axis=0)
        better = trial_value <= value[remaining]
        x[:, remaining[better]], value[remaining[better]] = trial[:, better], trial_value[better]
        # a tiny step without improvement has reached the rounding of q
        open_ = np.max(np.abs(step), axis=0) >= np.where(better, 1e-11, 1e-7)
        remaining, trust = remaining[open_], np.where(better, 1.0, 0.25 * trust)[open_]
        if not remaining.size:
            break
    return x.reshape(shape)


def _newton_step(lam: FloatArray, beta: FloatArray, x: FloatArray) -> FloatArray:
    along, across = tangent_pair(x)
    slope = lam * x - beta
    g1, g2 = np.sum(along * slope, axis=0), np.sum(across * slope, axis=0)
    # a great circle curves away from its tangent, which takes x . slope off both curvatures
    pull = np.sum(x * slope, axis=0)
    a = np.sum(lam * along**2, axis=0) - pull
    d = np.sum(lam * across**2, axis=0) - pull
    b = np.sum(lam * along * across, axis=0)
    lowest = 0.5 * (a + d) - np.hypot(0.5 * (a - d), b)
    floor = 1e-12 * (np.abs(a) + np.abs(d)) + 1e-300
    # a negative curvature becomes as large a positive one: downhill, whatever the sign
    shift = np.where(lowest > floor, 0.0, floor - 2.0 * np.minimum(lowest, 0.0))
    a, d = a + shift, d + shift
    determinant = a * d - b * b
    s1, s2 = (b * g2 - d * g1) / determinant, (b * g1 - a * g2) / determinant
    shorten = np.minimum(1.0, 0.3 / np.maximum(np.hypot(s1, s2), 1e-300))
    return np.asarray(shorten * (s1 * along + s2 * across))


def tangent_pair(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors square to x (3, ...) and to each other, without a singular direction.

    T. Duff et al., "Building an orthonormal basis, revisited", JCGT 6(1), 2017.
    """
    sign = np.copysign(1.0, x[2])
    a = -1.0 / (sign + x[2])
    b = x[0] * x[1] * a
    return (
        np.stack([1.0 + sign * x[0] ** 2 * a, sign * b, -sign * x[0]]),
        np.stack([b, sign + x[1] ** 2 * a, -x[1]]),
    )


def _times(matrices: FloatArray, rows: FloatArray) -> FloatArray:
    return np.asarray(np.matmul(matrices, rows[..., np.newaxis])[..., 0])


def _order(normals: FloatArray, misfits: FloatArray, is_known: BoolArray) -> Branches:
    swap, blank = misfits[1] < misfits[0], np.where(is_known, 0.0, np.nan)
    first, second = np.where(swap[..., np.newaxis], normals[::-1], normals) + blank[..., np.newaxis]
    least, other = np.where(swap, misfits[::-1], misfits) + blank
    return Branches(first, second, least, other, np.linalg.norm(first - second, axis=-1) < _MERGED)


@dataclass(frozen=True, slots=True)
class Choice:
    """The preferred normal (..., 3), its misfit, and the other branch if within the tilt limit, else NaN.

    `steeper` is the branch that would fit better but for the limit, else the preferred normal.
    """

    best: FloatArray
    misfit: FloatArray
    other: FloatArray
    other_misfit: FloatArray
    steeper: FloatArray


def choose(misfit: Misfit, branches: Branches, tilt_limit_deg: float, *, at_limit: bool = False) -> Choice:
    """The preferred one of a misfit's branches (`solve`), given that the tilt does not exceed the limit.

    Within 20 minutes both branches often fit equally well. Then the prior decides, uniform in tilt and
    azimuth up to the limit, in (0, 90]: per solid angle it falls as 1 / sin(tilt), so of two equal fits the
    flatter one is preferred. Where both branches are steeper than the limit, with `at_limit` where either is,
    the normal of least misfit on the limit is taken: its misfit shows whether the limit is the reason. A
    flatter branch that gives way to it stays the other.
    """
    normals = np.stack([branches.first, branches.second])
    misfits = np.stack([branches.first_misfit, branches.second_misfit])
    tilts = tilt_azimuth(normals)[0]
    allowed = tilts <= tilt_limit_deg + _ROUNDING_DEG
    penalised = np.where(allowed, misfits + prior_price(tilts), np.inf)
    swap = penalised[1] < penalised[0]
    best, other = np.where(swap[..., np.newaxis], normals[::-1], normals)
    misfit_best, misfit_other = np.where(swap, misfits[::-1], misfits)
    is_single = branches.merged | ~allowed.all(axis=0)
    other = np.where(is_single[..., np.newaxis], np.nan, other)
    steep = ~(allowed.all(axis=0) if at_limit else allowed.any(axis=0)) & np.isfinite(misfits[0])
    if np.any(steep):
        edge, edge_misfit = _on_limit(misfit, tilt_limit_deg, steep)
        steep &= edge_misfit + prior_price(tilt_limit_deg) < penalised.min(axis=0)
        has_flatter = steep & allowed.any(axis=0)
        other = np.where(has_flatter[..., np.newaxis], best, other)
        misfit_other = np.where(has_flatter, misfit_best, misfit_other)
        is_single &= ~has_flatter
        best = np.where(steep[..., np.newaxis], edge, best)
        misfit_best = np.where(steep, edge_misfit, misfit_best)
    is_steeper = is_single & (branches.first_misfit < misfit_best)
    steeper = np.where(is_steeper[..., np.newaxis], branches.first, best)
    return Choice(best, misfit_best, other, np.where(is_single, np.nan, misfit_other), steeper)


def prior_price(tilt_deg: ArrayLike) -> FloatArray:
    """-2 log of the prior per solid angle at tilts in degrees; below 0.1 it would win against any data."""
    return np.asarray(2.0 * np.log(np.sin(np.radians(np.clip(tilt_deg, 0.1, 90.0)))))


def _on_limit(misfit: Misfit, tilt_limit_deg: float, chosen: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Normal of least misfit on the tilt limit and that misfit, for the slopes wanted; NaN for the others."""
    rim = normal(tilt_limit_deg, np.arange(0.0, 360.0, 0.1))
    best, least = np.full((*chosen.shape, 3), np.nan), np.full(chosen.shape, np.nan)
    # in parts, to bound the memory for many slopes
    for part in np.array_split(np.argwhere(chosen), 1 + int(chosen.sum()) // 1000):
        index = tuple(part.T)
        H = misfit.H if misfit.H.ndim == 2 else misfit.H[index]
        values = np.einsum("ri,...ij,rj->...r", rim, H, rim, optimize=True)
        values = values - 2.0 * misfit.b[index] @ rim.T + np.asarray(misfit.c)[index][..., np.newaxis]
        best[index], least[index] = rim[np.argmin(values, axis=-1)], values.min(axis=-1)
    return best, least


def solve_known_azimuth(
    misfit: Misfit, azimuth_deg: ArrayLike, tilt_limit_deg: float
) -> tuple[FloatArray, FloatArray]:
    """Tilts of least misfit of m slopes, each along its azimuth: the best, and the other local minimum or
    NaN.

    Angles in degrees, azimuths (m,) from north, clockwise. An end of the range up to the tilt limit counts as
    a minimum where the misfit falls towards it.
    """
    azimuth, tilts = np.asarray(azimuth_deg, np.float64), np.linspace(0.0, tilt_limit_deg, 721)
    values = misfit(normal(tilts[:, np.newaxis], azimuth)).T
    values = np.pad(values, ((0, 0), (1, 1)), constant_values=np.inf)
    slope, low = np.nonzero((values[:, 1:-1] <= values[:, :-2]) & (values[:, 1:-1] < values[:, 2:]))
    H, along = np.broadcast_to(misfit.H, (azimuth.size, 3, 3))[slope], azimuth[slope]
    each = Misfit(H, misfit.b[slope], misfit.c[slope], misfit.count[slope])
    polished = _polish_tilts(each, tilts[low], along, tilt_limit_deg)
    order = np.lexsort((each(normal(polished, along)), slope))
    first = np.searchsorted(slope, np.arange(azimuth.size))
    minima = np.append(polished[order], np.nan)
    has_other = np.bincount(slope, minlength=azimuth.size) > 1
    return minima[first], minima[np.where(has_other, first + 1, -1)]


def choose_along(misfit: Misfit, azimuth_deg: FloatArray, tilt_limit_deg: float, drop: float) -> Choice:
    """The preferred tilts of m slopes, each along its azimuth: of two that fit within `drop` the flatter."""
    tilt, other = solve_known_azimuth(misfit, azimuth_deg, tilt_limit_deg)
    best, second = normal(tilt, azimuth_deg), normal(other, azimuth_deg)
    value, second_value = misfit(best), misfit(second)
    swap = (other < tilt) & (second_value - value < drop)
    swapped = swap[:, np.newaxis]
    best, second = np.where(swapped, second, best), np.where(swapped, best, second)
    value, second_value = np.where(swap, second_value, value), np.where(swap, value, second_value)
    return Choice(best, value, second, second_value, steeper=best)


def _polish_tilts(
    misfit: Misfit, tilts_deg: FloatArray, azimuth_deg: FloatArray, limit_deg: float
) -> FloatArray:
    """Newton steps along azimuths, for tilts of local minima nearby."""
    for _ in range(8):
        here, steeper = normal(tilts_deg, azimuth_deg), normal(tilts_deg + 90.0, azimuth_deg)
        pull = _times(misfit.H, here) - misfit.b
        slope = np.sum(steeper * pull, axis=1)
        bend = np.sum(steeper * _times(misfit.H, steeper) - here * pull, axis=1)
        # on a hump Newton's step climbs: stay where the grid has its minimum
        is_bowl = bend > 0.0
        step = np.where(is_bowl, slope / np.where(is_bowl, bend, 1.0), 0.0)
        tilts_deg = np.clip(tilts_deg - np.degrees(step), 0.0, limit_deg)
    return np.asarray(tilts_deg)


def mirror(normals: ArrayLike, H: FloatArray) -> FloatArray:
    """Mirror images ``n - 2 (n . m) m`` of unit normals (..., 3) in the plane of the sun's motion.

    `m`, the eigenvector of the information matrix H (..., 3, 3) with the smallest eigenvalue, is the
    direction in which the sun never stood; a mirror image fits nearly as well as the slope itself.
    """
    n = np.asarray(normals, np.float64)
    across = np.linalg.eigh(H)[1][..., :, 0]
    return np.asarray(n - 2.0 * np.sum(n * across, axis=-1, keepdims=True) * across)


def tangents(normals: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Unit vectors along increasing tilt and increasing azimuth at normals (..., 3), shape (..., 3) each.

    At the vertical, where azimuth is undefined, those of azimuth 0.
    """
    tilt, azimuth = tilt_azimuth(normals)
    return normal(tilt + 90.0, azimuth), normal(90.0, azimuth + 90.0)


def cramer_rao(H: FloatArray, normals: ArrayLike) -> FloatArray:
    """Cramer-Rao bound of unit normals (..., 3): the smallest covariance of an unbiased estimate, rad2.

    (..., 2, 2) of tilt and of direction on the ground (azimuth times the sine of tilt), by the information
    matrix H (..., 3, 3). Needs only sun, irradiance and noise, so it can be computed before the day. Too
    small near the fold. S. Kay, "Fundamentals of statistical signal processing: estimation theory", 1993, ch.
    3.
    """
    basis = np.stack(tangents(normals), axis=-1)
    return np.asarray(np.linalg.inv(np.swapaxes(basis, -1, -2) @ H @ basis))
