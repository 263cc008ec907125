"""From the counts of a frame to an image: values, colour scale, colours, outlines.

Shared by the screen, ``fieldkit live --png`` and the report. Pixel coordinates as in
`fieldkit.model.site.Region`: x to the right, y down, pixel centres at whole numbers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fieldkit.model.arrays import BoolArray, FloatArray
from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import Frame
from fieldkit.model.site import Region
from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.palettes import INFERNO, Colours, palette
from fieldkit.physics.camera_laws import frame_k, has_temperatures
from fieldkit.pixel_axes import WHITE, Colour, label, letters, outline, with_axes

PNG_WIDTH = 960
OUTLINE = (0, 215, 215)
HOLE = (110, 110, 110)
"""Colour of region outlines, which does not occur in the palette."""


@dataclass(frozen=True, slots=True)
class Scale:
    """The values of the first and the last colour."""

    low: float
    high: float
    unit: str  # "°C", or "counts" if the camera's temperatures are unknown

    def position(self, values: FloatArray) -> FloatArray:
        """Position of `values` between first (0) and last colour (1), clipped."""
        return np.clip((values - self.low) / (self.high - self.low), 0.0, 1.0)

    def text(self, value: float) -> str:
        """A value of the scale with its unit."""
        return f"{value:.0f} {self.unit}"


def values(frame: Frame, info: StreamInfo) -> FloatArray:
    """Brightness temperature in °C, shape of the frame; its counts if they have no known temperature."""
    if unit(info) == "counts":
        return frame.counts.astype(np.float64)
    return frame_k(info, frame.counts, frame.metadata_rows) - CELSIUS_ZERO_K


def unit(info: StreamInfo) -> str:
    """Unit of `values`: ``°C`` or ``counts``."""
    return "°C" if has_temperatures(info) and info.unit == "K" else "counts"


def scale_of(shown: FloatArray, unit: str) -> Scale:
    """A scale from the 1st to the 99th percentile, rounded outwards to whole units.

    Whole units keep the colours stable from one frame to the next.
    """
    finite = shown[np.isfinite(shown)]
    low, high = np.percentile(finite if finite.size else 0.0, (1.0, 99.0))
    low, high = math.floor(low), math.ceil(high)
    return Scale(low, max(high, low + 2), unit)


def colours(shown: FloatArray, scale: Scale, name: str = INFERNO) -> Colours:
    """The frame in the colours of a palette, shape (rows, cols, 3), red-green-blue; else `HOLE`."""
    image: Colours = palette(name)[np.rint(np.nan_to_num(scale.position(shown)) * 255).astype(np.intp)]
    image[np.isnan(shown)] = HOLE
    return image


def resize(shown: FloatArray, rows: int, cols: int) -> FloatArray:
    """`shown` on another grid: pixel means when smaller, repeated pixels when larger."""
    import cv2

    smaller = rows <= shown.shape[0]
    how = cv2.INTER_AREA if smaller else cv2.INTER_NEAREST
    return np.asarray(cv2.resize(shown, (cols, rows), interpolation=how), np.float64)


def on_grid(region: Region, shape: tuple[int, ...], rows: int, cols: int) -> FloatArray:
    """Vertices of a region of a frame of `shape` on a grid of (rows, cols), shape (n, 2) of (x, y)."""
    factor = np.array([cols / shape[1], rows / shape[0]])
    on_grid: FloatArray = (np.array(region.points_px, np.float64) + 0.5) * factor - 0.5
    return on_grid


def outline_mask(region: Region, shape: tuple[int, int], rows: int, cols: int) -> BoolArray:
    """Cells of a grid of (rows, cols) that the outline of a region passes through."""
    import cv2

    mask = np.zeros((rows, cols), np.uint8)
    points = np.rint(on_grid(region, shape, rows, cols)).astype(np.int32)
    cv2.polylines(mask, [points], isClosed=True, color=1)
    return mask.astype(np.bool_)


def mark_region(
    image: Colours, region: Region, shape: tuple[int, ...], size: float, colour: Colour = WHITE
) -> None:
    """Draw outline and name of a region into the enlarged image of a frame of `shape`."""
    corners = np.rint(on_grid(region, shape, image.shape[0], image.shape[1]))
    outline(image, corners, colour)
    label(image, region.name, int(corners[:, 0].mean()), int(corners[:, 1].mean()), size, centred=True)


def enlargement(shape: tuple[int, ...], width: int = PNG_WIDTH) -> int:
    """The factor by which a frame of `shape` (rows, cols) is enlarged to come close to `width`."""
    return max(1, round(width / shape[1]))


def png(frame: Frame, info: StreamInfo, regions: Sequence[Region] = (), *, width: int = PNG_WIDTH) -> bytes:
    """A PNG file: the frame enlarged close to `width`, axes in camera pixels, outlines, names, scale."""
    pixels = values(frame, info)
    scale = scale_of(pixels, unit(info))
    factor = enlargement(pixels.shape, width)
    rows, cols = pixels.shape[0] * factor, pixels.shape[1] * factor
    canvas = colours(resize(pixels, rows, cols), scale)
    for region in regions:
        mark_region(canvas, region, pixels.shape, 0.8, OUTLINE)
    page = with_axes(canvas, factor)
    return png_file(np.hstack((page, _scale_bar(page.shape[0], scale))))


def bare_png(frame: Frame, info: StreamInfo, scale: Scale) -> bytes:
    """A PNG file of the frame alone, at its own resolution, for pages that draw the outlines."""
    return png_file(colours(values(frame, info), scale))


def png_file(image: Colours) -> bytes:
    """A PNG file of an image, red-green-blue."""
    import cv2

    ok, data = cv2.imencode(".png", image[:, :, ::-1])
    assert ok
    return data.tobytes()


def _scale_bar(rows: int, scale: Scale) -> Colours:
    """Colours from top (high) to bottom (low) with the values of both ends, 110 pixels wide."""
    bar = np.full((rows, 110, 3), 255, np.uint8)
    bar[:, 10:30] = palette()[np.linspace(255, 0, rows).astype(np.intp)][:, None]
    for value, y in ((scale.high, 20), ((scale.low + scale.high) / 2, rows // 2 + 6), (scale.low, rows - 8)):
        letters(bar, scale.text(value).replace("°", " "), 36, y, 0.6)
    return bar
