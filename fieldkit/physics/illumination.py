"""How light divides: the diffuse share of global light, and lumens per watt of daylight.

Published correlations as pure functions. Cosines are of the zenith angle of the sun,
irradiances in W/m2, arrays that broadcast. Which of them is used, and on what plane the
meter lies, is `irradiance.IrradianceModel`'s business.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldkit.physics.facet import FloatArray


def diffuse_fraction_erbs(clearness: ArrayLike) -> FloatArray:
    """Diffuse share of global horizontal irradiance by the clearness index (global over extraterrestrial).

    D. G. Erbs, S. A. Klein and J. A. Duffie, "Estimation of the diffuse radiation fraction
    for hourly, daily and monthly-average global radiation", Solar Energy 28, 293-302, 1982,
    the hourly correlation. An hourly mean law: for a single minute good to about 0.1.
    """
    k = np.maximum(np.asarray(clearness, np.float64), 0.0)
    middle = 0.9511 - 0.1604 * k + 4.388 * k**2 - 16.638 * k**3 + 12.336 * k**4
    return np.where(k <= 0.22, 1.0 - 0.09 * k, np.where(k <= 0.80, middle, 0.165) + 0.0 * k)


# R. Perez et al., "Modeling daylight availability and irradiance components from direct and
# global irradiance", Solar Energy 44, 271-289, 1990, table 4: a, b, c, d by bin of sky clearness.
_CLEARNESS_EDGES = np.array([1.065, 1.23, 1.5, 1.95, 2.8, 4.5, 6.2])
_GLOBAL = np.array(
    [
        [96.63, 107.54, 98.73, 92.72, 86.73, 88.34, 78.63, 99.65],
        [-0.47, 0.79, 0.70, 0.56, 0.98, 1.39, 1.47, 1.86],
        [11.50, 1.79, 4.40, 8.36, 7.10, 6.06, 4.93, -4.46],
        [-9.16, -1.19, -6.95, -8.31, -10.94, -7.60, -11.37, -3.15],
    ]
)
_DIRECT = np.array(
    [
        [57.20, 98.99, 109.83, 110.34, 106.36, 107.19, 105.75, 101.18],
        [-4.55, -3.46, -4.90, -5.84, -3.97, -1.25, 0.77, 1.58],
        [-2.98, -1.21, -1.71, -1.99, -1.75, -1.51, -1.26, -1.10],
        [117.12, 12.38, -8.81, -4.56, -6.16, -26.73, -34.44, -8.29],
    ]
)


def perez_efficacy(
    direct_normal_w_m2: ArrayLike,
    diffuse_w_m2: ArrayLike,
    cos_zenith: ArrayLike,
    extraterrestrial_w_m2: ArrayLike,
    precipitable_water_cm: float = 2.0,
) -> tuple[FloatArray, FloatArray]:
    """Luminous efficacy of global horizontal and of direct light, lm/W.

    Valid with the sun up and some diffuse light; NaN where the sun is below 3 degrees.
    """
    cosine = np.asarray(cos_zenith, np.float64)
    cosine = np.where(cosine > 0.05, cosine, np.nan)
    zenith, sky = np.arccos(cosine), np.maximum(diffuse_w_m2, 1.0)
    cube = 1.041 * zenith**3
    clearness = ((sky + np.asarray(direct_normal_w_m2)) / sky + cube) / (1.0 + cube)
    brightness = sky / cosine / np.asarray(extraterrestrial_w_m2)
    bins: NDArray[np.intp] = np.digitize(clearness, _CLEARNESS_EDGES)
    a, b, c, d = _GLOBAL[:, bins]
    of_global = a + b * precipitable_water_cm + c * cosine + d * np.log(brightness)
    a, b, c, d = _DIRECT[:, bins]
    of_direct = a + b * precipitable_water_cm + c * np.exp(5.73 * zenith - 5.0) + d * brightness
    return np.asarray(of_global), np.asarray(np.maximum(of_direct, 0.0))
