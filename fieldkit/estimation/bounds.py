"""What the path of the sun allows: a slope's mirror image, and how precise an estimate can be at best."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.physics.facet import FloatArray, tilt_azimuth


def mirror(normals: ArrayLike, H: FloatArray) -> FloatArray:
    """Mirror images ``n - 2 (n . m) m`` of normals (..., 3) in the plane of the sun's motion.

    `m`, the eigenvector of H with the smallest eigenvalue, is the direction the sun never
    showed; what fits a slope fits its mirror image nearly as well.
    """
    n = np.asarray(normals, np.float64)
    across = np.linalg.eigh(H)[1][..., :, 0]
    return np.asarray(n - 2.0 * np.sum(n * across, axis=-1, keepdims=True) * across)


def tangents(normals: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Unit vectors along growing tilt and growing azimuth at normals (..., 3).

    At the vertical, where azimuth has no meaning, those of azimuth 0.
    """
    tilt, azimuth = (np.radians(angle) for angle in tilt_azimuth(normals))
    level = np.zeros_like(tilt)
    along = np.stack([np.cos(tilt) * np.sin(azimuth), np.cos(tilt) * np.cos(azimuth), -np.sin(tilt)], axis=-1)
    return along, np.stack([np.cos(azimuth), -np.sin(azimuth), level], axis=-1)


def cramer_rao(H: FloatArray, normals: ArrayLike) -> FloatArray:
    """Smallest possible covariance (..., 2, 2) of an unbiased estimate at normals (..., 3), rad**2.

    Entry 0 is tilt, entry 1 direction on the ground (azimuth times the sine of tilt). S. Kay,
    "Fundamentals of statistical signal processing: estimation theory", 1993. Needs only sun,
    irradiance and noise, so it can be drawn before the day. Near the fold it is too small.
    """
    basis = np.stack(tangents(normals), axis=-1)
    return np.asarray(np.linalg.inv(np.swapaxes(basis, -1, -2) @ H @ basis))
