"""The horizon of a place from a DEM, from the skyline clicked in a frame, or by its neighbours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import map_coordinates

from fieldkit.calibrate.inputs import read_columns, write_lines
from fieldkit.calibration.ranges import require_ranges
from fieldkit.config import Config
from fieldkit.config.edit import change_region, editing, set_key
from fieldkit.config.pose import Pose, load_pose
from fieldkit.config.references import COLUMNS
from fieldkit.model.clock import utc_ns
from fieldkit.model.errors import ConfigError
from fieldkit.phrases import Words
from fieldkit.physics.camera_geometry import Grid, horizon_of_ground, rays
from fieldkit.physics.facet import tilt_azimuth
from fieldkit.physics.horizon import Horizon, higher_horizon, horizon_of_neighbours
from fieldkit.sessions.formats import geotiff


def horizon_from_dem(
    dem: str | Path, crs: str, east_m: float, north_m: float, *, nearest_m: float = 0.0
) -> Horizon:
    """The horizon of a point by a GeoTIFF of heights: (azimuth, elevation) every degree.

    `crs` is a projected system in metres; ground nearer than `nearest_m` is omitted. Raises
    `ConfigError`.

    Examples
    --------
    >>> import numpy as np, rasterio
    >>> heights = np.where(np.arange(101) < 75, 0.0, 10.0).astype("float32") * np.ones((101, 1), "float32")
    >>> corner = rasterio.Affine(1.0, 0.0, 499949.5, 0.0, -1.0, 3936250.5)
    >>> size = {"width": 101, "height": 101, "count": 1, "dtype": "float32"}
    >>> with rasterio.open("wall.tif", "w", "GTiff", crs="EPSG:32654", transform=corner, **size) as file:
    ...     file.write(heights, 1)
    >>> round(dict(fieldkit.calibrate.horizon_from_dem("wall.tif", "EPSG:32654", 500000, 3936200))[90.0])
    22
    """
    require_ranges({"nearest_m": nearest_m})
    dem = Path(dem)
    system = geotiff.projected_crs(crs)
    grid = geotiff.grid_at(system, east_m, north_m)
    ground = geotiff.read_heights(dem, system, grid.scale)
    if not np.isfinite(ground.at(east_m, north_m)):
        raise ConfigError(
            f"no height at {east_m:g}, {north_m:g}", place=dem, fix="check the place and the CRS"
        )
    azimuths = np.arange(0.0, 360.0)
    on_grid = azimuths + grid.true_north_deg
    elevations = horizon_of_ground(ground, east_m, north_m, on_grid, nearest_m)
    if unknown := int(np.isnan(elevations).sum()):
        raise ConfigError(
            f"no heights beyond the place in {unknown} of {azimuths.size} directions",
            place=dem,
            fix="take a DEM that reaches around the place",
        )
    return list(zip(azimuths.tolist(), elevations.round(2).tolist(), strict=True))


def horizon_from_skyline(
    points: str | Path, pose: str | Path, shape: tuple[int, int], *, at: datetime | None = None
) -> Horizon:
    r"""The horizon by a CSV file of pixels ``x_px,y_px`` on the skyline of a frame; raises `ConfigError`.

    `pose` is the file of a pose, `at` the frame's time if the camera moves, `shape` its rows and columns.

    Examples
    --------
    >>> from pathlib import Path
    >>> _ = Path("skyline.csv").write_text("x_px,y_px\n79.5,39.5\n119.5,59.5\n39.5,59.5\n")
    >>> place = {"east_m": 500000.0, "north_m": 3936200.0, "height_m": 2.0, "range_m": 100.0, "ground_m": 0.0}
    >>> angles = {"yaw_deg": 90.0, "pitch_deg": 0.0, "hfov_deg": 90.0}
    >>> lines = [f"{key} = {value}" for key, value in {**place, **angles}.items()]
    >>> _ = Path("pose.toml").write_text("\n".join(['crs = "EPSG:32654"', *lines]))
    >>> horizon = fieldkit.calibrate.horizon_from_skyline("skyline.csv", "pose.toml", (120, 160))
    >>> [round(elevation) for _, elevation in horizon]
    [0, 0, 14, 0, 0]
    >>> fieldkit.calibrate.write_horizon("horizon.csv", horizon)
    """
    seen_by = load_pose(Path(pose), utc_ns(at or datetime.now(UTC)))
    return horizon_of_pixels(read_columns(Path(points), ("x_px", "y_px")), seen_by, shape, str(points))


def horizon_of_pixels(
    pixels: ArrayLike, pose: Pose, shape: tuple[int, int], source: str = "skyline"
) -> Horizon:
    """The horizon by pixels (x, y) on the skyline of a frame (rows, cols), from the camera's place.

    Level left and right of them; of those above each other the highest. Raises `ConfigError`, which names
    their source.
    """
    table = np.asarray(pixels, np.float64).reshape(-1, 2)
    inside = (table >= -0.5).all() and (table < np.array(shape[::-1]) - 0.5).all()
    if len(table) < 2 or not inside:
        raise ConfigError(Words("error.skyline"), place=source, fix="check the size of the frame")
    camera = pose.camera(shape, Grid())  # yaw is against true north
    x, y = table.T
    lines = np.stack(
        [map_coordinates(component, [y, x], order=1) for component in np.moveaxis(rays(camera), -1, 0)],
        axis=-1,
    )
    zenith, azimuth = tilt_azimuth(lines)
    order = np.argsort((azimuth - camera.yaw_deg + 180.0) % 360.0)
    pairs = [(float(azimuth[i]), float(90.0 - zenith[i])) for i in order]
    first, last = (pairs[0][0] - 0.1) % 360.0, (pairs[-1][0] + 0.1) % 360.0
    highest: dict[float, float] = {}
    for at, up in ((round(at, 2) % 360.0, round(up, 2)) for at, up in pairs):
        highest[at] = max(up, highest.get(at, up))
    return [(round(first, 2), 0.0), *highest.items(), (round(last, 2), 0.0)]


def horizons_of_regions(config: Config) -> dict[str, Horizon]:
    """The horizon of each region on the ground that another one rises above, with the site's, by name.

    Corners are the tops of beds; a region counts as shaded where any part of it is. Raises `ConfigError`.
    """
    beds = {region.name: np.array(region.points_m) for region in config.regions if region.points_m}
    if config.pose is None or len(beds) < 2:
        raise ConfigError(
            "regions that shade each other: give two or more with corners on the ground",
            fix="give regions points_m = [[east, north, height], ...], and [camera] a pose",
        )
    system = geotiff.projected_crs(config.pose.table.crs)
    site = config.estimator_settings().horizon
    horizons: dict[str, Horizon] = {}
    for name, bed in beds.items():
        grid = geotiff.grid_at(system, *bed[0, :2])
        on_ground = (grid.scale, grid.scale, 1.0)
        others = [other / on_ground for its_name, other in beds.items() if its_name != name]
        over = horizon_of_neighbours(bed / on_ground, others)
        if max(up for _, up in over) > 0.0:
            on_site = [(float((at - grid.true_north_deg) % 360.0), up) for at, up in over]
            horizons[name] = _thin(higher_horizon(on_site, site))
    return horizons


def set_skyline(
    config: Config, pixels: Sequence[tuple[float, float]], shape: tuple[int, int], time_ns: int
) -> Horizon:
    """Write the skyline of a frame as ``skyline.csv`` and name it as the site's horizon.

    Seen by ``camera.pose`` at a time (UTC nanoseconds). Raises `ConfigError`.
    """
    if config.pose is None:
        raise ConfigError(Words("error.no_pose"), fix=Words("fix.pose"))
    horizon = horizon_of_pixels(pixels, config.pose.at(time_ns), shape)
    file = config.path.parent / "skyline.csv"  # its own: a surveyed horizon.csv stays
    write_horizon(file, horizon)
    with editing(config.path) as draft:
        set_key(draft, "site", "horizon", file.name)
    return horizon


def set_horizons(file: Path, horizons: Mapping[str, Horizon]) -> list[Path]:
    """Write ``horizon-REGION.csv`` beside a ``fieldkit.toml`` and name each in its region; the files."""
    files = []
    with editing(file) as draft:
        for name, horizon in horizons.items():
            files.append(file.parent / f"horizon-{name}.csv")
            write_horizon(files[-1], horizon)
            change_region(draft, name, {"horizon": files[-1].name})
    return files


def _thin(horizon: Horizon) -> Horizon:
    """Rounded for a file, without points amid others of the same elevation."""
    rounded = {round(at, 3) % 360.0: round(up, 2) for at, up in horizon}
    pairs = sorted(rounded.items())
    up = np.array([elevation for _, elevation in pairs])
    turns = (up != np.roll(up, 1)) | (up != np.roll(up, -1))
    return [pair for pair, is_turn in zip(pairs, turns, strict=True) if is_turn] or pairs[:1]


def write_horizon(path: str | Path, horizon: Horizon) -> None:
    """Write the CSV file that ``horizon`` of a site or region names; raises `StorageError`.

    Examples
    --------
    >>> fieldkit.calibrate.write_horizon("horizon.csv", [(80.0, 0.0), (90.0, 14.0), (100.0, 0.0)])
    """
    lines = [",".join(COLUMNS), *(f"{azimuth:g},{elevation:g}" for azimuth, elevation in horizon)]
    write_lines(Path(path), lines)
