"""A session for ROS 2 in one MCAP: frames as ``sensor_msgs/Image``, readings and events as their own types.

A frame is 32FC1 in kelvin of brightness temperature where the camera's law is known, else mono16 counts.
Temperatures are in °C, as ``sensor_msgs/Temperature`` has them. Needs ``fieldkit[terrain]``.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import Event, Frame, Reading, Severity
from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.physics.camera_laws import frame_k, has_temperatures
from fieldkit.sessions.analysis import channel_names
from fieldkit.sessions.formats.ros2 import definition, header, ros2_writer, time
from fieldkit.sessions.reader import SessionReader

_DEFINITIONS = {
    "sensor_msgs/msg/Image": "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\n"
    "uint8 is_bigendian\nuint32 step\nuint8[] data",
    "sensor_msgs/msg/Temperature": "std_msgs/Header header\nfloat64 temperature\nfloat64 variance",
    "sensor_msgs/msg/Illuminance": "std_msgs/Header header\nfloat64 illuminance\nfloat64 variance",
    "std_msgs/msg/Float64": "float64 data",
    "rcl_interfaces/msg/Log": "byte DEBUG=10\nbyte INFO=20\nbyte WARN=30\nbyte ERROR=40\nbyte FATAL=50\n"
    "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\nstring function\n"
    "uint32 line",
}
_LEVELS = {Severity.INFO: 20, Severity.WARNING: 30, Severity.ERROR: 40}
Message = tuple[str, str, dict[str, Any]]
"""Topic, type and fields."""


def export_ros2(
    session: SessionReader, folder: Path, *, stream: str | None = None, every: int = 1
) -> list[Path]:
    """One ``-ros2.mcap`` with all streams, or the one named; of frames every n-th.

    Raises `ConfigError` where the package that writes it is not installed.
    """
    path = folder / f"{session.path.stem}{'' if stream is None else f'-{stream}'}-ros2.mcap"
    names = tuple(session.streams) if stream is None else (session.stream(stream).info.name,)
    with path.open("wb") as file, ros2_writer(file) as writer:
        schemas = {
            kind: writer.register_msgdef(kind, definition({"": text})) for kind, text in _DEFINITIONS.items()
        }
        for item in heapq.merge(session.samples(*names), session.events(), key=lambda item: item.mono_ns):
            if not isinstance(item, Frame) or item.seq % every == 0:
                for topic, kind, fields in _messages(item, session.streams):
                    writer.write_message(topic, schemas[kind], fields, item.time_ns, item.time_ns)
    return [path]


def _messages(item: Frame | Reading | Event, streams: Mapping[str, StreamInfo]) -> Iterator[Message]:
    if isinstance(item, Event):
        yield "/rosout", "rcl_interfaces/msg/Log", _log(item)
    elif isinstance(item, Frame):
        yield f"/{item.stream}/image_raw", "sensor_msgs/msg/Image", _image(item, streams[item.stream])
    else:
        yield from _readings(item, streams[item.stream])


def _log(event: Event) -> dict[str, Any]:
    return {
        "stamp": time(event.time_ns), "level": _LEVELS.get(event.severity, 30), "name": event.stream,
        "msg": event.text, "file": "", "function": event.kind.name.lower(), "line": 0,
    }  # fmt: skip


def _image(frame: Frame, info: StreamInfo) -> dict[str, Any]:
    known = has_temperatures(info)
    pixels = (
        frame_k(info, frame.counts, frame.metadata_rows, np.float32).astype("<f4")
        if known
        else frame.counts.astype("<u2")
    )
    rows, cols = pixels.shape
    return {
        "header": header(frame.time_ns, frame.stream), "height": rows, "width": cols,
        "encoding": "32FC1" if known else "mono16", "is_bigendian": 0, "step": cols * pixels.itemsize,
        "data": pixels.tobytes(),
    }  # fmt: skip


def _readings(reading: Reading, info: StreamInfo) -> Iterator[Message]:
    """A message for each channel; a variance of 0 is unknown, as ROS has it."""
    variance = info.accuracy**2 if math.isfinite(info.accuracy) else 0.0
    head = header(reading.time_ns, reading.stream)
    for name, value in zip(channel_names(info), reading.values, strict=True):
        topic = f"/{reading.stream}/{_name(name)}"
        match info.unit:
            case "K":
                fields = {"header": head, "temperature": value - CELSIUS_ZERO_K, "variance": variance}
                yield topic, "sensor_msgs/msg/Temperature", fields
            case "lx":
                fields = {"header": head, "illuminance": value, "variance": variance}
                yield topic, "sensor_msgs/msg/Illuminance", fields
            case _:
                yield topic, "std_msgs/msg/Float64", {"data": value}


def _name(channel: str) -> str:
    """A channel as a part of a topic: letters, digits and underscores, no digit first."""
    name = "".join(one if one.isascii() and one.isalnum() else "_" for one in channel)
    return f"_{name}" if name[:1].isdigit() else name
