"""The reflector method: crumpled foil in the surface's plane shows what the surface mirrors (ISO 18434-1).

Foil is not a perfect mirror: the few hundredths that it emits itself make a cold sky some kelvins too warm.
Foil under a cold sky may be colder than the camera can tell; then it shows the camera's lowest value in
many pixels at once, which is a bound and no measurement.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fieldkit.calibration.band import FLAT, Band
from fieldkit.model.errors import CalibrationError
from fieldkit.physics.facet import FloatArray

SATURATED_SHARE = 0.25
"""Of a foil's pixels at one lowest count; noise alone leaves a few of a hundred there."""

FOIL_EMISSIVITY, FOIL_EMISSIVITY_SD = 0.04, 0.02
"""Aluminium foil at 10 micrometres and 27 °C in the emissivity tables of thermal camera manuals; dust and
folds add, and its own temperature is only known as the surface's it lies on."""


def mirrored_temperature_k(
    foil_k: FloatArray, surface_k: FloatArray, foil_emissivity: float, band: Band = FLAT
) -> FloatArray:
    """Band temperature of what a foil mirrors, its own emission taken out, kelvin, (n,).

    `foil_k` is how the camera reads it at emissivity 1, `surface_k` its own temperature.
    """
    own = foil_emissivity * band.signal(surface_k)
    return band.temperature((band.signal(foil_k) - own) / (1.0 - foil_emissivity))


def is_saturated(counts: NDArray[np.uint16]) -> bool:
    """Whether the foil's pixels (n,) of one picture stand at the end of the camera's range."""
    return bool(np.mean(counts == counts.min()) >= SATURATED_SHARE)


def refuse_saturated(pictures: int, saturated: int, lowest_k: float) -> None:
    """Raise `CalibrationError` if the foil was at the end of the range in half of the pictures or more."""
    if pictures and 2 * saturated >= pictures:
        raise CalibrationError(
            f"the foil reads the camera's lowest temperature, {lowest_k - 273.15:.0f} °C: saturated",
            fix="give the sky's temperature in the camera's band with --reflected, from another instrument, "
            "or --reflected free with a surface that spans 15 K",
        )
