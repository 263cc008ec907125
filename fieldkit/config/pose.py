"""Pose of the camera and the ground before it: ``[camera.pose]``, or a file with its keys; its trajectory.

A trajectory is a CSV with a header, or of TUM's format.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from decimal import Decimal, InvalidOperation
from functools import lru_cache
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from fieldkit.config.files import table_in
from fieldkit.config.references import campaign_folder
from fieldkit.config.toml_schema import PoseTable, describe_value, node_at
from fieldkit.config.validation import Mistake
from fieldkit.model.clock import as_moment, utc_ns
from fieldkit.model.errors import ConfigError, message_of
from fieldkit.model.text_file import parse_toml, read_text
from fieldkit.model.units import SECOND_NS
from fieldkit.physics.camera_geometry import Camera, Grid, angles_of_quaternion, quaternion_of_angles
from fieldkit.physics.trajectory import CameraPath, Point, Quaternion, Trajectory

UNIT_WITHIN = 1e-3
"""Tolerance of the length of a quaternion: three digits of each component."""
PLACE = ("east_m", "north_m", "height_m")
QUATERNION = ("qx", "qy", "qz", "qw")
ANGLES = ("yaw_deg", "pitch_deg", "roll_deg")


@lru_cache(maxsize=4)
def trajectory_from(text: str, name: str) -> Trajectory:
    """The trajectory in a text, `name` for errors: CSV if it begins with names of columns, else TUM's format.

    Raises `ConfigError`.
    """
    poses: list[tuple[int, Point, Quaternion]] = []
    for line, row in _rows(text):
        try:
            pose = _pose(row)
        except KeyError as error:
            raise _wrong(name, line, f"no {error.args[0]}") from error
        except (ValueError, TypeError, InvalidOperation) as error:
            raise _wrong(name, line, message_of(error) or "not a number") from error
        if poses and pose[0] <= poses[-1][0]:
            raise _wrong(name, line, "its time is not after that of the pose before")
        poses.append(pose)
    if len(poses) < 2:
        raise ConfigError(
            f"holds {len(poses)} poses", place=name, fix="give a trajectory two positions or more"
        )
    times, places, quaternions = zip(*poses, strict=True)
    return Trajectory(times, places, quaternions)


def require_unit(quaternion: Sequence[float]) -> None:
    """Raise `ValueError` unless it is a quaternion whose length is one."""
    if len(quaternion) != 4:
        raise ValueError("four numbers x, y, z, w are needed")
    if not abs((length := math.hypot(*quaternion)) - 1.0) <= UNIT_WITHIN:
        raise ValueError(f"quaternion: its length is {length:.4g}, not 1")


def outside(trajectory: Trajectory, time_ns: int, name: str) -> ConfigError:
    """The error for a time of which a trajectory has no pose."""
    first, last = trajectory.time_ns[0], trajectory.time_ns[-1]
    return ConfigError(
        f"holds poses from {_iso(first)} to {_iso(last)}, none of {_iso(time_ns)}",
        place=name,
        fix="give the trajectory of this session, its times in UTC",
    )


def _rows(text: str) -> Iterator[tuple[int, Mapping[str, str]]]:
    """Each pose by the names of its columns, with its line."""
    if "time" in text.partition("\n")[0].split(","):
        table = csv.DictReader(io.StringIO(text))
        for row in table:
            yield table.line_num, row
        return
    for number, line in enumerate(text.splitlines(), start=1):
        if values := line.partition("#")[0].split():
            yield number, dict(zip(("timestamp", *PLACE, *QUATERNION), values, strict=False))


def _pose(row: Mapping[str, str]) -> tuple[int, Point, Quaternion]:
    time_ns = _unix_ns(row["timestamp"]) if "timestamp" in row else utc_ns(as_moment(row["time"]))
    east, north, up = (float(row[name]) for name in PLACE)
    if ANGLES[0] in row:
        angles = [float(row[name]) for name in ANGLES]
        _require_finite(east, north, up, *angles)
        x, y, z, w = quaternion_of_angles(*angles)
    else:
        x, y, z, w = (float(row[name]) for name in QUATERNION)
        require_unit((x, y, z, w))
        _require_finite(east, north, up)
    return time_ns, (east, north, up), (x, y, z, w)


def _require_finite(*values: float) -> None:
    if not all(map(math.isfinite, values)):
        raise ValueError("a value is not finite")


def _unix_ns(text: str) -> int:
    seconds = Decimal(text)
    if not abs(seconds) < 2**63 // SECOND_NS:
        raise ValueError(f"{text} s since 1970 is no time of a recording")
    return round(seconds * SECOND_NS)


def _wrong(name: str, line: int, what: str) -> ConfigError:
    return ConfigError(what, place=f"{name}:{line}", fix=f"correct line {line} of {name}")


def _iso(time_ns: int) -> str:
    return datetime.fromtimestamp(time_ns / SECOND_NS, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


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
    return CameraPose(pose_table(parse_toml(read_text(path), path), path), path.parent)


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
            table = read_pose(folder / pose).table.model_dump(exclude_none=True)
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


def pose_table(values: dict[str, Any], path: Path) -> PoseTable:
    """The checked table with these keys, of a file at `path`; raises `ConfigError` with the first mistake."""
    for key, message in _contradictions(values):
        raise ConfigError(message, place=f"{path}, {key}", fix=f"correct {key} in {path}")
    try:
        return PoseTable.model_validate(_with_trajectory(values, path.parent))
    except ValidationError as error:
        key, _, problem = message_of(error).partition(": ")
        raise ConfigError(problem, place=f"{path}, {key}", fix=f"correct {key} in {path}") from None


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
            yield key, f"missing; expected {describe_value(node_at((*KEY, key)))}"
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
