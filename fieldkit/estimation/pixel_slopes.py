"""Slope maps: tilt and azimuth of every pixel, their bounds and states.

All pixels share the weights of a frame (the balance's steepness differs by 7 %), so the information matrix H
and its decomposition are shared, and a pixel keeps four numbers, ``b`` and ``c``. Frames are added at camera
rate and maps solved at display rate, in closed form: for windows of 20 minutes the tilt is within 0.005
degree of the iterated solution that regions use (`normal.solve`), the azimuth within 0.01. The branch is
chosen as for regions (`normal.choose`): tilt limit, then misfit and prior.

Bounds: in the plane of the sun's motion the likelihood of a pixel is an ellipse about its best slope, whose
size follows from noise, a misfit beyond it and the stated systematic uncertainties. The extremes of tilt and
azimuth are found along its edge; where the edge leaves the unit disc, both branches belong to one region.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from fieldkit.estimation.instant import AlongSun, along_sun, instant_scale_sd
from fieldkit.estimation.normal import LOWEST_COS_INCIDENCE
from fieldkit.estimation.pixel_posterior import PixelPosterior
from fieldkit.estimation.settings import PAPER_SCALE_SD, EstimatorSettings
from fieldkit.model.arrays import BoolArray, ByteArray, FloatArray, SingleArray
from fieldkit.model.confidence import CONFIDENCE, misfit_drop
from fieldkit.model.slope import SlopeState, half_width_deg, is_too_wide
from fieldkit.physics.bodies import BODIES
from fieldkit.physics.energy_balance import SurfaceParameters, irradiance_per_kelvin
from fieldkit.physics.facet import normal, tilt_azimuth

PIECE = 32_768  # pixels at a time, so that their intermediate arrays stay small
DEGREES = np.float32(180.0 / np.pi)
STEPS = 24
"""Points along the ellipse's edge: its extremes are met within one part in a hundred."""
LEAST_ACROSS = 0.2
"""Least distance from the plane of the sun's motion at which information across it is used."""


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


class MapSums:
    """Running sums of a slope map over the frames (rows, cols) of a window.

    `noise_k` is the standard deviation of one pixel, `tilt_limit_deg` the largest tilt considered,
    `confidence` that with which a second slope must be worse.
    """

    def __init__(
        self,
        shape: tuple[int, int],
        surface: SurfaceParameters,
        noise_k: float,
        tilt_limit_deg: float = 45.0,
        confidence: float = CONFIDENCE,
    ) -> None:
        self.shape = shape
        self.count: int = 0
        self._surface, self._noise_k = surface, noise_k
        self._drop = misfit_drop(confidence, 2)
        self._limit_cosine = np.float32(np.cos(np.radians(tilt_limit_deg)))
        pixels = shape[0] * shape[1]
        self._H, self._b, self._c = np.zeros((3, 3)), np.zeros((3, pixels)), np.zeros(pixels)
        self._weight_per_kelvin, self._towards_sun = 0.0, np.zeros(3)
        # in pieces that fit the processor's cache: the loops are bound by memory
        self._pieces = [slice(at, min(at + PIECE, pixels)) for at in range(0, pixels, PIECE)]

    def add(
        self,
        temperature_k: FloatArray,
        reference_k: float,
        sun: FloatArray,
        dni_w_m2: float,
        reference_normal: FloatArray,
        stored_w_m2: FloatArray | None = None,
        noise_gain: float = 1.0,
    ) -> None:
        """Add one frame of surface temperatures (rows, cols); NaN makes a pixel unknown.

        `reference_normal` is the reference's unit normal (3,), `sun` the unit vector towards the sun (3,),
        `dni_w_m2` > 0; with the full model the design vector and the beam with circumsolar light (`balance`).
        `stored_w_m2` (rows, cols) is the heat flux into the layer of a pixel less that of the reference,
        `noise_gain` how much more noise a pixel's heat has with it.
        """
        steepness = float(irradiance_per_kelvin(reference_k, self._surface))
        weight = (dni_w_m2 / (np.sqrt(2.0) * steepness * self._noise_k * noise_gain)) ** 2
        alpha, beta = self._surface.alpha / dni_w_m2, self._surface.beta / dni_w_m2
        start = float(reference_normal @ sun) - (alpha * reference_k**4 + beta * reference_k)
        flat_k = temperature_k.reshape(-1)
        for piece in self._pieces:
            kelvin = flat_k[piece]
            # y = n . s by eq. (6), as ((alpha T^2) T + beta) T + start
            y = kelvin * kelvin
            y *= alpha
            y *= kelvin
            y += beta
            y *= kelvin
            y += start
            if stored_w_m2 is not None:
                y += stored_w_m2.reshape(-1)[piece] / ((1.0 - self._surface.albedo) * dni_w_m2)
            for axis in range(3):
                self._b[axis, piece] += (weight * sun[axis]) * y
            y *= y
            y *= weight
            self._c[piece] += y
        self._H += weight * np.outer(sun, sun)
        self._towards_sun += weight * sun
        self._weight_per_kelvin += weight * steepness / dni_w_m2
        self.count += 1

    def add_rows(self, design: FloatArray, sun: FloatArray, values: Callable[[slice], SingleArray]) -> None:
        """Add rows ``design n = value`` of unit variance, with a design (k, 3) that all pixels share.

        `sun` (3,) is the mean vector towards the sun; `values` gives those (k, pixels) of a slice of the
        pixels, NaN to make one unknown.
        """
        for piece in self._pieces:
            y = values(piece)
            self._b[:, piece] += design.T.astype(np.float32) @ y
            self._c[piece] += np.einsum("kp,kp->p", y, y)
        self._H += design.T @ design
        self._towards_sun += len(design) * sun
        self.count += len(design)

    @property
    def per_kelvin(self) -> float:
        """Mean change of a pixel's cosine to the sun per kelvin of its temperature."""
        return self._weight_per_kelvin / float(np.trace(self._H))  # sun vectors are of length one

    def sun_axes(self) -> tuple[FloatArray, FloatArray]:
        """Axes along the mean sun, along its motion and across both, rows of (3, 3), the last one upwards.

        Before them, (3,), the information of the frames so far along each: inverse variances of a pixel's
        normal.
        """
        values, vectors = np.linalg.eigh(self._H)
        vectors[:, 0] *= np.copysign(1.0, vectors[2, 0])
        return values[::-1], vectors[:, ::-1].T

    def along_sun(self, reference_normal: FloatArray, settings: EstimatorSettings) -> AlongSun:
        """The component of every pixel's slope along the mean sun, (rows, cols): all that one frame gives."""
        values, axes = self.sun_axes()
        sun = axes[0] * np.copysign(1.0, axes[0, 2])
        cosine = (sun @ self._b / values[0]).reshape(self.shape)
        scaled = instant_scale_sd(settings) * (cosine - reference_normal @ sun)
        unscaled = np.hypot(values[0] ** -0.5, settings.offset_sd_k * self.per_kelvin)
        return along_sun(sun, cosine, np.hypot(scaled, unscaled), settings)

    def pull(self, direction: FloatArray, pixels: BoolArray) -> FloatArray:
        """Half the gradient of the misfit of these pixels against a direction (3,), at the origin."""
        return direction @ self._b[:, pixels.ravel()]

    def solve(self, explained: BoolArray | None = None) -> SlopeMap:
        """The map of all frames so far; the state is `TOO_FEW` with fewer than three.

        `explained` are pixels (rows, cols) of regions of which a slope was found: neither a misfit refuses
        them, which widens their bounds instead, nor a slope beyond the limit, which their bounds may reach.
        """
        refused = np.ones(self._c.size, np.bool_) if explained is None else ~explained.ravel()
        planes = np.full((4, self._c.size), np.nan, np.float32)
        state = np.full(self._c.size, SlopeState.TOO_FEW, np.uint8)
        if self.count >= 3:
            values, axes = self.sun_axes()
            for piece in self._pieces:
                self._solve_piece(
                    piece, values[::-1], axes[::-1].T, planes[:, piece], state[piece], refused[piece]
                )
        tilt, azimuth, second, chi_square = planes.reshape(4, *self.shape)
        return SlopeMap(tilt, azimuth, second, chi_square, state.reshape(self.shape))

    @property
    def _freedom(self) -> int:
        return max(self.count - 2, 1)

    def _solve_piece(
        self,
        piece: slice,
        values: FloatArray,
        vectors: FloatArray,
        planes: SingleArray,
        state: ByteArray,
        refused: BoolArray,
    ) -> None:
        import cv2

        y1, y2, pull, remainder = self._resolve(piece, values, vectors)
        m, e2, e1 = vectors.T.astype(np.float32)
        sun = (self._towards_sun / np.linalg.norm(self._towards_sun)).astype(np.float32)
        lowest, middle, highest = values.astype(np.float32)
        x1 = np.clip(y1, -1.0, 1.0)
        room = np.sqrt(1.0 - x1 * x1)
        x2 = np.minimum(np.maximum(y2, -room), room)
        across = np.sqrt(np.maximum(room * room - x2 * x2, 0.0))
        # over hours the sun leaves that plane, which gives information across it as well
        remainder += (lowest * across - 2.0 * pull) * across
        gain = 4.0 * pull * across  # misfit of the steeper branch less that of the flatter
        # both branches share the components in the plane
        east, north, level = (x1 * e1[i] + x2 * e2[i] for i in range(3))
        lift = m[2] * across
        flatter, steeper = level + lift, level - lift
        is_alone = (steeper < self._limit_cosine) | (across == 0.0)
        swap = ~is_alone & (gain < np.log(_square_sine(flatter) / _square_sine(steeper)))
        remainder += swap * gain
        side = np.float32(1.0) - np.float32(2.0) * swap
        for numbers in (gain, across, lift):
            numbers *= side
        tilt, azimuth, second, chi_square = planes
        chosen, other = level + lift, level - lift
        _arc_cosine(chosen, tilt)
        for component, part in ((north, m[1]), (east, m[0])):
            component += part * across
        is_dark = east * sun[0] + north * sun[1] + chosen * sun[2] < LOWEST_COS_INCIDENCE
        # accurate to 0.01 degree, and forty times as fast as numpy's
        azimuth[:] = cv2.phase(north, east, angleInDegrees=True).ravel()
        pinned = highest * (y1 - x1) ** 2 + middle * (y2 - x2) ** 2
        np.maximum(remainder, 0.0, out=remainder)
        np.divide(np.add(remainder, pinned, out=remainder), self._freedom, out=chi_square)
        self._set_states(chosen, other, chi_square, gain, is_alone, refused, state)
        misfits = refused & (chi_square > _alarm(self._freedom))
        _raise_state(state, misfits, SlopeState.NO_INTERSECTION)
        _raise_state(state, is_dark, SlopeState.SHADED)
        _raise_state(state, np.isnan(y1), SlopeState.NO_DATA)
        _arc_cosine(other, second)
        second += _NAN_UNLESS_NOT_RESOLVED.take(state)
        unknown = state >= np.uint8(SlopeState.NO_INTERSECTION)  # else all are converted to integers
        tilt[unknown] = azimuth[unknown] = np.nan  # they lie together

    def _resolve(self, piece: slice, values: FloatArray, vectors: FloatArray) -> Iterator[SingleArray]:
        """Each pixel's components in the plane of the sun's motion, its gradient across, and its misfit.

        Once the ill-conditioned sums are resolved into these, single precision is enough.
        """
        pull, c2, c1 = vectors.T @ self._b[:, piece]
        c1, c2 = c1 / values[2], c2 / values[1]
        remainder = self._c[piece] - values[2] * c1 * c1 - values[1] * c2 * c2
        return (numbers.astype(np.float32) for numbers in (c1, c2, pull, remainder))

    def _set_states(
        self,
        chosen: SingleArray,
        other: SingleArray,
        chi_square: SingleArray,
        gain: SingleArray,
        is_alone: BoolArray,
        refused: BoolArray,
        state: ByteArray,
    ) -> None:
        """States of lit pixels; `gain` is the misfit of the other branch less the chosen one's."""
        # a misfit beyond noise inflates the variance, and with it the significant difference
        significant = self._drop * np.maximum(chi_square, 1.0)
        np.multiply(~is_alone & (gain < significant), np.uint8(SlopeState.NOT_RESOLVED), out=state)
        limit = self._limit_cosine
        too_steep = (chosen < limit) | ((other < limit) & (gain < -significant))
        _raise_state(state, refused & too_steep, SlopeState.NO_INTERSECTION)


def _raise_state(state: ByteArray, where: BoolArray, value: SlopeState) -> None:
    """Set the state of some pixels; of two states the one of the larger number stays.

    By arithmetic: where neighbouring pixels differ, a masked assignment takes thirty times as long.
    """
    np.maximum(state, where * np.uint8(value), out=state)


_NAN_UNLESS_NOT_RESOLVED = np.full(len(SlopeState), np.nan, np.float32)
_NAN_UNLESS_NOT_RESOLVED[SlopeState.NOT_RESOLVED] = 0.0


def _square_sine(cosine: SingleArray) -> SingleArray:
    """The prior of `choose` adds its logarithm to the misfit; below a tenth of a degree it is constant."""
    return np.asarray(np.maximum(np.float32(1.0) - cosine * cosine, np.float32(3e-6)))


def _arc_cosine(cosine: SingleArray, out: SingleArray) -> None:
    """In degrees."""
    np.minimum(cosine, np.float32(1.0), out=out)
    np.arccos(out, out=out)
    out *= DEGREES


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


class _Extent:
    """Running extremes of tilt and azimuth of each pixel."""

    def __init__(self, tilt_deg: FloatArray, azimuth_deg: FloatArray) -> None:
        self._azimuth = azimuth_deg
        self.tilts, self.azimuth_shifts = np.array([tilt_deg, tilt_deg]), np.zeros((2, tilt_deg.size))

    def add(self, normals: FloatArray) -> None:
        tilt, azimuth = tilt_azimuth(normals)
        azimuth_shift = (azimuth - self._azimuth + 180.0) % 360.0 - 180.0
        for extremes, values in ((self.tilts, tilt), (self.azimuth_shifts, azimuth_shift)):
            np.minimum(extremes[0], values, out=extremes[0])
            np.maximum(extremes[1], values, out=extremes[1])


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
    gain = 4.0 * sums.pull(axes[2], is_known) * at[:, 2] / inflation
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
    own, other, touches = _along_edge(tilt, azimuth, at, covariance, axes, drop)
    is_vertical = _contains(axes[:2, 2] - at[:, :2], covariance, drop) & ((at[:, 2] > 0.0) | touches)
    low, high = _where_they_touch(touches, own.tilts, other.tilts)
    left, right = _where_they_touch(touches, own.azimuth_shifts, other.azimuth_shifts)
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


def _where_they_touch(touches: BoolArray, own: FloatArray, other: FloatArray) -> Iterator[FloatArray]:
    """Least and greatest values, of both branches where one region joins them."""
    for extreme, end, beyond in zip((np.minimum, np.maximum), own, other, strict=True):
        yield np.where(touches, extreme(end, beyond), end)


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
    tilt: FloatArray,
    azimuth: FloatArray,
    at: FloatArray,
    covariance: FloatArray,
    axes: FloatArray,
    drop: float,
) -> tuple[_Extent, _Extent, BoolArray]:
    """Extremes along each ellipse on its own branch and on the other, and whether it joins the two."""
    own, other = _Extent(tilt, azimuth), _Extent(tilt, azimuth)
    touches = np.zeros(tilt.size, np.bool_)
    half_axes = np.sqrt(drop) * np.linalg.cholesky(covariance)
    for angle in np.linspace(0.0, 2.0 * np.pi, STEPS, endpoint=False):
        plane = at[:, :2] + half_axes @ np.array([np.cos(angle), np.sin(angle)])
        length = np.hypot(plane[:, 0], plane[:, 1])
        touches |= length > 1.0
        plane /= np.maximum(length, 1.0)[:, np.newaxis]
        across = np.sqrt(np.maximum(1.0 - np.minimum(length, 1.0) ** 2, 0.0)) * np.copysign(1.0, at[:, 2])
        own.add(np.column_stack([plane, across]) @ axes)
        other.add(np.column_stack([plane, -across]) @ axes)
    return own, other, touches


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
