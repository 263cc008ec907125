"""Where the sun stands: unit vectors to it in east, north, up.

The engine is astropy, which only this module imports: in the field there is no network, so its downloads
are switched off. UT1 and polar motion come from the file that astropy brings along (IERS, finals2000A), read
here in milliseconds; astropy's general reader takes longer than everything else a command does at its start.
Beyond the end of that table UT1 is extrapolated, which costs far less than 0.01 degrees.

Positions are computed on a 300 s grid and the *unit vector* is interpolated by a cubic
spline (angles would wrap at north and break at the zenith). Geometric positions are the
default, as in the paper's Table 2; with `refraction` it is the apparent sun, which lights
a surface. Nothing here knows about facets or irradiance.
"""

from __future__ import annotations

import warnings
from functools import lru_cache
from pathlib import Path

import astropy.units as u
import erfa  # type: ignore[import-untyped]
import numpy as np
from astropy.coordinates import AltAz, EarthLocation, get_sun
from astropy.table import QTable
from astropy.time import Time
from astropy.utils import iers
from astropy.utils.exceptions import AstropyWarning
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from fieldkit.model.site import Site
from fieldkit.model.units import DAY_NS, DAY_S
from fieldkit.physics.facet import FloatArray, tilt_azimuth

COLUMNS = {
    "MJD": (7, 15, u.d),
    "PM_x": (18, 27, u.arcsec),
    "PM_y": (37, 46, u.arcsec),
    "UT1_UTC": (58, 68, u.s),
}
"""First and last character of each column, and its unit, by the file's description (readme.finals2000A)."""


class EarthRotation(iers.IERS):  # type: ignore[misc]
    """UT1 - UTC and polar motion by day, measured and predicted; the last values hold beyond the ends."""

    def _check_interpolate_indices(self, *_: object) -> None:
        """Accept times beyond the table: the error of UT1 there moves the sun by less than 0.005 degrees."""


@lru_cache(maxsize=1)
def earth_rotation() -> EarthRotation:
    """Earth rotation from the IERS file that was installed with astropy; read once.

    Returns
    -------
    Table to set as astropy's ``earth_orientation_table``.
    """
    days = [line for line in Path(iers.IERS_A_FILE).read_text("ascii").splitlines() if line[58:68].strip()]
    columns = {
        name: np.array([line[begin:end] for line in days], np.float64) * unit
        for name, (begin, end, unit) in COLUMNS.items()
    }
    return EarthRotation(QTable(columns))


iers.conf.auto_download = False
iers.conf.auto_max_age = None
iers.conf.iers_degraded_accuracy = "ignore"

GRID_S = 300
PADDING_NODES = 2


def sun_vectors(time_ns: ArrayLike, site: Site, *, refraction: bool = False) -> FloatArray:
    """Topocentric unit vectors to the sun, also below the horizon.

    Parameters
    ----------
    time_ns
        UTC nanoseconds since 1970, shape (n,) or a single time.
    site
        Where the observer is.
    refraction
        Apparent instead of geometric position; see `refract`.

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
        vectors[chosen] = _spline_of_day(int(day), site)(seconds)
    vectors /= np.sqrt(np.einsum("ij,ij->i", vectors, vectors))[:, np.newaxis]
    if refraction:
        vectors = refract(vectors, site.elevation_m)
    return vectors.reshape(*times.shape, 3)


def sun_angles(time_ns: ArrayLike, site: Site, *, refraction: bool = False) -> tuple[FloatArray, FloatArray]:
    """Zenith angle and azimuth of the sun.

    Parameters
    ----------
    time_ns
        UTC nanoseconds since 1970, any shape.
    site
        Where the observer is.
    refraction
        Apparent instead of geometric position; see `refract`.

    Returns
    -------
    Zenith angle in [0, 180] and azimuth in [0, 360), same shape each. [degrees]
    """
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


def astropy_vectors(unix_s: NDArray[np.float64], site: Site) -> FloatArray:
    """Geometric unit vectors to the sun straight from astropy.

    About a second for 10 000 times; `sun_vectors` interpolates and is tested against it.

    Parameters
    ----------
    unix_s
        UTC seconds since 1970, shape (n,). [s]
    site
        Where the observer is.

    Returns
    -------
    East, north, up, shape (n, 3). [-]
    """
    place = EarthLocation.from_geodetic(
        site.longitude_deg * u.deg, site.latitude_deg * u.deg, site.elevation_m * u.m
    )
    with warnings.catch_warnings():
        # beyond its tables astropy warns of an accuracy far better than needed here
        warnings.simplefilter("ignore", AstropyWarning)
        warnings.simplefilter("ignore", erfa.ErfaWarning)
        with iers.earth_orientation_table.set(earth_rotation()):
            time = Time(unix_s, format="unix", scale="utc")
            sun = get_sun(time).transform_to(AltAz(obstime=time, location=place))
    altitude, azimuth = sun.alt.rad, sun.az.rad
    level = np.cos(altitude)
    return np.stack([level * np.sin(azimuth), level * np.cos(azimuth), np.sin(altitude)], axis=-1)


@lru_cache(maxsize=512)
def _spline_of_day(day: int, site: Site) -> CubicSpline:
    """Spline of the sun vector over UTC day `day` since 1970, by seconds of the day."""
    seconds = np.arange(-PADDING_NODES * GRID_S, DAY_S + PADDING_NODES * GRID_S + 1, GRID_S, dtype=np.float64)
    return CubicSpline(seconds, astropy_vectors(day * DAY_S + seconds, site))
