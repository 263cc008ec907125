"""Recordings of ROS (bags of ROS 1 and 2, MCAP): topics of numbers become meters, images become cameras.

A stream is a topic, its channels the numbers in a message; the time is that of the message's header where it
has one, else of its recording. Units are those of the message types, as their definitions state them. Needs
``fieldkit-slope[files]``.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from fieldkit.model.arrays import AnyArray, CountArray
from fieldkit.model.component_names import component_named
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError, FieldkitError, message_of
from fieldkit.model.installation import install_extra
from fieldkit.model.limits import bounds_of, flag_implausible
from fieldkit.model.next_step import Argument
from fieldkit.model.quantities import POWER, Unit, meaning_of, unknown_meaning
from fieldkit.model.samples import Frame, Sample, Severity
from fieldkit.physics import camera_laws
from fieldkit.sessions.formats.imported import ImportedRecording, ReadAgain, imported_reading, usual_rate_hz
from fieldkit.sessions.formats.stills import NO_VALUE, Scale, counts_of, temperature_unit
from fieldkit.sessions.formats.times import plausible_ns

SUFFIXES = (".mcap", ".bag")
_UNITS = {
    # message type: its field with a unit, as sensor_msgs defines them
    "Temperature": ("temperature", "C"),
    "Illuminance": ("illuminance", "lx"),
    "FluidPressure": ("fluid_pressure", "Pa"),
}
_COUNTS = {"mono16": "u2", "16UC1": "u2", "32FC1": "f4"}
_NO_NUMBERS = ("header", "stamp", "variance")
_NO_METERS = ("Log", "CameraInfo", "Clock", "ParameterEvent")
Message = tuple[str, str, int, Any]
"""Topic, type without its package, UTC nanoseconds, the message."""


@dataclass(frozen=True, slots=True)
class BagOptions:
    """Beginning of the streams' names, topics to read (all by default), unit of numbers, scale of counts."""

    name: str = ""
    topics: Collection[str] = ()
    unit: str = ""
    scale: Scale | None = None
    offset_ns: int = 0


@dataclass(slots=True)
class _Topic:
    """A topic that is read: its stream, the fields of its numbers, and their meaning or the pixels' unit."""

    info: StreamInfo
    fields: tuple[str, ...] = ()
    unit: Unit | None = None
    stamps_ns: list[int] = field(default_factory=list)


def is_bag(path: Path) -> bool:
    """True for a file of ROS or MCAP, and the folder of a rosbag2."""
    return path.suffix.lower() in SUFFIXES or (path / "metadata.yaml").is_file()


def read_bag(path: Path, options: BagOptions) -> ImportedRecording:
    """The topics of a recording as streams; it is read twice, and never kept whole. Raises `ConfigError`."""
    topics: dict[str, _Topic] = {}
    others: set[str] = set()
    for name, kind, time_ns, message in _messages(path, options):
        if name not in topics and (topic := _topic(path, name, kind, message, options)):
            topics[name] = topic
        if name in topics:
            topics[name].stamps_ns.append(time_ns)
        else:
            others.add(name)
    if not topics:
        problem = (
            f"no topic of numbers or of 16-bit or 32-bit images, of {', '.join(sorted(others)) or 'none'}"
        )
        raise ConfigError(problem, place=path, fix="record one, as sensor_msgs/Temperature or mono16")
    for topic in topics.values():
        topic.info = replace(topic.info, rate_hz=usual_rate_hz(topic.stamps_ns))
    notes = [(Severity.WARNING, f"topics without numbers are left out: {', '.join(sorted(others))}")]
    samples = ReadAgain(lambda: _samples(path, topics, options))
    streams = tuple(topic.info for topic in topics.values())
    return ImportedRecording(streams, samples, tuple(notes if others else ()))


def _messages(path: Path, options: BagOptions) -> Iterator[Message]:
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise ConfigError("recordings of ROS need rosbags", place=path, fix=install_extra("files")) from error
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
            for connection, logged_ns, data in reader.messages():
                if options.topics and connection.topic not in options.topics:
                    continue
                message = reader.deserialize(data, connection.msgtype)
                stamp = getattr(getattr(message, "header", None), "stamp", None)
                time_ns = stamp.sec * 10**9 + stamp.nanosec if stamp and stamp.sec else logged_ns
                kind = connection.msgtype.rsplit("/", 1)[-1]
                yield connection.topic, kind, plausible_ns(time_ns + options.offset_ns), message
    except FieldkitError:
        raise
    except Exception as error:  # of rosbags, SQLite, and the packers
        problem = f"cannot be read as a recording of ROS: {message_of(error)[:200]}"
        fix = "of an MCAP of another program export its topics as CSV; a rosbag2 is named by its folder"
        raise ConfigError(problem, place=path, fix=fix) from error


def _topic(path: Path, name: str, kind: str, message: Any, options: BagOptions) -> _Topic | None:
    """A topic by its first message; None if it has no numbers."""
    *_, last = name.split("/")
    stream = "-".join(filter(None, (options.name, *name.split("/"))))
    if kind == "Image":
        return _camera(f"{path}, {name}", stream, message, options) if message.encoding in _COUNTS else None
    named, written = _UNITS.get(kind, ("", options.unit))
    numbers = () if kind in _NO_METERS else tuple(_numbers(message)) if not named else (named,)
    if not numbers:
        return None
    meaning = meaning_of(written, last) or unknown_meaning(written)
    labels = (last,) if len(numbers) == 1 else numbers
    component = component_named(last) if meaning.quantity.units == POWER else ""
    info = StreamInfo(
        stream,
        meaning.quantity.name,
        meaning.quantity.units.stored,
        (len(numbers),),
        channels=labels,
        measures=(component,) if component else (),
        driver="import",
    )
    return _Topic(info, numbers, meaning.unit)


def _numbers(message: Any, before: str = "") -> dict[str, float]:
    """The numbers of a message by their names, those of its parts with a point."""
    numbers: dict[str, float] = {}
    for part in fields(message):
        value = getattr(message, part.name)
        if part.name in _NO_NUMBERS:
            continue
        if is_dataclass(value):
            numbers |= _numbers(value, f"{before}{part.name}.")
        elif isinstance(value, Real):
            numbers[before + part.name] = float(value)
    return numbers


def _camera(place: str, stream: str, message: Any, options: BagOptions) -> _Topic:
    is_kelvin = message.encoding == "32FC1"
    unit = temperature_unit(options.unit) if is_kelvin else None
    if is_kelvin and unit is None:
        fix = Argument("unit", "K") + ", or C, F"
        raise ConfigError("its temperatures state no unit", place=place, fix=fix)
    scale = Scale(0.01) if is_kelvin else options.scale
    if scale is None:
        fix = Argument("kelvin_per_count", 0.01) + "; NaN (none) for frames only"
        raise ConfigError("what one count means is not known", place=place, fix=fix)
    info = StreamInfo(
        stream,
        "brightness_temperature",
        "K",
        (message.height, message.width),
        scale.kelvin_per_count,
        scale.kelvin_at_zero,
        driver="import",
        settings={camera_laws.NO_VALUE: NO_VALUE} if is_kelvin else {},
    )
    return _Topic(info, unit=unit)


def _samples(path: Path, topics: Mapping[str, _Topic], options: BagOptions) -> Iterator[Sample]:
    bounds = {name: bounds_of(topic.info) for name, topic in topics.items()}
    for name, _, time_ns, message in _messages(path, options):
        if (topic := topics.get(name)) is None:
            continue
        if topic.info.is_camera:
            counts = _counts(f"{path}, {name}", topic, message)
            yield Frame(topic.info.name, time_ns, time_ns, counts, np.empty((0, 0), np.uint16))
            continue
        numbers = _numbers(message)
        unit = topic.unit or Unit("")
        values = tuple((numbers[field] + unit.add) / unit.by for field in topic.fields)
        yield flag_implausible(imported_reading(topic.info.name, time_ns, values), bounds[name])


def _counts(place: str, topic: _Topic, message: Any) -> CountArray:
    if (message.height, message.width) != topic.info.shape or message.encoding not in _COUNTS:
        problem = f"an image of {message.height} x {message.width} {message.encoding} among others"
        raise ConfigError(problem, place=place, fix="record images of each size as a topic of their own")
    numbers = np.dtype(f"{'>' if message.is_bigendian else '<'}{_COUNTS[message.encoding]}")
    try:
        rows = np.asarray(message.data, np.uint8).reshape(message.height, message.step)
        pixels: AnyArray = rows[:, : message.width * numbers.itemsize].copy().view(numbers)
    except ValueError as error:
        raise ConfigError("an image is cut short", place=place, fix="record it again") from error
    return counts_of(pixels, (1.0, 0.0), topic.unit) if topic.unit else pixels.astype(np.uint16)
