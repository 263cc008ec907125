"""Daylight by published correlations: from the top of the atmosphere through the sky onto a tilted facet.

Extraterrestrial irradiance, clear sky, diffuse share and luminous efficacy; then what sky and ground send to
a facet besides the direct beam, which eqs. (1)-(7) of the paper leave out. Irradiances in W/m2, cosines
instead of angles, arrays that broadcast. Which correlation is used for a meter is decided in
`irradiance.IrradianceModel`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.model.arrays import FloatArray, IndexArray
from fieldkit.model.site import Site
from fieldkit.physics.bodies import EARTH, Body, body_of
from fieldkit.physics.dust import dusty_sky

SOLAR_CONSTANT_W_M2 = 1361.0
"""Kopp and Lean, "A new, lower value of total solar irradiance", 2011."""

# below one degree of elevation the ratio of cosines carries no information on circumsolar light
_LOWEST_COS_ZENITH = 0.01745
_SWINBANK = 5.31e-13  # W m-2 K-6, Q. J. R. Meteorol. Soc. 89, 339-348, 1963


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

# The same paper, tables 1 and 6: F11, F12, F13, F21, F22, F23 by bin of sky clearness.
_BRIGHTENING = np.array(
    [
        [-0.008, 0.588, -0.062, -0.060, 0.072, -0.022],
        [0.130, 0.683, -0.151, -0.019, 0.066, -0.029],
        [0.330, 0.487, -0.221, 0.055, -0.064, -0.026],
        [0.568, 0.187, -0.295, 0.109, -0.152, -0.014],
        [0.873, -0.392, -0.362, 0.226, -0.462, 0.001],
        [1.132, -1.237, -0.412, 0.288, -0.823, 0.056],
        [1.060, -1.600, -0.359, 0.264, -1.127, 0.131],
        [0.678, -0.327, -0.250, 0.156, -1.377, 0.251],
    ]
)


def extraterrestrial(time_ns: ArrayLike, body: Body = EARTH) -> FloatArray:
    """Irradiance of a plane facing the sun outside the atmosphere: by day of year, elsewhere by distance.

    Parameters
    ----------
    time_ns
        UTC nanoseconds since 1970, any shape.
    body
        The world.

    Returns
    -------
    Same shape, about 1316 in July to 1409 in January, 493 to 717 on Mars. [W/m2]

    References
    ----------
    .. [1] J. W. Spencer, "Fourier series representation of the position of the sun", Search 2(5), 172, 1971.
    """
    if body.subsolar is not None:
        unix_s = np.asarray(np.asarray(time_ns, np.int64) * 1e-9, np.float64)
        distance_au = body.subsolar(np.atleast_1d(unix_s).ravel())[2]
        return np.asarray(SOLAR_CONSTANT_W_M2 / distance_au**2).reshape(unix_s.shape)
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
    """Relative air mass, corrected for the pressure at the site.

    Parameters
    ----------
    cos_zenith
        Cosine of the sun's zenith angle, above 0, any shape. [-]
    elevation_m
        Elevation of the site above sea level. [m]

    Returns
    -------
    Same shape; 1 for the sun overhead at sea level. [-]

    References
    ----------
    .. [1] F. Kasten and A. T. Young, "Revised optical air mass tables and approximation formula",
       Applied Optics 28, 4735-4738, 1989, doi:10.1364/AO.28.004735.
    """
    zenith = np.degrees(np.arccos(np.clip(cos_zenith, -1.0, 1.0)))
    relative = 1.0 / (np.cos(np.radians(zenith)) + 0.50572 * (96.07995 - zenith) ** -1.6364)
    pressure = (1.0 - 2.25577e-5 * elevation_m) ** 5.25588
    return np.asarray(relative * pressure)


def clear_sky(
    cos_zenith: ArrayLike, time_ns: ArrayLike, elevation_m: float = 0.0, linke_turbidity: float = 3.0
) -> tuple[FloatArray, FloatArray]:
    """Direct normal and diffuse horizontal irradiance of a cloudless sky.

    For plans and for the simulation study; it does not replace a measurement.

    Parameters
    ----------
    cos_zenith
        Cosine of the sun's zenith angle, shape (n,). [-]
    time_ns
        UTC nanoseconds since 1970, shape (n,).
    elevation_m
        Elevation of the site above sea level. [m]
    linke_turbidity
        About 2 in clear mountain winter, 3 in the country, 4 to 5 on a humid summer day near a city. [-]

    Returns
    -------
    DNI and DHI, shape (n,) each; zero with the sun below the horizon. [W/m2]

    References
    ----------
    .. [1] P. Ineichen and R. Perez, "A new airmass independent formulation for the Linke turbidity
       coefficient", Solar Energy 73, 151-157, 2002, doi:10.1016/S0038-092X(02)00045-2.
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
    # the diffuse part cannot be smaller than that of the clearest sky
    most = total / safe * (1.0 - (0.1 - 0.2 * np.exp(-linke_turbidity)) / (0.1 + 0.882 / f1))
    beam = np.minimum(beam, np.maximum(most, 0.0))
    return np.where(up, beam, 0.0), np.where(up, total - beam * safe, 0.0)


def clear_day(
    cos_zenith: ArrayLike,
    time_ns: ArrayLike,
    site: Site,
    *,
    turbidity: float,
) -> tuple[FloatArray, FloatArray]:
    """Direct normal and diffuse horizontal irradiance of a clear day on the site's body, as `clear_sky`,
    W/m2.

    `turbidity` is Linke's of the Earth's air; elsewhere the dust is that of the body's clear season.
    """
    body = body_of(site)
    if body.has_air_of_earth:
        return clear_sky(cos_zenith, time_ns, site.elevation_m, turbidity)
    return dusty_sky(cos_zenith, extraterrestrial(time_ns, body), body.dust_optical_depth or 0.0)


def diffuse_fraction_erbs(clearness: ArrayLike) -> FloatArray:
    """Diffuse share of global horizontal irradiance from the clearness index.

    Parameters
    ----------
    clearness
        Global horizontal over extraterrestrial horizontal irradiance, any shape. [-]

    Returns
    -------
    Same shape, 0.165 to 1. [-]

    Notes
    -----
    A correlation of hourly means; for a single minute good to about 0.1.

    References
    ----------
    .. [1] D. G. Erbs, S. A. Klein and J. A. Duffie, "Estimation of the diffuse radiation fraction for hourly,
       daily and monthly-average global radiation", Solar Energy 28, 293-302, 1982,
       doi:10.1016/0038-092X(82)90302-4.
    """
    k = np.maximum(np.asarray(clearness, np.float64), 0.0)
    middle = 0.9511 - 0.1604 * k + 4.388 * k**2 - 16.638 * k**3 + 12.336 * k**4
    return np.where(k <= 0.22, 1.0 - 0.09 * k, np.where(k <= 0.80, middle, 0.165) + 0.0 * k)


def diffuse_fraction_of_beam(transmission: ArrayLike) -> FloatArray:
    """Diffuse share of global horizontal irradiance from the direct light, by the same correlation.

    `transmission`, of any shape, is direct normal over extraterrestrial irradiance, up to 0.83: clearer skies
    are taken as that.
    """
    clearness = np.linspace(0.0, 1.0, 1001)
    beam = clearness * (1.0 - diffuse_fraction_erbs(clearness))  # grows with the clearness
    return diffuse_fraction_erbs(np.interp(np.asarray(transmission, np.float64), beam, clearness))


def perez_efficacy(
    dni_w_m2: ArrayLike,
    dhi_w_m2: ArrayLike,
    cos_zenith: ArrayLike,
    extraterrestrial_w_m2: ArrayLike,
    precipitable_water_cm: float = 2.0,
) -> tuple[FloatArray, FloatArray]:
    """Luminous efficacy of global horizontal and of direct light.

    Parameters
    ----------
    dni_w_m2, dhi_w_m2
        Direct normal and diffuse horizontal irradiance, shapes that broadcast. [W/m2]
    cos_zenith
        Cosine of the sun's zenith angle. [-]
    extraterrestrial_w_m2
        See `extraterrestrial`. [W/m2]
    precipitable_water_cm
        Water in a column of the atmosphere. [cm]

    Returns
    -------
    Efficacy of global and of direct light; NaN where the sun is below 3 degrees. [lm/W]

    References
    ----------
    .. [1] R. Perez et al., "Modeling daylight availability and irradiance components from direct and global
       irradiance", Solar Energy 44, 271-289, 1990, table 4, doi:10.1016/0038-092X(90)90055-H.
    """
    cosine = np.asarray(cos_zenith, np.float64)
    cosine = np.where(cosine > 0.05, cosine, np.nan)
    zenith, sky = np.arccos(cosine), np.maximum(dhi_w_m2, 1.0)
    clearness = _clearness(sky, dni_w_m2, zenith)
    brightness = sky / cosine / np.asarray(extraterrestrial_w_m2)
    bins: IndexArray = np.digitize(clearness, _CLEARNESS_EDGES)
    a, b, c, d = _GLOBAL[:, bins]
    of_global = a + b * precipitable_water_cm + c * cosine + d * np.log(brightness)
    a, b, c, d = _DIRECT[:, bins]
    of_direct = a + b * precipitable_water_cm + c * np.exp(5.73 * zenith - 5.0) + d * brightness
    return np.asarray(of_global), np.asarray(np.maximum(of_direct, 0.0))


def _clearness(sky_w_m2: FloatArray, dni_w_m2: ArrayLike, zenith: FloatArray) -> FloatArray:
    """Perez' sky clearness, eq. (1) of the same paper; the zenith angle in radians."""
    cube = 1.041 * zenith**3
    return np.asarray(((sky_w_m2 + np.asarray(dni_w_m2)) / sky_w_m2 + cube) / (1.0 + cube))


def sky_view(cos_tilt: ArrayLike) -> FloatArray:
    """Fraction of a facet's hemisphere that is sky, (1 + cos b) / 2, by the cosine of its tilt, any shape."""
    return np.asarray(0.5 * (1.0 + np.asarray(cos_tilt, dtype=np.float64)))


def ground_view(cos_tilt: ArrayLike) -> FloatArray:
    """Fraction of a facet's hemisphere that is flat ground, (1 - cos b) / 2, by the cosine of its tilt."""
    return np.asarray(0.5 * (1.0 - np.asarray(cos_tilt, dtype=np.float64)))


def clear_sky_longwave(air_temperature_k: ArrayLike) -> FloatArray:
    """Downward longwave of a cloudless sky on the Earth, ``5.31e-13 T**6``, from the air near the ground,
    W/m2.

    W. C. Swinbank, "Long-wave radiation from clear skies", Q. J. R. Meteorol. Soc. 89, 339-348, 1963.
    """
    return np.asarray(_SWINBANK * np.asarray(air_temperature_k, np.float64) ** 6)


def air_under_clear_sky(longwave_down_w_m2: ArrayLike) -> FloatArray:
    """The inverse of `clear_sky_longwave`: air temperature from downward longwave, kelvin."""
    return np.asarray((np.asarray(longwave_down_w_m2, np.float64) / _SWINBANK) ** (1.0 / 6.0))


def isotropic_diffuse(dhi_w_m2: ArrayLike, cos_tilt: ArrayLike) -> FloatArray:
    """Diffuse irradiance on a facet under a sky of uniform radiance, W/m2."""
    return np.asarray(np.multiply(dhi_w_m2, sky_view(cos_tilt)))


def hay_davies_diffuse(
    dhi_w_m2: ArrayLike,
    dni_w_m2: ArrayLike,
    extraterrestrial_w_m2: ArrayLike,
    cos_incidence: ArrayLike,
    cos_zenith: ArrayLike,
    cos_tilt: ArrayLike,
) -> FloatArray:
    """Diffuse irradiance on a facet, with a circumsolar part.

    The circumsolar share is the transmission of the beam; the rest is isotropic [1]_.

    Parameters
    ----------
    dhi_w_m2, dni_w_m2
        Diffuse horizontal and direct normal irradiance. [W/m2]
    extraterrestrial_w_m2
        See `extraterrestrial`. [W/m2]
    cos_incidence
        Cosine between sun and facet normal; negative where the facet faces away. [-]
    cos_zenith
        Cosine of the sun's zenith angle; taken as at least that of 1 degree of elevation. [-]
    cos_tilt
        Cosine of the facet's tilt from horizontal. [-]

    Returns
    -------
    Shape of the arguments, broadcast. [W/m2]

    References
    ----------
    .. [1] J. E. Hay and J. A. Davies, "Calculation of the solar radiation incident on an inclined surface",
       Proc. First Canadian Solar Radiation Data Workshop, 59-72, 1980.
    """
    circumsolar = np.clip(np.divide(dni_w_m2, extraterrestrial_w_m2), 0.0, 1.0)
    beam_ratio = np.maximum(cos_incidence, 0.0) / np.maximum(cos_zenith, _LOWEST_COS_ZENITH)
    share = circumsolar * beam_ratio + (1.0 - circumsolar) * sky_view(cos_tilt)
    return np.asarray(np.multiply(dhi_w_m2, share))


def perez_brightening(
    dhi_w_m2: ArrayLike, dni_w_m2: ArrayLike, extraterrestrial_w_m2: ArrayLike, cos_zenith: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Shares of the diffuse light that come from around the sun and from the horizon.

    F1, at least 0, and F2, negative where the zenith is brighter; on a facet of tilt b they give
    ``DHI ((1 - F1) (1 + cos b) / 2 + F1 a / b' + F2 sin b)``, with a / b' the cosines of incidence and of the
    zenith angle, at least that of 5 degrees of elevation. Arguments as
    of `perez_efficacy`, and its source: eqs. (1), (9) and tables 1 and 6.
    """
    cosine = np.clip(np.asarray(cos_zenith, np.float64), 0.0, 1.0)
    zenith, sky = np.arccos(cosine), np.maximum(np.asarray(dhi_w_m2, np.float64), 1e-3)
    clearness = _clearness(sky, dni_w_m2, zenith)
    brightness = sky * air_mass(cosine) / np.asarray(extraterrestrial_w_m2)
    f11, f12, f13, f21, f22, f23 = np.moveaxis(_BRIGHTENING[np.digitize(clearness, _CLEARNESS_EDGES)], -1, 0)
    around_sun = np.maximum(f11 + f12 * brightness + f13 * zenith, 0.0)
    return np.asarray(around_sun), np.asarray(f21 + f22 * brightness + f23 * zenith)


def ground_reflected(ghi_w_m2: ArrayLike, ground_albedo: ArrayLike, cos_tilt: ArrayLike) -> FloatArray:
    """Sunlight reflected from flat ground, of an albedo in [0, 1], onto a facet, W/m2."""
    return np.asarray(np.multiply(ghi_w_m2, ground_albedo) * ground_view(cos_tilt))


def longwave_on_facet(
    longwave_down_w_m2: ArrayLike, longwave_ground_w_m2: ArrayLike, cos_tilt: ArrayLike
) -> FloatArray:
    """Longwave irradiance on a facet from its shares of sky and flat ground, W/m2."""
    from_sky = np.multiply(longwave_down_w_m2, sky_view(cos_tilt))
    return np.asarray(from_sky + np.multiply(longwave_ground_w_m2, ground_view(cos_tilt)))
