"""Axes and a grid in camera pixels around an enlarged image, outlines and letters in it.

Shared by all images from which regions are drawn: exports, ``live --png``, maps, the report. Coordinates as
in `fieldkit.model.site.Region`: pixel centres at whole numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]

LEFT_PX, BELOW_PX = 46, 46
"""Margins with the labels, in pixels of the enlarged image."""
Colour = tuple[int, int, int]
BLACK, WHITE = (0, 0, 0), (255, 255, 255)
_STEPS = (5, 10, 20, 50, 100, 200, 500)
_MOST_TICKS = 8
_PAPER, _FAINT = 255, 0.35


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
        letters(framed, f"{y}", LEFT_PX - 6, _centre(y, factor) + 5, 0.45, align=1.0)
    for x in ticks(cols):
        letters(framed, f"{x}", LEFT_PX + _centre(x, factor), image.shape[0] + 16, 0.45, align=0.5)
    note = f"camera pixels x, y of {cols} x {rows}" + (f"; enlarged {factor} times" if factor > 1 else "")
    letters(framed, note, LEFT_PX, image.shape[0] + 38, 0.45, align=0.0)
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


# --- letters and outlines of all images; the built-in font is ASCII only


def letters(
    image: Image, text: str, x: int, y: int, size: float = 0.55, colour: Colour = BLACK, align: float = 0.0
) -> None:
    """Draw a text whose base line begins at (x, y); with `align` 1 it ends there."""
    import cv2

    plain, font = text.encode("ascii", "replace").decode(), cv2.FONT_HERSHEY_SIMPLEX
    left = round(x - align * cv2.getTextSize(plain, font, size, 1)[0][0])
    cv2.putText(image, plain, (left, y), font, size, colour, thickness=1, lineType=cv2.LINE_AA)


def label(
    image: Image, text: str, x: int, y: int, size: float, *, margin: int = 5, centred: bool = False
) -> None:
    """White letters on black, which show on any colour, from (x, y) on or `centred` there."""
    import cv2

    plain = text.encode("ascii", "replace").decode()
    (width, height), below = cv2.getTextSize(plain, cv2.FONT_HERSHEY_SIMPLEX, size, 1)
    if centred:
        x, y = x - width // 2, y + height // 2
    box = (x - margin, y - height - margin), (x + width + margin, y + below)
    cv2.rectangle(image, *box, BLACK, cv2.FILLED)
    letters(image, plain, x, y, size, WHITE)


def outline(image: Image, corners: NDArray[np.float64], colour: Colour = WHITE, thickness: int = 2) -> None:
    """Draw a polygon of corners (n, 2) in pixels of the image, with black on both sides of its line."""
    import cv2

    points = np.rint(corners).astype(np.int32)
    for ink, width in ((BLACK, 2 * thickness + 1), (colour, thickness)):
        cv2.polylines(image, [points], True, ink, width, cv2.LINE_AA)
