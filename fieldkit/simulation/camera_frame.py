"""Effects of a thermal camera on the frame: soft edges, fixed pattern, drift, noise, shutter corrections.

Temperatures in, temperatures out; the driver of a simulated camera packs them into bytes. A shutter
correction (FFC) leaves a new small level error and a new fine pattern; between corrections the level drifts.
Everything follows from the seed and the numbers of correction and frame, so a frame can be drawn again at
any time.

A camera may also move: it drifts, pans, shakes and is kicked, and what lies before it stays. Over level
ground that it looks straight down on, `Motion.homography` is that of a camera that is displaced and then
turned.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.ndimage import gaussian_filter

from fieldkit.model.arrays import FloatArray, SingleArray
from fieldkit.simulation.facets import FRAME_SHAPE, Facet, pixel_shares

_NOISE_K = 0.045  # the maker's "below 50 mK"
_PATTERN_K = 0.04  # left by each correction, pixel by pixel
_SHADING_K = 0.05  # over the whole frame, never corrected
_TEXTURE_K = 0.25  # grains, footprints: the temperature of the ground is not uniform
_BED_TEXTURE = 0.3  # share of it that remains on a raked bed
_LEVEL_K = 0.08  # level error after a correction
_DRIFT_K_S = 0.0006  # drift of the level, about 0.1 K in three minutes


@dataclass(frozen=True, slots=True)
class Correction:
    """The last shutter correction before a frame: its number, when it ended, and an added level error."""

    number: int = 0
    ended_ns: int = 0
    step_k: float = 0.0


FOCAL_PX = 147.0
"""Focal length of 160 pixels over 57 degrees, the FLIR Lepton's field of view (datasheet 500-0726-01)."""


@dataclass(frozen=True, slots=True)
class Motion:
    """Movement of a camera over a scene, from none at its start.

    `drift_px` (content right and down) and `pan_deg` (a turn to the left, content to the right) are reached
    at the end and grow evenly. `jitter_px` is the largest shift of single frames, in x and in y; every one up
    to it is as likely. `jump_px` shifts content right and down from a share `jump_at` of the scene's duration
    on.
    """

    drift_px: tuple[float, float] = (0.0, 0.0)
    pan_deg: float = 0.0
    jitter_px: float = 0.0
    jump_px: tuple[float, float] = (0.0, 0.0)
    jump_at: float = 0.5

    def homography(self, share: float, random: np.random.Generator) -> FloatArray:
        """Place of content that was at x, y, 1 at the start, (3, 3), after a share of the scene."""
        import cv2

        shift = share * np.asarray(self.drift_px) + self.jitter_px * random.uniform(-1.0, 1.0, 2)
        if share >= self.jump_at:
            shift = shift + self.jump_px
        turn = cv2.Rodrigues(np.array([0.0, np.radians(share * self.pan_deg), 0.0]))[0]
        centre = np.array([[FOCAL_PX, 0.0, 79.5], [0.0, FOCAL_PX, 59.5], [0.0, 0.0, 1.0]])
        translation = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]], [0.0, 0.0, 1.0]])
        return np.asarray(centre @ turn @ np.linalg.inv(centre) @ translation)


class CameraModel:
    """Draws frames of these facets; `seed` fixes the camera's own errors.

    Where `is_raked`, the ground is as smooth as a bed: its relief is in its temperatures.
    """

    def __init__(self, facets: Sequence[Facet], seed: int, *, is_raked: bool = False) -> None:
        self._seed, self._ground_texture = seed, _BED_TEXTURE if is_raked else 1.0
        self._shares = pixel_shares(facets)
        self._still, self._texture = self._static_pattern()
        self._pattern = lru_cache(maxsize=4)(self._draw_pattern)

    def draw(
        self,
        brightness_k: FloatArray,
        time_ns: int,
        number: int,
        correction: Correction,
        homography: FloatArray | None = None,
        ground_k: SingleArray | None = None,
    ) -> SingleArray:
        """Frame `number` of facets and ground at these brightness temperatures (k + 1,), in K.

        Ground in relief has one in every pixel, `ground_k` (pixels,). `homography` (3, 3) is where content
        lies once the camera has moved; its own errors stay.
        """
        pattern, level_k, drift_k_s = self._pattern(correction.number)
        age_s = (time_ns - correction.ended_ns) * 1e-9
        level = np.float32(level_k + drift_k_s * age_s + correction.step_k)
        noise = np.random.Generator(np.random.SFC64([self._seed, number, 1]))
        frame = brightness_k.astype(np.float32) @ self._shares
        if ground_k is not None:
            frame += self._shares[-1] * (ground_k - np.float32(brightness_k[-1]))
        if homography is not None:
            frame = warp((frame + self._texture).reshape(FRAME_SHAPE), homography).ravel() - self._texture
        frame += self._still
        frame += pattern
        frame += level
        frame += np.float32(_NOISE_K) * noise.standard_normal(frame.size, dtype=np.float32)
        return frame.reshape(FRAME_SHAPE)

    def _static_pattern(self) -> tuple[SingleArray, SingleArray]:
        """The constant part, shading of the lens and texture of the ground; and the latter alone."""
        random = np.random.default_rng([self._seed, 2])
        shading = _unit(gaussian_filter(random.standard_normal(FRAME_SHAPE), 40.0, mode="nearest"))
        texture = _unit(gaussian_filter(random.standard_normal(FRAME_SHAPE), 3.0, mode="nearest"))
        of_ground = self._shares[-1].reshape(FRAME_SHAPE)
        roughness = self._ground_texture * of_ground + _BED_TEXTURE * (1.0 - of_ground)
        ground = _TEXTURE_K * roughness * texture
        still: SingleArray = (_SHADING_K * shading + ground).astype(np.float32)
        return still.ravel(), ground.astype(np.float32).ravel()

    def _draw_pattern(self, correction: int) -> tuple[SingleArray, float, float]:
        """Fine pattern (pixels,), level error [K] and drift [K/s] after a correction."""
        random = np.random.default_rng([self._seed, correction, 3])
        pattern = np.float32(_PATTERN_K) * random.standard_normal(self._texture.size, dtype=np.float32)
        level, drift = random.standard_normal(2)
        return pattern, _LEVEL_K * float(level), _DRIFT_K_S * float(drift)


def warp(scene_k: SingleArray, homography: FloatArray) -> SingleArray:
    """A frame (rows, cols) as a camera sees it that has moved; beyond its edge the ground is mirrored."""
    import cv2

    size = scene_k.shape[1], scene_k.shape[0]
    warped = cv2.warpPerspective(
        scene_k, homography, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101
    )
    return np.asarray(warped, np.float32)


def _unit(field: FloatArray) -> FloatArray:
    """The field with mean 0 and standard deviation 1."""
    centred: FloatArray = field - field.mean()
    return np.asarray(centred / centred.std())
