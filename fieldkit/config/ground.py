"""Regions by their corners on the ground: their heights, and where the camera sees them.

``points_m`` of a region gets its heights from the ground of the pose, and ``points_px`` is where the region
is seen first; both are kept, so that a session shows its regions without the DEM.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ValidationError

from fieldkit.config.files import regions_in, table_in
from fieldkit.config.pose import CameraPose
from fieldkit.config.references import campaign_folder
from fieldkit.config.toml_schema import PoseTable
from fieldkit.config.validation import Mistake
from fieldkit.model.arrays import BoolArray, FloatArray
from fieldkit.model.errors import ConfigError
from fieldkit.model.site import Site
from fieldkit.physics.camera_geometry import Heights, is_hidden, project
from fieldkit.physics.trajectory import CameraPath
from fieldkit.sessions.formats import geotiff

if TYPE_CHECKING:
    from rasterio.crs import CRS

Corner = tuple[float, float]


@dataclass(frozen=True)
class Ground:
    """The ground before a camera, and its frame's rows and columns. Needs ``fieldkit-slope[terrain]``."""

    pose: CameraPose
    shape: tuple[int, int]

    @cached_property
    def crs(self) -> CRS:
        """The projected reference system; raises `ConfigError`."""
        return geotiff.projected_crs(self.pose.table.crs)

    @cached_property
    def dem(self) -> Heights | None:
        """The DEM; None for level ground. Raises `ConfigError`."""
        table = self.pose.table
        if table.dem is None:
            return None
        return geotiff.read_heights(self.pose.folder / table.dem, self.crs, self.path.grid_scale)

    @cached_property
    def path(self) -> CameraPath:
        """The camera over time, in the axes of the grid."""
        return camera_path(self.pose)

    def with_heights(self, points: Sequence[Sequence[float]]) -> list[list[float]]:
        """Points as east, north, height, those without a height on the ground.

        Raises `ConfigError` where the DEM has none.
        """
        heights = []
        for east, north, *given in points:
            height = given[0] if given else self._height_m(east, north)
            if np.isnan(height):
                what = f"has no height at {east:.10g}, {north:.10g}"
                raise ConfigError(what, place=self.pose.table.dem)
            heights.append([float(east), float(north), float(height)])
        return heights

    def corners_seen(self, points_m: Sequence[Sequence[float]], times_ns: Sequence[int]) -> list[Corner]:
        """Corners in the frame, to a tenth of a pixel, at the first of some times that shows them all.

        Raises `ConfigError` if there is none, with those that the first does not show.
        """
        corners = np.asarray(points_m, np.float64)
        for time_ns in times_ns:
            is_unseen, on_frame = self._on_frame(time_ns, corners)
            if not is_unseen.any():
                return on_frame
        unseen = corners[self._on_frame(times_ns[0], corners)[0]]
        raise ConfigError(
            "not seen by the camera: behind it, outside the frame, beyond range_m or behind nearer ground",
            place=" ".join(f"{east:.10g},{north:.10g}" for east, north, _ in unseen),
            fix="correct the points or the pose",
        )

    def _height_m(self, east_m: float, north_m: float) -> float:
        if self.dem is not None:
            return float(self.dem.at(east_m, north_m))
        assert self.pose.table.ground_m is not None
        return self.pose.table.ground_m

    def _on_frame(self, time_ns: int, corners: FloatArray) -> tuple[BoolArray, list[Corner]]:
        """Which corners are not seen, and where they are in the frame, those outside on its edge."""
        camera = self.path.camera(time_ns, self.shape)
        assert camera is not None
        x, y, away = project(camera, corners)
        rows, cols = self.shape
        inside = (x > -0.5) & (x < cols - 0.5) & (y > -0.5) & (y < rows - 0.5)
        unseen = np.asarray(~inside | (away > self.pose.table.range_m))
        if self.dem is not None and not unseen.any():
            unseen = is_hidden(self.dem, camera.position_m, corners, 2.0 * self.dem.cell_m)
        return unseen, [
            (round(float(np.clip(right, 0, cols - 1)), 1), round(float(np.clip(down, 0, rows - 1)), 1))
            for right, down in zip(x, y, strict=True)
        ]


def camera_path(pose: CameraPose, site: Site | None = None) -> CameraPath:
    """The camera over time, in the axes of its reference system's grid.

    Raises `ConfigError`, also for a pose that is not at the site.
    """
    crs, (east_m, north_m, _) = geotiff.projected_crs(pose.table.crs), pose.trajectory.position_m[0]
    if site is not None:
        geotiff.require_near(site, crs, east_m, north_m)
    return pose.path(geotiff.grid_at(crs, east_m, north_m))


def with_regions(values: dict[str, Any], path: Path) -> list[Mistake]:
    """Complete the regions that are given on the ground; returns the mistakes."""
    regions = [((*at, "points_m"), region) for at, region in regions_in(values) if _is_incomplete(region)]
    if not regions:
        return []
    ground = _ground(values, path)
    if isinstance(ground, str):
        return [Mistake(key, ground) for key, _ in regions]
    mistakes = []
    for key, region in regions:
        try:
            _complete(region, ground)
        except ConfigError as error:
            mistakes.append(Mistake(key, error.message))
    return mistakes


def _complete(region: dict[str, Any], ground: Ground) -> None:
    points = region["points_m"]
    if not (isinstance(points, list) and len(points) >= 3 and all(map(_is_point, points))):
        raise ConfigError("at least three corners [east, north] or [east, north, height] are needed")
    region["points_m"] = ground.with_heights(points)
    if "points_px" not in region:
        corners = ground.corners_seen(region["points_m"], ground.path.trajectory.time_ns)
        region["points_px"] = [list(corner) for corner in corners]


def _is_incomplete(region: dict[str, Any]) -> bool:
    """True if a region on the ground has no heights or pixels yet."""
    points: Any = region.get("points_m")
    if not isinstance(points, list):
        return bool(points)  # `_complete` refuses it
    return bool(points) and not ("points_px" in region and all(_is_point(point, (3,)) for point in points))


def _is_point(point: Any, sizes: tuple[int, ...] = (2, 3)) -> bool:
    return isinstance(point, list) and len(point) in sizes and all(type(xyz) in (int, float) for xyz in point)


def _ground(values: dict[str, Any], path: Path) -> Ground | str:
    """The ground of the configured pose, or why there is none."""
    camera = table_in(values, "camera")
    width, height = camera.get("width_px"), camera.get("height_px")
    if "pose" not in camera:
        return "corners on the ground need the pose of the camera, camera.pose"
    if not (isinstance(width, int) and isinstance(height, int)):
        return "corners on the ground need camera.width_px and camera.height_px"
    try:
        pose = CameraPose(PoseTable.model_validate(camera["pose"]), campaign_folder(path))
        ground = Ground(pose, (height, width))
        _ = ground.path, ground.dem
    except ValidationError:
        return "corners on the ground need a valid camera.pose"
    except ConfigError as error:
        return error.message
    return ground
