"""The reflector method: crumpled foil in the surface's plane shows what the surface mirrors (ISO 18434-1).

Foil under a cold sky may be colder than the camera can tell; then it shows the camera's lowest value in
many pixels at once, which is a bound and no measurement.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fieldkit.errors import CalibrationError

SATURATED_SHARE = 0.25
"""Of a foil's pixels at one lowest count; noise alone leaves a few of a hundred there."""


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
