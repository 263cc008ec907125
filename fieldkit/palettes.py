"""Colours of temperatures: one table for images, videos and the field page."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:  # a command that only names palettes would wait for it
    import numpy as np
    from numpy.typing import NDArray

Colours: TypeAlias = "NDArray[np.uint8]"

INFERNO = "inferno"
STOPS = {
    "ironbow": "00000a 1c0065 6b0096 b8187c e4572e f99d10 fddc5c fffff6",
    "white-hot": "000000 ffffff",
    "black-hot": "ffffff 000000",
    "cividis": "00224e 002d68 163770 2e416d 3f4c6c 4e566c 5c616e 696b71 767676 838179 928c78 a09875 "
    "afa471 bfb06b cfbd62 dfca57 f0d846 fee838",
}
"""Colours in hexadecimal, in even steps from cold to hot.

cividis looks alike to the colour-blind: every 15th colour of Nunez, Anderton and Renslow, PLoS ONE 13,
e0199239 (2018).
"""
NAMES = (INFERNO, *STOPS)
"""What `palette` takes; the first is the default."""


@cache
def palette(name: str = INFERNO) -> Colours:
    """256 colours from cold to hot, red-green-blue, shape (256, 3); inferno has even perceived steps."""
    return _inferno() if name == INFERNO else _ramp(STOPS[name])


def bgr(name: str) -> Colours:
    """The same colours as OpenCV wants them, blue-green-red."""
    import numpy as np

    return np.ascontiguousarray(palette(name)[:, ::-1])


def _inferno() -> Colours:
    import cv2
    import numpy as np

    ramp = np.arange(256, dtype=np.uint8).reshape(-1, 1)
    colours: Colours = np.ascontiguousarray(cv2.applyColorMap(ramp, cv2.COLORMAP_INFERNO)[:, 0, ::-1])
    return colours


def _ramp(stops: str) -> Colours:
    import numpy as np

    channels = np.array([list(bytes.fromhex(stop)) for stop in stops.split()], np.float64)
    places, at = np.linspace(0.0, 1.0, 256), np.linspace(0.0, 1.0, len(channels))
    colours: Colours = np.rint(
        np.column_stack([np.interp(places, at, channel) for channel in channels.T])
    ).astype(np.uint8)
    return colours
