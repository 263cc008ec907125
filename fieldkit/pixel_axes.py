"""Axes and a grid in camera pixels around an enlarged image, so that region corners can be read off it.

Shared by all images from which regions are drawn: exports, ``live --png``, maps, the report. Coordinates as
in `fieldkit.model.site.Region`: pixel centres at whole numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]

LEFT_PX, BELOW_PX = 46, 46
"""Margins with the labels, in pixels of the enlarged image."""
_STEPS = (5, 10, 20, 50, 100, 200, 500)
_MOST_TICKS = 8
_INK, _PAPER, _FAINT = 0, 255, 0.35


def ticks(length: int) -> list[int]:
    """Labelled whole pixels of an axis of `length` pixels: at most eight, from 0."""
    step = next((step for step in _STEPS if length <= step * _MOST_TICKS), length)
    return list(range(0, length, step))


def with_axes(image: Image, factor: int) -> Image:
    """The image (rows * factor, cols * factor, 3) with a faint grid, and labels on the left and below.

    The caption gives the size of the original and the enlargement.
    """
    rows, cols = image.shape[0] // factor, image.shape[1] // factor
    framed = np.full((image.shape[0] + BELOW_PX, image.shape[1] + LEFT_PX, 3), _PAPER, np.uint8)
    framed[: image.shape[0], LEFT_PX:] = _with_grid(image, factor, ticks(rows), ticks(cols))
    for y in ticks(rows):
        _write(framed, f"{y}", LEFT_PX - 6, _centre(y, factor) + 5, align=1.0)
    for x in ticks(cols):
        _write(framed, f"{x}", LEFT_PX + _centre(x, factor), image.shape[0] + 16, align=0.5)
    note = f"camera pixels x, y of {cols} x {rows}" + (f"; enlarged {factor} times" if factor > 1 else "")
    _write(framed, note, LEFT_PX, image.shape[0] + 38, align=0.0)
    return framed


def _with_grid(image: Image, factor: int, rows: list[int], cols: list[int]) -> Image:
    """Lines through the centres of the labelled pixels, faint enough to see the image below."""
    grid = image.astype(np.float64)
    lines = np.zeros(image.shape[:2], np.bool_)
    lines[[_centre(y, factor) for y in rows]] = True
    lines[:, [_centre(x, factor) for x in cols]] = True
    grid[lines] += _FAINT * (_PAPER - grid[lines])
    return grid.astype(np.uint8)


def _centre(pixel: int, factor: int) -> int:
    return pixel * factor + factor // 2


def _write(image: Image, text: str, x: int, y: int, *, align: float) -> None:
    """Text at (x, y); `align` 0 begins there, 1 ends there."""
    import cv2

    font, size = cv2.FONT_HERSHEY_SIMPLEX, 0.45
    width = cv2.getTextSize(text, font, size, 1)[0][0]
    place = (round(x - align * width), y)
    cv2.putText(image, text, place, font, size, (_INK, _INK, _INK), thickness=1, lineType=cv2.LINE_AA)
