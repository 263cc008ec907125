"""The horizon of a place from a DEM, or from the skyline clicked in a frame: pairs for ``fieldkit.toml``."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
from scipy.ndimage import map_coordinates

from fieldkit.config.files import read_text
from fieldkit.config.horizon import COLUMNS
from fieldkit.config.pose import Pose
from fieldkit.disk import replacing
from fieldkit.model.errors import ConfigError, StorageError
from fieldkit.physics.camera_geometry import horizon_of_ground, rays
from fieldkit.physics.facet import FloatArray, tilt_azimuth
from fieldkit.physics.horizon import Horizon
from fieldkit.sessions.formats import geotiff

SKYLINE = ("x_px", "y_px")


def horizon_from_dem(
    dem: Path, crs: str, east_m: float, north_m: float, *, nearest_m: float = 0.0
) -> Horizon:
    """The horizon of a point by a DEM, every degree; raises `ConfigError`."""
    system = geotiff.projected_crs(crs)
    ground = geotiff.read_heights(dem, system)
    if not np.isfinite(ground.at(east_m, north_m)):
        raise ConfigError(f"{dem} has no height at {east_m:g}, {north_m:g}", fix="check --at and --crs")
    azimuths = np.arange(0.0, 360.0)
    on_grid = azimuths + geotiff.true_north_deg(system, east_m, north_m)
    elevations = np.nan_to_num(horizon_of_ground(ground, east_m, north_m, on_grid, nearest_m))
    return list(zip(azimuths.tolist(), elevations.round(2).tolist(), strict=True))


def horizon_from_skyline(points: Path, pose: Pose, shape: tuple[int, int]) -> Horizon:
    """The horizon by pixels on the skyline of a frame (rows, cols), from the camera's place.

    Level left and right of the frame. Raises `ConfigError`.
    """
    camera = pose.camera(shape, 0.0)  # yaw is against true north
    x, y = _skyline(points, shape).T
    lines = np.stack(
        [map_coordinates(one, [y, x], order=1) for one in np.moveaxis(rays(camera), -1, 0)], axis=-1
    )
    zenith, azimuth = tilt_azimuth(lines)
    order = np.argsort((azimuth - camera.yaw_deg + 180.0) % 360.0)
    pairs = [(float(azimuth[i]), float(90.0 - zenith[i])) for i in order]
    first, last = (pairs[0][0] - 0.1) % 360.0, (pairs[-1][0] + 0.1) % 360.0
    rounded = [(round(at, 2), round(up, 2)) for at, up in pairs]
    return [(round(first, 2), 0.0), *rounded, (round(last, 2), 0.0)]


def write_horizon(path: Path, horizon: Horizon) -> None:
    """Write the CSV file that ``horizon`` of a site or region names; raises `StorageError`."""
    lines = [",".join(COLUMNS), *(f"{azimuth:g},{elevation:g}" for azimuth, elevation in horizon)]
    try:
        with replacing(path, synced=False) as file:
            file.write_text("\n".join([*lines, ""]), encoding="utf-8")
    except OSError as error:
        raise StorageError(f"cannot write {path}: {error.strerror or error}") from error


def _skyline(points: Path, shape: tuple[int, int]) -> FloatArray:
    """Pixels x, y (n, 2)."""
    rows = list(csv.DictReader(io.StringIO(read_text(points))))
    try:
        table = np.array([[float(row[name]) for name in SKYLINE] for row in rows]).reshape(-1, 2)
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigError(
            f"{points}: not a table of numbers with the columns x_px, y_px ({error})",
            fix="begin the file with x_px,y_px",
        ) from error
    inside = (table >= -0.5).all() and (table < np.array(shape[::-1]) - 0.5).all()
    if len(table) < 2 or not inside:
        raise ConfigError(f"{points}: needs two or more pixels, all within the frame", fix="check --frame")
    return table
