"""How sure each pixel of a slope map is: its 90 % region, and the state that follows from it.

In the plane of the sun's motion the likelihood of a pixel is an ellipse about its best slope, made as wide as
noise, a misfit beyond it and the stated systematic uncertainties ask for. Its edge is walked round once;
where it leaves the unit disc, both branches of the slope belong to one region.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fieldkit.estimation.likelihood import NINETY_PERCENT
from fieldkit.estimation.settings import PAPER_SCALE_SD, EstimatorSettings
from fieldkit.estimation.slope_map import MapSums, SlopeMap
from fieldkit.model.slope import SlopeState, is_too_wide
from fieldkit.physics.facet import FloatArray, normal, tilt_azimuth

STEPS = 24
"""Points of an ellipse's edge that are tried: its extremes are met within one part in a hundred."""
SUN_RAD_PER_H = 2.0 * np.pi / 24.0
LEAST_ACROSS = 0.2
"""Nearer to the plane of the sun's motion than this, what hours say about leaving it is not counted."""


@dataclass(frozen=True, slots=True)
class PixelBounds:
    """Projections of each pixel's 90 % region, (rows, cols), degrees; NaN where there is no slope.

    Azimuths are unwrapped, low <= azimuth <= high; a whole turn apart where the vertical normal fits too.
    """

    tilt_low_deg: NDArray[np.float32]
    tilt_high_deg: NDArray[np.float32]
    azimuth_low_deg: NDArray[np.float32]
    azimuth_high_deg: NDArray[np.float32]


class _Extent:
    """The extremes of tilt and azimuth among normals, one after the other of each pixel."""

    def __init__(self, tilt_deg: FloatArray, azimuth_deg: FloatArray) -> None:
        self._azimuth = azimuth_deg
        self.tilts, self.turns = np.array([tilt_deg, tilt_deg]), np.zeros((2, tilt_deg.size))

    def add(self, normals: FloatArray) -> None:
        tilt, azimuth = tilt_azimuth(normals)
        turn = (azimuth - self._azimuth + 180.0) % 360.0 - 180.0
        for extremes, values in ((self.tilts, tilt), (self.turns, turn)):
            np.minimum(extremes[0], values, out=extremes[0])
            np.maximum(extremes[1], values, out=extremes[1])


def with_bounds(
    slopes: SlopeMap, sums: MapSums, reference_normal: FloatArray, settings: EstimatorSettings
) -> tuple[SlopeMap, PixelBounds]:
    """The map with the states `FLAT` and `UNCERTAIN` by the rules of regions, and its pixels' bounds.

    The stated systematic uncertainties of scale, offset and drift count to first order.
    """
    known = np.isfinite(slopes.tilt_deg)
    tilt, azimuth = (angle[known].astype(np.float64) for angle in (slopes.tilt_deg, slopes.azimuth_deg))
    values, axes = sums.sun_axes()
    at = normal(tilt, azimuth) @ axes.T
    covariance = _covariance(at, values, np.maximum(slopes.chi_square[known], 1.0))
    _add_systematics(covariance, at - axes @ reference_normal, sums.per_kelvin, settings)
    own, other, touches = _walked(tilt, azimuth, at, covariance, axes)
    is_vertical = _holds(axes[:2, 2] - at[:, :2], covariance) & ((at[:, 2] > 0.0) | touches)
    low, high = own.tilts
    low = np.where(touches, np.minimum(low, other.tilts[0]), low)
    high = np.where(touches, np.maximum(high, other.tilts[1]), high)
    left = np.where(touches, np.minimum(own.turns[0], other.turns[0]), own.turns[0])
    right = np.where(touches, np.maximum(own.turns[1], other.turns[1]), own.turns[1])
    bounds = (
        np.where(is_vertical, 0.0, low),
        np.maximum(np.minimum(high, settings.tilt_limit_deg), tilt),
        azimuth + np.where(is_vertical, -180.0, left),
        azimuth + np.where(is_vertical, 180.0, right),
    )
    planes = np.full((4, *known.shape), np.nan, np.float32)
    planes[:, known] = bounds
    flat = np.zeros(known.shape, np.bool_)
    flat[known] = is_vertical
    return _judged(slopes, planes, flat), PixelBounds(*planes)


def _covariance(at: FloatArray, values: FloatArray, inflation: FloatArray) -> FloatArray:
    """Of the two components in the plane of the sun's motion, (m, 2, 2), by noise alone.

    `at` (m, 3) are the best slopes along the mean sun, along its motion and across both; `values` (3,) are
    what the sums say along these.
    """
    values = np.maximum(values, 1e-9 * values[0])  # rounding may leave less than nothing of the least
    outer = at[:, :2, np.newaxis] * at[:, np.newaxis, :2]
    # a unit normal that moves in the plane also moves across it, which hours of sun notice
    across = values[2] / np.maximum(at[:, 2] ** 2, LEAST_ACROSS**2)
    information = np.diag(values[:2]) + across[:, np.newaxis, np.newaxis] * outer
    return np.asarray(np.linalg.inv(information) * inflation[:, np.newaxis, np.newaxis])


def _add_systematics(
    covariance: FloatArray, away: FloatArray, per_kelvin: float, settings: EstimatorSettings
) -> None:
    """Add what does not average away: a scale moves slopes from the reference, an offset towards the sun."""
    scale_sd = np.hypot(settings.scale_sd, PAPER_SCALE_SD)
    covariance += scale_sd**2 * away[:, :2, np.newaxis] * away[:, np.newaxis, :2]
    covariance[:, 0, 0] += (settings.offset_sd_k * per_kelvin) ** 2
    covariance[:, 1, 1] += (settings.drift_sd_k_per_h * per_kelvin / SUN_RAD_PER_H) ** 2


def _walked(
    tilt: FloatArray, azimuth: FloatArray, at: FloatArray, covariance: FloatArray, axes: FloatArray
) -> tuple[_Extent, _Extent, NDArray[np.bool_]]:
    """Extremes round each ellipse on the pixel's own branch and the other, and whether it joins the two."""
    own, other = _Extent(tilt, azimuth), _Extent(tilt, azimuth)
    touches = np.zeros(tilt.size, np.bool_)
    half_axes = np.sqrt(NINETY_PERCENT) * np.linalg.cholesky(covariance)
    for angle in np.linspace(0.0, 2.0 * np.pi, STEPS, endpoint=False):
        plane = at[:, :2] + half_axes @ np.array([np.cos(angle), np.sin(angle)])
        length = np.hypot(plane[:, 0], plane[:, 1])
        touches |= length > 1.0
        plane /= np.maximum(length, 1.0)[:, np.newaxis]
        across = np.sqrt(np.maximum(1.0 - np.minimum(length, 1.0) ** 2, 0.0)) * np.copysign(1.0, at[:, 2])
        own.add(np.column_stack([plane, across]) @ axes)
        other.add(np.column_stack([plane, -across]) @ axes)
    return own, other, touches


def _holds(away: FloatArray, covariance: FloatArray) -> NDArray[np.bool_]:
    """Whether a point (m, 2) from the centre lies within the 90 % ellipse."""
    solved = np.linalg.solve(covariance, away[:, :, np.newaxis])[:, :, 0]
    return np.asarray((away * solved).sum(axis=1) <= NINETY_PERCENT)


def _judged(slopes: SlopeMap, bounds: NDArray[np.float32], is_flat: NDArray[np.bool_]) -> SlopeMap:
    state, is_ok = slopes.state.copy(), slopes.state == SlopeState.OK
    state[is_ok & is_flat] = SlopeState.FLAT
    state[is_ok & is_too_wide(slopes.tilt_deg, bounds[0], bounds[1])] = SlopeState.UNCERTAIN
    return replace(slopes, state=state)
