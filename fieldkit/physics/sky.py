"""What the sky and the ground around send to a tilted facet besides the direct beam.

The paper's eqs. (1)-(7) leave these terms out; the full surface model and the simulated
scene use them. Pure functions of irradiances [W/m2] and cosines, arrays that broadcast.
`cos_tilt` is the cosine of the facet's tilt: a facet sees (1 + cos b)/2 of the sky and
(1 - cos b)/2 of flat ground.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.physics.facet import FloatArray

SOLAR_CONSTANT_W_M2 = 1361.0
"""Kopp and Lean, "A new, lower value of total solar irradiance", 2011."""

# below one degree of elevation the ratio of cosines says nothing about circumsolar light
_LOWEST_COS_ZENITH = 0.01745


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


def sky_view(cos_tilt: ArrayLike) -> FloatArray:
    """Share of a facet's hemisphere that is sky."""
    return np.asarray(0.5 * (1.0 + np.asarray(cos_tilt, dtype=np.float64)))


def ground_view(cos_tilt: ArrayLike) -> FloatArray:
    """Share of a facet's hemisphere that is flat ground."""
    return np.asarray(0.5 * (1.0 - np.asarray(cos_tilt, dtype=np.float64)))
