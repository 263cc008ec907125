"""MCAP files with ROS 2 messages: a session, or layers on the ground.

No ROS is needed to write them; ``ros2 bag play``, rviz, Foxglove and the ``mcap`` package read them, because
the definitions of all messages stand in the file. Frames are 32FC1 in kelvin of brightness temperature where
the camera's law is known, else mono16 counts; temperatures are in °C, as ``sensor_msgs/Temperature`` has
them. What ROS has no message for is in messages of ``fieldkit_msgs``: each sample as it was recorded, slopes,
and the details of events. On the ground x is east, y north.
"""

from __future__ import annotations

import heapq
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from pydantic_core import to_json

from fieldkit.disk import replacing
from fieldkit.model.arrays import SingleArray
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError
from fieldkit.model.installation import install_extra
from fieldkit.model.samples import Event, Frame, Reading, Severity
from fieldkit.model.slope import SLOPE_FIELDS, SlopeEstimate
from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.physics.camera_geometry import Heights
from fieldkit.physics.camera_laws import frame_k, has_temperatures
from fieldkit.sessions.analysis import channel_names
from fieldkit.sessions.formats.imported import free_name
from fieldkit.sessions.reader import SessionReader
from fieldkit.sessions.sample_fields import SAMPLE_FIELDS

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
        raise ConfigError("MCAP needs mcap-ros2-support", fix=install_extra("lab")) from error
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


# --- a session: what ROS has a message for as its own types, and everything as it was recorded


_OWN_FIELDS = {"q": "int64", "I": "uint32", "d": "float64"}
_RECORDED = [field for field in SAMPLE_FIELDS if field.attribute != "time_ns"]  # that is in the header
_DEFINITIONS = {
    "sensor_msgs/msg/Image": "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\n"
    "uint8 is_bigendian\nuint32 step\nuint8[] data",
    "sensor_msgs/msg/Temperature": "std_msgs/Header header\nfloat64 temperature\nfloat64 variance",
    "sensor_msgs/msg/Illuminance": "std_msgs/Header header\nfloat64 illuminance\nfloat64 variance",
    "std_msgs/msg/Float64": "float64 data",
    "rcl_interfaces/msg/Log": "byte DEBUG=10\nbyte INFO=20\nbyte WARN=30\nbyte ERROR=40\nbyte FATAL=50\n"
    "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\nstring function\n"
    "uint32 line",
    "fieldkit_msgs/msg/Event": "std_msgs/Header header\nstring kind\nstring text\nstring data  # JSON",
    "fieldkit_msgs/msg/Sample": "\n".join(
        ["std_msgs/Header header", *(f"{_OWN_FIELDS[field.code]} {field.column}" for field in _RECORDED)]
    )
    + "\nuint8[] raw  # bytes of a reading; counts of a frame, then the rows that the camera sent with it",
    "fieldkit_msgs/msg/Slope": "std_msgs/Header header\nstring state\nstring model\nstring reason\n"
    "uint32 minutes\n"
    + "\n".join(f"float64 {field.key}  # {field.description}" for field in SLOPE_FIELDS.values()),
}
_LEVELS = {Severity.INFO: 20, Severity.WARNING: 30, Severity.ERROR: 40}
Message = tuple[str, str, dict[str, Any]]
"""Topic, type and fields."""


def export_mcap(
    session: SessionReader, folder: Path, *, stream: str | None = None, every: int = 1
) -> list[Path]:
    """One ``.mcap`` with all streams, or the one named; of frames every n-th.

    Raises `ConfigError` where the package that writes it is not installed.
    """
    path = folder / f"{session.path.stem}{'' if stream is None else f'-{stream}'}.mcap"
    names = tuple(session.streams) if stream is None else (session.stream(stream).info.name,)
    topics = _topics(session.streams)
    entries = heapq.merge(session.samples(*names), session.events(), key=lambda item: item.mono_ns)
    with replacing(path, synced=False) as draft, draft.open("wb") as file, ros2_writer(file) as writer:
        _about(writer, session)
        schemas = {
            kind: writer.register_msgdef(kind, definition({"": text})) for kind, text in _DEFINITIONS.items()
        }
        for item in chain(entries, session.estimates()):
            if not isinstance(item, Frame) or item.seq % every == 0:
                for topic, kind, fields in _messages(item, session.streams, topics):
                    writer.write_message(topic, schemas[kind], fields, item.time_ns, item.time_ns)
    return [path]


def _about(writer: Writer, session: SessionReader) -> None:
    """Header and provenance of the session as metadata, its configuration as an attachment."""
    facts = {"header": session.header.to_json(), "id": session.session_id, "state": session.state}
    writer.add_metadata("fieldkit session", {**facts, **session.provenance})
    config = session.config_toml.encode()
    writer.add_attachment(session.start_ns, session.start_ns, "fieldkit.toml", "application/toml", config)


def _topics(streams: Mapping[str, StreamInfo]) -> dict[str, list[str]]:
    """The topics of each stream: its samples, then its images or channels; a number parts equal ones."""
    topics: dict[str, list[str]] = {}
    names: set[str] = set()
    for info in streams.values():
        for channel in ("sample", *(("image_raw",) if info.is_camera else channel_names(info))):
            topic = f"/{_name(info.name)}/{_name(channel)}"
            free = free_name(topic, names, topic.rstrip("_") + "_{1}")
            names.add(free)
            topics.setdefault(info.name, []).append(free)
    return topics


def _messages(
    item: Frame | Reading | Event | SlopeEstimate,
    streams: Mapping[str, StreamInfo],
    topics: Mapping[str, Sequence[str]],
) -> Iterator[Message]:
    match item:
        case SlopeEstimate():
            yield "/slopes", "fieldkit_msgs/msg/Slope", _slope(item)
        case Event():
            yield "/rosout", "rcl_interfaces/msg/Log", _log(item)
            yield "/events", "fieldkit_msgs/msg/Event", _event(item)
        case Frame():
            sample, image = topics[item.stream]
            yield sample, "fieldkit_msgs/msg/Sample", _sample(item)
            yield image, "sensor_msgs/msg/Image", _image(item, streams[item.stream])
        case Reading():
            sample, *channels = topics[item.stream]
            yield sample, "fieldkit_msgs/msg/Sample", _sample(item)
            yield from _readings(item, streams[item.stream], channels)


def _slope(estimate: SlopeEstimate) -> dict[str, Any]:
    return {
        "header": header(estimate.time_ns, estimate.region),
        "state": estimate.state.name.lower(), "model": estimate.model, "reason": estimate.reason,
        "minutes": estimate.n_bins, **{name: getattr(estimate, name) for name in SLOPE_FIELDS},
    }  # fmt: skip


def _log(event: Event) -> dict[str, Any]:
    return {
        "stamp": time(event.time_ns), "level": _LEVELS.get(event.severity, 30), "name": event.stream,
        "msg": event.text, "file": "", "function": event.kind.name.lower(), "line": 0,
    }  # fmt: skip


def _event(event: Event) -> dict[str, Any]:
    head = header(event.time_ns, event.stream)
    data = to_json(event.data, inf_nan_mode="null").decode()
    return {"header": head, "kind": event.kind.name.lower(), "text": event.text, "data": data}


def _sample(sample: Frame | Reading) -> dict[str, Any]:
    if isinstance(sample, Frame):
        raw = b"".join(array.astype("<u2").tobytes() for array in (sample.counts, sample.metadata_rows))
    else:
        raw = sample.raw
    recorded = {field.column: getattr(sample, field.attribute, field.fill) for field in _RECORDED}
    return {"header": header(sample.time_ns, sample.stream), **recorded, "raw": raw}


def _image(frame: Frame, info: StreamInfo) -> dict[str, Any]:
    is_kelvin = has_temperatures(info)
    values = frame_k(info, frame.counts, frame.metadata_rows, np.float32) if is_kelvin else frame.counts
    pixels = values.astype("<f4" if is_kelvin else "<u2")
    rows, cols = pixels.shape
    return {
        "header": header(frame.time_ns, frame.stream), "height": rows, "width": cols,
        "encoding": "32FC1" if is_kelvin else "mono16", "is_bigendian": 0, "step": cols * pixels.itemsize,
        "data": pixels.tobytes(),
    }  # fmt: skip


def _readings(reading: Reading, info: StreamInfo, topics: Sequence[str]) -> Iterator[Message]:
    """A message for each channel; a variance of 0 is unknown, as ROS has it."""
    variance = info.accuracy**2 if math.isfinite(info.accuracy) else 0.0
    head = header(reading.time_ns, reading.stream)
    for topic, value in zip(topics, reading.values, strict=True):
        match info.unit:
            case "K":
                fields = {"header": head, "temperature": value - CELSIUS_ZERO_K, "variance": variance}
                yield topic, "sensor_msgs/msg/Temperature", fields
            case "lx":
                fields = {"header": head, "illuminance": value, "variance": variance}
                yield topic, "sensor_msgs/msg/Illuminance", fields
            case _:
                yield topic, "std_msgs/msg/Float64", {"data": value}


def _name(written: str) -> str:
    """A stream or channel as a part of a topic: letters, digits, single underscores, no digit first.

    As https://design.ros2.org/articles/topic_and_service_names.html has it.
    """
    name = re.sub("[^A-Za-z0-9]+", "_", written)
    return f"_{name}" if name[:1].isdigit() else name


# --- layers on the ground: a grid map, and an occupancy grid of a risk


_GRID_MAP = {
    "": "std_msgs/Header header\ngrid_map_msgs/GridMapInfo info\nstring[] layers\nstring[] basic_layers\n"
    "std_msgs/Float32MultiArray[] data\nuint16 outer_start_index\nuint16 inner_start_index",
    "grid_map_msgs/GridMapInfo": "float64 resolution\nfloat64 length_x\nfloat64 length_y\n"
    "geometry_msgs/Pose pose",
    "std_msgs/Float32MultiArray": "std_msgs/MultiArrayLayout layout\nfloat32[] data",
    "std_msgs/MultiArrayLayout": "std_msgs/MultiArrayDimension[] dim\nuint32 data_offset",
    "std_msgs/MultiArrayDimension": "string label\nuint32 size\nuint32 stride",
}
_OCCUPANCY_GRID = {
    "": "std_msgs/Header header\nnav_msgs/MapMetaData info\nint8[] data",
    "nav_msgs/MapMetaData": "builtin_interfaces/Time map_load_time\nfloat32 resolution\nuint32 width\n"
    "uint32 height\ngeometry_msgs/Pose origin",
}
UNKNOWN = -1


def write_maps(
    path: Path, layers: Mapping[str, SingleArray], ground: Heights, time_ns: int, *, risk: str | None = None
) -> None:
    """Write layers as ``/grid_map``, and one of them as ``/occupancy_grid``.

    `layers` are values on the cells of the ground by name, rows from north to south, NaN unknown; its heights
    become the layer ``elevation``, and `risk` names the layer in [0, 1] for the occupancy grid. The origin of
    the frame ``map`` is that of the reference system. Raises `OSError`, and `ConfigError` if the package
    that writes ROS 2 messages is not installed.
    """
    head = header(time_ns, "map")
    heights = {"elevation": ground.heights_m.astype(np.float32)}
    messages = [
        ("/grid_map", "grid_map_msgs/msg/GridMap", _GRID_MAP, _grid_map({**heights, **layers}, ground))
    ]
    if risk is not None:
        grid = _occupancy_grid(layers[risk], ground, time_ns)
        messages.append(("/occupancy_grid", "nav_msgs/msg/OccupancyGrid", _OCCUPANCY_GRID, grid))
    with replacing(path, synced=False) as draft, draft.open("wb") as file, ros2_writer(file) as writer:
        for topic, kind, parts, message in messages:
            schema = writer.register_msgdef(kind, definition(parts))
            writer.write_message(topic, schema, {"header": head, **message}, time_ns, time_ns)


def _pose(east_m: float, north_m: float) -> dict[str, Any]:
    return {
        "position": {"x": east_m, "y": north_m, "z": 0.0},
        "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
    }


def _grid_map(layers: Mapping[str, SingleArray], ground: Heights) -> dict[str, Any]:
    """Its first index runs from east to west, its second from north to south, the first one fastest."""
    rows, cols = ground.heights_m.shape
    length_x, length_y = cols * ground.cell_m, rows * ground.cell_m
    layout = {
        "dim": [
            {"label": "column_index", "size": rows, "stride": rows * cols},
            {"label": "row_index", "size": cols, "stride": cols},
        ],
        "data_offset": 0,
    }
    centre = _pose(ground.west_m + 0.5 * length_x, ground.north_m - 0.5 * length_y)
    return {
        "info": {"resolution": ground.cell_m, "length_x": length_x, "length_y": length_y, "pose": centre},
        "layers": list(layers),
        "basic_layers": [],
        "data": [{"layout": layout, "data": values[:, ::-1].ravel().tolist()} for values in layers.values()],
        "outer_start_index": 0,
        "inner_start_index": 0,
    }


def _occupancy_grid(risk: SingleArray, ground: Heights, time_ns: int) -> dict[str, Any]:
    """From the south-western cell to the east, then northwards; percent."""
    rows, cols = risk.shape
    percent = np.where(np.isnan(risk), UNKNOWN, np.rint(100.0 * np.nan_to_num(risk)))
    info = {
        "map_load_time": time(time_ns), "resolution": ground.cell_m, "width": cols, "height": rows,
        "origin": _pose(ground.west_m, ground.north_m - rows * ground.cell_m),
    }  # fmt: skip
    return {"info": info, "data": percent[::-1].astype(int).ravel().tolist()}
