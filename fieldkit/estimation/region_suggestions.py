"""Find beds in a frame: even areas with four straight, sharp edges, each as an outline inset from them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np

from fieldkit.estimation.region_check import CameraView, RegionInspection, check_region
from fieldkit.model.arrays import BoolArray, FloatArray, SingleArray
from fieldkit.model.errors import ConfigError, NoAnswerError
from fieldkit.model.next_step import Action
from fieldkit.model.site import Region, RegionKind
from fieldkit.phrases import Words

LEAST_CONTRAST_K = 0.5
CONTRAST_OVER_SPREAD = 3.0
"""A bed differs from what surrounds it by more than this and by this many times its own spread."""
_COLS = 160
"""Larger frames are averaged to about so many columns: noise and time shrink; smaller ones are enlarged."""
_LEVELS = 12  # limits of "little" that are tried
_SMOOTHED_PX = 1.0  # noise of single pixels would tear an even area
_MOST_OF_FRAME, _LEAST_OF_LARGEST = 0.4, 0.25
"""Beds are alike in size: what is far smaller than the largest lies on or beside them."""
_FILLED = 0.88  # of four corners and the area they stand for: what both share over what either covers
_UNDISTURBED = 15.0
"""Per cent of a side that something may lie across."""
_LEAST_PX = 100  # of 160 x 120
_INSET_PX = 1.5  # pixels at an edge see two surfaces; an even area of an enlarged frame ends inside of them
# along a side without its corners, where the neighbouring sides' surroundings begin
_ALONG = np.linspace(0.12, 0.88, 32)
_INSIDE_PX, _OUTSIDE_PX = (-3.0, -2.0, -1.0), (3.0, 4.0, 5.0)
"""Distances from the edge of an even area, which ends up to two pixels before that of its bed."""
_FARTHER = 1.5  # by so much of the pixels of an enlarged frame, which may see both
NEARER = Words("fix.nearer") + ", or draw them: " + Action.ADD_REGION()
FIX = Words("fix.warmed") + ", or draw them: " + Action.ADD_REGION()


Outline = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class FoundBed:
    """An area that looks like a bed.

    `points_px` are its four corners (x, y) in pixels, inset from its edges, `pixels` the number inside;
    `contrast_k` is how much it differs from its surroundings where it differs least, `spread_k` the standard
    deviation inside.
    """

    points_px: Outline
    pixels: int
    contrast_k: float
    spread_k: float

    @property
    def least_contrast_k(self) -> float:
        """By so much it would differ clearly from its surroundings."""
        return max(LEAST_CONTRAST_K, CONTRAST_OVER_SPREAD * self.spread_k)


def find_beds(frame: FloatArray, noise_k: float = math.nan) -> list[FoundBed]:
    """The areas of a frame that look like beds, row by row from the top left.

    Areas are the connected parts in which the temperature changes little from pixel to pixel, at every limit
    of "little": those are kept that nearly fill a quadrilateral and differ from their surroundings all along
    its four sides. Brightness temperatures (rows, cols) are NaN where unknown; `noise_k` as in `CameraView`.
    Raises `NoAnswerError` where there is none that can be used; the message states what is missing.
    """
    if not np.isfinite(frame).any():
        raise NoAnswerError(Words("error.no_temperature"), fix=FIX)
    filled = np.where(np.isfinite(frame), frame, np.nanmedian(frame))
    enlarged, factor = (max(1, round(ratio)) for ratio in (_COLS / frame.shape[1], frame.shape[1] / _COLS))
    image = _working_image(filled, enlarged, factor)
    candidates = [bed for corners in _quadrilaterals(image) if (bed := _measure(corners, image, enlarged))]
    beds = [_in_frame(bed, factor / enlarged) for bed in _apart(candidates, image.shape)]
    checks = [check_region(_region(bed.points_px), CameraView(frame.shape, filled, noise_k)) for bed in beds]
    usable = [
        replace(bed, pixels=check.pixels, spread_k=check.spread_k)
        for bed, check in zip(beds, checks, strict=True)
        if check.level == "ok"
    ]
    if not usable:
        raise NoAnswerError(_missing(candidates, checks), fix=NEARER if checks else FIX)
    largest = max(bed.pixels for bed in usable)
    large = [bed for bed in usable if bed.pixels >= _LEAST_OF_LARGEST * largest]
    return sorted(large, key=lambda bed: _row_by_row(bed, frame.shape[0]))


def _working_image(frame: FloatArray, enlarged: int, factor: int) -> SingleArray:
    """The frame at its working size, without single wrong pixels."""
    size = frame.shape[1] * enlarged // factor, frame.shape[0] * enlarged // factor
    how = cv2.INTER_LINEAR if enlarged > 1 else cv2.INTER_AREA
    resized = cv2.resize(frame.astype(np.float32), size, interpolation=how)
    return np.asarray(cv2.medianBlur(resized, 3), np.float32)


def _quadrilaterals(image: SingleArray) -> Iterator[FloatArray]:
    """Corners (4, 2) of the even areas that fill a quadrilateral."""
    smooth = cv2.GaussianBlur(image, (0, 0), _SMOOTHED_PX)
    # Sobel's weights add up to 8: an eighth is kelvin per pixel
    gradient = np.hypot(cv2.Sobel(smooth, -1, 1, 0, scale=0.125), cv2.Sobel(smooth, -1, 0, 1, scale=0.125))
    low, high = np.maximum(np.percentile(gradient, (20.0, 98.0)), (1e-3, 2e-3))
    for level in np.geomspace(low, high, _LEVELS):
        for area in _areas(gradient < level):
            if (corners := _corners(area)) is not None:
                inside = _region(corners).mask(area.shape)
                if (inside & area).sum() >= _FILLED * (inside | area).sum():
                    yield corners


def _areas(even: BoolArray) -> Iterator[BoolArray]:
    """The connected parts that could be a bed: not too small or large, and away from the frame's edge."""
    _, labels, statistics, _ = cv2.connectedComponentsWithStats(even.astype(np.uint8), connectivity=4)
    rows, cols = even.shape
    for number, (x, y, width, height, pixels) in enumerate(statistics[1:], start=1):
        is_inside = min(x, y) >= 2 and x + width <= cols - 2 and y + height <= rows - 2
        if is_inside and width * height >= pixels >= _LEAST_PX and pixels <= _MOST_OF_FRAME * even.size:
            yield labels == number


def _corners(area: BoolArray) -> FloatArray | None:
    """The hull of an area reduced to four corners; None where fewer are left."""
    contours, _ = cv2.findContours(area.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    hull = cv2.convexHull(max(contours, key=cv2.contourArea))
    length = cv2.arcLength(hull, closed=True)
    for share in np.linspace(0.01, 0.12, 23):
        corners = cv2.approxPolyDP(hull, share * length, closed=True)[:, 0]
        if len(corners) <= 4:
            return corners.astype(np.float64) if len(corners) == 4 else None
    return None


def _measure(corners: FloatArray, image: SingleArray, enlarged: int) -> FoundBed | None:
    """The inset outline with its contrast and spread; None where nothing is left inside."""
    try:
        region = _region(corners).shrunk(_INSET_PX if enlarged == 1 else 0.0)
    except ConfigError:
        return None
    inside = image[region.mask((image.shape[0], image.shape[1]))]
    if inside.size < _LEAST_PX:
        return None
    contrast_k = _contrast_k(corners, image, _FARTHER * (enlarged - 1))
    return FoundBed(region.points_px, inside.size, contrast_k, float(inside.std()))


def _contrast_k(corners: FloatArray, image: SingleArray, farther: float) -> float:
    """Difference across the least distinct side, but for the part of it that something may lie across."""
    along = np.roll(corners, -1, axis=0) - corners
    outwards = along[:, ::-1] * (1.0, -1.0) / np.linalg.norm(along, axis=1, keepdims=True)
    outwards *= np.sign(np.sum(outwards * (corners - corners.mean(axis=0)), axis=1, keepdims=True))
    places = corners[:, np.newaxis] + _ALONG[:, np.newaxis] * along[:, np.newaxis]
    ends = np.array(_INSIDE_PX), np.array(_OUTSIDE_PX) + farther
    inside, outside = (_means(places, outwards, steps, image) for steps in ends)
    return float(np.percentile(np.abs(outside - inside), _UNDISTURBED, axis=1).min())


def _means(places: FloatArray, outwards: FloatArray, steps: FloatArray, image: SingleArray) -> FloatArray:
    """Means over steps outwards from places along the sides, (4, n, 2); shape (4, n)."""
    at = places + np.multiply.outer(steps, outwards)[:, :, np.newaxis]
    x, y = np.moveaxis(at, -1, 0).astype(np.float32).reshape(2, len(steps), -1)
    values = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values.mean(axis=0, dtype=np.float64).reshape(places.shape[:2]))


def _apart(beds: list[FoundBed], shape: tuple[int, ...]) -> list[FoundBed]:
    """The distinct ones, and of those that share pixels the largest."""
    covered, separate = np.zeros(shape, np.bool_), []
    for bed in sorted(beds, key=lambda bed: -bed.pixels):
        inside = _region(bed.points_px).mask((shape[0], shape[1]))
        if bed.contrast_k >= bed.least_contrast_k and not (inside & covered).any():
            covered |= inside
            separate.append(bed)
    return separate


def _in_frame(bed: FoundBed, factor: float) -> FoundBed:
    """A bed of the working size in pixels of the frame, whose centres are at whole numbers."""
    corners = [((x + 0.5) * factor - 0.5, (y + 0.5) * factor - 0.5) for x, y in bed.points_px]
    return replace(bed, points_px=tuple((round(x, 1), round(y, 1)) for x, y in corners))


def _row_by_row(bed: FoundBed, rows: int) -> tuple[int, float]:
    """Its place in reading order: beds side by side are rarely at one height to the pixel."""
    x, y = np.mean(bed.points_px, axis=0)
    return round(4.0 * float(y) / rows), float(x)


def _region(corners: FloatArray | Outline) -> Region:
    return Region("bed", RegionKind.TARGET, tuple((float(x), float(y)) for x, y in corners))


def _missing(candidates: list[FoundBed], checks: list[RegionInspection]) -> str:
    if not candidates:
        return Words("error.no_area")
    if checks:
        largest = max(checks, key=lambda check: check.pixels)
        return Words("error.largest_area", pixels=largest.pixels, why=largest.issues)
    best = max(candidates, key=lambda bed: bed.contrast_k)
    return Words("error.indistinct", kelvin=f"{best.contrast_k:.1f}", needed=f"{best.least_contrast_k:.1f}")
