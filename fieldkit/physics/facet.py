"""Facets and directions: a plane surface by its tilt and azimuth, or by its unit normal.

Axes are east, north, up. Tilt is measured from horizontal, azimuth of the surface normal from north,
clockwise; both in degrees, radians never leave a function. Time and light are not here.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.model.arrays import FloatArray

VERTICAL: FloatArray = np.array([0.0, 0.0, 1.0])
VERTICAL.setflags(write=False)


def normal(tilt_deg: ArrayLike, azimuth_deg: ArrayLike) -> FloatArray:
    """Unit normals (east, north, up), (..., 3), of facets by tilt and azimuth that broadcast to (...)."""
    tilt, azimuth = np.broadcast_arrays(np.radians(tilt_deg), np.radians(azimuth_deg))
    horizontal = np.sin(tilt)
    return np.stack([horizontal * np.sin(azimuth), horizontal * np.cos(azimuth), np.cos(tilt)], axis=-1)


def tilt_azimuth(normals: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Tilt in [0, 180] and azimuth in [0, 360) of vectors (..., 3) of any length; a vertical one gets azimuth
    0.
    """
    vectors = np.asarray(normals, dtype=np.float64)
    east, north, up = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    horizontal = np.hypot(east, north)
    azimuth = np.degrees(np.arctan2(east, north)) % 360.0
    # -1e-17 % 360 rounds to 360 itself
    azimuth = np.where((azimuth >= 360.0) | (horizontal == 0.0), 0.0, azimuth)
    return np.degrees(np.arctan2(horizontal, up)), azimuth


def cos_incidence(normals: ArrayLike, sun: ArrayLike) -> FloatArray:
    """Cosine of the angle between facets and sun.

    Parameters
    ----------
    normals
        Unit normals of facets, shape (..., 3).
    sun
        Unit vectors to the sun, shape (n, 3) or (3,).

    Returns
    -------
    Shape (..., n), or (...) for one sun vector; negative where the facet faces away from the sun. [-]
    """
    return np.asarray(normals, dtype=np.float64) @ np.asarray(sun, dtype=np.float64).T


def angle_between_deg(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """Angle in [0, 180] between unit vectors, shapes (..., 3) that broadcast.

    Kahan's half-angle form is exact also for nearly equal and nearly opposite vectors, where an arc cosine
    loses half its digits.
    """
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    apart = np.linalg.norm(a - b, axis=-1)
    together = np.linalg.norm(a + b, axis=-1)
    return np.asarray(np.degrees(2.0 * np.arctan2(apart, together)))


def incidence_deg(normals: ArrayLike, sun: ArrayLike) -> FloatArray:
    """Incidence angle of the sun on facets, the paper's theta of eq. (2) and Table 2, in [0, 180].

    Shapes as of `cos_incidence`.
    """
    facets, rays = np.asarray(normals, dtype=np.float64), np.asarray(sun, dtype=np.float64)
    if rays.ndim == 1:
        return angle_between_deg(facets, rays)
    return angle_between_deg(facets[..., np.newaxis, :], rays)
