"""The point of the Moon below the sun: ERFA's positions of Earth and Moon, the IAU's rotation of the Moon."""

from __future__ import annotations

import erfa  # type: ignore[import-untyped]
import numpy as np

from fieldkit.physics.facet import FloatArray
from fieldkit.physics.time_scales import days_of_tt, tt_of_utc

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
    """The point of the Moon where the sun stands in the zenith, and the distance to the sun.

    Parameters
    ----------
    unix_s
        UTC seconds since 1970, shape (n,). [s]

    Returns
    -------
    Selenographic latitude and longitude east in [-180, 180), mean Earth/polar axis system, and distance,
    shape (n,) each. Within 0.01 degrees. [degrees, degrees, au]

    References
    ----------
    .. [1] B. A. Archinal et al., "Report of the IAU Working Group on Cartographic Coordinates and Rotational
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
    heliocentric, barycentric = erfa.epv00(*tt)
    moon = erfa.moon98(*tt)
    position, velocity = -(heliocentric["p"] + moon["p"]), barycentric["v"] + moon["v"]
    distance = np.linalg.norm(position, axis=1)
    seen = position / distance[:, np.newaxis] + velocity / _C_AU_D  # aberration
    return seen / np.linalg.norm(seen, axis=1, keepdims=True), distance


def _rotation(days: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Right ascension and declination of the pole and prime meridian W, (n,) each, radians."""
    argument = np.radians(_ARGUMENTS[:, 0] + np.multiply.outer(days, _ARGUMENTS[:, 1]))
    sines, cosines, centuries = np.sin(argument), np.cos(argument), days / 36525.0
    right_ascension = 269.9949 + 0.0031 * centuries + sines @ _POLE_RA
    declination = 66.5392 + 0.0130 * centuries + cosines @ _POLE_DEC
    meridian = 38.3213 + 13.17635815 * days - 1.4e-12 * days**2 + sines @ _MERIDIAN
    return np.radians(right_ascension), np.radians(declination), np.radians(meridian)
