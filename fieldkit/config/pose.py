"""Where the camera stood and looked, and the ground before it: a small TOML file of its own.

It is not part of ``fieldkit.toml``: a pose is often surveyed after the recording.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError

from fieldkit.config.load import read_text
from fieldkit.config.toml_schema import Table
from fieldkit.config.trajectory import ANGLES, PLACE, load_trajectory, require_unit
from fieldkit.model.errors import ConfigError
from fieldkit.physics.camera_geometry import Camera, angles_of_quaternion


class PoseFile(Table):
    """A pose, by its keys; angles against true north and the horizon."""

    crs: str
    east_m: float
    north_m: float
    height_m: float
    yaw_deg: float = Field(ge=-360, le=360)
    pitch_deg: float = Field(ge=-90, le=90)
    roll_deg: float = Field(default=0.0, ge=-180, le=180)
    hfov_deg: float = Field(gt=0, lt=180)
    distortion: Annotated[list[float], Field(min_length=5, max_length=5)] | None = None
    range_m: float = Field(gt=0, le=10_000)
    ground_m: float | None = None
    dem: str | None = None

    def camera(self, shape: tuple[int, int], true_north_deg: float) -> Camera:
        """The camera in the axes of the grid, whose true north lies in a direction clockwise of its own."""
        place = (self.east_m, self.north_m, self.height_m)
        yaw = self.yaw_deg + true_north_deg
        lens = tuple(self.distortion or ())
        return Camera(place, yaw, self.pitch_deg, self.roll_deg, self.hfov_deg, shape, lens)


def load_pose(path: Path, time_ns: int) -> PoseFile:
    """Read a pose at a time (UTC nanoseconds), which only matters if the file names a trajectory.

    ``dem`` becomes a path beside the file, ``trajectory`` and ``quaternion`` place and angles. Raises
    `ConfigError`.
    """
    try:
        document = _at_time(tomllib.loads(read_text(path)), path, time_ns)
        pose = PoseFile.model_validate(_with_angles(document, path))
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: {error}", fix=f"correct {path}") from error
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise ConfigError(f"{path}: {key}: {first['msg']}", fix=f"correct {key} in {path}") from None
    if (pose.ground_m is None) == (pose.dem is None):
        raise ConfigError(
            f"{path} needs either ground_m, the height of level ground, or dem, a GeoTIFF of heights",
            fix=f"give one of the two in {path}",
        )
    if pose.dem is None:
        return pose
    return pose.model_copy(update={"dem": str(path.parent / pose.dem)})


def _at_time(document: dict[str, Any], path: Path, time_ns: int) -> dict[str, Any]:
    """The document with the place and quaternion of its trajectory at that time, if it has one."""
    if "trajectory" not in document:
        return document
    name = document.pop("trajectory")
    if twice := [key for key in (*PLACE, "quaternion", *ANGLES) if key in document]:
        raise ConfigError(f"{path} has both trajectory and {', '.join(twice)}", fix=f"keep one in {path}")
    if not isinstance(name, str):
        raise ConfigError(f"{path}: trajectory: a file is needed", fix=f"correct trajectory in {path}")
    place, quaternion = load_trajectory(path.parent / name).at(time_ns)
    return document | dict(zip(PLACE, place.tolist(), strict=True)) | {"quaternion": quaternion.tolist()}


def _with_angles(document: dict[str, Any], path: Path) -> dict[str, Any]:
    """The document with the angles of its quaternion, if it has one."""
    if "quaternion" not in document:
        return document
    given = document.pop("quaternion")
    fix = f"correct quaternion in {path}"
    if angles := [name for name in ANGLES if name in document]:
        raise ConfigError(f"{path} has both quaternion and {', '.join(angles)}", fix=f"keep one in {path}")
    if not (isinstance(given, list) and len(given) == 4 and all(type(one) in (int, float) for one in given)):
        raise ConfigError(f"{path}: quaternion: four numbers x, y, z, w are needed", fix=fix)
    try:
        require_unit(given)
    except ValueError as error:
        raise ConfigError(f"{path}: {error}", fix=fix) from None
    return document | dict(zip(ANGLES, angles_of_quaternion(given), strict=True))
