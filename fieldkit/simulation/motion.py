"""Motion of a simulated camera: it drifts, pans, shakes and is kicked; what lies before it stays.

Over level ground that it looks straight down on, `homography` is that of a camera that is displaced and then
turned.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fieldkit.model.arrays import FloatArray

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
