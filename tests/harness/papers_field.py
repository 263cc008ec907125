"""The place, the sun and the surfaces of the paper: eq. (7) with S 800 W/m2, T_a 303.15 K and L 400 W/m2."""

from __future__ import annotations

import numpy as np

from fieldkit.model.arrays import AnyArray, FloatArray
from fieldkit.model.site import Site
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.energy_balance import SurfaceParameters, surface_temperature
from fieldkit.physics.sun import sun_vectors

SITE = Site(35.558675, 139.395232, 9.0, "Asia/Tokyo")
SURFACE = SurfaceParameters()
"""Table 1."""


def utc_ns(text: str) -> int:
    """Nanoseconds of a time in UTC."""
    return int(np.datetime64(text, "ns").astype(np.int64))


def suns(start_utc: str, minutes: int, step: int = 1) -> FloatArray:
    """Directions (n, 3) to the sun of each minute, or of each `step`-th."""
    return sun_vectors(utc_ns(start_utc) + np.arange(0, minutes, step) * MINUTE_NS, SITE)


def temperatures_k(normals: AnyArray, suns: AnyArray) -> FloatArray:
    """Surface temperatures of slopes under a sun, or of one slope under several."""
    return surface_temperature(800.0 * np.maximum(normals @ suns.T, 0.0), 400.0, 303.15, SURFACE)
