"""The pose of a camera from ground points marked in its frame, as a file for ``fieldkit map --pose``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tomlkit

from fieldkit.calibrate.inputs import read_columns, write_lines
from fieldkit.calibration.pose import QUANTITIES, PoseFit, fit_pose
from fieldkit.calibration.ranges import require_ranges
from fieldkit.config.pose import pose_table
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.physics.camera_geometry import Grid
from fieldkit.sessions.formats import geotiff

COLUMNS = ("x_px", "y_px", "east_m", "north_m", "height_m")


@dataclass(frozen=True, slots=True)
class PoseCalibration:
    """A pose and its reference system, with its true north and scale there."""

    fit: PoseFit
    crs: str
    grid: Grid

    @property
    def values(self) -> dict[str, float]:
        """The pose by the names of `QUANTITIES`, its yaw against true north."""
        camera = self.fit.camera
        yaw = (camera.yaw_deg - self.grid.true_north_deg) % 360.0
        numbers = (*camera.position_m, yaw, camera.pitch_deg, camera.roll_deg, camera.hfov_deg)
        return dict(zip(QUANTITIES, numbers, strict=True))

    def write(self, path: Path, *, range_m: float, ground_m: float | None, dem: str | None) -> None:
        """Write the pose with its uncertainties and its ground.

        Raises `ConfigError` for what no pose can have, `StorageError`.
        """
        table = tomlkit.document()
        table["crs"] = self.crs
        for name, value in self.values.items():
            table[name] = tomlkit.item(round(value, 4))
            if sd := self.fit.sd[name]:
                table[name].comment(f"standard uncertainty {sd:.2g}")
        if self.fit.camera.distortion:
            table["distortion"] = list(self.fit.camera.distortion)
        table["range_m"] = range_m
        table.update({"ground_m": ground_m} if dem is None else {"dem": dem})
        pose_table(table.unwrap(), path)
        if ground_m is not None and ground_m >= self.values["height_m"]:
            height = f"{self.values['height_m']:.1f} m"
            raise ConfigError(
                f"not below the camera at {height}",
                place=Argument("ground_m", ground_m),
                fix="give the height of level ground",
            )
        write_lines(path, [tomlkit.dumps(table).rstrip()])


def pose(
    points: Path, crs: str, shape: tuple[int, int], *, hfov_deg: float | None = None, mark_sd_px: float = 1.0,
    distortion: tuple[float, ...] = (),
) -> PoseCalibration:  # fmt: skip
    """Find the pose of a camera.

    Parameters
    ----------
    points
        CSV file with the columns of `COLUMNS`, a row for each marked point.
    crs
        Projected system of the points in metres, such as ``EPSG:32654``.
    shape
        Rows and columns of a frame.
    hfov_deg
        Horizontal field of view; found as well if it is not given. [degrees]
    mark_sd_px
        Standard uncertainty of a mark. [pixels]
    distortion
        k1, k2, p1, p2, k3 of the lens, from a calibration of its own; none by default. [-]

    Raises
    ------
    ConfigError
        If the file or the reference system is wrong.
    CalibrationError
        If the points do not determine the pose.

    Examples
    --------
    >>> from pathlib import Path
    >>> points = Path("points.csv")
    >>> _ = points.write_text('''x_px,y_px,east_m,north_m,height_m
    ... 52.4,104.5,354602.0,3936215.0,100.0
    ... 94.0,71.4,354608.0,3936217.0,101.5
    ... 57.0,53.8,354606.0,3936228.0,100.2
    ... 88.0,27.0,354614.0,3936232.0,103.0
    ... 94.7,71.4,354610.0,3936221.0,99.0
    ... ''')
    >>> pose = fieldkit.calibrate.pose(points, "EPSG:32654", (120, 160), hfov_deg=50.0)
    >>> {name: round(value) for name, value in pose.values.items()}
    {'east_m': 354600, 'north_m': 3936200, 'height_m': 112, 'yaw_deg': 19, 'pitch_deg': -25, 'roll_deg': 4,
     'hfov_deg': 50}
    """
    require_ranges({"hfov_deg": hfov_deg, "mark_sd_px": mark_sd_px})
    system = geotiff.projected_crs(crs)
    table = read_columns(points, COLUMNS)
    grid = geotiff.grid_at(system, *table[:, 2:4].mean(axis=0)) if len(table) else Grid()
    fit = fit_pose(
        table[:, :2], table[:, 2:], shape, hfov_deg=hfov_deg, mark_sd_px=mark_sd_px, distortion=distortion,
        grid_scale=grid.scale,
    )  # fmt: skip
    return PoseCalibration(fit, crs, grid)
