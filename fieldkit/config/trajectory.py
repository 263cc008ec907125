"""Where a camera was and looked over time: a CSV file with a header, or a trajectory in TUM's format.

TUM's format is that of its RGB-D benchmark (Sturm et al., IROS 2012): a line ``timestamp tx ty tz qx qy qz
qw`` for each pose, timestamps in seconds since 1970, comments behind ``#``.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from fieldkit.config.load import read_text
from fieldkit.model.errors import ConfigError
from fieldkit.model.units import SECOND_NS
from fieldkit.physics.camera_geometry import quaternion_of_angles
from fieldkit.physics.facet import FloatArray

UNIT_WITHIN = 1e-3
"""How far the length of a quaternion may be off one: three digits of each component."""
PLACE = ("east_m", "north_m", "height_m")
QUATERNION = ("qx", "qy", "qz", "qw")
ANGLES = ("yaw_deg", "pitch_deg", "roll_deg")


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Poses in order of time: UTC nanoseconds (n,), east, north, up in metres (n, 3), quaternions (n, 4)."""

    path: Path
    time_ns: NDArray[np.int64]
    position_m: FloatArray
    quaternion: FloatArray

    def at(self, time_ns: int) -> tuple[FloatArray, FloatArray]:
        """Position (3,) and quaternion (4,) at a time, turned evenly between two poses.

        Raises `ConfigError` for a time before the first or after the last.
        """
        first, last = int(self.time_ns[0]), int(self.time_ns[-1])
        if not first <= time_ns <= last:
            raise ConfigError(
                f"{self.path} holds poses from {_iso(first)} to {_iso(last)}, none of {_iso(time_ns)}",
                fix="give the trajectory of this session, its times in UTC",
            )
        since_s = (self.time_ns - first) / SECOND_NS
        now_s = (time_ns - first) / SECOND_NS
        place = [np.interp(now_s, since_s, one) for one in self.position_m.T]
        return np.array(place), Slerp(since_s, Rotation.from_quat(self.quaternion))(now_s).as_quat()


def load_trajectory(path: Path) -> Trajectory:
    """Read a trajectory: CSV if its name ends so, else TUM's format. Raises `ConfigError`."""
    poses: list[tuple[int, list[float], list[float]]] = []
    for line, row in _rows(path, read_text(path)):
        try:
            pose = _pose(row)
        except KeyError as error:
            raise _wrong(path, line, f"no {error.args[0]}") from error
        except (ValueError, TypeError, InvalidOperation) as error:
            raise _wrong(path, line, str(error) or "not a number") from error
        if poses and pose[0] <= poses[-1][0]:
            raise _wrong(path, line, "its time is not after that of the pose before")
        poses.append(pose)
    if len(poses) < 2:
        raise ConfigError(f"{path} holds {len(poses)} poses", fix="a trajectory needs two or more")
    times, places, quaternions = zip(*poses, strict=True)
    return Trajectory(path, np.array(times, np.int64), np.array(places), np.array(quaternions))


def require_unit(quaternion: Sequence[float]) -> None:
    """Raise `ValueError` unless the length of a quaternion is one."""
    if not abs((length := math.hypot(*quaternion)) - 1.0) <= UNIT_WITHIN:
        raise ValueError(f"quaternion: its length is {length:.4g}, not 1")


def _rows(path: Path, text: str) -> Iterator[tuple[int, Mapping[str, str]]]:
    """Each pose by the names of its columns, with its line."""
    if path.suffix.lower() == ".csv":
        table = csv.DictReader(io.StringIO(text))
        for row in table:
            yield table.line_num, row
        return
    for number, line in enumerate(text.splitlines(), start=1):
        if values := line.partition("#")[0].split():
            yield number, dict(zip(("timestamp", *PLACE, *QUATERNION), values, strict=False))


def _pose(row: Mapping[str, str]) -> tuple[int, list[float], list[float]]:
    time_ns = round(Decimal(row["timestamp"]) * SECOND_NS) if "timestamp" in row else _utc_ns(row["time"])
    place = [float(row[name]) for name in PLACE]
    if ANGLES[0] in row:
        angles = [float(row[name]) for name in ANGLES]
        if not all(map(math.isfinite, (*place, *angles))):
            raise ValueError("a value is not finite")
        return time_ns, place, quaternion_of_angles(*angles)
    quaternion = [float(row[name]) for name in QUATERNION]
    require_unit(quaternion)
    if not all(map(math.isfinite, place)):
        raise ValueError("a value is not finite")
    return time_ns, place, quaternion


def _utc_ns(text: str) -> int:
    time = datetime.fromisoformat(text)
    if time.tzinfo is None:
        raise ValueError(f"the time {text} has no offset from UTC, such as Z")
    return round(Decimal(str(time.timestamp())) * SECOND_NS)


def _wrong(path: Path, line: int, what: str) -> ConfigError:
    return ConfigError(f"{path}:{line}: {what}", fix=f"correct line {line} of {path}")


def _iso(time_ns: int) -> str:
    return datetime.fromtimestamp(time_ns / SECOND_NS, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
