"""The horizon of a place, as elevations by azimuth: how much of the sun and of the sky stands above it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.model.arrays import FloatArray
from fieldkit.physics.facet import tilt_azimuth

Horizon = Sequence[tuple[float, float]]
"""Pairs of azimuth from north, clockwise, and elevation, in any order. [degrees]"""

SUN_RADIUS_DEG = 0.267
"""Half the width of the sun's disc, seen from the Earth."""
MINUTE_EDGE_DEG = 0.4
"""The same within a minute, in which the sun moves by a quarter of a degree."""
_ANGLES = (np.arange(12) + 0.5) * np.pi / 6.0
_DISC = np.concatenate([np.sqrt(part / 3.0) * np.exp(1j * _ANGLES) for part in (1, 2, 3)])
"""Points of a disc of radius 1, each for an equal share of it: across and up."""
_AZIMUTHS = 3600  # every tenth of a degree, as a horizon is linear between its points
_STEP_WIDTH_DEG = 0.005
"""Distance from a corner at which a horizon is given on both sides: a step is as wide as rounding."""


def horizon_elevation(horizon: Horizon, azimuth_deg: ArrayLike) -> FloatArray:
    """Elevation of a horizon at azimuths of any shape, linear between its points; 0 without any."""
    azimuth = np.asarray(azimuth_deg, np.float64)
    if not len(horizon):
        return np.zeros_like(azimuth)
    azimuths, elevations = np.array(horizon, np.float64).T
    return np.asarray(np.interp(azimuth, azimuths, elevations, period=360.0))


def sunlit_share(horizon: Horizon, sun: ArrayLike, within_deg: float = SUN_RADIUS_DEG) -> FloatArray:
    """Share of a disc around the sun's centre that a horizon leaves visible, 0 to 1.

    By unit vectors to the sun (east, north, up), shape (..., 3), and the disc's radius. Without a horizon's
    pairs the whole sun is visible, even below a level horizon.
    """
    zenith, azimuth = (np.asarray(angle) for angle in tilt_azimuth(np.asarray(sun, np.float64)))
    if not len(horizon):
        return np.ones_like(zenith)
    up = 90.0 - zenith[..., np.newaxis] + within_deg * _DISC.imag
    across = within_deg * _DISC.real / np.maximum(np.sin(np.radians(zenith)), 0.01)[..., np.newaxis]
    visible = up > horizon_elevation(horizon, azimuth[..., np.newaxis] + across)
    return np.asarray(visible.mean(axis=-1))


def horizon_of_neighbours(bed_m: ArrayLike, others_m: Sequence[ArrayLike]) -> Horizon:
    """Elevation of plane beds above a bed, by azimuth, seen from the part of it where they are highest; else
    0.

    Corners (n, 3) are east, north, up in metres; none of the others overlaps the bed in plan. Exact at every
    degree and on both sides of each corner, where the outline may step. The differences of points of two
    convex outlines fill the hull of their corners' differences, and what is steepest at an azimuth lies on an
    edge of it. An outline that is not convex counts as its hull.
    """
    bed = np.asarray(bed_m, np.float64)
    apart = [np.subtract(other, bed[:, np.newaxis]).reshape(-1, 3) for other in others_m]
    corners = np.concatenate([tilt_azimuth(edge)[1] for edge in apart]) if apart else np.empty(0)
    beside = np.concatenate([corners - _STEP_WIDTH_DEG, corners + _STEP_WIDTH_DEG]) % 360.0
    azimuths = np.unique(np.concatenate([np.arange(360.0), beside]))
    elevations = np.zeros_like(azimuths)
    for points in apart:
        first, last = np.triu_indices(len(points), 1)
        elevations = np.maximum(elevations, _elevation_of_lines(points[first], points[last], azimuths))
    return list(zip(azimuths.tolist(), elevations.tolist(), strict=True))


def _elevation_of_lines(begin: FloatArray, end: FloatArray, azimuth_deg: FloatArray) -> FloatArray:
    """Highest elevation of straight lines (n, 3) to (n, 3) at azimuths (m,), from the origin; else -90."""
    ahead = np.stack([np.sin(np.radians(azimuth_deg)), np.cos(np.radians(azimuth_deg))])
    left = np.stack([-ahead[1], ahead[0]])
    aside, aside_at_end = begin[:, :2] @ left, end[:, :2] @ left  # (n, m): the line crosses where it is 0
    with np.errstate(divide="ignore", invalid="ignore"):
        share = aside / (aside - aside_at_end)
        away = begin[:, :2] @ ahead * (1.0 - share) + end[:, :2] @ ahead * share
        up = begin[:, 2:] * (1.0 - share) + end[:, 2:] * share
        crosses = (share >= 0.0) & (share <= 1.0) & (away > 0.0)
    return np.asarray(np.degrees(np.arctan2(up, away)).max(axis=0, where=crosses, initial=-90.0))


def higher_horizon(first: Horizon, second: Horizon) -> Horizon:
    """The higher of two horizons at the azimuths of both; a horizon without pairs hides nothing."""
    if not len(first) or not len(second):
        return first or second
    azimuths = sorted({azimuth % 360.0 for azimuth, _ in (*first, *second)})
    elevations = np.maximum(horizon_elevation(first, azimuths), horizon_elevation(second, azimuths))
    return list(zip(azimuths, elevations.tolist(), strict=True))


def sky_view_factor(horizon: Horizon) -> float:
    """Share of an even sky's light on level ground that a horizon leaves, the mean of cos² of its elevation.

    What is below level hides nothing. J. Dozier and J. Frew, "Rapid calculation of terrain parameters for
    radiation modeling from digital elevation data", IEEE Trans. Geosci. Remote Sens. 28, 963-969, 1990, eq.
    (7b).
    """
    azimuths = (np.arange(_AZIMUTHS) + 0.5) * 360.0 / _AZIMUTHS
    elevations = np.maximum(horizon_elevation(horizon, azimuths), 0.0)
    return float(np.mean(np.cos(np.radians(elevations)) ** 2))
