"""Cameras people own, as models: their identity, formats, metadata and commands.

A model is fed by `Kelvin`: a function from seconds (since the camera was made) to the
brightness temperatures in kelvin, shape (rows, cols) of the sensor. The layouts are public
facts about the products; the descriptors are ours, shaped like theirs.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fieldkit.model.arrays import CountArray, FloatArray

Kelvin = Callable[[float], FloatArray]


def luma(kelvin: FloatArray) -> CountArray:
    """White-hot YUYV words: brightness in the low byte, no colour (128) in the high byte."""
    low, high = float(kelvin.min()), float(kelvin.max())
    bright = (kelvin - low) * (255.0 / max(high - low, 1e-6))
    return bright.astype(np.uint16) | np.uint16(128 << 8)
