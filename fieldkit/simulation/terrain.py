"""Ground in relief as the camera sees it: every pixel has a slope and a horizon of its own."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fieldkit.model.arrays import FloatArray, SingleArray
from fieldkit.model.units import SECOND_NS
from fieldkit.physics.facet import tilt_azimuth
from fieldkit.physics.horizon import SUN_RADIUS_DEG, Horizon

PIECE = 2000
"""Pixels computed together: their time series fit the memory."""


@dataclass(frozen=True, eq=False)
class Terrain:
    """Slopes and horizons of the pixels of a frame, row by row: `normals` are unit vectors (pixels, 3).

    `horizon_deg` (pixels, n) is the skyline's elevation at evenly spaced azimuths from north on.
    """

    normals: FloatArray
    horizon_deg: FloatArray

    def pieces(self) -> Iterator[slice]:
        """Slices of the pixels."""
        for begin in range(0, len(self.normals), PIECE):
            yield slice(begin, begin + PIECE)

    @cached_property
    def sky_view(self) -> FloatArray:
        """Share of an even sky that each pixel's horizon leaves, (pixels,); see `sky_view_factor`."""
        return np.asarray(np.mean(np.cos(np.radians(np.maximum(self.horizon_deg, 0.0))) ** 2, axis=1))

    def horizon_at(self, pixel: int) -> Horizon:
        """The skyline of one pixel."""
        elevations = self.horizon_deg[pixel].tolist()
        return [(360.0 * n / len(elevations), elevation) for n, elevation in enumerate(elevations)]

    def sunlit_share(self, sun: FloatArray, piece: slice) -> FloatArray:
        """Share of the sun's disc above the horizon of pixels at times, whose sun vectors are (m, 3).

        Shape (pixels, m); the horizon counts as level across the disc.
        """
        zenith, azimuth = tilt_azimuth(sun)
        count = self.horizon_deg.shape[1]
        place = azimuth / 360.0 * count
        left = place.astype(int) % count
        share = place % 1.0
        horizon = self.horizon_deg[piece]
        skyline = horizon[:, left] * (1.0 - share) + horizon[:, (left + 1) % count] * share
        above = np.clip((90.0 - zenith - skyline) / SUN_RADIUS_DEG, -1.0, 1.0)
        # area of a circle above a chord
        return np.asarray(0.5 + (np.arcsin(above) + above * np.sqrt(1.0 - above**2)) / np.pi)


@dataclass(frozen=True, slots=True)
class TerrainSeries:
    """Brightness temperatures (m, pixels) in kelvin, at even times (m,) in seconds after `origin_ns`."""

    origin_ns: int
    time_s: FloatArray
    brightness_k: SingleArray

    def at(self, time_ns: int) -> SingleArray:
        """Brightness temperatures (pixels,) at one time by linear interpolation; constant beyond the ends."""
        place = np.clip((time_ns - self.origin_ns) / SECOND_NS / self.time_s[1], 0.0, self.time_s.size - 1.0)
        before = min(int(place), self.time_s.size - 2)
        earlier, later = self.brightness_k[before : before + 2]
        return np.asarray(earlier + np.float32(place - before) * (later - earlier))
