"""Plan of a day: which hours determine which slopes, before anything is measured.

All of it follows from sun, irradiance and noise, minute by minute: the change of light and temperature per
degree of tilt, the Cramer-Rao bound of a window of minutes, and the mirror slope that fits as well. Pure
functions: facets are unit normals (f, 3), suns unit vectors (n, 3), angles in degrees.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.estimation.normal import LOWEST_COS_INCIDENCE, cramer_rao, mirror, tangents
from fieldkit.model.arrays import BoolArray, FloatArray, IntArray
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.bodies import EARTH
from fieldkit.physics.constants import STEFAN_BOLTZMANN
from fieldkit.physics.energy_balance import (
    SurfaceParameters,
    direct_irradiance,
    irradiance_per_kelvin,
    surface_temperature,
)
from fieldkit.physics.facet import cos_incidence, normal, tilt_azimuth

SKY_EMISSIVITY = 0.85
"""Emissivity of a clear sky of average humidity, for planning: downward longwave over sigma T_a^4."""
LONG_SHADOWS_DEG = 15.0
WEAK_K_PER_DEG = 1.0 / 30.0
"""Below this a tenth of a kelvin between two facets is more than three degrees of tilt."""
FLAT_DEG = 3.0
"""The azimuth of a flatter facet is not worth estimating."""
FINE_DEG, LONGEST_MIN = 10.0, 360
DARK_W_M2 = 1e-9
"""Dust at the horizon leaves of the sun less than a quotient can hold."""
TABLE_1 = SurfaceParameters()


@dataclass(frozen=True, slots=True)
class PlanSettings:
    """Assumptions about the facets, the camera and the air.

    `noise_k` is the standard deviation of one region's minute mean, `window_min` the
    length of the windows whose bound is computed, `bias_deg` the tilt error to budget for,
    `azimuth_known` whether estimates use the given azimuths instead of estimating them. `sky_emissivity` is
    the downward longwave over sigma T_a^4, `rising_deg` the elevation of the sun's centre at sunrise.
    """

    surface: SurfaceParameters = TABLE_1
    noise_k: float = 0.1
    window_min: int = 20
    low_sun_deg: float = 8.0
    tilt_limit_deg: float = 45.0
    air_k: float = 288.15
    bias_deg: float = 2.0
    azimuth_known: bool = False
    sky_emissivity: float = SKY_EMISSIVITY
    rising_deg: float = EARTH.rising_deg


@dataclass(frozen=True, slots=True)
class DayPlan:
    """One day for some facets (tilt, azimuth), by the minute (n,) and at chosen rows (r,).

    `rows` index minutes; `bounds` hold for the window that starts at each of them.
    """

    facets: tuple[tuple[float, float], ...]
    settings: PlanSettings
    time_ns: IntArray
    sun: FloatArray
    dni_w_m2: FloatArray
    sensitivity: Sensitivity
    sigma: FloatArray
    rows: IntArray
    bounds: tuple[Bound, ...]

    @property
    def elevation_deg(self) -> FloatArray:
        """Elevation of the sun at each minute."""
        return _elevation_deg(self.sun)

    @property
    def usable(self) -> BoolArray:
        """Minutes (n,) with the sun high enough for its light to be known, and not behind the horizon."""
        return (self.elevation_deg >= self.settings.low_sun_deg) & (self.dni_w_m2 > 0.0)

    @property
    def weak(self) -> BoolArray:
        """Facets and minutes (f, n) at which temperature hardly depends on tilt."""
        return np.abs(self.sensitivity.temperature_k) < WEAK_K_PER_DEG

    def tilt_sd_deg(self, row: int) -> FloatArray:
        """Bound (f,) of the tilt in the window of `rows[row]`, 1 sd, the azimuth known or not as set."""
        bounds = self.bounds[row]
        return bounds.known_azimuth_deg if self.settings.azimuth_known else bounds.tilt_deg

    @property
    def best_row(self) -> int | None:
        """The one of `rows` that starts the window with the smallest bound for the worst facet.

        Of the facets that a window bounds; one that bounds more of them comes first.
        """
        last = self.rows + self.settings.window_min
        whole = np.flatnonzero(last < self.usable.size).tolist()
        sds = {row: self.tilt_sd_deg(row) for row in whole if self._is_usable(row)}
        bounded = {row: sd[np.isfinite(sd)] for row, sd in sds.items() if np.isfinite(sd).any()}
        worst = {row: (-sd.size, float(np.max(sd))) for row, sd in bounded.items()}
        return min(worst, key=worst.__getitem__) if worst else None

    def _is_usable(self, row: int) -> bool:
        first = self.rows[row]
        return bool(self.usable[first : first + self.settings.window_min + 1].all())

    def bias_budget_k(self) -> FloatArray:
        """Offset to the reference that biases the tilt by `bias_deg` in the best window, (f,), kelvin."""
        if self.best_row is None:
            return np.full(len(self.facets), np.nan)
        first = self.rows[self.best_row]
        window = self.sensitivity.temperature_k[:, first : first + self.settings.window_min + 1]
        return np.asarray(np.abs(window.mean(axis=1)) * self.settings.bias_deg)

    def minutes_for_azimuth(self) -> int | None:
        """Shortest window around the best that bounds all tilted facets' azimuths (`FINE_DEG`), or None."""
        sines = np.sin(np.radians([tilt for tilt, _ in self.facets]))
        tilted = sines > np.sin(np.radians(FLAT_DEG))
        if self.best_row is None or not tilted.any():
            return None
        middle = int(self.rows[self.best_row]) + self.settings.window_min // 2
        normals, usable = _normals(self.facets)[tilted], np.where(self.usable, self.sigma, np.inf)[tilted]
        for minutes in range(10, LONGEST_MIN + 1, 10):
            window = slice(max(0, middle - minutes // 2), middle + minutes // 2 + 1)
            bounds = bound(normals, self.sun[window], usable[:, window])
            if np.all(bounds.direction_deg / sines[tilted] <= FINE_DEG):
                return minutes
        return None

    def intervals(self, condition: BoolArray) -> list[tuple[int, int]]:
        """First and last usable minute of every interval in which `condition` (n,) holds, UTC nanoseconds."""
        minutes = np.flatnonzero(self.usable)
        inside = np.concatenate([[False], condition[minutes], [False]])
        starts = np.flatnonzero(inside[1:] & ~inside[:-1])
        ends = np.flatnonzero(inside[:-1] & ~inside[1:]) - 1
        times = self.time_ns[minutes]
        return [(int(times[a]), int(times[b])) for a, b in zip(starts, ends, strict=True)]

    def verdict(self, row: int) -> str:
        """Rating of the hour of `rows[row]` by sun and slope: usable, fair, weak or poor, with the reason."""
        minute = int(self.rows[row])
        elevation = self.elevation_deg[minute]
        if elevation < self.settings.low_sun_deg:
            return "poor: irradiance unknown near the horizon"
        if not self.usable[minute]:
            return "poor: the horizon hides the sun"
        if not self._is_usable(row):
            lowest = self.elevation_deg[minute : minute + self.settings.window_min + 1].min()
            is_low = lowest < self.settings.low_sun_deg
            what = "the sun is too low" if is_low else "the horizon hides the sun"
            return f"poor: {what} within {self.settings.window_min} min"
        weak = self.weak[:, minute]
        if weak.any():
            return f"weak for {self._facet_names(weak)}"
        if elevation < LONG_SHADOWS_DEG:
            return "fair: low sun, long shadows"
        return "usable"

    def _facet_names(self, chosen: BoolArray) -> str:
        if chosen.all() and chosen.size > 1:
            return "all"
        return ", ".join(label(self.facets[facet]) for facet in np.flatnonzero(chosen))


def plan_day(
    facets: Sequence[tuple[float, float]],
    time_ns: IntArray,
    sun: FloatArray,
    dni_w_m2: FloatArray,
    settings: PlanSettings,
    step_min: int = 30,
) -> DayPlan:
    """Plan of one day for some facets, tilt and azimuth of each in degrees.

    `time_ns` (n,), UTC, are the day's minutes, equally spaced, `sun` (n, 3) unit vectors towards the sun
    then, `dni_w_m2` (n,) direct normal irradiance. Rows are the multiples of `step_min` with the sun up, or
    the minute of its highest if it is up between two of them.
    """
    normals = _normals(facets)
    elevation = _elevation_deg(sun)
    up = elevation > settings.rising_deg
    light = np.where(up, dni_w_m2, 0.0)
    surface_k = expected_temperature(normals, sun, light, settings)
    sigma = cosine_noise(light, surface_k, settings.noise_k, settings.surface)
    on_step = (time_ns - time_ns[0]) % (step_min * MINUTE_NS) == 0
    rows = np.flatnonzero(up & (on_step if (up & on_step).any() else elevation == elevation.max()))
    usable_sigma = np.where(elevation < settings.low_sun_deg, np.inf, sigma)
    windows = [slice(row, row + settings.window_min + 1) for row in rows.tolist()]
    return DayPlan(
        facets=tuple(facets),
        settings=settings,
        time_ns=time_ns,
        sun=sun,
        dni_w_m2=light,
        sensitivity=sensitivity(normals, sun, light, surface_k, settings.surface),
        sigma=sigma,
        rows=rows,
        bounds=tuple(bound(normals, sun[window], usable_sigma[:, window]) for window in windows),
    )


def label(facet: tuple[float, float]) -> str:
    """A facet in words: ``10°/180°``."""
    return f"{facet[0]:g}°/{facet[1]:g}°"


def _elevation_deg(sun: FloatArray) -> FloatArray:
    return np.asarray(90.0 - tilt_azimuth(sun)[0])


def _normals(facets: Sequence[tuple[float, float]]) -> FloatArray:
    return normal([tilt for tilt, _ in facets], [azimuth for _, azimuth in facets])


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """Change per degree of tilt on each facet at each minute, arrays (f, n).

    `irradiance_w_m2` of direct light, `temperature_k` of the surface; negative where a steeper facet turns
    away from the sun, zero where it is self-shaded.
    """

    irradiance_w_m2: FloatArray
    temperature_k: FloatArray


@dataclass(frozen=True, slots=True)
class Bound:
    """Cramer-Rao bound of each facet in a window, arrays (f,); NaN where the window determines nothing.

    Standard deviations in degrees: `tilt_deg` and `direction_deg` (on the ground: azimuth
    times the sine of tilt) with both unknown, `correlation` between the two, `known_azimuth_deg` of tilt
    where the azimuth is given. `mirror_*` is the slope that fits as well.
    """

    tilt_deg: FloatArray
    direction_deg: FloatArray
    correlation: FloatArray
    known_azimuth_deg: FloatArray
    mirror_tilt_deg: FloatArray
    mirror_azimuth_deg: FloatArray


def expected_temperature(
    normals: FloatArray, sun: FloatArray, dni_w_m2: ArrayLike, settings: PlanSettings
) -> FloatArray:
    """Surface temperature under a clear sky by the paper's eq. (7), shape (f, n), kelvin.

    Of unit normals (f, 3) under suns (n, 3) of direct normal irradiance (n,).
    """
    longwave = settings.sky_emissivity * STEFAN_BOLTZMANN * settings.air_k**4
    light = direct_irradiance(dni_w_m2, cos_incidence(normals, sun))
    return surface_temperature(light, longwave, settings.air_k, settings.surface)


def sensitivity(
    normals: FloatArray,
    sun: FloatArray,
    dni_w_m2: ArrayLike,
    temperature_k: ArrayLike,
    surface: SurfaceParameters,
) -> Sensitivity:
    """Change of light and temperature per degree of tilt: the paper's eq. (2), and eqs. (2) and (6) together.

    Arguments as of `expected_temperature`, and surface temperatures that broadcast with (f, n).
    """
    steeper, _ = tangents(normals)
    lit = cos_incidence(normals, sun) > 0.0
    light = np.where(lit, np.asarray(dni_w_m2) * np.radians(cos_incidence(steeper, sun)), 0.0)
    heat = irradiance_per_kelvin(temperature_k, surface) + np.zeros_like(light)
    # without light nothing changes, also where no air and no sky keep a surface from 0 K
    return Sensitivity(light, np.divide(light, heat, out=np.zeros_like(light), where=light != 0.0))


def cosine_noise(
    dni_w_m2: ArrayLike, temperature_k: ArrayLike, noise_k: float, surface: SurfaceParameters
) -> FloatArray:
    """Standard deviation of one minute's measured cosine of incidence; infinite without sun.

    ``sqrt(2) D sigma_T / S``: both regions have the noise `noise_k` of a mean. Irradiance and temperature
    have any shapes that broadcast.
    """
    direct = np.asarray(dni_w_m2, np.float64)
    noise = np.sqrt(2.0) * noise_k * irradiance_per_kelvin(temperature_k, surface)
    return np.where(direct > DARK_W_M2, noise / np.maximum(direct, DARK_W_M2), np.inf)


def bound(normals: FloatArray, sun: FloatArray, sigma: ArrayLike) -> Bound:
    """Cramer-Rao bound of the slopes of facets from some minutes.

    Unit normals (f, 3), unit vectors towards the sun (n, 3); `sigma` of the measured cosines, (n,) or (f, n),
    is infinite to exclude a minute. Minutes in which a facet is self-shaded give no information about it; at
    least three are needed.
    """
    lit = cos_incidence(normals, sun) > LOWEST_COS_INCIDENCE
    weights = np.where(lit, 1.0 / np.square(sigma), 0.0)
    enough = (np.count_nonzero(weights, axis=-1) >= 3)[:, np.newaxis, np.newaxis]
    H = np.where(enough, np.einsum("fk,ki,kj->fij", weights, sun, sun, optimize=True), np.eye(3))
    covariance = np.where(enough, np.degrees(np.degrees(cramer_rao(H, normals))), np.nan)
    tilt_sd, direction_sd = np.sqrt(covariance[:, 0, 0]), np.sqrt(covariance[:, 1, 1])
    steeper, _ = tangents(normals)
    along = np.einsum("fi,fij,fj->f", steeper, H, steeper)
    tilt_alone = np.where(enough[:, 0, 0], np.degrees(1.0 / np.sqrt(along)), np.nan)
    other_tilt, other_azimuth = tilt_azimuth(np.where(enough[:, 0], mirror(normals, H), np.nan))
    return Bound(
        tilt_sd,
        direction_sd,
        covariance[:, 0, 1] / (tilt_sd * direction_sd),
        tilt_alone,
        other_tilt,
        other_azimuth,
    )
