"""Position of the sun: unit vectors to it in east, north, up.

The engine is ERFA, the library under astropy's coordinates, called directly: importing these takes longer
than everything else a command does at its start. UT1 and polar motion come from the file that astropy brings
along (IERS, finals2000A), so no network is needed. Before its first and after its last day the values there
are held, which costs far less than 0.01 degrees.

Positions are computed at some thirty instants of a UTC day and the *unit vector* is interpolated by a
Chebyshev series (angles would wrap at north and break at the zenith). Geometric positions are the
default, as in the paper's Table 2; with `refraction` it is the apparent sun, which lights
a surface. Nothing here knows about facets or irradiance.
"""

from __future__ import annotations

import warnings
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import erfa  # type: ignore[import-untyped]
import numpy as np
from astropy_iers_data import IERS_A_FILE  # type: ignore[import-untyped]
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from fieldkit.model.arrays import FloatArray, TableArray
from fieldkit.model.site import Site
from fieldkit.model.units import DAY_NS, DAY_S
from fieldkit.physics.bodies import body_of
from fieldkit.physics.facet import tilt_azimuth
from fieldkit.physics.subsolar import EPOCH_JD, MJD_0_JD

COLUMNS = {"mjd": (7, 15), "x_arcsec": (18, 27), "y_arcsec": (37, 46), "ut1_utc_s": (58, 68)}
"""First and last character of each column, by the file's description (readme.finals2000A)."""


class EarthRotation(NamedTuple):
    """UT1 - UTC and polar motion at 0 h UTC of consecutive days, measured and predicted; shape (n,) each."""

    mjd: FloatArray
    x_arcsec: FloatArray
    y_arcsec: FloatArray
    ut1_utc_s: FloatArray

    def at(self, mjd: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """UT1 - UTC in seconds and the pole's x and y in radians.

        What is interpolated is UT1 - TAI, which has no leaps.
        """
        within = np.clip(mjd, self.mjd[0], self.mjd[-1])
        ut1_tai_s = np.interp(within, self.mjd, self.ut1_utc_s - _leap_seconds(self.mjd))
        x, y = (np.interp(within, self.mjd, pole) for pole in (self.x_arcsec, self.y_arcsec))
        return ut1_tai_s + _leap_seconds(within), np.radians(x / 3600.0), np.radians(y / 3600.0)


def _leap_seconds(mjd: FloatArray) -> FloatArray:
    """TAI - UTC in seconds."""
    year, month, day, _ = erfa.jd2cal(MJD_0_JD, np.floor(mjd))
    return np.asarray(erfa.dat(year, month, day, 0.0), np.float64)


@lru_cache(maxsize=1)
def earth_rotation() -> EarthRotation:
    """Earth rotation from the IERS file that was installed with astropy; read once."""
    days = [line for line in Path(IERS_A_FILE).read_text("ascii").splitlines() if line[58:68].strip()]
    columns = ([line[begin:end] for line in days] for begin, end in COLUMNS.values())
    return EarthRotation(*(np.array(column, np.float64) for column in columns))


DEGREE = 28
"""Degree of the series over a day: the sun turns once, and the remainder is below 1e-12."""


def sun_vectors(time_ns: ArrayLike, site: Site, *, refraction: bool = False) -> FloatArray:
    """Topocentric unit vectors to the sun, also below the horizon.

    Parameters
    ----------
    time_ns
        UTC nanoseconds since 1970, shape (n,) or a single time.
    site
        Where the observer is.
    refraction
        Apparent instead of geometric position; see `refract`. Only the Earth's air refracts.

    Returns
    -------
    East, north, up, shape (n, 3), or (3,) for a single time. Within 0.01 arcseconds of astropy. [-]
    """
    times = np.asarray(time_ns, dtype=np.int64)
    flat = times.reshape(-1)
    days = flat // DAY_NS
    vectors = np.empty((flat.size, 3))
    for day in np.unique(days):
        chosen = days == day
        seconds = (flat[chosen] - day * DAY_NS) * 1e-9
        vectors[chosen] = chebyshev.chebval(2.0 * seconds / DAY_S - 1.0, _series_of_day(int(day), site)).T
    vectors /= np.sqrt(np.einsum("ij,ij->i", vectors, vectors))[:, np.newaxis]
    if refraction and body_of(site).refracts:
        vectors = refract(vectors, site.elevation_m)
    return vectors.reshape(*times.shape, 3)


def sun_angles(time_ns: ArrayLike, site: Site, *, refraction: bool = False) -> tuple[FloatArray, FloatArray]:
    """Zenith angle in [0, 180] and azimuth in [0, 360) of the sun at times of any shape, as `sun_vectors`."""
    return tilt_azimuth(sun_vectors(time_ns, site, refraction=refraction))


def refract(vectors: FloatArray, elevation_m: float = 0.0) -> FloatArray:
    """Apparent from geometric directions, by the refraction of a standard atmosphere at 12 °C.

    Parameters
    ----------
    vectors
        Geometric unit vectors (east, north, up), shape (n, 3).
    elevation_m
        Elevation of the site above sea level, for the pressure. [m]

    Returns
    -------
    Unit vectors, shape (n, 3); unchanged below -0.8336 degrees of geometric altitude.

    References
    ----------
    .. [1] I. Reda and A. Andreas, "Solar position algorithm for solar radiation applications",
       Solar Energy 76, 577-589, 2004, eq. (42), doi:10.1016/j.solener.2003.12.003.
    """
    altitude = 90.0 - tilt_azimuth(vectors)[0]
    pressure_hpa = 1013.25 * (1.0 - 2.25577e-5 * elevation_m) ** 5.25588
    visible = altitude > -0.8336
    bent = np.where(visible, altitude, 0.0)
    lift_at_1010_hpa = 1.02 / (60.0 * np.tan(np.radians(bent + 10.3 / (bent + 5.11))))
    lift_deg = lift_at_1010_hpa * pressure_hpa / 1010.0 * 283.0 / 285.0
    apparent = np.radians(np.where(visible, altitude + lift_deg, altitude))
    horizontal = vectors[:, :2] / np.maximum(np.hypot(vectors[:, 0], vectors[:, 1]), 1e-300)[:, np.newaxis]
    return np.column_stack([horizontal * np.cos(apparent)[:, np.newaxis], np.sin(apparent)])


def exact_vectors(unix_s: FloatArray, site: Site) -> FloatArray:
    """Geometric unit vectors (n, 3) to the sun straight from the ephemeris, at UTC seconds since 1970 (n,).

    About a second for 10 000 times on the Earth; `sun_vectors` interpolates and is tested against it. Within
    0.0001 arcseconds of astropy on the Earth, 0.01 degrees elsewhere (`fieldkit.physics.bodies`).

    IAU SOFA Board, "SOFA Astrometry Tools", 2023: astrometry for an observed place; ``epv00``, IAU 2006/2000A
    precession and nutation.
    """
    subsolar = body_of(site).subsolar
    return _over_earth(unix_s, site) if subsolar is None else _over_point(site, *subsolar(unix_s)[:2])


def solar_time_h(time_ns: ArrayLike, site: Site) -> FloatArray:
    """Local true solar time: the sun's hour angle in 24ths of the body's day, 12 when it stands highest.

    At UTC nanoseconds since 1970, any shape; in [0, 24). [h]
    """
    sun = sun_vectors(time_ns, site)
    latitude = np.radians(site.latitude_deg)
    towards_pole = sun[..., 1] * np.cos(latitude) + sun[..., 2] * np.sin(latitude)
    towards_meridian = (sun[..., 2] - towards_pole * np.sin(latitude)) / np.cos(latitude)
    return np.asarray((12.0 - np.degrees(np.arctan2(sun[..., 0], towards_meridian)) / 15.0) % 24.0)


def _over_point(site: Site, declination_deg: FloatArray, subsolar_longitude_deg: FloatArray) -> FloatArray:
    """Unit vectors to a sun far away that is overhead at these points, (n, 3).

    The vertical of a planetographic latitude makes that angle with the equator, so the declination of the
    sun's direction belongs here, not the planetographic latitude of the point below it.
    """
    declination, latitude = np.radians(declination_deg), np.radians(site.latitude_deg)
    hour_angle = np.radians(site.longitude_deg - subsolar_longitude_deg)
    outward = np.cos(declination) * np.cos(hour_angle)
    east = -np.cos(declination) * np.sin(hour_angle)
    north = np.cos(latitude) * np.sin(declination) - np.sin(latitude) * outward
    up = np.sin(latitude) * np.sin(declination) + np.cos(latitude) * outward
    return np.stack([east, north, up], axis=-1)


def _over_earth(unix_s: FloatArray, site: Site) -> FloatArray:
    """Topocentric unit vectors by ERFA, (n, 3)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", erfa.ErfaWarning)  # of years whose leap seconds are not known yet
        observer = _observer(unix_s, site)
        # The sun itself is where it is: aberration by the observer's motion, no parallax, no deflection.
        aberrated = erfa.ab(-observer["eh"], observer["v"], observer["em"], observer["bm1"])
        right_ascension, declination = erfa.c2s(erfa.rxp(observer["bpn"], aberrated))
        azimuth, zenith, *_ = erfa.atioq(right_ascension, declination, observer)
    level = np.sin(zenith)
    return np.stack([level * np.sin(azimuth), level * np.cos(azimuth), np.cos(zenith)], axis=-1)


def _observer(unix_s: FloatArray, site: Site) -> TableArray:
    """ERFA's astrometry parameters of an observer without an atmosphere."""
    utc = EPOCH_JD + np.floor(unix_s / DAY_S), (unix_s % DAY_S) / DAY_S
    ut1_utc_s, x, y = earth_rotation().at(utc[0] - MJD_0_JD + utc[1])
    ut1 = erfa.utcut1(*utc, ut1_utc_s)
    tt = erfa.taitt(*erfa.utctai(*utc))
    longitude, latitude = np.radians([site.longitude_deg, site.latitude_deg])
    tdb = tt[0], tt[1] + erfa.dtdb(*tt, ut1[1] % 1.0, longitude, 0.0, 0.0) / DAY_S
    heliocentric, barycentric = erfa.epv00(*tdb)
    pole_x, pole_y, locator = erfa.xys06a(*tt)
    # a numpy ufunc takes its arguments by position only; the order is that of SOFA's iauApco
    return np.asarray(
        erfa.apco(
            *tt, barycentric, heliocentric["p"], pole_x, pole_y, locator, erfa.era00(*ut1),
            longitude, latitude, site.elevation_m, x, y, erfa.sp00(*tt), 0.0, 0.0,
        )
    )  # fmt: skip


@lru_cache(maxsize=512)
def _series_of_day(day: int, site: Site) -> FloatArray:
    """Chebyshev coefficients (n, 3) of the sun vector over UTC day `day` since 1970, its ends at -1 and 1."""
    places = chebyshev.chebpts1(DEGREE + 1)
    exact = exact_vectors((day + 0.5 * (places + 1.0)) * DAY_S, site)
    return np.asarray(chebyshev.chebfit(places, exact, DEGREE))
