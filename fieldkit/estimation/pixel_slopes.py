"""Slope maps: tilt and azimuth of every pixel, their bounds and states.

A pixel is solved as a region is (`normal.solve`). All pixels share the weights of a frame (the balance's
steepness differs by 7 %), so they share the information matrix H, and a pixel keeps four numbers, ``b`` and
``c``. The branch is chosen as for regions: tilt limit, then misfit and prior.

Bounds: in the plane of the sun's motion the likelihood of a pixel is an ellipse about its best slope, whose
size follows from noise, a misfit beyond it and the stated systematic uncertainties. The extremes of tilt and
azimuth are found along its edge; where the edge leaves the unit disc, both branches belong to one region.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from fieldkit.estimation.instant import AlongSun, along_sun, instant_scale_sd
from fieldkit.estimation.normal import LOWEST_COS_INCIDENCE, Misfit, prior_price, solve
from fieldkit.estimation.pixel_posterior import PixelPosterior
from fieldkit.estimation.settings import PAPER_SCALE_SD, EstimatorSettings
from fieldkit.model.arrays import AnyArray, BoolArray, ByteArray, FloatArray, SingleArray
from fieldkit.model.confidence import CONFIDENCE, misfit_drop
from fieldkit.model.slope import SlopeState, half_width_deg, is_too_wide
from fieldkit.physics.bodies import BODIES
from fieldkit.physics.facet import normal, tilt_azimuth

PIECE = 4096
"""Pixels at a time, whose rows and intermediate arrays fit the memory."""
STEPS = 24
"""Points along the ellipse's edge: its extremes are met within one part in a hundred."""
LEAST_ACROSS = 0.2
"""Least distance from the plane of the sun's motion at which information across it is used."""
_NO_SLOPE = (SlopeState.NO_DATA, SlopeState.NO_INTERSECTION, SlopeState.SHADED)


@dataclass(frozen=True, slots=True)
class SlopeMap:
    """Slopes of a frame (rows, cols): degrees, reduced chi-square, and `SlopeState` as uint8.

    Angles are NaN where the state is `NO_DATA`, `NO_INTERSECTION` or `SHADED`. `second_tilt_deg` is the
    other branch's tilt, shown in the state `NOT_RESOLVED`: it is within the limit and fits about as well.
    """

    tilt_deg: SingleArray
    azimuth_deg: SingleArray
    second_tilt_deg: SingleArray
    chi_square: SingleArray
    state: ByteArray


def pieces(pixels: int) -> list[slice]:
    """The pixels of a frame, some at a time."""
    return [slice(at, at + PIECE) for at in range(0, pixels, PIECE)]


@dataclass(frozen=True, slots=True)
class MapSums:
    """Sums over the rows of a map, whose frames are of `shape` (rows, cols): the misfit of every pixel.

    `rows` is their number, `sun` (3,) the mean vector towards the sun, `per_kelvin` the mean change of a
    pixel's cosine to the sun per kelvin of its temperature.
    """

    shape: tuple[int, int]
    misfit: Misfit
    rows: int
    sun: FloatArray
    per_kelvin: float

    @classmethod
    def of(
        cls,
        shape: tuple[int, int],
        design: FloatArray,
        sun: FloatArray,
        values: Callable[[slice], AnyArray],
        per_kelvin: float = 0.0,
    ) -> MapSums:
        """Sum rows ``design n = value`` of unit variance, with a design (k, 3) that all pixels share.

        `values` gives those (k, pixels) of a slice of the pixels, NaN to make one unknown.
        """
        count = shape[0] * shape[1]
        b, c = np.empty((count, 3)), np.empty(count)
        for piece in pieces(count):
            y = values(piece).T.astype(np.float64)
            b[piece], c[piece] = y @ design, (y**2).sum(axis=1)
        misfit = Misfit(design.T @ design, b, c, np.full(count, len(design)))
        return cls(shape, misfit, len(design), sun / np.linalg.norm(sun), per_kelvin)

    def sun_axes(self) -> tuple[FloatArray, FloatArray]:
        """Axes along the mean sun, along its motion and across both, rows of (3, 3), the last one upwards.

        Before them, (3,), the information of the rows along each: inverse variances of a pixel's normal.
        """
        values, vectors = np.linalg.eigh(self.misfit.H)
        vectors[:, 0] *= np.copysign(1.0, vectors[2, 0])
        return values[::-1], vectors[:, ::-1].T

    def along_sun(self, reference_normal: FloatArray, settings: EstimatorSettings) -> AlongSun:
        """The component of every pixel's slope along the mean sun, (rows, cols): all that one frame gives."""
        values, axes = self.sun_axes()
        sun = axes[0] * np.copysign(1.0, axes[0, 2])
        cosine = (self.misfit.b @ sun / values[0]).reshape(self.shape)
        scaled = instant_scale_sd(settings) * (cosine - reference_normal @ sun)
        unscaled = np.hypot(values[0] ** -0.5, settings.offset_sd_k * self.per_kelvin)
        return along_sun(sun, cosine, np.hypot(scaled, unscaled), settings)

    def solve(self, settings: EstimatorSettings, explained: BoolArray | None = None) -> SlopeMap:
        """The map; the state is `TOO_FEW` with fewer than three rows.

        `explained` are pixels (rows, cols) of regions of which a slope was found: neither a misfit refuses
        them, which widens their bounds instead, nor a slope beyond the limit, which their bounds may reach.
        `settings` give the tilt limit, and the confidence with which a second slope must be worse.
        """
        count = self.shape[0] * self.shape[1]
        refused = np.ones(count, np.bool_) if explained is None else ~explained.ravel()
        planes, state = np.full((4, count), np.nan, np.float32), np.full(count, SlopeState.TOO_FEW, np.uint8)
        for piece in pieces(count) if self.rows >= 3 else ():
            planes[:, piece], state[piece] = self._solve_piece(piece, refused[piece], settings)
        tilt, azimuth, second, chi_square = planes.reshape(4, *self.shape)
        return SlopeMap(tilt, azimuth, second, chi_square, state.reshape(self.shape))

    def _solve_piece(
        self, piece: slice, refused: BoolArray, settings: EstimatorSettings
    ) -> tuple[FloatArray, ByteArray]:
        """Tilt, azimuth, second tilt and chi-square (4, p) of some pixels, and their states (p,)."""
        whole, limit, freedom = self.misfit, settings.tilt_limit_deg, max(self.rows - 2, 1)
        branches = solve(Misfit(whole.H, whole.b[piece], whole.c[piece], whole.count[piece]))
        normals = np.stack([branches.first, branches.second])
        misfits = np.stack([branches.first_misfit, branches.second_misfit])
        tilts, azimuths = tilt_azimuth(normals)
        # a branch beyond the limit is chosen only where the other one is too: the flatter then
        is_alone = branches.merged | (tilts.max(axis=0) > limit)
        rank = np.where(is_alone, tilts, misfits + prior_price(tilts)).argsort(axis=0)
        (tilt, second), (azimuth, _), (least, other) = (
            np.take_along_axis(each, rank, axis=0) for each in (tilts, azimuths, misfits)
        )
        cosine = np.take_along_axis(normals @ self.sun, rank, axis=0)[0]
        chi_square = np.maximum(least, 0.0) / freedom
        # a misfit beyond noise inflates the variance, and with it the significant difference
        significant = misfit_drop(settings.confidence, 2) * np.maximum(chi_square, 1.0)
        too_steep = (tilt > limit) | ((second > limit) & (other - least < -significant))
        cases = {
            SlopeState.NO_DATA: np.isnan(tilt),
            SlopeState.SHADED: cosine < LOWEST_COS_INCIDENCE,
            SlopeState.NO_INTERSECTION: refused & (too_steep | (chi_square > _alarm(freedom))),
            SlopeState.NOT_RESOLVED: ~is_alone & (other - least < significant),
        }
        state = np.select(list(cases.values()), list(cases), SlopeState.OK).astype(np.uint8)
        tilt[np.isin(state, _NO_SLOPE)] = np.nan
        azimuth[np.isnan(tilt)] = np.nan
        second[state != SlopeState.NOT_RESOLVED] = np.nan
        return np.stack([tilt, azimuth, second, chi_square]), state


def _alarm(freedom: int) -> float:
    """Reduced chi-square beyond which no slope explains a pixel: three times what noise exceeds in 1 %."""
    return 3.0 * (1.0 + 2.33 * float(np.sqrt(2.0 / freedom)))


@dataclass(frozen=True, slots=True)
class PixelBounds:
    """Projections of each pixel's likelihood region, (rows, cols), degrees; NaN where there is no slope.

    Azimuths are unwrapped, low <= azimuth <= high; a whole turn apart where the vertical normal fits too.
    """

    tilt_low_deg: SingleArray
    tilt_high_deg: SingleArray
    azimuth_low_deg: SingleArray
    azimuth_high_deg: SingleArray
    confidence: float = CONFIDENCE


def posterior(
    slopes: SlopeMap, sums: MapSums, reference_normal: FloatArray, settings: EstimatorSettings
) -> PixelPosterior:
    """The likelihood of every pixel's normal.

    The stated systematic uncertainties of scale, offset and drift are included to first order.
    """
    is_known = np.isfinite(slopes.tilt_deg)
    values, axes = sums.sun_axes()
    at = normal(slopes.tilt_deg[is_known], slopes.azimuth_deg[is_known]) @ axes.T
    inflation = np.maximum(slopes.chi_square[is_known].astype(np.float64), 1.0)
    covariance = _covariance(at, values, inflation)
    _add_systematics(covariance, at - axes @ reference_normal, sums.per_kelvin, settings)
    # half the gradient of the misfit across the plane, at the origin
    pull = sums.misfit.b[is_known.ravel()] @ axes[2]
    gain = 4.0 * pull * at[:, 2] / inflation
    second = np.exp(-0.5 * np.maximum(gain, 0.0))
    # a mirror that is too steep, with all that its ellipse may add to it, is no second slope
    up = at @ axes[:, 2] - 2.0 * at[:, 2] * axes[2, 2]
    reach = 3.0 * np.sqrt(np.trace(covariance, axis1=1, axis2=2)) / np.maximum(np.abs(at[:, 2]), LEAST_ACROSS)
    second[up + reach < np.cos(np.radians(settings.tilt_limit_deg))] = 0.0
    return PixelPosterior(is_known, at, covariance, second, axes, settings.tilt_limit_deg)


def with_bounds(
    slopes: SlopeMap, likelihood: PixelPosterior, settings: EstimatorSettings
) -> tuple[SlopeMap, PixelBounds]:
    """The map with the states `FLAT` and `WIDE` by the rules of regions, and its pixels' bounds."""
    is_known = likelihood.known
    tilt, azimuth = (angle[is_known].astype(np.float64) for angle in (slopes.tilt_deg, slopes.azimuth_deg))
    at, covariance, axes = likelihood.at, likelihood.covariance, likelihood.axes
    drop = misfit_drop(settings.confidence, 2)
    (low, high, left, right), touches = np.empty((4, tilt.size)), np.empty(tilt.size, np.bool_)
    for piece in pieces(tilt.size):
        tilts, shifts, touches[piece] = _along_edge(at[piece], covariance[piece], axes, azimuth[piece], drop)
        low[piece], high[piece] = np.minimum(tilts.min(axis=1), tilt[piece]), tilts.max(axis=1)
        left[piece], right[piece] = np.minimum(shifts.min(axis=1), 0.0), np.maximum(shifts.max(axis=1), 0.0)
    is_vertical = _contains(axes[:2, 2] - at[:, :2], covariance, drop) & ((at[:, 2] > 0.0) | touches)
    bounds = (
        np.where(is_vertical, 0.0, low),
        np.minimum(np.maximum(high, tilt), np.maximum(settings.tilt_limit_deg, low)),
        azimuth + np.where(is_vertical, -180.0, left),
        azimuth + np.where(is_vertical, 180.0, right),
    )
    planes = np.full((4, *is_known.shape), np.nan, np.float32)
    planes[:, is_known] = bounds
    slopes = _within_limit(slopes, planes, settings.tilt_limit_deg)
    flat = np.zeros(is_known.shape, np.bool_)
    flat[is_known] = is_vertical
    low, high, left, right = planes
    slopes = _with_states(slopes, planes, flat, settings.target_half_width_deg)
    return slopes, PixelBounds(low, high, left, right, settings.confidence)


def _within_limit(slopes: SlopeMap, bounds: SingleArray, limit_deg: float) -> SlopeMap:
    """Pixels beyond the tilt limit: on it where their bounds reach it, else, with their bounds, NaN."""
    state, tilt, azimuth = slopes.state.copy(), slopes.tilt_deg.copy(), slopes.azimuth_deg.copy()
    is_beyond = tilt > limit_deg
    state[is_beyond] = SlopeState.WIDE
    tilt[is_beyond] = limit_deg
    refused = bounds[0] > limit_deg
    state[refused] = SlopeState.NO_INTERSECTION
    tilt[refused] = azimuth[refused] = bounds[:, refused] = np.nan
    return replace(slopes, state=state, tilt_deg=tilt, azimuth_deg=azimuth)


def _covariance(at: FloatArray, values: FloatArray, inflation: FloatArray) -> FloatArray:
    """Bounds of the two components in the plane of the sun's motion, (m, 2, 2), by noise alone.

    `at` (m, 3) are the best slopes along the mean sun, along its motion and across both; `values` (3,) are
    the information along these.
    """
    values = np.maximum(values, 1e-9 * values[0])  # rounding may make the least one negative
    outer = at[:, :2, np.newaxis] * at[:, np.newaxis, :2]
    # a unit normal that moves in the plane also moves across it, which hours of sun can resolve
    across = values[2] / np.maximum(at[:, 2] ** 2, LEAST_ACROSS**2)
    information = np.diag(values[:2]) + across[:, np.newaxis, np.newaxis] * outer
    return np.asarray(np.linalg.inv(information) * inflation[:, np.newaxis, np.newaxis])


def _add_systematics(
    covariance: FloatArray, away: FloatArray, per_kelvin: float, settings: EstimatorSettings
) -> None:
    """Add what does not average away: scale shifts slopes from the reference, offset towards the sun."""
    scale_sd = np.hypot(settings.scale_sd, PAPER_SCALE_SD if settings.model == "paper" else 0.0)
    covariance += scale_sd**2 * away[:, :2, np.newaxis] * away[:, np.newaxis, :2]
    covariance[:, 0, 0] += (settings.offset_sd_k * per_kelvin) ** 2
    # a drift grows with the time as the sun moves on: it looks like a lean along that motion
    sun_rad_per_h = 2.0 * np.pi / (BODIES[settings.body].day_s / 3600.0)
    covariance[:, 1, 1] += (settings.drift_sd_k_per_h * per_kelvin / sun_rad_per_h) ** 2


def _along_edge(
    at: FloatArray, covariance: FloatArray, axes: FloatArray, azimuth: FloatArray, drop: float
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Tilts along each pixel's ellipse (p, k) and azimuths over its best one, and whether it joins both
    branches (p,); then points of the other branch count as well.
    """
    angles = np.linspace(0.0, 2.0 * np.pi, STEPS, endpoint=False)
    half_axes = np.sqrt(drop) * np.linalg.cholesky(covariance)
    plane = at[:, np.newaxis, :2] + np.swapaxes(half_axes @ np.stack([np.cos(angles), np.sin(angles)]), 1, 2)
    length = np.hypot(plane[..., 0], plane[..., 1])
    touches = (length > 1.0).any(axis=1)
    plane /= np.maximum(length, 1.0)[..., np.newaxis]
    across = np.sqrt(np.maximum(1.0 - np.minimum(length, 1.0) ** 2, 0.0))
    across *= np.copysign(1.0, at[:, 2:])
    other = np.where(touches[:, np.newaxis], -across, across)
    edge = np.dstack([np.hstack([plane, plane]), np.hstack([across, other])])
    tilts, azimuths = tilt_azimuth(edge @ axes)
    return tilts, (azimuths - azimuth[:, np.newaxis] + 180.0) % 360.0 - 180.0, touches


def _contains(away: FloatArray, covariance: FloatArray, drop: float) -> BoolArray:
    """True for points (m, 2) from the centre that lie within the ellipse."""
    solved = np.linalg.solve(covariance, away[:, :, np.newaxis])[:, :, 0]
    return np.asarray((away * solved).sum(axis=1) <= drop)


def _with_states(slopes: SlopeMap, bounds: SingleArray, is_flat: BoolArray, target_deg: float) -> SlopeMap:
    state, is_ok = slopes.state.copy(), slopes.state == SlopeState.OK
    state[is_ok & is_flat] = SlopeState.FLAT
    half = half_width_deg(slopes.tilt_deg, bounds[0], bounds[1])
    state[is_ok & is_too_wide(slopes.tilt_deg, half, target_deg)] = SlopeState.WIDE
    return replace(slopes, state=state)
