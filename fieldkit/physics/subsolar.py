"""The point below the sun on Mars and the Moon, and terrestrial time, in which ephemerides count, from UTC.

Mars in closed form: the fit of Allison and McEwen with the corrections that NASA's Mars24 applies, good to
0.01 degrees between 1970 and 2100. The Moon by ERFA's positions of Earth and Moon and the IAU's rotation.
"""

from __future__ import annotations

import warnings

import erfa  # type: ignore[import-untyped]
import numpy as np

from fieldkit.model.arrays import FloatArray
from fieldkit.model.units import DAY_S

EPOCH_JD, MJD_0_JD, J2000_JD = 2440587.5, 2400000.5, 2451545.0
"""Julian dates of 1970-01-01, of modified Julian day 0 and of J2000."""


def tt_of_utc(unix_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Julian date in terrestrial time, in two parts, of UTC seconds since 1970; shape of `unix_s` each."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", erfa.ErfaWarning)  # of years whose leap seconds are not known yet
        day, fraction = erfa.taitt(*erfa.utctai(EPOCH_JD + np.floor(unix_s / DAY_S), unix_s % DAY_S / DAY_S))
    return np.asarray(day), np.asarray(fraction)


def days_of_tt(unix_s: FloatArray) -> FloatArray:
    """Days of terrestrial time since J2000 of UTC seconds since 1970; same shape."""
    day, fraction = tt_of_utc(unix_s)
    return np.asarray(day - J2000_JD + fraction)


# --- Mars

SOL_S = 88_775.244
"""Mean solar day of Mars; Allison and McEwen 2000, 1.0274912517 days."""
_SOL_D = 1.0274912517
_PERTURBERS = np.array(
    [
        (0.0071, 2.2353, 49.409),
        (0.0057, 2.7543, 168.173),
        (0.0039, 1.1177, 191.837),
        (0.0037, 15.7866, 21.736),
        (0.0021, 2.1354, 15.704),
        (0.0020, 2.4694, 95.528),
        (0.0018, 32.8493, 49.095),
    ]
)
"""Amplitude in degrees, period in Julian years and phase in degrees of the planets' pull; table 5."""


def mars_subsolar(unix_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Declination of the sun, longitude below it and its distance from Mars at UTC seconds since 1970 (n,).

    Planetocentric, degrees, the longitude east in [-180, 180), and au, (n,) each.

    M. Allison and M. McEwen, "A post-Pathfinder evaluation of areocentric solar coordinates with improved
    timing recipes for Mars seasonal/diurnal climate studies", Planet. Space Sci. 48, 215-235, 2000,
    doi:10.1016/S0032-0633(99)00092-6; with the constants of Mars24, NASA GISS.
    """
    days = days_of_tt(unix_s)
    amplitude, period_y, phase = _PERTURBERS.T
    pull = np.cos(np.radians(np.multiply.outer(days, 0.985626 / period_y) + phase)) @ amplitude
    m = np.radians(19.3871 + 0.52402073 * days)  # mean anomaly
    centre = (10.691 + 3.0e-7 * days) * np.sin(m) + pull
    for order, size in enumerate((0.623, 0.050, 0.005, 0.0005), start=2):
        centre = centre + size * np.sin(order * m)
    ls = np.radians((270.3871 + 0.524038496 * days + centre) % 360.0)  # areocentric solar longitude
    # equation of time, and mean solar time of the prime meridian
    time_deg = 2.861 * np.sin(2 * ls) - 0.071 * np.sin(4 * ls) + 0.002 * np.sin(6 * ls) - centre
    mtc_h = 24.0 * ((days - 4.5) / _SOL_D + 44796.0 - 0.0009626) % 24.0
    orbit = 1.00436 - 0.09309 * np.cos(m) - 0.004336 * np.cos(2 * m)
    return (
        np.degrees(np.arcsin(0.42565 * np.sin(ls))),
        -(15.0 * mtc_h + time_deg) % 360.0 - 180.0,
        1.52367934 * (orbit - 0.00031 * np.cos(3 * m) - 0.00003 * np.cos(4 * m)),
    )


# --- the Moon

_C_AU_D = 173.144632674
"""Speed of light in astronomical units per day."""
_ARGUMENTS = np.array(
    [
        (125.045, -0.0529921), (250.089, -0.1059842), (260.008, 13.0120009), (176.625, 13.3407154),
        (357.529, 0.9856003), (311.589, 26.4057084), (134.963, 13.0649930), (276.617, 0.3287146),
        (34.226, 1.7484877), (15.134, -0.1589763), (119.743, 0.0036096), (239.961, 0.1643573),
        (25.053, 12.9590088),
    ]
)  # fmt: skip
"""E1 to E13 of the report: degrees at J2000 and per day."""
_POLE_RA = np.array([-3.8787, -0.1204, 0.0700, -0.0172, 0, 0.0072, 0, 0, 0, -0.0052, 0, 0, 0.0043])
_POLE_DEC = np.array([1.5419, 0.0239, -0.0278, 0.0068, 0, -0.0029, 0.0009, 0, 0, 0.0008, 0, 0, -0.0009])
_MERIDIAN = np.array(
    [
        3.5610, 0.1208, -0.0642, 0.0158, 0.0252, -0.0066, -0.0047, -0.0046, 0.0028, 0.0052, 0.0040,
        0.0019, -0.0044,
    ]
)  # fmt: skip


def moon_subsolar(unix_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The point of the Moon where the sun stands in the zenith at UTC seconds since 1970 (n,), and its
    distance.

    Selenographic latitude and longitude east in [-180, 180), mean Earth/polar axis system, in degrees, and
    distance in au, (n,) each. Within 0.01 degrees.

    B. A. Archinal et al., "Report of the IAU Working Group on Cartographic Coordinates and Rotational
    Elements: 2009", Celest. Mech. Dyn. Astr. 109, 101-135, 2011, doi:10.1007/s10569-010-9320-4.
    """
    sun, distance_au = _to_sun(unix_s)
    right_ascension, declination, meridian = _rotation(days_of_tt(unix_s))
    node = np.pi / 2 + right_ascension
    x = sun[:, 0] * np.cos(node) + sun[:, 1] * np.sin(node)
    across = -sun[:, 0] * np.sin(node) + sun[:, 1] * np.cos(node)
    y = across * np.sin(declination) + sun[:, 2] * np.cos(declination)
    z = -across * np.cos(declination) + sun[:, 2] * np.sin(declination)
    longitude = np.degrees(np.arctan2(y, x) - meridian)
    return np.degrees(np.arcsin(z)), (longitude + 180.0) % 360.0 - 180.0, distance_au


def _to_sun(unix_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Apparent unit vector from Moon to sun in the ICRS, (n, 3), and distance in au, (n,)."""
    tt = tt_of_utc(unix_s)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", erfa.ErfaWarning)  # arcseconds off in 1700 and 2250
        heliocentric, barycentric = erfa.epv00(*tt)
    moon = erfa.moon98(*tt)
    position, velocity = -(heliocentric["p"] + moon["p"]), barycentric["v"] + moon["v"]
    distance = np.linalg.norm(position, axis=1)
    is_visible = position / distance[:, np.newaxis] + velocity / _C_AU_D  # aberration
    return is_visible / np.linalg.norm(is_visible, axis=1, keepdims=True), distance


def _rotation(days: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Right ascension and declination of the pole and prime meridian W, (n,) each, radians."""
    argument = np.radians(_ARGUMENTS[:, 0] + np.multiply.outer(days, _ARGUMENTS[:, 1]))
    sines, cosines, centuries = np.sin(argument), np.cos(argument), days / 36525.0
    right_ascension = 269.9949 + 0.0031 * centuries + sines @ _POLE_RA
    declination = 66.5392 + 0.0130 * centuries + cosines @ _POLE_DEC
    meridian = 38.3213 + 13.17635815 * days - 1.4e-12 * days**2 + sines @ _MERIDIAN
    return np.radians(right_ascension), np.radians(declination), np.radians(meridian)
