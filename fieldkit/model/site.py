"""Site of the experiment, and regions of the frame.

Angles in degrees: latitude north and longitude east positive; tilt from horizontal, azimuth of the surface
normal from north, clockwise.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError, available_timezones

import numpy as np

from fieldkit.model.arrays import BoolArray, FloatArray, IntArray
from fieldkit.model.door import checked
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.model.samples import NumberedEnum
from fieldkit.model.spelling import nearest
from fieldkit.phrases import Words

EARTH_RADIUS_M = 6_371_000.0
ELEVATIONS_M = (-10_000.0, 25_000.0)
"""From the deepest ground of the three worlds to above the highest, the summit of Olympus Mons on Mars."""


@checked
@dataclass(frozen=True, slots=True)
class Site:
    """A place on the Earth, Mars or the Moon (`body`).

    `timezone` is an IANA name and only used for display. Latitudes are geographic: the angle between the
    vertical and the equator.

    Examples
    --------
    >>> site = fieldkit.Site(37.70, -105.92, 2317.0, "America/Denver")
    >>> site.elevation_m
    2317.0
    """

    latitude_deg: float
    longitude_deg: float
    elevation_m: float = 0.0
    timezone: str = "UTC"
    body: str = "earth"

    def __post_init__(self) -> None:
        for name, (low, high), fix in (
            ("latitude_deg", (-90.0, 90.0), "give latitude first, then longitude, in degrees"),
            ("longitude_deg", (-180.0, 180.0), "give the longitude in degrees, east positive"),
            ("elevation_m", ELEVATIONS_M, "give the elevation in metres"),
        ):
            if not low <= (value := getattr(self, name)) <= high:
                what = f"{value:g} is not within {low:g} to {high:g}"
                raise ConfigError(what, place=Argument(name), fix=fix)


def zone_by_longitude(longitude_deg: float) -> str:
    """IANA zone of whole hours from Greenwich nearest to a longitude."""
    hours = round(((longitude_deg + 180.0) % 360.0 - 180.0) / 15.0)
    # the sign of these names is inverted: Etc/GMT-9 is nine hours ahead of Greenwich
    return f"Etc/GMT{-hours:+d}" if hours else "UTC"


def as_site(site: Site | Sequence[float]) -> Site:
    """The site, or that of latitude, longitude and elevation in its zone; raises `ConfigError`."""
    if isinstance(site, Site):
        return with_zone(site, site.timezone)
    if not 2 <= len(site) <= 3:
        fix = "give latitude, longitude and elevation"
        raise ConfigError(f"{site!r} is not a site", place=Argument("site"), fix=fix)
    try:
        latitude_deg, longitude_deg, *elevation_m = site
        return with_zone(Site(latitude_deg, longitude_deg, *elevation_m), None)  # type: ignore[arg-type]
    except ConfigError as error:
        raise ConfigError(error.explanation, place=Argument("site"), fix=error.fix) from error


def apart_m(one: Site, other: Site) -> float:
    """Distance along the Earth's surface, exact enough within some ten kilometres, m."""
    north = math.radians(other.latitude_deg - one.latitude_deg)
    around = (other.longitude_deg - one.longitude_deg + 180.0) % 360.0 - 180.0
    east = math.radians(around) * math.cos(math.radians(one.latitude_deg))
    return EARTH_RADIUS_M * math.hypot(north, east)


def with_zone(site: Site, zone: str | None) -> Site:
    """The site with a zone: the one given, or the whole hours that its longitude lies from Greenwich.

    Raises `ConfigError` for a zone that this computer does not have.
    """
    name = zone or zone_by_longitude(site.longitude_deg)
    if known_zone(name) is None:
        fix = f"write one like {nearest(name, available_timezones()) or 'Asia/Tokyo'}"
        raise ConfigError(f"unknown time zone {name!r}", place=Argument("timezone"), fix=fix)
    return replace(site, timezone=name)


@lru_cache
def known_zone(name: str) -> ZoneInfo | None:
    """The IANA time zone of that name; None if this computer does not have it."""
    try:
        return ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError, OSError):  # a folder or an endless name is an OSError
        return None


class RegionKind(NumberedEnum):
    """Use of a region; the numbers are stored in the session file."""

    REFERENCE = 0
    TARGET = 1
    BLACKBODY = 2  # of known temperature, by its probes: it shows the camera's errors, and has no slope
    FOIL = 3  # aluminium foil, which shows what the ground reflects, and has no slope


@checked
@dataclass(frozen=True, slots=True)
class Region:
    """A named polygon of the frame.

    `points_px` are (x, y) in pixels, x to the right, y down, pixel centres at whole numbers. `tilt_deg` and
    `azimuth_deg` are as measured by inclinometer and compass: used by the estimator for references, for
    targets only for comparison (NaN: unknown). `points_m` are the corners on the ground (east, north,
    height in the system of the camera's pose) of a region given by them; `points_px` is where they were seen.
    `camera` names the stream whose frames it lies in, "" the first camera.

    Examples
    --------
    >>> from fieldkit.model.site import RegionKind
    >>> outline = ((10, 10), (40, 10), (40, 30), (10, 30))
    >>> bed = fieldkit.Region("b15", RegionKind.TARGET, outline, tilt_deg=15.0, azimuth_deg=180.0)
    >>> int(bed.mask((120, 160)).sum())
    651
    >>> bed.box((120, 160))
    (slice(10, 31, None), slice(10, 41, None))
    >>> bed.is_within((120, 160)), bed.crosses_itself
    (True, False)
    >>> bed.shrunk(2.0).points_px
    ((12.0, 12.0), (38.0, 12.0), (38.0, 28.0), (12.0, 28.0))
    """

    name: str
    kind: RegionKind
    points_px: tuple[tuple[float, float], ...]
    tilt_deg: float = float("nan")
    azimuth_deg: float = float("nan")
    emissivity: float = float("nan")
    points_m: tuple[tuple[float, float, float], ...] = ()
    camera: str = ""

    def mask(self, shape: tuple[int, int], within: tuple[slice, slice] | None = None) -> BoolArray:
        """Pixels whose centre lies inside the polygon or on its edge, shape (rows, cols).

        Even-odd rule, so an outline that crosses itself is still defined. `within` asks for a part of the
        frame alone, as `box` gives it.
        """
        # Not cv2.fillPoly: it also fills every pixel that the outline touches, so no mask would stay the same
        # (1200 random polygons, all differ), and estimates would include mixed pixels from the edge.
        rows, cols = within or (slice(0, shape[0]), slice(0, shape[1]))
        y, x = (np.arange(part.start, part.stop, dtype=np.float64) for part in (rows, cols))
        mask = np.zeros((y.size, x.size), dtype=np.bool_)
        edges = list(zip(self.points_px, (*self.points_px[1:], *self.points_px[:1]), strict=True))
        for (x0, y0), (x1, y1) in edges:
            if y0 != y1:
                first, end = np.searchsorted(y, sorted((y0, y1)))
                at = x0 + (y[first:end] - y0) * (x1 - x0) / (y1 - y0)
                mask[first:end] ^= x < at[:, np.newaxis]
        for start, end in edges:
            mask[_pixels_on(start, end, rows, cols)] = True
        return mask

    def box(self, shape: tuple[int, ...]) -> tuple[slice, slice]:
        """The rows and columns of a frame of `shape` (rows, cols) that can have pixels of the region."""
        xs, ys = zip(*self.points_px, strict=True)
        return _span(ys, shape[0]), _span(xs, shape[1])

    @property
    def crosses_itself(self) -> bool:
        """True if two edges that are not neighbours meet, which makes the inside ambiguous."""
        corners = self._corners
        edges = list(zip(corners, np.roll(corners, -1, axis=0), strict=True))
        apart = (
            (edges[place], edges[other])
            for place in range(len(edges))
            for other in range(place + 2, len(edges) - (place == 0))
        )
        return any(_meet(*first, *second) for first, second in apart)

    @property
    def _corners(self) -> FloatArray:
        """The points_px (n, 2), without immediate repetitions."""
        corners = np.array(self.points_px, np.float64)
        return corners[np.any(corners != np.roll(corners, 1, axis=0), axis=1)]

    def is_within(self, shape: tuple[int, ...]) -> bool:
        """True if every corner lies within a frame of `shape` (rows, cols)."""
        rows, cols = shape
        return all(0 <= x <= cols - 1 and 0 <= y <= rows - 1 for x, y in self.points_px)

    def shrunk(self, pixels: float) -> Region:
        """The region with every edge moved inwards by `pixels`; raises `ConfigError` if nothing remains."""
        corners = self._corners
        along = np.roll(corners, -1, axis=0) - corners
        left = along[:, ::-1] * (-1.0, 1.0) / np.linalg.norm(along, axis=1, keepdims=True)
        inward = left * np.sign(np.sum(corners[:, 0] * along[:, 1] - corners[:, 1] * along[:, 0]))
        before = np.roll(inward, 1, axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):  # an edge that runs straight back
            mitre = (before + inward) / (1.0 + np.sum(before * inward, axis=1, keepdims=True))
            inner = corners + pixels * mitre
        is_convex = np.sum((np.roll(inner, -1, axis=0) - inner) * along, axis=1) > 0.0  # no edge is reversed
        if not (is_convex.all() and inward.any()):
            what = Words("error.shrunk", pixels=f"{pixels:g}")
            raise ConfigError(what, place=self.name, fix=Words("fix.shrink"))
        return replace(self, points_px=tuple((float(x), float(y)) for x, y in inner))


@dataclass(frozen=True, slots=True)
class RegionRecord:
    """An outline of a region and when it began to hold, or the region's removal at that time.

    `time_ns` is UTC; an outline holds from the first full minute that begins at or after it.
    """

    region: Region
    time_ns: int
    is_removed: bool = False

    def changed(self, regions: Iterable[Region]) -> tuple[Region, ...]:
        """The regions with this outline in place of the one of its name, or without it."""
        by_name = {region.name: region for region in regions} | {self.region.name: self.region}
        return tuple(region for region in by_name.values() if not (self.is_removed and region is self.region))


def _span(values: Sequence[float], size: int) -> slice:
    """The whole numbers from 0 to below `size` between the least and the largest value."""
    if not all(map(math.isfinite, values)):
        return slice(0, 0)
    return slice(min(max(0, math.floor(min(values))), size), min(max(0, math.ceil(max(values)) + 1), size))


def _pixels_on(
    start: tuple[float, float], end: tuple[float, float], rows: slice, cols: slice
) -> tuple[IntArray, IntArray]:
    """Rows and columns within a part of the frame of the pixels whose centre lies on an edge.

    They are looked for along its longer side, beside the line.
    """
    (x0, y0), (x1, y1) = start, end
    is_steep = abs(y1 - y0) >= abs(x1 - x0)
    (a0, b0), (a1, b1) = ((y0, x0), (y1, x1)) if is_steep else ((x0, y0), (x1, y1))
    long, short = (rows, cols) if is_steep else (cols, rows)
    part = _span((a0, a1), long.stop)
    along = np.arange(max(part.start, long.start), part.stop)
    slope = (b1 - b0) / (a1 - a0) if a1 != a0 else 0.0
    beside = np.rint(np.clip(b0 + (along - a0) * slope, short.start - 2, short.stop + 1)).astype(np.int64)
    along, beside = np.tile(along, 3), np.concatenate([beside - 1, beside, beside + 1])
    x, y = (beside, along) if is_steep else (along, beside)
    cross = (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0)
    on_edge = (np.abs(cross) < 1e-9) & ((x - x0) * (x - x1) + (y - y0) * (y - y1) <= 0)
    on_edge &= (beside >= short.start) & (beside < short.stop)
    return y[on_edge] - rows.start, x[on_edge] - cols.start


def _meet(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> bool:
    """True if the lines from `a` to `b` and from `c` to `d` cross or touch."""
    turns = [_turn(a, b, c), _turn(a, b, d), _turn(c, d, a), _turn(c, d, b)]
    if turns[0] != turns[1] and turns[2] != turns[3]:
        return True
    ends = ((a, b, c), (a, b, d), (c, d, a), (c, d, b))
    return any(
        turn == 0 and bool(np.all(np.minimum(p, q) <= r) and np.all(r <= np.maximum(p, q)))
        for turn, (p, q, r) in zip(turns, ends, strict=True)
    )


def _turn(p: FloatArray, q: FloatArray, r: FloatArray) -> int:
    """1 where `r` lies to the left of the line from `p` to `q`, -1 to the right, 0 on it."""
    return int(np.sign((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])))
