"""Sun vectors against astropy, and against the solar position algorithm that one would pick instead."""

from __future__ import annotations

import warnings

import astropy.units as u
import numpy as np
import pandas as pd
import pvlib
from astropy.coordinates import AltAz, EarthLocation, get_sun
from astropy.time import Time
from astropy.utils import iers

from benchmarks.result import Result, Row
from benchmarks.sides import compare
from fieldkit.model.arrays import FloatArray
from fieldkit.model.site import Site
from fieldkit.physics import sun
from fieldkit.physics.facet import angle_between_deg, normal

iers.conf.auto_download = False
SITE = Site(35.558675, 139.395232, 9.0)
START_S = 1_504_051_200  # 2017-08-30T00:00Z
DAY_S = 86_400
GRID = "the day's series, computed anew in each round"
OVER_ASTROPY = Row("astropy", "86 400 sun vectors, astropy over ours", ">= 150", included=GRID)
OVER_SPA = Row("spa-day", "86 400 sun vectors, pvlib's SPA over ours", ">= 7", included=GRID)
LARGEST = Row("difference", "largest difference from astropy in a day", "<= 0.01", "arcsec")
FEW_OVER_SPA = Row("spa", "10 000 sun vectors, pvlib's SPA over ours", ">= 1.5", included=GRID)


def run() -> list[Result]:
    day, ten_thousand = START_S + np.arange(DAY_S), START_S + np.arange(0, DAY_S, 8.64).astype(np.int64)
    sun.sun_vectors(day[:1] * 10**9, SITE)  # reads the tables
    ours, theirs = sun.sun_vectors(day[::97] * 10**9, SITE), _astropy(day[::97])
    return [
        compare(OVER_ASTROPY, lambda: _ours(day), lambda: _astropy(day), rounds=3),
        compare(OVER_SPA, lambda: _ours(day), lambda: _spa(day)),
        compare(FEW_OVER_SPA, lambda: _ours(ten_thousand), lambda: _spa(ten_thousand)),
        LARGEST.result(3600.0 * float(np.max(angle_between_deg(ours, theirs)))),
    ]


def _ours(unix_s: np.ndarray[tuple[int], np.dtype[np.int64]]) -> FloatArray:
    """As for a day that was not asked for before."""
    sun._series_of_day.cache_clear()
    return sun.sun_vectors(unix_s * 10**9, SITE)


def _astropy(unix_s: np.ndarray[tuple[int], np.dtype[np.int64]]) -> FloatArray:
    place = EarthLocation.from_geodetic(
        SITE.longitude_deg * u.deg, SITE.latitude_deg * u.deg, SITE.elevation_m * u.m
    )
    moments = Time(unix_s, format="unix", scale="utc")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of dates beyond its tables
        horizontal = get_sun(moments).transform_to(AltAz(obstime=moments, location=place))
    return normal(90.0 - horizontal.alt.deg, horizontal.az.deg)


def _spa(unix_s: np.ndarray[tuple[int], np.dtype[np.int64]]) -> FloatArray:
    times = pd.DatetimeIndex(pd.to_datetime(unix_s, unit="s", utc=True))
    position = pvlib.solarposition.spa_python(
        times, SITE.latitude_deg, SITE.longitude_deg, SITE.elevation_m, temperature=12.0
    )
    return normal(position["zenith"].to_numpy(), position["azimuth"].to_numpy())
