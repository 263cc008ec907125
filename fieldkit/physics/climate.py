"""The usual air of a place: what is known of a temperature before anyone has measured it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.model.arrays import FloatArray
from fieldkit.model.site import Site
from fieldkit.model.units import CELSIUS_ZERO_K

_MEAN_C, _BY_LATITUDE_C, _SEASON_C = 14.9, 28.0, 15.5
_COLDEST_DAY, _WARMEST_H = 20.0, 15.0  # the ground's heat delays both after solstice and noon
_SWING_K = 4.0
_LAPSE_K_PER_M = 0.005
"""Lapse rate of ground that rises, which the sun warms from below; the free air has 0.0065."""
_DAY_NS = 86_400 * 10**9


def usual_air_k(time_ns: ArrayLike, site: Site) -> FloatArray:
    """Air temperature by latitude, height, date and hour on the Earth, good to some 8 K; at times of any
    shape.

    G. R. North and J. A. Coakley, "Differences between seasonal and mean annual energy balance model
    calculations of climate and climate sensitivity", J. Atmos. Sci. 36, 1189-1204, 1979: zonal means and
    their season as Legendre polynomials of the sine of the latitude.
    """
    sine = np.sin(np.radians(site.latitude_deg))
    days = np.asarray(time_ns, np.int64) / _DAY_NS
    of_year = np.mod(days, 365.2425)
    solar_h = 24.0 * np.mod(days + site.longitude_deg / 360.0, 1.0)
    annual = _MEAN_C - _BY_LATITUDE_C * (3.0 * sine**2 - 1.0) / 2.0 - _LAPSE_K_PER_M * site.elevation_m
    season = -_SEASON_C * sine * np.cos(2.0 * np.pi * (of_year - _COLDEST_DAY) / 365.2425)
    swing = _SWING_K * np.cos(2.0 * np.pi * (solar_h - _WARMEST_H) / 24.0)
    return np.asarray(CELSIUS_ZERO_K + annual + season + swing)
