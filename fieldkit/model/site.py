"""Where the experiment is, and which parts of the frame belong to which surface.

Angles in degrees: latitude north and longitude east positive; tilt from horizontal, azimuth of the surface
normal from north, clockwise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import numpy as np
from numpy.typing import NDArray

from fieldkit.model.numbered import NumberedEnum


@dataclass(frozen=True, slots=True)
class Site:
    """A place on the Earth; `timezone` is an IANA name and only used for display."""

    latitude_deg: float
    longitude_deg: float
    elevation_m: float = 0.0
    timezone: str = "UTC"


def zone_by_longitude(longitude_deg: float) -> str:
    """IANA zone of whole hours from Greenwich nearest to a longitude."""
    hours = round(((longitude_deg + 180.0) % 360.0 - 180.0) / 15.0)
    # the sign of these names is inverted: Etc/GMT-9 is nine hours ahead of Greenwich
    return f"Etc/GMT{-hours:+d}" if hours else "UTC"


def with_zone(site: Site, zone: str | None) -> Site:
    """The site with a zone: the one given, or the whole hours that its longitude lies from Greenwich."""
    return replace(site, timezone=zone or zone_by_longitude(site.longitude_deg))


@lru_cache
def known_zone(name: str) -> ZoneInfo | None:
    """The IANA time zone of that name; None if this computer does not have it."""
    try:
        return ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError, OSError):  # a folder or an endless name is an OSError
        return None


_Point = NDArray[np.float64]  # (x, y)


class RegionKind(NumberedEnum):
    """What a region is for; the numbers are stored in the session file."""

    REFERENCE = 0
    TARGET = 1


@dataclass(frozen=True, slots=True)
class Region:
    """A named polygon of the frame.

    `vertices` are (x, y) in pixels, x to the right, y down, pixel centres at whole numbers. `tilt_deg` and
    `azimuth_deg` are as measured by inclinometer and compass: used by the estimator for references, for
    targets only for comparison (NaN: unknown).
    """

    name: str
    kind: RegionKind
    vertices: tuple[tuple[float, float], ...]
    tilt_deg: float = float("nan")
    azimuth_deg: float = float("nan")
    emissivity: float = float("nan")

    def mask(self, shape: tuple[int, int]) -> NDArray[np.bool_]:
        """Pixels whose centre lies inside the polygon or on its edge, shape (rows, cols).

        Even-odd rule, so an outline that crosses itself is still defined.
        """
        # Not cv2.fillPoly: it also fills every pixel that the outline touches, so no mask would stay the same
        # (1200 random polygons, all differ), and estimates would include mixed pixels from the edge.
        y, x = np.mgrid[0 : shape[0], 0 : shape[1]].astype(np.float64)
        inside = np.zeros(shape, dtype=np.bool_)
        on_edge = np.zeros(shape, dtype=np.bool_)
        for (x0, y0), (x1, y1) in zip(self.vertices, (*self.vertices[1:], self.vertices[0]), strict=True):
            cross = (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0)
            on_edge |= (np.abs(cross) < 1e-9) & ((x - x0) * (x - x1) + (y - y0) * (y - y1) <= 0)
            if y0 != y1:
                inside ^= ((y0 > y) != (y1 > y)) & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
        return inside | on_edge

    @property
    def crosses_itself(self) -> bool:
        """Whether two edges that are not neighbours meet, which makes the inside ambiguous."""
        corners = self._corners
        edges = list(zip(corners, np.roll(corners, -1, axis=0), strict=True))
        apart = (
            (edges[one], edges[other])
            for one in range(len(edges))
            for other in range(one + 2, len(edges) - (one == 0))
        )
        return any(_meet(*first, *second) for first, second in apart)

    @property
    def _corners(self) -> NDArray[np.float64]:
        """The vertices (n, 2), without immediate repetitions."""
        corners = np.array(self.vertices, np.float64)
        return corners[np.any(corners != np.roll(corners, 1, axis=0), axis=1)]

    def is_within(self, shape: tuple[int, ...]) -> bool:
        """Whether every corner lies within a frame of `shape` (rows, cols)."""
        rows, cols = shape
        return all(0 <= x <= cols - 1 and 0 <= y <= rows - 1 for x, y in self.vertices)

    def shrunk(self, pixels: float) -> Region:
        """The region with every edge moved inwards by `pixels`; raises `ValueError` if nothing remains."""
        corners = self._corners
        along = np.roll(corners, -1, axis=0) - corners
        left = along[:, ::-1] * (-1.0, 1.0) / np.linalg.norm(along, axis=1, keepdims=True)
        inward = left * np.sign(np.sum(corners[:, 0] * along[:, 1] - corners[:, 1] * along[:, 0]))
        before = np.roll(inward, 1, axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):  # an edge that runs straight back
            mitre = (before + inward) / (1.0 + np.sum(before * inward, axis=1, keepdims=True))
            moved = corners + pixels * mitre
        kept = np.sum((np.roll(moved, -1, axis=0) - moved) * along, axis=1) > 0.0  # no edge is reversed
        if not (kept.all() and inward.any()):
            raise ValueError(f"nothing of region {self.name!r} is {pixels:g} px inside its edge")
        return replace(self, vertices=tuple((float(x), float(y)) for x, y in moved))


def _meet(
    a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64], d: NDArray[np.float64]
) -> bool:
    """Whether the lines from `a` to `b` and from `c` to `d` cross or touch."""
    turns = [_turn(a, b, c), _turn(a, b, d), _turn(c, d, a), _turn(c, d, b)]
    if turns[0] != turns[1] and turns[2] != turns[3]:
        return True
    ends = ((a, b, c), (a, b, d), (c, d, a), (c, d, b))
    return any(
        turn == 0 and bool(np.all(np.minimum(p, q) <= r) and np.all(r <= np.maximum(p, q)))
        for turn, (p, q, r) in zip(turns, ends, strict=True)
    )


def _turn(p: _Point, q: _Point, r: _Point) -> int:
    """1 where `r` lies to the left of the line from `p` to `q`, -1 to the right, 0 on it."""
    return int(np.sign((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])))
