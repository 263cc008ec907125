"""The horizon of a place, as elevations by azimuth: whether the sun stands above it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldkit.physics.facet import FloatArray, tilt_azimuth

Horizon = Sequence[tuple[float, float]]
"""Pairs of azimuth from north, clockwise, and elevation, in any order. [degrees]"""


def horizon_elevation(horizon: Horizon, azimuth_deg: ArrayLike) -> FloatArray:
    """Elevation of a horizon, linear between its points and periodic in azimuth.

    Parameters
    ----------
    horizon
        At least one pair of azimuth and elevation. [degrees]
    azimuth_deg
        Any shape. [degrees]

    Returns
    -------
    Shape of `azimuth_deg`. [degrees]
    """
    azimuths, elevations = np.array(horizon, np.float64).reshape(-1, 2).T
    return np.asarray(np.interp(np.asarray(azimuth_deg, np.float64), azimuths, elevations, period=360.0))


def is_below_horizon(horizon: Horizon, sun: ArrayLike) -> NDArray[np.bool_]:
    """Whether the centre of the sun's disc is below a horizon.

    Parameters
    ----------
    horizon
        Pairs of azimuth and elevation; without any the horizon is level and nothing is below it. [degrees]
    sun
        Unit vectors to the sun (east, north, up), shape (..., 3).

    Returns
    -------
    Shape (...).
    """
    zenith, azimuth = tilt_azimuth(np.asarray(sun, np.float64))
    if not len(horizon):
        return np.zeros(np.shape(zenith), np.bool_)
    return np.asarray(90.0 - zenith < horizon_elevation(horizon, azimuth))
