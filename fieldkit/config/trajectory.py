"""Pose of a camera over time: CSV with a header, or TUM's format.

TUM's format is that of its RGB-D benchmark (Sturm et al., IROS 2012): a line ``timestamp tx ty tz qx qy qz
qw`` for each pose, timestamps in seconds since 1970, comments behind ``#``.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from decimal import Decimal, InvalidOperation
from functools import lru_cache

from fieldkit.model.clock import utc_ns
from fieldkit.model.errors import ConfigError
from fieldkit.model.units import SECOND_NS
from fieldkit.physics.camera_geometry import quaternion_of_angles
from fieldkit.physics.trajectory import Point, Quaternion, Trajectory

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
            raise _wrong(name, line, str(error) or "not a number") from error
        if poses and pose[0] <= poses[-1][0]:
            raise _wrong(name, line, "its time is not after that of the pose before")
        poses.append(pose)
    if len(poses) < 2:
        raise ConfigError(f"holds {len(poses)} poses", place=name, fix="a trajectory needs two or more")
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
    time_ns = _unix_ns(row["timestamp"]) if "timestamp" in row else _utc_ns(row["time"])
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


def _utc_ns(text: str) -> int:
    time = datetime.fromisoformat(text)
    if time.tzinfo is None:
        raise ValueError(f"the time {text} has no offset from UTC, such as Z")
    return utc_ns(time)


def _unix_ns(text: str) -> int:
    seconds = Decimal(text)
    if not abs(seconds) < 2**63 // SECOND_NS:
        raise ValueError(f"{text} s since 1970 is no time of a recording")
    return round(seconds * SECOND_NS)


def _wrong(name: str, line: int, what: str) -> ConfigError:
    return ConfigError(f"{name}:{line}: {what}", fix=f"correct line {line} of {name}")


def _iso(time_ns: int) -> str:
    return datetime.fromtimestamp(time_ns / SECOND_NS, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
