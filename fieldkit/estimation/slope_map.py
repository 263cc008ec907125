"""Tilt and azimuth of every pixel: one decomposition of the sun's path serves the whole picture.

The weights of a minute are taken alike for all pixels (the balance's steepness differs by
7 %), so H is shared and a pixel keeps four numbers, ``b`` and ``c``. Pictures are added at
camera rate, maps solved at display rate, in closed form: the tilt within 0.005 degree of the
polished answer for windows of 20 minutes (`normal`, which regions use), the azimuth within 0.01.
Which of the two branches is meant is decided as for regions (`choice`): the tilt limit, then misfit
and prior.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from fieldkit.estimation.likelihood import NINETY_PERCENT
from fieldkit.model.slope import SlopeState
from fieldkit.physics.facet import FloatArray
from fieldkit.physics.surface import SurfaceParameters, irradiance_per_kelvin

LOWEST_COSINE = 0.03
"""Pixels darker than this in the mean are in their own shade."""
PIECE = 16_384
DEGREES = np.float32(180.0 / np.pi)


@dataclass(frozen=True, slots=True)
class SlopeMap:
    """Slopes of a picture (rows, cols): degrees, reduced chi-square, and `SlopeState` as uint8.

    Angles are NaN where the state is `NO_DATA`, `NO_INTERSECTION` or `SHADED`. `second_tilt_deg` is the
    other branch's tilt, shown in the state `NOT_RESOLVED`: it keeps the limit and fits about as well.
    """

    tilt_deg: NDArray[np.float32]
    azimuth_deg: NDArray[np.float32]
    second_tilt_deg: NDArray[np.float32]
    chi_square: NDArray[np.float32]
    state: NDArray[np.uint8]


class MapSums:
    """Running sums of a slope map over the pictures of a window."""

    def __init__(
        self, shape: tuple[int, int], surface: SurfaceParameters, noise_k: float, tilt_limit_deg: float = 45.0
    ) -> None:
        self.shape, self.count = shape, 0
        self._surface, self._noise_k = surface, noise_k
        self._limit_cosine = np.float32(np.cos(np.radians(tilt_limit_deg)))
        pixels = shape[0] * shape[1]
        self._H, self._b, self._c = np.zeros((3, 3)), np.zeros((3, pixels)), np.zeros(pixels)
        self._weight_per_kelvin = 0.0
        # worked through in pieces that stay in the processor's cache: the loops are bound by memory
        self._pieces = [slice(at, min(at + PIECE, pixels)) for at in range(0, pixels, PIECE)]

    def add(
        self,
        temperature_k: FloatArray,
        reference_k: float,
        sun: FloatArray,
        direct_w_m2: float,
        reference_normal: FloatArray,
    ) -> None:
        """Add one picture of surface temperatures (rows, cols), in kelvin.

        `sun` (3,) unit vector and `direct_w_m2` at its time; `reference_k` the temperature
        of a bed whose normal is `reference_normal`. Pixels that are NaN stay NaN.
        """
        steepness = float(irradiance_per_kelvin(reference_k, self._surface))
        weight = (direct_w_m2 / (np.sqrt(2.0) * steepness * self._noise_k)) ** 2
        alpha, beta = self._surface.alpha / direct_w_m2, self._surface.beta / direct_w_m2
        start = float(reference_normal @ sun) - (alpha * reference_k**4 + beta * reference_k)
        warm = temperature_k.reshape(-1)
        for piece in self._pieces:
            kelvin = warm[piece]
            # y = n . s by eq. (6), as ((alpha T^2) T + beta) T + start
            y = kelvin * kelvin
            y *= alpha
            y *= kelvin
            y += beta
            y *= kelvin
            y += start
            for axis in range(3):
                self._b[axis, piece] += (weight * sun[axis]) * y
            y *= y
            y *= weight
            self._c[piece] += y
        self._H += weight * np.outer(sun, sun)
        self._weight_per_kelvin += weight * steepness / direct_w_m2
        self.count += 1

    @property
    def per_kelvin(self) -> float:
        """Mean change of a pixel's cosine to the sun per kelvin of its temperature."""
        return self._weight_per_kelvin / float(np.trace(self._H))  # sun vectors are of length one

    def sun_axes(self) -> tuple[FloatArray, FloatArray]:
        """Axes along the mean sun, along its motion and across both, rows of (3, 3), the last one upwards.

        Before them, (3,), how much the pictures so far say along each: inverse variances of a pixel's normal.
        """
        values, vectors = np.linalg.eigh(self._H)
        vectors[:, 0] *= np.copysign(1.0, vectors[2, 0])
        return values[::-1], vectors[:, ::-1].T

    def solve(self) -> SlopeMap:
        """The map of all pictures so far; at least three are needed to tell anything."""
        planes = np.full((4, self._c.size), np.nan, np.float32)
        state = np.full(self._c.size, SlopeState.TOO_FEW, np.uint8)
        if self.count >= 3:
            values, axes = self.sun_axes()
            for piece in self._pieces:
                self._solve_piece(piece, values[::-1], axes[::-1].T, planes[:, piece], state[piece])
        tilt, azimuth, second, chi_square = planes.reshape(4, *self.shape)
        return SlopeMap(tilt, azimuth, second, chi_square, state.reshape(self.shape))

    @property
    def _freedom(self) -> int:
        return max(self.count - 2, 1)

    def _solve_piece(
        self,
        piece: slice,
        values: FloatArray,
        vectors: FloatArray,
        planes: NDArray[np.float32],
        state: NDArray[np.uint8],
    ) -> None:
        y1, y2, pull, left = self._resolved(piece, values, vectors)
        m, e2, e1 = vectors.T.astype(np.float32)
        lowest, middle, highest = values.astype(np.float32)
        x1 = np.clip(y1, -1.0, 1.0)
        room = np.sqrt(1.0 - x1 * x1)
        x2 = np.clip(y2, -room, room)
        across = np.sqrt(np.maximum(room * room - x2 * x2, 0.0))
        # over hours the sun leaves that plane, and the slope shows across it as well
        left += (lowest * across - 2.0 * pull) * across
        gain = 4.0 * pull * across  # misfit of the steeper branch less that of the flatter
        # both branches share what lies in the plane
        east, north, level = (x1 * e1[i] + x2 * e2[i] for i in range(3))
        flatter, steeper = level + m[2] * across, level - m[2] * across
        is_alone = (steeper < self._limit_cosine) | (across == 0.0)
        swap = ~is_alone & (gain < np.log(_square_sine(flatter) / _square_sine(steeper)))
        side = np.where(swap, np.float32(-1.0), np.float32(1.0))
        left += np.where(swap, gain, np.float32(0.0))
        gain *= side
        across *= side
        tilt, azimuth, second, chi_square = planes
        chosen, other = level + m[2] * across, level - m[2] * across
        tilt[:] = _arc_cosine(chosen)
        # good to 0.01 degree, and forty times as fast as numpy's
        azimuth[:] = cv2.phase(north + m[1] * across, east + m[0] * across, angleInDegrees=True).ravel()
        pinned = highest * (y1 - x1) ** 2 + middle * (y2 - x2) ** 2
        chi_square[:] = (np.maximum(left, 0.0) + pinned) / self._freedom
        self._judge(chosen, other, chi_square, gain, is_alone, state)
        # the first axis is the sun's mean direction, so along it lies the mean cosine
        state[(y1 if e1[2] > 0.0 else -y1) < LOWEST_COSINE] = SlopeState.SHADED
        state[np.isnan(y1)] = SlopeState.NO_DATA
        doubtful = state == SlopeState.NOT_RESOLVED
        second[doubtful] = _arc_cosine(other[doubtful])
        unknown = state >= SlopeState.NO_INTERSECTION
        tilt[unknown] = azimuth[unknown] = np.nan

    def _resolved(
        self, piece: slice, values: FloatArray, vectors: FloatArray
    ) -> Iterator[NDArray[np.float32]]:
        """Each pixel's components in the plane of the sun's motion, what pulls it across, and the misfit.

        Once the ill-conditioned sums are resolved into them, single precision is ample.
        """
        pull, c2, c1 = vectors.T @ self._b[:, piece]
        c1, c2 = c1 / values[2], c2 / values[1]
        left = self._c[piece] - values[2] * c1 * c1 - values[1] * c2 * c2
        return (numbers.astype(np.float32) for numbers in (c1, c2, pull, left))

    def _judge(
        self,
        chosen: NDArray[np.float32],
        other: NDArray[np.float32],
        chi_square: NDArray[np.float32],
        gain: NDArray[np.float32],
        is_alone: NDArray[np.bool_],
        state: NDArray[np.uint8],
    ) -> None:
        """States of lit pixels; `gain` is the misfit of the other branch less the chosen one's."""
        # a misfit beyond what noise explains is itself the measure of how far a difference tells
        telling = NINETY_PERCENT * np.maximum(chi_square, 1.0)
        state[:] = SlopeState.OK
        state[~is_alone & (gain < telling)] = SlopeState.NOT_RESOLVED
        limit = self._limit_cosine
        too_steep = (chosen < limit) | ((other < limit) & (gain < -telling))
        state[too_steep | (chi_square > _alarm(self._freedom))] = SlopeState.NO_INTERSECTION


def _square_sine(cosine: NDArray[np.float32]) -> NDArray[np.float32]:
    """The prior of `choice` adds its logarithm to a misfit; a tenth of a degree and less count alike."""
    return np.asarray(np.maximum(np.float32(1.0) - cosine * cosine, np.float32(3e-6)))


def _arc_cosine(cosine: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.asarray(np.arccos(np.minimum(cosine, np.float32(1.0))) * DEGREES)


def _alarm(freedom: int) -> float:
    """Reduced chi-square beyond which no slope explains a pixel: three times what noise exceeds in 1 %."""
    return 3.0 * (1.0 + 2.33 * float(np.sqrt(2.0 / freedom)))
