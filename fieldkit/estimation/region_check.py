"""Check that a region can be measured: large enough, in the frame, apart from others, of one temperature."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from fieldkit.model.arrays import BoolArray, FloatArray
from fieldkit.model.site import Region
from fieldkit.phrases import Words

INNER_PX = 3
"""Rows and columns of pixels that must lie clear of a region's rim."""
MOST_NOISE_K = 0.1
"""Of the mean of a region's pixels over a minute."""
MOST_OF_FRAME = 0.9
"""A region that covers more of the frame than this sees more than one bed."""
COLS_OF_ONE = 160
"""Frames of fewer have pixels wider than a lens's blur: one at an edge sees two surfaces, else two do."""
MOST_SPREAD_K = 2.0
"""A larger standard deviation inside is a warning: beds of sand have a tenth of a kelvin."""
UNEVEN_EDGE_K = 1.0
CLEAN_EDGE_K = 0.2
"""A larger edge difference is a warning; shrinking should bring it below the smaller value."""
MOST_SHRUNK_PX = 10  # an edge that is uneven farther in is no edge, but the bed
LARGEST_PX = 4096
"""Rows and columns of a frame whose size is not known: no thermal camera has more, and masks take memory."""
Level = Literal["ok", "warn", "FAIL"]


@dataclass(frozen=True, slots=True)
class CameraView:
    """What is known of a camera's frames.

    `shape` is (rows, cols), `frame` one in kelvin, `noise_k` that of a pixel in the mean of a minute, NaN if
    not known.
    """

    shape: tuple[int, ...]
    frame: FloatArray | None = None
    noise_k: float = math.nan


def pixel_noise_k(frames: FloatArray) -> float:
    """Noise of a pixel in one of successive frames (n, rows, cols), from their differences, K; NaN of one.

    The median of the pixels' own, so that neither a shift of all nor what moves through the frame counts.
    """
    if len(frames) < 2:
        return math.nan
    changes = np.diff(frames, axis=0)
    changes -= np.nanmedian(changes, axis=(1, 2), keepdims=True)
    return float(np.sqrt(np.nanmedian(np.mean(changes**2, axis=0)) / 2.0))


def rim_px(cols: int) -> int:
    """Width of the rim of a region in frames of so many columns: pixels there may see two surfaces."""
    return 1 if cols < COLS_OF_ONE else 2


@dataclass
class RegionInspection:
    """The result of checking one region; `spread_k` and `edge_k` are NaN without a frame.

    `edge_k` is how much the pixels of its rim differ from the inside, in kelvin; `shrink_px` by how many
    pixels to move the edges inwards so that they differ no more, None where that is not needed or no remedy.
    """

    region: Region
    pixels: int
    spread_k: float = math.nan
    edge_k: float = math.nan
    failures: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    shrink_px: int | None = None

    @property
    def issues(self) -> list[str]:
        """All issues in words."""
        return self.failures + self.warnings

    @property
    def named_failures(self) -> list[str]:
        """The failures, each with the region's name."""
        return [Words("text.of", what=self.region.name, text=failure) for failure in self.failures]

    @property
    def level(self) -> Level:
        """The worst level of all issues."""
        return "FAIL" if self.failures else "warn" if self.warnings else "ok"

    def row(self) -> tuple[str, ...]:
        """One line of the table."""
        spread = "-" if math.isnan(self.spread_k) else f"{self.spread_k:.2f} K"
        verdict = f"{self.level}: {'; '.join(self.issues)}" if self.issues else "ok"
        return self.region.name, slope_text(self.region), f"{self.pixels} px", spread, verdict

    def document(self) -> dict[str, Any]:
        """The result as a JSON object."""
        return {
            "name": self.region.name,
            "pixels": self.pixels,
            "spread_k": self.spread_k,
            "edge_k": self.edge_k,
            "level": self.level,
            "remarks": self.issues,
        }


def slope_text(region: Region) -> str:
    """``15/180``, ``15`` where the azimuth is not known, or a dash."""
    angles = [f"{angle:g}" for angle in (region.tilt_deg, region.azimuth_deg) if not math.isnan(angle)]
    return "-" if math.isnan(region.tilt_deg) else "/".join(angles)


def check_regions(regions: Sequence[Region], views: Mapping[str, CameraView]) -> list[RegionInspection]:
    """Check each region in the frames of its camera, by the camera's name.

    Without a view the regions are only checked against each other.
    """
    return [
        check_region(
            region,
            views.get(region.camera),
            [other for other in regions[:number] if other.camera == region.camera],
        )
        for number, region in enumerate(regions)
    ]


def check_region(region: Region, view: CameraView | None, others: Sequence[Region] = ()) -> RegionInspection:
    """Check one region in the frames of its camera, as fast as a finger draws it.

    The region must share no pixel with `others`. Without a view its place in the frame is not checked.
    """
    rows, cols = view.shape if view else _around(region)
    box = region.box((rows, cols))
    mask = region.mask((rows, cols), box)
    inspection = RegionInspection(region, int(mask.sum()))
    _check_size(inspection, mask, (rows, cols), view)
    for other in others:
        if shared := int((mask & other.mask((rows, cols), box)).sum()):
            inspection.failures.append(Words("issue.region.shared", pixels=shared, region=other.name))
    if view and inspection.pixels > MOST_OF_FRAME * rows * cols:
        percent = round(100.0 * inspection.pixels / (rows * cols))
        inspection.warnings.append(Words("issue.region.whole_frame", percent=percent))
    if view and view.frame is not None and (seen := mask & np.isfinite(view.frame[box])).any():
        if holes := int(mask.sum() - seen.sum()):
            inspection.warnings.append(Words("issue.region.no_value", pixels=holes))
        _check_evenness(inspection, seen, view.frame[box], view.frame)
    return inspection


def _around(region: Region) -> tuple[int, int]:
    """A frame large enough for a region, if any camera's is."""
    xs, ys = zip(*region.points_px, strict=True)
    return min(math.ceil(max(ys)) + 1, LARGEST_PX), min(math.ceil(max(xs)) + 1, LARGEST_PX)


def _check_size(
    inspection: RegionInspection, mask: BoolArray, shape: tuple[int, int], view: CameraView | None
) -> None:
    rim, noise_k = rim_px(shape[1]) if view else 1, view.noise_k if view else math.nan
    if not inspection.region.is_within(shape):
        inspection.failures.append(Words("issue.region.outside", cols=shape[1], rows=shape[0]))
    elif not _has_inside(mask, rim):
        sides = {"inner": INNER_PX, "rim": rim, "side": INNER_PX + 2 * rim}
        inspection.failures.append(Words("issue.region.small", **sides))
    elif noise_k > MOST_NOISE_K * math.sqrt(inspection.pixels):
        needed = math.ceil((noise_k / MOST_NOISE_K) ** 2)
        inspection.failures.append(Words("issue.region.noise", kelvin=MOST_NOISE_K, pixels=needed))
    if inspection.region.crosses_itself:
        inspection.failures.append(Words("issue.region.crosses"))


def _has_inside(mask: BoolArray, rim: int) -> bool:
    """Whether `INNER_PX` rows and columns of pixels lie so many pixels inside the rim."""
    import cv2  # takes longer to import than every light command takes

    around = np.ones((INNER_PX + 2 * rim,) * 2, np.uint8)
    whole = np.pad(mask, 1).astype(np.uint8)
    return bool(cv2.erode(whole, around, borderType=cv2.BORDER_CONSTANT, borderValue=0).any())


def _check_evenness(
    inspection: RegionInspection, mask: BoolArray, around: FloatArray, frame: FloatArray
) -> None:
    """Temperature spread of the region, and whether its rim differs from its inside."""
    inspection.spread_k = float(around[mask].std())
    inspection.edge_k = _edge_k(inspection.region, frame)
    if abs(inspection.edge_k) > UNEVEN_EDGE_K:
        inspection.shrink_px = pixels = _pixels_to_shrink(inspection.region, frame)
        key, kelvin = (
            "issue.region.edge.shrink" if pixels else "issue.region.edge",
            f"{inspection.edge_k:+.1f}",
        )
        inspection.warnings.append(Words(key, kelvin=kelvin, pixels=pixels))
    elif inspection.spread_k > MOST_SPREAD_K:
        inspection.warnings.append(Words("issue.region.uneven", kelvin=f"{inspection.spread_k:.1f}"))


def _edge_k(region: Region, frame: FloatArray, pixels: int = 0) -> float:
    """Difference of the outer pixels of the region so many pixels smaller from those inside; NaN without."""
    around, rim = frame[region.box(frame.shape)], rim_px(frame.shape[1])
    (count, total), (inner, inner_total) = (
        (int(np.isfinite(kelvin).sum()), float(np.nansum(kelvin)))
        for kelvin in (around[_smaller_mask(region, frame.shape, by)] for by in (pixels, pixels + rim))
    )
    if inner == 0 or count <= inner:
        return math.nan
    return (total - inner_total) / (count - inner) - inner_total / inner


def _pixels_to_shrink(region: Region, frame: FloatArray) -> int | None:
    """Pixels to shrink the region by so that it covers only its bed; None if too little would be left.

    On an uneven bed the edge difference need only fall below the warning.
    """
    fewest: int | None = None
    for pixels in range(1, MOST_SHRUNK_PX + 1):
        if not _has_inside(_smaller_mask(region, frame.shape, pixels), rim_px(frame.shape[1])):
            break
        edge_k = abs(_edge_k(region, frame, pixels))
        if edge_k <= CLEAN_EDGE_K:
            return pixels
        if fewest is None and edge_k <= UNEVEN_EDGE_K:
            fewest = pixels
    return fewest


def _smaller_mask(region: Region, shape: tuple[int, ...], pixels: int) -> BoolArray:
    """Pixels, in the region's box, of the region so many pixels smaller; none if nothing is left of it."""
    box = region.box((shape[0], shape[1]))
    try:
        smaller = region.shrunk(pixels) if pixels else region
    except ValueError:
        return np.zeros(tuple(part.stop - part.start for part in box), np.bool_)
    return smaller.mask((shape[0], shape[1]), box)
