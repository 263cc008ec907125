"""Products of a map on the ground: orthorectified as GeoTIFF and as ROS 2 grids.

A cell takes the value of the pixel that sees its centre. The slopes also give the relief: the heights of
the surface that has them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fieldkit.config.ground import Ground
from fieldkit.config.pose import CameraPose, Pose
from fieldkit.config.toml_schema import PoseTable
from fieldkit.disk import replacing
from fieldkit.estimation.pixel_slopes import SlopeMap
from fieldkit.ground.terrain_products import Layer
from fieldkit.model.arrays import FloatArray, SingleArray
from fieldkit.model.errors import ConfigError, NoAnswerError
from fieldkit.model.next_step import Argument
from fieldkit.physics.camera_geometry import (
    Camera,
    Grid,
    Heights,
    distances_to_ground_m,
    distances_to_plane_m,
    ground_points,
    project_to_frame,
)
from fieldkit.physics.facet import normal
from fieldkit.physics.terrain import heights_from_normals
from fieldkit.sessions.formats import geotiff, ros2

if TYPE_CHECKING:
    from rasterio.crs import CRS

MOST_CELLS = 20_000_000


@dataclass(frozen=True, slots=True)
class GroundView:
    """Ground that each pixel of a camera sees.

    Attributes
    ----------
    camera, crs
        The camera, in the axes of the projected reference system.
    ground
        Heights of the ground on the cells of the output.
    dem
        Heights that the pose names, None on level ground.
    grid
        Its true north and scale.
    distances_m
        From the camera along each pixel's ray, (rows, cols); NaN where it meets no ground within range. [m]
    """

    camera: Camera
    crs: CRS
    ground: Heights
    dem: Heights | None
    grid: Grid
    distances_m: FloatArray

    @property
    def points_m(self) -> FloatArray:
        """Ground points of the pixels in metres, shape (rows, cols, 3)."""
        return ground_points(self.camera, self.distances_m)

    def on_cells(self, values: SingleArray) -> SingleArray:
        """Values (rows, cols) of the frame on the cells of the ground; NaN where the camera sees none."""
        rows, cols = self.ground.heights_m.shape
        cell = self.ground.cell_m
        east = self.ground.west_m + cell * (np.arange(cols) + 0.5)
        north = self.ground.north_m - cell * (np.arange(rows) + 0.5)
        points = np.stack([*np.meshgrid(east, north), self.ground.heights_m], axis=-1)
        row, col, is_visible = project_to_frame(self.camera, points, self.distances_m, cell)
        return np.where(is_visible, values[row, col], np.float32(np.nan))

    def relief(self, slopes: SlopeMap) -> tuple[FloatArray, FloatArray]:
        """Heights in metres that have these slopes, of the ground's mean, and their misclosure in degrees.

        See `heights_from_normals`; on the cells of the ground.
        """
        tilt_deg, azimuth_deg = self.on_cells(slopes.tilt_deg), self.on_cells(slopes.azimuth_deg)
        normals = normal(tilt_deg, azimuth_deg + self.grid.true_north_deg)
        return heights_from_normals(normals, self.ground.cell_m / self.grid.scale, self.ground.heights_m)


def ground_view(pose: Pose, shape: tuple[int, int], cell_m: float | None = None) -> GroundView:
    """Trace the pixels of frames of `shape` (rows, cols), by a camera's pose with its ground, to that ground.

    `cell_m` is the side of a cell in metres; the median distance between neighbouring pixels on the ground by
    default. Raises `ConfigError` if the reference system is unknown, not in metres or stretched, the DEM does
    not fit it, or a cell is too small, `NoAnswerError` if no pixel meets the ground within range.
    """
    table = pose.table
    crs = geotiff.projected_crs(table.crs)
    grid = geotiff.grid_at(crs, *pose.position_m[:2])
    dem = None if pose.dem is None else geotiff.read_heights(pose.dem, crs, grid.scale)
    camera = pose.camera(shape, grid)
    away = _distances_m(camera, table, dem)
    if not np.isfinite(away).any():
        problem = f"no pixel meets it within {table.range_m:g} m of the camera"
        fix = "check position, pitch_deg and range_m of the pose, and the place of the DEM"
        raise NoAnswerError(problem, place=pose.dem or f"level ground at {table.ground_m} m", fix=fix)
    return GroundView(camera, crs, _cells(ground_points(camera, away), table, dem, cell_m), dem, grid, away)


def on_frame(
    pose: CameraPose, shape: tuple[int, int], points_m: Sequence[tuple[float, float]], time_ns: int
) -> list[tuple[float, float]]:
    """Pixels of points of the ground (east and north in the pose's reference system), to a tenth of a pixel.

    In a frame of `shape` (rows, cols), at UTC nanoseconds since 1970, which only matter to a pose along a
    trajectory. Raises `ConfigError` if the reference system or the DEM is wrong, or the camera does not see
    one of the points.
    """
    ground = Ground(pose, shape)
    pose.at(time_ns)
    return ground.corners_seen(ground.with_heights(points_m), [time_ns])


def _distances_m(camera: Camera, pose: PoseTable, dem: Heights | None) -> FloatArray:
    if dem is not None:
        return distances_to_ground_m(camera, dem, pose.range_m)
    assert pose.ground_m is not None
    away = distances_to_plane_m(camera, pose.ground_m)
    return np.where(away <= pose.range_m, away, np.nan)


def _cells(points: FloatArray, pose: PoseTable, dem: Heights | None, cell_m: float | None) -> Heights:
    """Heights on the cells around the points, edges at multiples of their side."""
    if cell_m is None:
        apart = np.linalg.norm(np.diff(points, axis=1)[..., :2], axis=-1)
        cell_m = float(np.nanmedian(apart)) if np.isfinite(apart).any() else 1.0
    east, north = points[..., 0], points[..., 1]
    west, south = (float(np.floor(np.nanmin(coordinates) / cell_m)) * cell_m for coordinates in (east, north))
    cols, rows = (
        max(2, int(np.ceil((np.nanmax(coordinates) - edge) / cell_m)))
        for coordinates, edge in ((east, west), (north, south))
    )
    if rows * cols > MOST_CELLS:
        fix = "choose a larger " + Argument("cell_m")
        raise ConfigError(f"makes {rows} x {cols} cells", place=Argument("cell_m", cell_m), fix=fix)
    top = south + rows * cell_m
    flat = np.full((rows, cols), np.nan if pose.ground_m is None else pose.ground_m)
    if dem is not None:
        at = west + cell_m * (np.arange(cols) + 0.5), top - cell_m * (np.arange(rows) + 0.5)
        flat = dem.at(*np.meshgrid(*at))
    return Heights(west, top, cell_m, flat)


def write_on_ground(
    base: Path, view: GroundView, layers: Sequence[Layer], slopes: SlopeMap, time_ns: int
) -> list[Path]:
    """Write layers of the frame on the ground: ``BASE.tif`` and ``BASE.mcap``; the files.

    Each holds the layers, their uncertainties, the state and the relief at a time, UTC nanoseconds since
    1970. Raises `OSError`.
    """
    planes = [(layer.name, layer.units, layer.values) for layer in layers]
    planes += [(f"{layer.name}_sd", layer.units, layer.sd) for layer in layers if layer.sd is not None]
    planes.append(("state", "1", slopes.state.astype(np.float32)))
    on_cells = [(name, units, view.on_cells(values)) for name, units, values in planes]
    height, misclosure = (layer.astype(np.float32) for layer in view.relief(slopes))
    on_cells += [("height", "m", height), ("misclosure", "degree", misclosure)]
    ground = view.ground
    risk = next((layer.name for layer in layers if layer.name == "ptilt"), None)
    with replacing(image := base.with_name(f"{base.name}.tif"), synced=False) as file:
        geotiff.write_layers(file, on_cells, view.crs, ground.west_m, ground.north_m, ground.cell_m)
    with replacing(maps := base.with_name(f"{base.name}.mcap"), synced=False) as file:
        ros2.write_maps(file, {name: values for name, _, values in on_cells}, ground, time_ns, risk=risk)
    return [image, maps]
