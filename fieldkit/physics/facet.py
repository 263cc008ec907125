"""Facets and directions: a plane surface by its tilt and azimuth, or by its unit normal.

Axes are east, north, up. Tilt is measured from horizontal, azimuth of the surface normal
from north, clockwise; both in degrees here, radians never leave a function. Nothing here
knows about time or light.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

VERTICAL: FloatArray = np.array([0.0, 0.0, 1.0])
VERTICAL.setflags(write=False)


def normal(tilt_deg: ArrayLike, azimuth_deg: ArrayLike) -> FloatArray:
    """Unit normals of facets; the two angles broadcast to (...), the result is (..., 3)."""
    tilt, azimuth = np.broadcast_arrays(np.radians(tilt_deg), np.radians(azimuth_deg))
    horizontal = np.sin(tilt)
    return np.stack([horizontal * np.sin(azimuth), horizontal * np.cos(azimuth), np.cos(tilt)], axis=-1)


def tilt_azimuth(normals: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Tilt in [0, 180] and azimuth in [0, 360) of vectors (..., 3) of any length, each (...).

    A vertical normal has no azimuth; 0 is given.
    """
    vectors = np.asarray(normals, dtype=np.float64)
    east, north, up = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    horizontal = np.hypot(east, north)
    azimuth = np.degrees(np.arctan2(east, north)) % 360.0
    # -1e-17 % 360 rounds to 360 itself
    azimuth = np.where((azimuth >= 360.0) | (horizontal == 0.0), 0.0, azimuth)
    return np.degrees(np.arctan2(horizontal, up)), azimuth


def cos_incidence(normals: ArrayLike, sun: ArrayLike) -> FloatArray:
    """Cosine of the angle between facets (..., 3) and sun vectors (n, 3) -> (..., n).

    Negative where the facet turns its back to the sun: the caller decides what that means.
    One sun vector of shape (3,) gives shape (...).
    """
    return np.asarray(normals, dtype=np.float64) @ np.asarray(sun, dtype=np.float64).T


def angle_between_deg(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """Angle between unit vectors (..., 3) that broadcast, degrees, in [0, 180].

    By Kahan's half-angle form, exact also for nearly equal and nearly opposite vectors,
    where an arc cosine loses half its digits.
    """
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    apart = np.linalg.norm(a - b, axis=-1)
    together = np.linalg.norm(a + b, axis=-1)
    angle: FloatArray = np.degrees(2.0 * np.arctan2(apart, together))
    return angle


def incidence_deg(normals: ArrayLike, sun: ArrayLike) -> FloatArray:
    """Incidence angle of sun vectors (n, 3) on facets (..., 3) -> (..., n), degrees.

    The paper's theta of eq. (2) and Table 2.
    """
    facets, rays = np.asarray(normals, dtype=np.float64), np.asarray(sun, dtype=np.float64)
    if rays.ndim == 1:
        return angle_between_deg(facets, rays)
    return angle_between_deg(facets[..., np.newaxis, :], rays)
