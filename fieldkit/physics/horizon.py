"""The horizon of a place, as elevations by azimuth: how much of the sun and of the sky stands above it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.physics.facet import FloatArray, tilt_azimuth

Horizon = Sequence[tuple[float, float]]
"""Pairs of azimuth from north, clockwise, and elevation, in any order. [degrees]"""

SUN_RADIUS_DEG = 0.267
"""Half the width of the sun's disc, seen from the Earth."""
MINUTE_EDGE_DEG = 0.4
"""The same within a minute, in which the sun moves by a quarter of a degree."""
_ANGLES = (np.arange(12) + 0.5) * np.pi / 6.0
_DISC = np.concatenate([np.sqrt(part / 3.0) * np.exp(1j * _ANGLES) for part in (1, 2, 3)])
"""Points of a disc of radius 1, each for an equal share of it: across and up."""
_AZIMUTHS = 3600


def horizon_elevation(horizon: Horizon, azimuth_deg: ArrayLike) -> FloatArray:
    """Elevation of a horizon, linear between its points and periodic in azimuth.

    Parameters
    ----------
    horizon
        Pairs of azimuth and elevation; level without any. [degrees]
    azimuth_deg
        Any shape. [degrees]

    Returns
    -------
    Shape of `azimuth_deg`. [degrees]
    """
    azimuth = np.asarray(azimuth_deg, np.float64)
    if not len(horizon):
        return np.zeros_like(azimuth)
    azimuths, elevations = np.array(horizon, np.float64).T
    return np.asarray(np.interp(azimuth, azimuths, elevations, period=360.0))


def sunlit_share(horizon: Horizon, sun: ArrayLike, within_deg: float = SUN_RADIUS_DEG) -> FloatArray:
    """Share of the sun that a horizon leaves visible.

    Parameters
    ----------
    horizon
        Pairs of azimuth and elevation; without any the whole sun is visible, even below a level horizon.
        [degrees]
    sun
        Unit vectors to the sun's centre (east, north, up), shape (..., 3).
    within_deg
        Radius of the disc. [degrees]

    Returns
    -------
    Shape (...), 0 to 1. [-]
    """
    zenith, azimuth = (np.asarray(one) for one in tilt_azimuth(np.asarray(sun, np.float64)))
    if not len(horizon):
        return np.ones_like(zenith)
    up = 90.0 - zenith[..., np.newaxis] + within_deg * _DISC.imag
    across = within_deg * _DISC.real / np.maximum(np.sin(np.radians(zenith)), 0.01)[..., np.newaxis]
    visible = up > horizon_elevation(horizon, azimuth[..., np.newaxis] + across)
    return np.asarray(visible.mean(axis=-1))


def sky_view_factor(horizon: Horizon) -> float:
    """Share of an even sky's light on level ground that a horizon leaves, the mean of cos² of its elevation.

    Parameters
    ----------
    horizon
        Pairs of azimuth and elevation; what is below level hides nothing. [degrees]

    Returns
    -------
    0 to 1. [-]

    References
    ----------
    .. [1] J. Dozier and J. Frew, "Rapid calculation of terrain parameters for radiation modeling from digital
       elevation data", IEEE Trans. Geosci. Remote Sens. 28, 963-969, 1990, eq. (7b).
    """
    azimuths = (np.arange(_AZIMUTHS) + 0.5) * 360.0 / _AZIMUTHS
    elevations = np.maximum(horizon_elevation(horizon, azimuths), 0.0)
    return float(np.mean(np.cos(np.radians(elevations)) ** 2))
