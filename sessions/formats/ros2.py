"""Shared parts of all messages for ROS 2: their writer, their definitions, stamps and headers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import IO, TYPE_CHECKING, Any

from fieldkit.model.errors import ConfigError

if TYPE_CHECKING:
    from mcap_ros2.writer import Writer

_PARTS = {
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
}


def ros2_writer(file: IO[bytes]) -> Writer:
    """A writer of typed MCAP. Raises `ConfigError` where its package is not installed."""
    try:
        from mcap_ros2.writer import Writer
    except ImportError as error:
        raise ConfigError(
            "MCAP of ROS 2 needs mcap-ros2-support", fix="pip install 'fieldkit[terrain]'"
        ) from error
    return Writer(file)


def definition(parts: Mapping[str, str]) -> str:
    """A message and what it is made of, each after a line of 80 equal signs, as rosbag2 stores them."""
    own, *others = {**parts, **_PARTS}.items()
    return f"\n{'=' * 80}\n".join([own[1], *(f"MSG: {name}\n{text}" for name, text in others)])


def time(time_ns: int) -> dict[str, int]:
    """A stamp, of UTC nanoseconds since 1970."""
    return {"sec": time_ns // 10**9, "nanosec": time_ns % 10**9}


def header(time_ns: int, frame_id: str) -> dict[str, Any]:
    """A header: when, and in which frame of reference."""
    return {"stamp": time(time_ns), "frame_id": frame_id}
