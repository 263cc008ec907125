"""Quantities for a rover's planner from surface normals: slope along a drive, northerly tilt, share of sun.

Slope and heading are the tilt and azimuth of `facet`. The set is that of JPL's MARSSLOPE [1]_, with the sun's
way over the day in place of its elevation at noon. Axes are east, north, up.

.. [1] NASA AMMOS, "Help for MARSSLOPE", VICAR documentation.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.model.arrays import FloatArray


def climb_deg(normals: ArrayLike, azimuth_deg: ArrayLike) -> FloatArray:
    """Slope along a direction, such as that of a drive, of unit normals (..., 3); positive where the way
    climbs.

    `azimuth_deg` is from north, clockwise, and broadcasts to (...). In [-90, 90] for surfaces that face up.
    [degrees]
    """
    n, along = np.asarray(normals), np.radians(azimuth_deg)
    downhill = n[..., 0] * np.sin(along) + n[..., 1] * np.cos(along)
    return np.asarray(np.degrees(np.arctan2(-downhill, n[..., 2])))


def northerly_tilt_deg(normals: ArrayLike) -> FloatArray:
    """Tilt towards north: the angle of normals (..., 3) from the zenith in the meridian plane, degrees."""
    return climb_deg(normals, 180.0)


def sunlit_cosine(normals: ArrayLike, suns: ArrayLike) -> FloatArray:
    """Mean cosine of incidence (...), zero while a surface or the horizontal faces away from the sun, in [0,
    1].

    Of unit normals (..., 3) and unit vectors to the sun at even steps of time (n, 3). Times the direct normal
    irradiance, constant over the time, it is the mean direct irradiance.
    """
    rays = np.asarray(suns, np.float64)
    total = np.zeros(np.shape(normals)[:-1])
    for ray in rays[rays[:, 2] > 0.0]:  # one at a time: a map times a day does not fit the memory
        total += np.maximum(normals @ ray, 0.0)
    return np.asarray(total / len(rays))
