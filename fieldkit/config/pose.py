"""Pose of the camera and the ground before it: ``[camera.pose]``, or a file with its keys.

``camera.pose = "pose.toml"`` becomes the table in that file and ``trajectory = "run.csv"`` the text of that
one, so that a session holds them itself; a DEM stays a file.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from fieldkit.config.files import read_text
from fieldkit.config.references import campaign_folder
from fieldkit.config.toml_lines import table_in
from fieldkit.config.toml_schema import PoseTable, expected, node_at
from fieldkit.config.trajectory import ANGLES, PLACE, outside, require_unit, trajectory_from
from fieldkit.config.validation import Mistake
from fieldkit.model.errors import ConfigError
from fieldkit.physics.camera_geometry import Camera, Grid, angles_of_quaternion, quaternion_of_angles
from fieldkit.physics.trajectory import CameraPath, Point, Trajectory

KEY = ("camera", "pose")


@dataclass(frozen=True, slots=True)
class Pose:
    """A camera at one time; angles against true north and the horizon, degrees."""

    table: PoseTable
    position_m: Point
    yaw_deg: float
    pitch_deg: float
    roll_deg: float
    dem: Path | None

    def camera(self, shape: tuple[int, int], grid: Grid) -> Camera:
        """The camera in the axes of a grid."""
        lens = tuple(self.table.distortion or ())
        angles = self.yaw_deg + grid.true_north_deg, self.pitch_deg, self.roll_deg
        return Camera(self.position_m, *angles, self.table.hfov_deg, shape, lens, grid.scale)


@dataclass(frozen=True, slots=True)
class CameraPose:
    """A checked pose, constant or along a trajectory; `dem` is a file in `folder`."""

    table: PoseTable
    folder: Path

    @property
    def trajectory(self) -> Trajectory:
        """Its poses; a constant one is a single pose."""
        table = self.table
        if table.trajectory is not None:
            return trajectory_from(table.trajectory, "trajectory")
        east_m, north_m, height_m = (getattr(table, name) for name in PLACE)
        angles = [getattr(table, name) or 0.0 for name in ANGLES]
        x, y, z, w = table.quaternion or quaternion_of_angles(*angles)
        return Trajectory((0,), ((east_m, north_m, height_m),), ((x, y, z, w),))

    def at(self, time_ns: int) -> Pose:
        """The pose at a time; raises `ConfigError` where the trajectory has none."""
        if (found := self.trajectory.at(time_ns)) is None:
            raise outside(self.trajectory, time_ns, "the trajectory")
        position_m, quaternion = found
        dem = None if self.table.dem is None else self.folder / self.table.dem
        return Pose(self.table, position_m, *angles_of_quaternion(quaternion), dem)

    def path(self, grid: Grid) -> CameraPath:
        """The camera over time, in the axes of a grid."""
        lens = tuple(self.table.distortion or ())
        return CameraPath(self.trajectory, self.table.hfov_deg, lens, grid.true_north_deg, grid.scale)


def read_pose(path: Path) -> CameraPose:
    """Read a file with the keys of ``[camera.pose]``. Raises `ConfigError`."""
    return CameraPose(_table_in(path), path.parent)


def load_pose(path: Path, time_ns: int) -> Pose:
    """The pose in a file at a time (UTC nanoseconds), which only matters if the file names a trajectory.

    Raises `ConfigError`.
    """
    return read_pose(path).at(time_ns)


def with_pose(values: dict[str, Any], path: Path) -> list[Mistake]:
    """Replace the files that ``camera.pose`` names by what is in them; returns the mistakes.

    They lie in the campaign of `path`, a ``fieldkit.toml`` or a session.
    """
    camera, folder = table_in(values, "camera"), campaign_folder(path)
    pose = camera.get("pose")
    if not isinstance(pose, str | dict):
        return []
    try:
        if isinstance(pose, str) and pose:
            table = _table_in(folder / pose).model_dump(exclude_none=True)
            if "dem" in table:
                table["dem"] = (Path(pose).parent / table["dem"]).as_posix()
            camera["pose"] = table
        elif pose and (wrong := list(_contradictions(pose))):
            return [Mistake((*KEY, key), message) for key, message in wrong]
        elif pose:
            camera["pose"] = _with_trajectory(pose, folder)
        else:
            del camera["pose"]
    except ConfigError as error:
        return [Mistake(KEY, error.message)]
    return []


def _table_in(path: Path) -> PoseTable:
    try:
        values = tomllib.loads(read_text(path))
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(str(error), place=path, fix=f"correct {path}") from error
    return pose_table(values, path)


def pose_table(values: dict[str, Any], path: Path) -> PoseTable:
    """The checked table with these keys, of a file at `path`; raises `ConfigError` with the first mistake."""
    for key, message in _contradictions(values):
        raise ConfigError(f"{key}: {message}", place=path, fix=f"correct {key} in {path}")
    try:
        return PoseTable.model_validate(_with_trajectory(values, path.parent))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise ConfigError(f"{key}: {first['msg']}", place=path, fix=f"correct {key} in {path}") from None


def _with_trajectory(values: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The table with the text of its trajectory."""
    name = values.get("trajectory")
    if not isinstance(name, str) or _is_text(name):
        return dict(values)
    text = read_text(folder / name)
    trajectory_from(text, str(folder / name))
    return {**values, "trajectory": text}


def _is_text(trajectory: str) -> bool:
    """True if it is what stands in a file of poses, two lines or more, not its name."""
    return "\n" in trajectory


def _contradictions(values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Mistakes between keys of a table, each with a key; malformed values are the schema's."""
    turned = "quaternion" if "quaternion" in values else "yaw_deg"
    needed = () if "trajectory" in values else (*PLACE, turned, *(ANGLES[1:2] if turned in ANGLES else ()))
    for key in needed:
        if key not in values:
            yield key, f"missing; expected {expected(node_at((*KEY, key)))}"
    for key, others in (("trajectory", (*PLACE, "quaternion", *ANGLES)), ("quaternion", ANGLES)):
        if key in values and (twice := [other for other in others if other in values]):
            yield key, f"both {key} and {', '.join(twice)} are given; keep one"
    if ("ground_m" in values) == ("dem" in values):
        yield "ground_m", "give either ground_m, the height of level ground, or dem, a GeoTIFF of heights"
    if isinstance(text := values.get("trajectory"), str) and _is_text(text):
        try:
            trajectory_from(text, "trajectory")
        except ConfigError as error:
            yield "trajectory", error.message
    if "quaternion" in values:
        try:
            require_unit(values["quaternion"])
        except (TypeError, ValueError) as error:
            yield "quaternion", str(error)
