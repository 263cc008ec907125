"""Whether regions can be used: large enough, inside the picture, apart, and even within."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import SessionError
from fieldkit.model.samples import Frame, Sample, is_usable
from fieldkit.model.site import Region
from fieldkit.physics.camera_laws import frame_k, has_temperatures

MIN_PIXELS = 100
MOST_OF_PICTURE = 0.9
"""A region beyond this share of the picture sees whatever lies around the beds as well."""
EDGE_PX = 2
UNEVEN_EDGE_K = 1.0  # more is warned of
CLEAN_EDGE_K = 0.2  # what shrinking by up to so many pixels is to reach
MOST_SHRUNK_PX = 10
PICTURES = 25

Picture = NDArray[np.float64]
Level = Literal["ok", "warn", "FAIL"]


@dataclass
class RegionInspection:
    """What was found about one region; `spread_k` and `edge_k` are NaN without a picture.

    `edge_k` is how much the outer two pixels differ from the inside, in kelvin.
    """

    region: Region
    pixels: int
    spread_k: float = math.nan
    edge_k: float = math.nan
    failures: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    @property
    def level(self) -> Level:
        """The worst of the findings."""
        return "FAIL" if self.failures else "warn" if self.warnings else "ok"

    def row(self) -> tuple[str, ...]:
        """One line of the table."""
        spread = "-" if math.isnan(self.spread_k) else f"{self.spread_k:.2f} K"
        said = "; ".join(self.failures + self.warnings)
        verdict = f"{self.level}: {said}" if said else "ok"
        return self.region.name, slope_text(self.region), f"{self.pixels} px", spread, verdict

    def document(self) -> dict[str, Any]:
        """The same for machines."""
        return {
            "name": self.region.name,
            "pixels": self.pixels,
            "spread_k": self.spread_k,
            "edge_k": self.edge_k,
            "level": self.level,
            "remarks": self.failures + self.warnings,
        }


def slope_text(region: Region) -> str:
    """``15/180``, or a dash where the slope is not known."""
    return "-" if math.isnan(region.tilt_deg) else f"{region.tilt_deg:g}/{region.azimuth_deg:g}"


def check_regions(
    regions: Sequence[Region], shape: tuple[int, ...] | None, picture: Picture | None = None
) -> list[RegionInspection]:
    """Look at each region in a picture of `shape` (rows, cols); `picture` holds kelvin of that shape.

    Without a shape the regions are only checked against each other.
    """
    rows, cols = shape or _around(regions)
    masks = [region.mask((rows, cols)) for region in regions]
    inspections = [
        RegionInspection(region, int(mask.sum())) for region, mask in zip(regions, masks, strict=True)
    ]
    for number, (inspection, mask) in enumerate(zip(inspections, masks, strict=True)):
        _check_size(inspection, rows, cols)
        for other, its_mask in zip(inspections[:number], masks[:number], strict=True):
            if shared := int((mask & its_mask).sum()):
                inspection.failures.append(f"shares {shared} px with {other.region.name}")
        if shape is not None and inspection.pixels > MOST_OF_PICTURE * rows * cols:
            inspection.warnings.append(
                f"covers {inspection.pixels / (rows * cols):.0%} of the picture, not one bed"
            )
        if picture is not None and inspection.pixels:
            _check_evenness(inspection, mask, picture)
    return inspections


def mean_picture(path: Path) -> Picture:
    """Mean of the first good pictures of a session's first camera, kelvin, shape (rows, cols).

    Raises `SessionError` if the session has no pictures with a temperature.
    """
    from fieldkit.sessions.reader import open_session

    with open_session(path) as session:
        camera = next((info for info in session.streams.values() if info.is_camera), None)
        pictures = _pictures(session.samples(camera.name), camera) if camera else iter(())
        kept = list(itertools.islice(pictures, PICTURES))
    if not kept:
        raise SessionError(f"{path} has no good picture with temperatures", fix="leave --on away")
    return np.asarray(np.mean(kept, axis=0, dtype=np.float64))


def _pictures(samples: Iterable[Sample], camera: StreamInfo) -> Iterator[Picture]:
    """The usable frames, as brightness temperatures."""
    if not has_temperatures(camera):
        return
    for sample in samples:
        if isinstance(sample, Frame) and is_usable(sample.quality):
            yield frame_k(camera, sample.counts, sample.metadata_rows)


def _around(regions: Sequence[Region]) -> tuple[int, int]:
    """A picture large enough for every region."""
    corners = [corner for region in regions for corner in region.vertices] or [(0.0, 0.0)]
    return math.ceil(max(y for _, y in corners)) + 1, math.ceil(max(x for x, _ in corners)) + 1


def _check_size(inspection: RegionInspection, rows: int, cols: int) -> None:
    if not inspection.region.is_within((rows, cols)):
        inspection.failures.append(f"outside the picture of {cols} x {rows} pixels")
    elif inspection.pixels < MIN_PIXELS:
        inspection.failures.append(f"too small, needs {MIN_PIXELS} px")
    if inspection.region.crosses_itself:
        inspection.failures.append("its outline crosses itself: give the corners in their order around it")


def _check_evenness(inspection: RegionInspection, mask: NDArray[np.bool_], picture: Picture) -> None:
    """Spread of the region, and whether its rim sees something else than its inside."""
    inspection.spread_k = float(picture[mask].std())
    inspection.edge_k = _edge_k(inspection.region, picture)
    if abs(inspection.edge_k) > UNEVEN_EDGE_K:
        name, pixels = inspection.region.name, _pixels_to_shrink(inspection.region, picture)
        advice = (
            f"roi edit {name} --shrink {pixels}" if pixels else f"roi remove {name}, then draw it smaller"
        )
        inspection.warnings.append(f"edge pixels differ by {inspection.edge_k:+.1f} K: fieldkit {advice}")


def _edge_k(region: Region, picture: Picture) -> float:
    """How much the outer pixels of a region differ from those inside; NaN if there are none of either."""
    shape = picture.shape[0], picture.shape[1]
    try:
        inside = region.shrunk(EDGE_PX).mask(shape)
    except ValueError:
        return math.nan
    rim = region.mask(shape) & ~inside
    return float(picture[rim].mean() - picture[inside].mean()) if rim.any() and inside.any() else math.nan


def _pixels_to_shrink(region: Region, picture: Picture) -> int | None:
    """How much smaller the region looks at its bed alone, None if too little would be left.

    A bed that is itself uneven is at least to come below what is warned of.
    """
    edges = list(_edges_inside(region, picture))
    limits = (CLEAN_EDGE_K, UNEVEN_EDGE_K)
    return next((pixels for limit in limits for pixels, edge_k in edges if abs(edge_k) <= limit), None)


def _edges_inside(region: Region, picture: Picture) -> Iterator[tuple[int, float]]:
    """Pixels that the region could be smaller, and by how many kelvin its edge would differ then."""
    for pixels in range(1, MOST_SHRUNK_PX + 1):
        try:
            smaller = region.shrunk(pixels)
        except ValueError:
            return
        if smaller.mask((picture.shape[0], picture.shape[1])).sum() >= MIN_PIXELS:
            yield pixels, _edge_k(smaller, picture)
