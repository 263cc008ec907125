"""The sun over Mars and the time of day there, in closed form: no ephemeris is needed.

The fit of Allison and McEwen with the corrections that NASA's Mars24 applies, good to 0.01 degrees between
1970 and 2100.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fieldkit.physics.facet import FloatArray
from fieldkit.physics.time_scales import days_of_tt

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


@dataclass(frozen=True, slots=True)
class MarsSun:
    """Position of the sun over Mars at n times, each array (n,).

    `ls_deg` is the areocentric solar longitude, `mean_anomaly_deg` M, `centre_deg` the equation of the
    centre, `time_deg` the equation of time, `mtc_h` the mean solar time of the prime meridian in hours of a
    24th of a sol, `declination_deg` the sun's declination (planetocentric), `subsolar_longitude_deg` east
    positive, `distance_au` the distance to the sun.
    """

    mean_anomaly_deg: FloatArray
    centre_deg: FloatArray
    ls_deg: FloatArray
    time_deg: FloatArray
    mtc_h: FloatArray
    declination_deg: FloatArray
    subsolar_longitude_deg: FloatArray
    distance_au: FloatArray

    @property
    def subsolar_latitude_deg(self) -> FloatArray:
        """Planetographic latitude below the sun, Mars24's D-1: it exceeds the declination by flattening."""
        return np.asarray(self.declination_deg + 0.25 * np.sin(np.radians(self.ls_deg)))


def mars_sun(unix_s: FloatArray) -> MarsSun:
    """The sun over Mars.

    Parameters
    ----------
    unix_s
        UTC seconds since 1970, shape (n,). [s]

    Returns
    -------
    See `MarsSun`; n values each.

    References
    ----------
    .. [1] M. Allison and M. McEwen, "A post-Pathfinder evaluation of areocentric solar coordinates with
       improved timing recipes for Mars seasonal/diurnal climate studies", Planet. Space Sci. 48, 215-235,
       2000, doi:10.1016/S0032-0633(99)00092-6; with the constants of Mars24, NASA GISS.
    """
    days = days_of_tt(unix_s)
    anomaly = 19.3871 + 0.52402073 * days
    amplitude, period_y, phase = _PERTURBERS.T
    pull = np.cos(np.radians(np.multiply.outer(days, 0.985626 / period_y) + phase)) @ amplitude
    m = np.radians(anomaly)
    centre = (10.691 + 3.0e-7 * days) * np.sin(m) + pull
    for order, size in enumerate((0.623, 0.050, 0.005, 0.0005), start=2):
        centre = centre + size * np.sin(order * m)
    ls_deg = (270.3871 + 0.524038496 * days + centre) % 360.0
    ls = np.radians(ls_deg)
    time_deg = 2.861 * np.sin(2 * ls) - 0.071 * np.sin(4 * ls) + 0.002 * np.sin(6 * ls) - centre
    mtc_h = 24.0 * ((days - 4.5) / _SOL_D + 44796.0 - 0.0009626) % 24.0
    orbit = 1.00436 - 0.09309 * np.cos(m) - 0.004336 * np.cos(2 * m)
    return MarsSun(
        mean_anomaly_deg=anomaly % 360.0,
        centre_deg=centre,
        ls_deg=ls_deg,
        time_deg=time_deg,
        mtc_h=mtc_h,
        declination_deg=np.degrees(np.arcsin(0.42565 * np.sin(ls))),
        subsolar_longitude_deg=-(15.0 * mtc_h + time_deg) % 360.0 - 180.0,
        distance_au=1.52367934 * (orbit - 0.00031 * np.cos(3 * m) - 0.00003 * np.cos(4 * m)),
    )
