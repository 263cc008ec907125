"""State of sky and air over a scene: sunlight, skylight, longwave, air and wind; measured, or clear by a
formula.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np

from fieldkit.model.arrays import FloatArray, IntArray
from fieldkit.model.errors import ConfigError
from fieldkit.model.site import Site
from fieldkit.physics.bodies import EARTH, body_of
from fieldkit.physics.constants import STEFAN_BOLTZMANN
from fieldkit.physics.daylight import clear_day, clear_sky_longwave
from fieldkit.weather import Weather

_DAY_H = 24.0
_WARMEST_H = 15.0  # air is warmest about three hours after solar noon
_WINDOW_DEFICIT = 1.5
COLDEST_SKY_K = 100.0
"""Colder than this, as space is, a sky adds nothing in the camera's band."""


@dataclass(frozen=True, slots=True)
class SkyState:
    """Sky and air at n times, each array (n,): W/m², K and m/s."""

    dni_w_m2: FloatArray
    dhi_w_m2: FloatArray
    longwave_down_w_m2: FloatArray
    air_temperature_k: FloatArray
    wind_m_s: FloatArray

    def window_temperature_k(self) -> FloatArray:
        """Sky temperature (n,) in the camera's 8-14 µm band.

        The atmosphere is most transparent there, so the sky looks colder than its broadband longwave
        suggests: by half as much again below the air. Clear dry air gives -40 to -60 °C; under an overcast
        all three temperatures are equal, as observed (window-band sky -20 to -60 °C).
        """
        sky = (self.longwave_down_w_m2 / STEFAN_BOLTZMANN) ** 0.25
        window = self.air_temperature_k - _WINDOW_DEFICIT * (self.air_temperature_k - sky)
        return np.maximum(window, COLDEST_SKY_K)


class Sky(Protocol):
    """State of sky and air at any time."""

    def sky_state(self, time_ns: IntArray, cos_zenith: FloatArray, site: Site) -> SkyState:
        """Sky and air at times (n,), given the cosines of the sun's zenith angle (n,)."""


@dataclass(frozen=True, slots=True)
class MeasuredSky:
    """The sky of a measured day, linear between the minutes and constant beyond the ends.

    Raises `ConfigError` for another day, or for a quantity that the station does not measure.
    """

    weather: Weather

    def sky_state(self, time_ns: IntArray, cos_zenith: FloatArray, site: Site) -> SkyState:
        """See `Sky`; the position of the sun is part of the measurement."""
        day = self.weather
        if time_ns[-1] < day.time_ns[0] or time_ns[0] > day.time_ns[-1]:
            span = day.time_ns[[0, -1]].astype("datetime64[ns]").astype("datetime64[m]")
            raise ConfigError(
                f"measured from {span[0]} to {span[1]} UTC, not at the scene's time",
                place=day.source,
                fix="let the scene start on that day",
            )
        dni, dhi, *others = (self._at(time_ns, column.name) for column in fields(SkyState))
        return SkyState(np.maximum(dni, 0.0), np.maximum(dhi, 0.0), *others)

    def _at(self, time_ns: IntArray, name: str) -> FloatArray:
        column: FloatArray = getattr(self.weather, name)
        has_value = np.isfinite(column)
        if not has_value.any():
            raise ConfigError(
                f"no {name}, which a simulated field needs",
                place=self.weather.source,
                fix="use a day of SURFRAD, whose stations measure it",
            )
        start_ns = self.weather.time_ns[0]
        since, known_since = time_ns - start_ns, self.weather.time_ns[has_value] - start_ns
        return np.asarray(np.interp(since, known_since, column[has_value]), np.float64)


@dataclass(frozen=True, slots=True)
class ClearSky:
    """A cloudless sky by formulas: `clear_day` for light, `clear_sky_longwave` for longwave.

    Elsewhere than on the Earth longwave and air are the body's, constant.

    Air temperature swings by `swing_k` around its mean, warmest at 15 h solar time.
    """

    linke_turbidity: float = 3.0
    air_temperature_k: float = 300.0
    swing_k: float = 4.0
    wind_m_s: float = 1.0

    def sky_state(self, time_ns: IntArray, cos_zenith: FloatArray, site: Site) -> SkyState:
        """See `Sky`."""
        dni_w_m2, dhi_w_m2 = clear_day(cos_zenith, time_ns, site, turbidity=self.linke_turbidity)
        body = body_of(site)
        if body is EARTH:
            solar_h = time_ns / 3.6e12 + site.longitude_deg / 15.0
            air = self.air_temperature_k + self.swing_k * np.cos(2 * np.pi * (solar_h - _WARMEST_H) / _DAY_H)
            longwave = clear_sky_longwave(air)
        else:
            air = np.full(time_ns.shape, body.air_temperature_k)
            longwave = np.full_like(air, body.longwave_down_w_m2)
        return SkyState(dni_w_m2, dhi_w_m2, longwave, air, np.full_like(air, self.wind_m_s))
