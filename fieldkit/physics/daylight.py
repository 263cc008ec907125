"""What the sky and the ground around send to a tilted facet besides the direct beam.

The paper's eqs. (1)-(7) leave these terms out; the full surface model and the simulated
scene use them. Pure functions of irradiances [W/m2] and cosines, arrays that broadcast.
`cos_tilt` is the cosine of the facet's tilt: a facet sees (1 + cos b)/2 of the sky and
(1 - cos b)/2 of flat ground.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldkit.physics.facet import FloatArray

SOLAR_CONSTANT_W_M2 = 1361.0
"""Kopp and Lean, "A new, lower value of total solar irradiance", 2011."""

# below one degree of elevation the ratio of cosines says nothing about circumsolar light
_LOWEST_COS_ZENITH = 0.01745


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


def extraterrestrial(time_ns: ArrayLike) -> FloatArray:
    """Irradiance of a plane facing the sun outside the atmosphere, W/m2, by day of year.

    J. W. Spencer, "Fourier series representation of the position of the sun", Search 2(5), 1971.
    """
    days = np.asarray(time_ns, dtype=np.int64).astype("datetime64[ns]")
    of_year = (days - days.astype("datetime64[Y]")) / np.timedelta64(1, "D")
    angle = 2.0 * np.pi * of_year / 365.0
    distance = (
        1.00011
        + 0.034221 * np.cos(angle)
        + 0.00128 * np.sin(angle)
        + 0.000719 * np.cos(2.0 * angle)
        + 0.000077 * np.sin(2.0 * angle)
    )
    return np.asarray(SOLAR_CONSTANT_W_M2 * distance, dtype=np.float64)


def air_mass(cos_zenith: ArrayLike, elevation_m: float = 0.0) -> FloatArray:
    """Air mass corrected for the pressure at the site, sun above the horizon.

    F. Kasten and A. T. Young, "Revised optical air mass tables and approximation formula",
    Applied Optics 28, 4735-4738, 1989.
    """
    zenith = np.degrees(np.arccos(np.clip(cos_zenith, -1.0, 1.0)))
    relative = 1.0 / (np.cos(np.radians(zenith)) + 0.50572 * (96.07995 - zenith) ** -1.6364)
    pressure = (1.0 - 2.25577e-5 * elevation_m) ** 5.25588
    return np.asarray(relative * pressure)


def clear_sky(
    cos_zenith: ArrayLike, time_ns: ArrayLike, elevation_m: float = 0.0, linke_turbidity: float = 3.0
) -> tuple[FloatArray, FloatArray]:
    """Direct normal and diffuse horizontal irradiance of a cloudless sky, W/m2, (n,) each.

    Zero with the sun down. P. Ineichen and R. Perez, "A new airmass independent
    formulation for the Linke turbidity coefficient", Solar Energy 73, 151-157, 2002.
    """
    cosine = np.asarray(cos_zenith, np.float64)
    up = cosine > 0.0
    safe = np.where(up, cosine, 1.0)
    top = extraterrestrial(time_ns)
    mass = air_mass(safe, elevation_m)
    f1, f2 = np.exp(-elevation_m / 8000.0), np.exp(-elevation_m / 1250.0)
    cg1, cg2 = 5.09e-5 * elevation_m + 0.868, 3.92e-5 * elevation_m + 0.0387
    total = cg1 * top * safe * np.exp(-cg2 * mass * (f1 + f2 * (linke_turbidity - 1.0)))
    beam = (0.664 + 0.163 / f1) * top * np.exp(-0.09 * mass * (linke_turbidity - 1.0))
    # the beam cannot leave less diffuse light than the clearest sky has
    most = total / safe * (1.0 - (0.1 - 0.2 * np.exp(-linke_turbidity)) / (0.1 + 0.882 / f1))
    beam = np.minimum(beam, np.maximum(most, 0.0))
    return np.where(up, beam, 0.0), np.where(up, total - beam * safe, 0.0)


def diffuse_fraction_erbs(clearness: ArrayLike) -> FloatArray:
    """Diffuse share of global horizontal irradiance by the clearness index (global over extraterrestrial).

    D. G. Erbs, S. A. Klein and J. A. Duffie, "Estimation of the diffuse radiation fraction
    for hourly, daily and monthly-average global radiation", Solar Energy 28, 293-302, 1982,
    the hourly correlation. An hourly mean law: for a single minute good to about 0.1.
    """
    k = np.maximum(np.asarray(clearness, np.float64), 0.0)
    middle = 0.9511 - 0.1604 * k + 4.388 * k**2 - 16.638 * k**3 + 12.336 * k**4
    return np.where(k <= 0.22, 1.0 - 0.09 * k, np.where(k <= 0.80, middle, 0.165) + 0.0 * k)


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


def sky_view(cos_tilt: ArrayLike) -> FloatArray:
    """Share of a facet's hemisphere that is sky."""
    return np.asarray(0.5 * (1.0 + np.asarray(cos_tilt, dtype=np.float64)))


def ground_view(cos_tilt: ArrayLike) -> FloatArray:
    """Share of a facet's hemisphere that is flat ground."""
    return np.asarray(0.5 * (1.0 - np.asarray(cos_tilt, dtype=np.float64)))


def isotropic_diffuse(diffuse_w_m2: ArrayLike, cos_tilt: ArrayLike) -> FloatArray:
    """Diffuse light on a facet when the whole sky is equally bright, W/m2."""
    return np.asarray(np.multiply(diffuse_w_m2, sky_view(cos_tilt)))


def hay_davies_diffuse(
    diffuse_w_m2: ArrayLike,
    dni_w_m2: ArrayLike,
    extraterrestrial_w_m2: ArrayLike,
    cos_incidence: ArrayLike,
    cos_zenith: ArrayLike,
    cos_tilt: ArrayLike,
) -> FloatArray:
    """Diffuse light on a facet when a share of it comes from around the sun, W/m2.

    The share is the beam's transmission; the rest is isotropic. `diffuse_w_m2` is on the
    horizontal, `dni_w_m2` normal to the beam. J. E. Hay and J. A. Davies, "Calculation
    of the solar radiation incident on an inclined surface", 1980.
    """
    circumsolar = np.clip(np.divide(dni_w_m2, extraterrestrial_w_m2), 0.0, 1.0)
    beam_ratio = np.maximum(cos_incidence, 0.0) / np.maximum(cos_zenith, _LOWEST_COS_ZENITH)
    seen = circumsolar * beam_ratio + (1.0 - circumsolar) * sky_view(cos_tilt)
    return np.asarray(np.multiply(diffuse_w_m2, seen))


def ground_reflected(global_w_m2: ArrayLike, ground_albedo: ArrayLike, cos_tilt: ArrayLike) -> FloatArray:
    """Sunlight that flat ground of `ground_albedo` throws onto a facet, W/m2."""
    return np.asarray(np.multiply(global_w_m2, ground_albedo) * ground_view(cos_tilt))


def longwave_on_facet(
    longwave_down_w_m2: ArrayLike, longwave_ground_w_m2: ArrayLike, cos_tilt: ArrayLike
) -> FloatArray:
    """Long-wave radiation arriving on a facet from its share of sky and of flat ground, W/m2."""
    from_sky = np.multiply(longwave_down_w_m2, sky_view(cos_tilt))
    return np.asarray(from_sky + np.multiply(longwave_ground_w_m2, ground_view(cos_tilt)))
