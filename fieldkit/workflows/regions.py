"""The regions of a campaign: add, edit and remove them in ``fieldkit.toml``, and check them.

A usable region is large enough, inside the frame, apart from the others, and of one temperature within.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypedDict, Unpack

import numpy as np
from numpy.typing import NDArray

from fieldkit.config import Config, ConfigMistakesError, edit, read_config
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError, SessionError
from fieldkit.model.samples import Frame, Sample, is_usable
from fieldkit.model.site import Region
from fieldkit.physics.camera_laws import frame_k, has_temperatures

MIN_PIXELS = 100
MOST_OF_FRAME = 0.9
"""A region that covers more of the frame than this sees more than one bed."""
EDGE_PX = 2
UNEVEN_EDGE_K = 1.0
CLEAN_EDGE_K = 0.2
"""A larger edge difference is a warning; shrinking should bring it below the smaller value."""
MOST_SHRUNK_PX = 10
AVERAGED_FRAMES = 25

Point = tuple[float, float]
Rect = tuple[float, float, float, float]
FrameK = NDArray[np.float64]
Level = Literal["ok", "warn", "FAIL"]


class RegionProperties(TypedDict, total=False):
    """What may be known about a region: its slope, its emissivity, the camera's offset there.

    Emissivity and offset may name a calibration record: ``"@sand"``.
    """

    tilt_deg: float
    azimuth_deg: float
    emissivity: float | str
    offset_k: float | str


def add_region(
    file: Path,
    name: str,
    *,
    points: Sequence[Point] = (),
    rect: Rect | None = None,
    is_ground: bool = False,
    reference: bool = False,
    **properties: Unpack[RegionProperties],
) -> dict[str, Any]:
    """Add a region to a ``fieldkit.toml``; the ``[[region]]`` table that was written.

    Parameters
    ----------
    file
        The campaign's ``fieldkit.toml``.
    name
        Letters, digits, ``-`` and ``_``.
    points
        Corners ``(x, y)`` in order around the region, at least three. [pixel]
    rect
        Instead of `points`: left, top, width, height. [pixel]
    is_ground
        Whether `points` are east, north on the ground of the campaign's ``camera.pose``. [m]
    reference
        Whether it is the flat reference; otherwise a target whose slope is estimated.
    **properties
        See `RegionProperties`.

    Raises
    ------
    ConfigError
        The region or the configuration with it would be invalid; nothing is written.
    """
    if bool(points) == (rect is not None):
        raise ConfigError("a region needs its corners or a rectangle", fix="give points or rect, not both")
    corners = points if rect is None else _corners(*rect)
    table = {
        "name": name,
        "kind": "reference" if reference else "target",
        "points_m" if is_ground else "points_px": _written(corners),
        **properties,
    }
    edit.add_region(file, table)
    return table


def edit_region(
    file: Path,
    name: str,
    *,
    points: Sequence[Point] = (),
    reference: bool | None = None,
    shrink_px: float | None = None,
    **properties: Unpack[RegionProperties],
) -> dict[str, Any]:
    """Change a region in a ``fieldkit.toml``: its corners, what it is for, its properties; the changed keys.

    `shrink_px` moves its edges inwards. Raises `ConfigError` if there is no such region, if nothing is to
    change, or if the result is invalid.
    """
    changes: dict[str, Any] = dict(properties)
    if points:
        changes["points_px"] = _written(points)
    if reference is not None:
        changes["kind"] = "reference" if reference else "target"
    if shrink_px is not None:
        changes["points_px"] = _shrunk_points(read_regions(file)[0], name, shrink_px)
    if not changes:
        raise ConfigError("give what to change: size, tilt, azimuth, emissivity or offset")
    edit.change_region(file, name, changes)
    return changes


def remove_region(file: Path, name: str) -> None:
    """Remove a region from a ``fieldkit.toml``; raises `ConfigError` if there is no such region."""
    edit.remove_region(file, name)


def read_regions(file: Path) -> tuple[Config, list[str]]:
    """The configuration with its regions, and what is wrong with the regions, for those who mend them.

    Raises `ConfigMistakesError` if no configuration can be read at all.
    """
    config, mistakes = read_config(file)
    if config is None:
        raise ConfigMistakesError(mistakes, fix=f"edit {file}")
    return config, [mistake.message for _, mistake in mistakes if mistake.path[:1] == ("region",)]


def inspect_regions(config: Config, session: Path | None = None) -> list[RegionInspection]:
    """Check a campaign's regions, in the frames of a session or in a frame of the configured size.

    Raises `SessionError` if the session has no frames with temperatures.
    """
    if session is not None:
        frame = mean_of_first_frames_k(session)
        return check_regions(config.regions, frame.shape, frame)
    camera = config.tables.camera
    shape = (camera.height_px, camera.width_px) if camera and camera.height_px and camera.width_px else None
    return check_regions(config.regions, shape)


def _corners(x: float, y: float, width: float, height: float) -> list[Point]:
    """The corner pixels of a rectangle `width` x `height` pixels large."""
    right, bottom = x + width - 1, y + height - 1
    return [(x, y), (right, y), (right, bottom), (x, bottom)]


def _shrunk_points(config: Config, name: str, pixels: float) -> list[list[int | float]]:
    """Corners of the region called `name`, moved inwards; empty if there is no such region."""
    region = next((region for region in config.regions if region.name == name), None)
    try:
        corners = region.shrunk(pixels).vertices if region else ()
    except ValueError as error:
        raise ConfigError(str(error), fix="a smaller --shrink") from error
    return _written([(round(x, 1), round(y, 1)) for x, y in corners])


def _written(corners: Sequence[Point]) -> list[list[int | float]]:
    """Corners as they stand in ``fieldkit.toml``."""
    return [[_short(x), _short(y)] for x, y in corners]


def _short(value: float) -> int | float:
    """A whole number without its decimal point, as people write pixels."""
    return int(value) if float(value).is_integer() else value


@dataclass
class RegionInspection:
    """The result of checking one region; `spread_k` and `edge_k` are NaN without a frame.

    `edge_k` is how much the outer two pixels differ from the inside, in kelvin; `shrink_px` by how many
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
    def text(self) -> str:
        """All issues in words; empty where there are none."""
        return "; ".join(self.failures + self.warnings)

    @property
    def level(self) -> Level:
        """The worst level of all issues."""
        return "FAIL" if self.failures else "warn" if self.warnings else "ok"

    def row(self) -> tuple[str, ...]:
        """One line of the table."""
        spread = "-" if math.isnan(self.spread_k) else f"{self.spread_k:.2f} K"
        verdict = f"{self.level}: {self.text}" if self.text else "ok"
        return self.region.name, slope_text(self.region), f"{self.pixels} px", spread, verdict

    def document(self) -> dict[str, Any]:
        """The result as a JSON object."""
        return {
            "name": self.region.name,
            "pixels": self.pixels,
            "spread_k": self.spread_k,
            "edge_k": self.edge_k,
            "level": self.level,
            "remarks": self.failures + self.warnings,
        }


def slope_text(region: Region) -> str:
    """``15/180``, ``15`` where the azimuth is not known, or a dash."""
    known = [f"{angle:g}" for angle in (region.tilt_deg, region.azimuth_deg) if not math.isnan(angle)]
    return "-" if math.isnan(region.tilt_deg) else "/".join(known)


def check_regions(
    regions: Sequence[Region], shape: tuple[int, ...] | None, frame: FrameK | None = None
) -> list[RegionInspection]:
    """Check each region in a frame of `shape` (rows, cols); `frame` holds kelvin of that shape.

    Without a shape the regions are only checked against each other.
    """
    return [check_region(one, shape, frame, regions[:number]) for number, one in enumerate(regions)]


def check_region(
    region: Region,
    shape: tuple[int, ...] | None,
    frame: FrameK | None = None,
    others: Sequence[Region] = (),
) -> RegionInspection:
    """Check one region in a frame of `shape` (rows, cols), as fast as a finger draws it.

    `frame` holds kelvin of that shape; the region must share no pixel with `others`. Without a shape its size
    and place in the frame are not checked.
    """
    rows, cols = shape or _around(region)
    box = region.box((rows, cols))
    mask = region.mask((rows, cols), box)
    inspection = RegionInspection(region, int(mask.sum()))
    _check_size(inspection, rows, cols)
    for other in others:
        if shared := int((mask & other.mask((rows, cols), box)).sum()):
            inspection.failures.append(f"shares {shared} px with {other.name}")
    if shape is not None and inspection.pixels > MOST_OF_FRAME * rows * cols:
        inspection.warnings.append(
            f"covers {inspection.pixels / (rows * cols):.0%} of the frame, not one bed"
        )
    if frame is not None and inspection.pixels:
        _check_evenness(inspection, mask, frame[box], frame)
    return inspection


def check_configured(config: Config, *, unless: Config) -> None:
    """Raise `ConfigError` for regions that cannot be used, apart from what is wrong in `unless` already."""
    before = {_failed(one) for one in inspect_regions(unless)}
    found = [_failed(one) for one in inspect_regions(config) if one.failures and _failed(one) not in before]
    if found:
        raise ConfigError("; ".join(found), fix="nothing was changed; draw it again")


def _failed(inspection: RegionInspection) -> str:
    return f"region {inspection.region.name}: {'; '.join(inspection.failures)}"


def mean_of_first_frames_k(path: Path) -> FrameK:
    """Mean of the first good frames of a session's first camera, kelvin, shape (rows, cols).

    Raises `SessionError` if the session has no frames with a temperature.
    """
    from fieldkit.sessions.reader import open_session

    with open_session(path) as session:
        camera = next((info for info in session.streams.values() if info.is_camera), None)
        frames = _usable_frames_k(session.samples(camera.name), camera) if camera else iter(())
        kept = list(itertools.islice(frames, AVERAGED_FRAMES))
    if not kept:
        raise SessionError(f"{path} has no usable frame with temperatures", fix="omit --on")
    return np.asarray(np.mean(kept, axis=0, dtype=np.float64))


def _usable_frames_k(samples: Iterable[Sample], camera: StreamInfo) -> Iterator[FrameK]:
    """The usable frames, as brightness temperatures."""
    if not has_temperatures(camera):
        return
    for sample in samples:
        if isinstance(sample, Frame) and is_usable(sample.quality):
            yield frame_k(camera, sample.counts, sample.metadata_rows)


def _around(region: Region) -> tuple[int, int]:
    """A frame large enough for a region."""
    xs, ys = zip(*region.vertices, strict=True)
    return math.ceil(max(ys)) + 1, math.ceil(max(xs)) + 1


def _check_size(inspection: RegionInspection, rows: int, cols: int) -> None:
    if not inspection.region.is_within((rows, cols)):
        inspection.failures.append(f"outside the frame of {cols} x {rows} pixels")
    elif inspection.pixels < MIN_PIXELS:
        inspection.failures.append(f"too small, needs {MIN_PIXELS} px")
    if inspection.region.crosses_itself:
        inspection.failures.append("its outline crosses itself: give the corners in order around it")


def _check_evenness(
    inspection: RegionInspection, mask: NDArray[np.bool_], around: FrameK, frame: FrameK
) -> None:
    """Temperature spread of the region, and whether its rim differs from its inside."""
    inspection.spread_k = float(around[mask].std())
    rims = _Rims(inspection.region, frame)
    inspection.edge_k = rims.edge_k(0)
    if abs(inspection.edge_k) > UNEVEN_EDGE_K:
        name, pixels = inspection.region.name, rims.pixels_to_shrink()
        inspection.shrink_px = pixels
        advice = (
            f"roi edit {name} --shrink {pixels}" if pixels else f"roi remove {name}, then draw it smaller"
        )
        inspection.warnings.append(f"edge pixels differ by {inspection.edge_k:+.1f} K: fieldkit {advice}")


class _Rims:
    """The rims of a region made smaller and smaller; each smaller one is masked once, and only if needed."""

    def __init__(self, region: Region, frame: FrameK) -> None:
        self._region, self._shape, self._box = (
            region,
            (frame.shape[0], frame.shape[1]),
            region.box(frame.shape),
        )
        self._around = frame[self._box]
        self._known: dict[int, tuple[int, float]] = {}

    def edge_k(self, pixels: int) -> float:
        """How much the outer pixels of the smaller region differ from those inside; NaN without either."""
        (count, total), (inner, inner_total) = self._sums(pixels), self._sums(pixels + EDGE_PX)
        if inner == 0 or count <= inner:
            return math.nan
        return (total - inner_total) / (count - inner) - inner_total / inner

    def pixels_to_shrink(self) -> int | None:
        """Pixels to shrink the region by so that it covers only its bed; None if too little would be left.

        On an uneven bed the edge difference need only fall below the warning.
        """
        found: int | None = None
        for pixels in range(1, MOST_SHRUNK_PX + 1):
            if self._sums(pixels)[0] < MIN_PIXELS:
                break
            edge_k = abs(self.edge_k(pixels))
            if edge_k <= CLEAN_EDGE_K:
                return pixels
            if found is None and edge_k <= UNEVEN_EDGE_K:
                found = pixels
        return found

    def _sums(self, pixels: int) -> tuple[int, float]:
        """Number of pixels and sum of kelvin of the region so many pixels smaller."""
        if pixels not in self._known:
            self._known[pixels] = self._summed(pixels)
        return self._known[pixels]

    def _summed(self, pixels: int) -> tuple[int, float]:
        try:
            smaller = self._region.shrunk(pixels) if pixels else self._region
        except ValueError:
            return 0, 0.0
        kelvin = self._around[smaller.mask(self._shape, self._box)]
        return kelvin.size, float(kelvin.sum())
