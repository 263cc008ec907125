"""Whether the camera still looks where it looked: the shift of the picture's edges.

Beds warm and cool through the day, but their edges stay. The phase of the edges' Fourier
transforms gives the shift of one picture against the first, whatever the contrast.
C. D. Kuglin and D. C. Hines, "The phase correlation image alignment method", 1975.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Spectrum = NDArray[np.complexfloating[Any, Any]]

MOVED_PX = 1.5
_CLEAR_PEAK = 8.0
"""How far the correlation peak must stand out of its surroundings, in standard deviations."""


class PictureWatch:
    """Compares one picture a minute with the first."""

    def __init__(self) -> None:
        self._first: Spectrum | None = None
        self._before = 0.0
        self.shift_px = 0.0

    def add(self, counts: NDArray[np.uint16]) -> bool:
        """Whether the picture has moved: by more than 1.5 pixels in this minute and the one before."""
        spectrum = np.fft.rfft2(_edges(counts))
        if self._first is None:
            self._first = spectrum
            return False
        self._before, self.shift_px = self.shift_px, _shift(self._first, spectrum, counts.shape)
        return min(self._before, self.shift_px) > MOVED_PX


def _edges(counts: NDArray[np.uint16]) -> NDArray[np.float32]:
    """Steepness of the picture, faded out towards its border (else the border itself is matched).

    In single precision: a shift of a pixel needs no more, and costs a third.
    """
    down, right = np.gradient(counts.astype(np.float32))
    steepness = np.sqrt(np.sqrt(down * down + right * right))
    return np.asarray((steepness - steepness.mean()) * _fade(*counts.shape))


@lru_cache(maxsize=4)
def _fade(rows: int, cols: int) -> NDArray[np.float32]:
    return np.outer(np.hanning(rows), np.hanning(cols)).astype(np.float32)


def _shift(
    first: NDArray[np.complexfloating[Any, Any]],
    now: NDArray[np.complexfloating[Any, Any]],
    shape: tuple[int, ...],
) -> float:
    """Length of the shift in pixels; 0 where the pictures have no edges in common that stand out."""
    cross = first.conj() * now
    # weighted by its size to half power: pure phase would listen to noise where there are no edges
    surface = np.fft.irfft2(cross / np.sqrt(np.abs(cross) + 1e-30), s=(shape[0], shape[1]))
    peak = np.unravel_index(int(np.argmax(surface)), surface.shape)
    if surface[peak] < surface.mean() + _CLEAR_PEAK * surface.std():
        return 0.0
    return float(np.hypot(_centred(surface, peak, 0), _centred(surface, peak, 1)))


def _centred(surface: NDArray[np.floating[Any]], peak: tuple[np.intp, ...], axis: int) -> float:
    """Peak position along an axis, refined by a parabola, as a signed shift."""
    size = surface.shape[axis]
    line = np.take(surface, int(peak[1 - axis]), axis=1 - axis)
    at = int(peak[axis])
    left, middle, right = line[at - 1], line[at], line[(at + 1) % size]
    bend = left - 2.0 * middle + right
    offset = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    return float((at + offset + size / 2.0) % size - size / 2.0)
