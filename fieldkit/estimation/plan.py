"""What a day can tell about slopes before anybody leaves the house: sensitivity and bounds.

All of it follows from the sun, the irradiance and the noise, minute by minute: how much
light and temperature change per degree of tilt, the Cramer-Rao bound of a window of
minutes, and the slope that would be mistaken for this one. Pure; nothing is measured yet.
Facets are unit normals (f, 3), suns unit vectors (n, 3), angles in degrees.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.estimation.bounds import cramer_rao, mirror, tangents
from fieldkit.physics.facet import FloatArray, cos_incidence, tilt_azimuth
from fieldkit.physics.surface import (
    STEFAN_BOLTZMANN,
    SurfaceParameters,
    direct_irradiance,
    irradiance_per_kelvin,
    surface_temperature,
)

GRAZING = 0.03
"""Cosine of incidence below which a facet is taken as in its own shade."""

SKY_EMISSIVITY = 0.85
"""Of a clear sky of middling humidity, for planning: long wave down over sigma T_a^4."""


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """What one degree of tilt does on each facet at each minute, arrays (f, n).

    `irradiance_w_m2` is direct light per degree, `temperature_k` kelvin per degree; negative
    where a steeper facet turns away from the sun, zero in its own shade.
    """

    irradiance_w_m2: FloatArray
    temperature_k: FloatArray


@dataclass(frozen=True, slots=True)
class Bound:
    """The best a window of minutes allows for each facet, arrays (f,); NaN where it allows nothing.

    Standard deviations in degrees: `tilt_deg` and `direction_deg` (on the ground: azimuth
    times the sine of tilt) with both unknown, `correlation` between the two, `known_azimuth_deg` of tilt
    where the azimuth is given. `mirror_*` is the slope that fits the same minutes.
    """

    tilt_deg: FloatArray
    direction_deg: FloatArray
    correlation: FloatArray
    known_azimuth_deg: FloatArray
    mirror_tilt_deg: FloatArray
    mirror_azimuth_deg: FloatArray

    @property
    def normal_deg(self) -> FloatArray:
        """Root mean square angle between the estimated normal and the true one."""
        return np.hypot(self.tilt_deg, self.direction_deg)


def expected_temperature(
    normals: FloatArray, sun: FloatArray, direct_w_m2: ArrayLike, air_k: float, surface: SurfaceParameters
) -> FloatArray:
    """Surface temperature (f, n) by eq. (7) under a clear sky, kelvin."""
    longwave = SKY_EMISSIVITY * STEFAN_BOLTZMANN * air_k**4
    light = direct_irradiance(direct_w_m2, cos_incidence(normals, sun))
    return surface_temperature(light, longwave, air_k, surface)


def sensitivity(
    normals: FloatArray,
    sun: FloatArray,
    direct_w_m2: ArrayLike,
    temperature_k: ArrayLike,
    surface: SurfaceParameters,
) -> Sensitivity:
    """Derivative of eq. (2) by tilt, and of eqs. (2) and (6) together."""
    steeper, _ = tangents(normals)
    lit = cos_incidence(normals, sun) > 0.0
    light = np.where(lit, np.asarray(direct_w_m2) * np.radians(cos_incidence(steeper, sun)), 0.0)
    return Sensitivity(light, light / irradiance_per_kelvin(temperature_k, surface))


def cosine_noise(
    direct_w_m2: ArrayLike, temperature_k: ArrayLike, noise_k: float, surface: SurfaceParameters
) -> FloatArray:
    """Standard deviation of one minute's measured cosine of incidence.

    ``sqrt(2) D sigma_T / S``: both regions carry the noise of a mean. Infinite without sun.
    """
    direct = np.asarray(direct_w_m2, np.float64)
    noise = np.sqrt(2.0) * noise_k * irradiance_per_kelvin(temperature_k, surface)
    return np.where(direct > 0.0, noise / np.where(direct > 0.0, direct, 1.0), np.inf)


def bound(normals: FloatArray, sun: FloatArray, sigma: ArrayLike) -> Bound:
    """Cramer-Rao bound from minutes with suns (n, 3) whose cosines are known to `sigma` (n,) or (f, n).

    Minutes in which a facet is in its own shade say nothing about it; fewer than three
    minutes determine nothing.
    """
    lit = cos_incidence(normals, sun) > GRAZING
    weights = np.where(lit, 1.0 / np.square(sigma), 0.0)
    enough = (np.count_nonzero(weights, axis=-1) >= 3)[:, np.newaxis, np.newaxis]
    H = np.where(enough, np.einsum("fk,ki,kj->fij", weights, sun, sun, optimize=True), np.eye(3))
    covariance = np.where(enough, np.degrees(np.degrees(cramer_rao(H, normals))), np.nan)
    tilt_sd, direction_sd = np.sqrt(covariance[:, 0, 0]), np.sqrt(covariance[:, 1, 1])
    steeper, _ = tangents(normals)
    along = np.einsum("fi,fij,fj->f", steeper, H, steeper)
    known = np.where(enough[:, 0, 0], np.degrees(1.0 / np.sqrt(along)), np.nan)
    other_tilt, other_azimuth = tilt_azimuth(np.where(enough[:, 0], mirror(normals, H), np.nan))
    return Bound(
        tilt_sd,
        direction_sd,
        covariance[:, 0, 1] / (tilt_sd * direction_sd),
        known,
        other_tilt,
        other_azimuth,
    )


def bounds_over_day(
    normals: FloatArray, sun: FloatArray, sigma: FloatArray, starts: ArrayLike, minutes: int
) -> list[Bound]:
    """One `Bound` per start: minutes ``start..start + minutes`` (both ends) of a one-minute grid.

    `sigma` has shape (f, n); infinite where there is no usable sun.
    """
    slices = [slice(int(start), int(start) + minutes + 1) for start in np.asarray(starts)]
    return [bound(normals, sun[chosen], sigma[:, chosen]) for chosen in slices]
