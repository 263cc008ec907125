"""Radiance in a flat 8-14 micrometre band, and back to temperature.

Planck's law is integrated once on a table; both directions interpolate the same table, so a round trip
returns the temperature. The response of a particular camera is not modelled: 8-14 micrometres flat stands
for the uncooled cameras used here. Kelvin; W/m2 into the hemisphere.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.model.arrays import FloatArray
from fieldkit.physics.constants import FIRST_RADIATION, SECOND_RADIATION

BAND_UM = (8.0, 14.0)
TABLE_K = (100.0, 800.0)
_STEP_K = 0.1  # linear interpolation is then within 2e-5 K


def band_radiance(temperature_k: ArrayLike) -> FloatArray:
    """Exitance of a black surface within 8-14 micrometres.

    Parameters
    ----------
    temperature_k
        Temperature, any shape. [K]

    Returns
    -------
    Same shape; NaN outside 100-800 K. [W/m2]
    """
    temperatures, radiances = _table()
    return np.interp(np.asarray(temperature_k, np.float64), temperatures, radiances, np.nan, np.nan)


def band_temperature(radiance_w_m2: ArrayLike) -> FloatArray:
    """Temperature of a black surface of a given band exitance, any shape: the inverse of `band_radiance`, K.

    NaN outside the exitances of 100-800 K.
    """
    temperatures, radiances = _table()
    return np.interp(np.asarray(radiance_w_m2, np.float64), radiances, temperatures, np.nan, np.nan)


def surface_temperature_k(
    brightness_k: ArrayLike, emissivity: ArrayLike, reflected_k: ArrayLike
) -> FloatArray:
    """Temperature of a grey surface from the brightness temperature a camera reports.

    The camera receives ``e M(T) + (1 - e) M(T_reflected)`` with M the band exitance.

    Parameters
    ----------
    brightness_k
        Temperature reported for emissivity 1, any shape. [K]
    emissivity
        Of the camera's band, in (0, 1], broadcastable. [-]
    reflected_k
        Band temperature of what the surface reflects; outdoors the clear sky, -20 to -60 °C. [K]

    Returns
    -------
    Same shape; NaN where the reflection exceeds what was received. [K]

    Raises
    ------
    ValueError
        If an emissivity lies outside (0, 1].
    """
    grey = _check(emissivity)
    emitted = band_radiance(brightness_k) - (1.0 - grey) * band_radiance(reflected_k)
    return band_temperature(emitted / grey)


def brightness_temperature_k(
    temperature_k: ArrayLike, emissivity: ArrayLike, reflected_k: ArrayLike
) -> FloatArray:
    """Brightness temperature that a camera reports of a grey surface: the inverse of `surface_temperature_k`.

    Emissivity, reflection, shapes and errors as there. [K]
    """
    grey = _check(emissivity)
    return band_temperature(grey * band_radiance(temperature_k) + (1.0 - grey) * band_radiance(reflected_k))


def kelvin_per_emissivity(
    temperature_k: ArrayLike, emissivity: ArrayLike, reflected_k: ArrayLike
) -> FloatArray:
    """Change of the computed surface temperature per unit of the emissivity assumed, K.

    ``(M(T_reflected) - M(T)) / (e M'(T))``: negative where the surface is warmer than what it reflects.
    Emissivity, reflection, shapes and errors as of `surface_temperature_k`.
    """
    kelvin = np.asarray(temperature_k, np.float64)
    steepness = band_radiance(kelvin + 0.5) - band_radiance(kelvin - 0.5)
    excess = band_radiance(reflected_k) - band_radiance(kelvin)
    return np.asarray(excess / (_check(emissivity) * steepness))


def _check(emissivity: ArrayLike) -> FloatArray:
    values = np.asarray(emissivity, np.float64)
    if not np.all((values > 0.0) & (values <= 1.0)):
        raise ValueError(f"emissivity must lie in (0, 1], not {values}")
    return values


@lru_cache(maxsize=1)
def _table() -> tuple[FloatArray, FloatArray]:
    temperatures = np.arange(TABLE_K[0], TABLE_K[1] + _STEP_K / 2, _STEP_K)
    nodes, weights = np.polynomial.legendre.leggauss(32)
    low, high = BAND_UM[0] * 1e-6, BAND_UM[1] * 1e-6
    wavelengths = 0.5 * (high - low) * nodes + 0.5 * (high + low)
    spectral = (
        FIRST_RADIATION / wavelengths**5 / np.expm1(SECOND_RADIATION / np.outer(temperatures, wavelengths))
    )
    return temperatures, spectral @ weights * 0.5 * (high - low)
