"""Plan of a day: which hours determine which slopes, before anything is measured.

All of it follows from sun and irradiance, minute by minute: the change of light and temperature per degree of
tilt, and the mirror slope that fits as well. Pure functions: facets are unit normals (f, 3), suns unit
vectors (n, 3), angles in degrees.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.estimation.normal import mirror, tangents
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
SUN_W_M2 = 1000.0
WINDOW_MIN = 20
"""Length of the usable interval that the best minute is in the middle of, and that a twin fits."""
TABLE_1 = SurfaceParameters()


@dataclass(frozen=True, slots=True)
class PlanSettings:
    """Assumptions about the facets and the air.

    `bias_deg` is the tilt error to budget for, `sky_emissivity` the downward longwave over sigma T_a^4,
    `rising_deg` the elevation of the sun's centre at sunrise.
    """

    surface: SurfaceParameters = TABLE_1
    low_sun_deg: float = 8.0
    tilt_limit_deg: float = 45.0
    air_k: float = 288.15
    bias_deg: float = 2.0
    sky_emissivity: float = SKY_EMISSIVITY
    rising_deg: float = EARTH.rising_deg


@dataclass(frozen=True, slots=True)
class DayPlan:
    """One day for some facets (tilt, azimuth), by the minute (n,); `rows` (r,) index the minutes to show."""

    facets: tuple[tuple[float, float], ...]
    settings: PlanSettings
    time_ns: IntArray
    sun: FloatArray
    dni_w_m2: FloatArray
    sensitivity: Sensitivity
    rows: IntArray

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

    def best_minute(self, minutes: int = WINDOW_MIN) -> int | None:
        """Middle of the usable interval in which the sun shines most on the facet on which it shines least.

        Facets that it does not reach do not count, and times when it reaches more of them come first. None if
        there is no usable interval of so many minutes.
        """
        window = np.ones(minutes + 1) / (minutes + 1)
        light = direct_irradiance(self.dni_w_m2, cos_incidence(_normals(self.facets), self.sun))
        mean = np.array([np.convolve(of_facet, window, "same") for of_facet in light])
        least = np.where(mean > 0.0, mean, np.inf).min(axis=0)
        can_be = (np.convolve(self.usable, window, "same") > 1.0 - 0.5 * window[0]) & np.isfinite(least)
        rank = np.count_nonzero(light, axis=0) - np.exp(-least / SUN_W_M2)
        return int(np.argmax(np.where(can_be, rank, -1.0))) if can_be.any() else None

    def bias_budget_k(self) -> FloatArray:
        """Offset to the reference that biases the tilt by `bias_deg` in the best minute, (f,), kelvin."""
        if (best := self.best_minute()) is None:
            return np.full(len(self.facets), np.nan)
        return np.abs(self.sensitivity.temperature_k[:, best]) * self.settings.bias_deg

    def twins(self) -> list[tuple[float, float]]:
        """Tilt and azimuth of the mirror slope of each facet, which fits the best `WINDOW_MIN` as well."""
        if (best := self.best_minute()) is None:
            return []
        first = best - WINDOW_MIN // 2
        sun = self.sun[first : first + WINDOW_MIN + 1]
        tilts, azimuths = tilt_azimuth(mirror(_normals(self.facets), sun.T @ sun))
        return list(zip(tilts.tolist(), azimuths.tolist(), strict=True))

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
        weak = self.weak[:, minute]
        if weak.any():
            facets = ", ".join(label(self.facets[facet]) for facet in np.flatnonzero(weak))
            return f"weak for {'all' if weak.all() and weak.size > 1 else facets}"
        return "fair: low sun, long shadows" if elevation < LONG_SHADOWS_DEG else "usable"


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
    on_step = (time_ns - time_ns[0]) % (step_min * MINUTE_NS) == 0
    rows = np.flatnonzero(up & (on_step if (up & on_step).any() else elevation == elevation.max()))
    return DayPlan(
        facets=tuple(facets),
        settings=settings,
        time_ns=time_ns,
        sun=sun,
        dni_w_m2=light,
        sensitivity=sensitivity(normals, sun, light, surface_k, settings.surface),
        rows=rows,
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
