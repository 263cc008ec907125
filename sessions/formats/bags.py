"""Recordings of ROS (bags of ROS 1 and 2, MCAP): topics of numbers become meters, images become cameras.

A stream is a topic, its channels the numbers in a message; the time is that of the message's header where it
has one, else of its recording. Units are those of the message types, as their definitions state them. Needs
``fieldkit-slope[files]``.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import astuple, fields, is_dataclass
from functools import partial
from numbers import Real
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fieldkit.model.arrays import AnyArray, CountArray
from fieldkit.model.component_names import component_named
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError
from fieldkit.model.limits import bounds_of, flag_implausible
from fieldkit.model.next_step import Argument
from fieldkit.model.quantities import POWER, Unit, meaning_of, unknown_meaning
from fieldkit.model.samples import Frame, Sample, Severity
from fieldkit.physics.camera_laws import NO_VALUE
from fieldkit.sessions.formats import imported, stills
from fieldkit.sessions.formats.imported import ImportedRecording, ReadAgain, explained, imported_reading
from fieldkit.sessions.formats.times import plausible_ns

SUFFIXES = (".mcap", ".bag")
OWN_PACKAGE = "fieldkit_msgs/"
_FIELDS = {
    # message type: its field with a unit, as sensor_msgs defines them
    "Temperature": ("temperature", "C"),
    "Illuminance": ("illuminance", "lx"),
    "FluidPressure": ("fluid_pressure", "Pa"),
}
_PIXELS = {"mono16": "u2", "16UC1": "u2", "32FC1": "f4"}
_NO_NUMBERS = ("header", "stamp", "variance")
_NO_METERS = ("Log", "CameraInfo", "Clock", "ParameterEvent")


class _Message(NamedTuple):
    """A message: its topic, its type without the package, UTC nanoseconds, its fields."""

    topic: str
    kind: str
    time_ns: int
    body: Any


class _Topic(NamedTuple):
    """A topic that is read: its stream, the fields of its numbers (none of images), their unit."""

    info: StreamInfo
    fields: tuple[str, ...]
    unit: Unit | None


def is_bag(path: Path) -> bool:
    """True for a file of ROS or MCAP, and the folder of a rosbag2."""
    return path.suffix.lower() in SUFFIXES or (path / "metadata.yaml").is_file()


def read_bag(
    path: Path,
    name: str = "",
    *,
    columns: Collection[str] = (),
    unit: str = "",
    scale: stills.Scale | None = None,
    offset_ns: int = 0,
) -> ImportedRecording:
    """The topics of a recording as streams; it is read twice, and never kept whole.

    `name` is the beginning of the streams' names, `columns` are the topics to read, by default all, `scale`
    that of counts. The unit is of images of temperatures, without one of the only topic of numbers that
    states none. Raises `ConfigError`.
    """
    read = partial(_messages, path, columns, offset_ns)
    first: dict[str, _Message] = {}
    stamps_ns: dict[str, list[int]] = {}
    for message in read():
        first.setdefault(message.topic, message)
        stamps_ns.setdefault(message.topic, []).append(message.time_ns)
    has_images = any(message.kind == "Image" for message in first.values())
    unstated = [message.topic for message in first.values() if _is_number(message)]
    if unit and not has_images and len(unstated) > 1:
        problem = f"the unit {unit} would apply to {', '.join(unstated)}"
        raise ConfigError(problem, place=path, fix=Argument("columns", unstated[0]))
    topics: dict[str, _Topic] = {}
    for topic, message in first.items():
        stream = "-".join(filter(None, (name, *topic.split("/"))))
        info = partial(StreamInfo, stream, rate_hz=imported.usual_rate_hz(stamps_ns[topic]), driver="import")
        if message.kind == "Image" and message.body.encoding in _PIXELS:
            topics[topic] = _camera(f"{path}, {topic}", message.body, info, unit, scale)
        elif message.kind != "Image" and (names := _names(message)):
            topics[topic] = _meter(message, names, info, "" if has_images else unit)
    others = ", ".join(sorted(first.keys() - topics))
    if not topics:
        problem = f"no topic of numbers, nor of images of 16 or 32 bits: {others or 'it is empty'}"
        raise ConfigError(problem, place=path, fix="record one, as sensor_msgs/Temperature or mono16")
    notes = ((Severity.WARNING, f"topics without numbers are excluded: {others}"),) if others else ()
    samples = ReadAgain(lambda: _samples(path, topics, read()))
    return ImportedRecording(tuple(topic.info for topic in topics.values()), samples, notes)


def _messages(path: Path, topics: Collection[str], offset_ns: int) -> Iterator[_Message]:
    fix = "export the topics of another program's MCAP as CSV; name a rosbag2 by its folder"
    # of rosbags, SQLite, and the packers
    with explained(path, "cannot be read as a recording of ROS", fix, Exception):
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
            for connection, time_ns, data in reader.messages():
                is_own = connection.msgtype.startswith(OWN_PACKAGE)  # what a session's export has beside
                if is_own or (topics and connection.topic not in topics):
                    continue
                body = reader.deserialize(data, connection.msgtype)
                stamp = getattr(getattr(body, "header", None), "stamp", None)
                if stamp and stamp.sec:
                    time_ns = stamp.sec * 10**9 + stamp.nanosec
                kind = connection.msgtype.rsplit("/", 1)[-1]
                yield _Message(connection.topic, kind, plausible_ns(time_ns + offset_ns), body)


def _is_number(message: _Message) -> bool:
    """True of a message of std_msgs that is one number, whose unit nothing states."""
    return isinstance(getattr(message.body, "data", None), Real)


def _names(message: _Message) -> tuple[str, ...]:
    """The fields of a message that are numbers: the one with a unit, or all."""
    if message.kind in _FIELDS:
        return (_FIELDS[message.kind][0],)
    return () if message.kind in _NO_METERS else tuple(_numbers(message.body))


def _meter(message: _Message, names: tuple[str, ...], info: Callable[..., StreamInfo], unit: str) -> _Topic:
    """The topic of a meter; `unit` is that of a number without a unit of its own."""
    *_, last = message.topic.split("/")
    _, written = _FIELDS.get(message.kind, ("", unit if _is_number(message) else ""))
    quantity, meant = meaning_of(written, last) or unknown_meaning(written)
    component = component_named(last) if quantity.units == POWER else ""
    about = {"channels": (last,) if len(names) == 1 else names, "measures": (component,) if component else ()}
    return _Topic(info(quantity.name, quantity.units.stored, (len(names),), **about), names, meant)


def _numbers(body: Any, before: str = "") -> dict[str, float]:
    """The numbers of a message by their names, those of its parts with a point."""
    numbers: dict[str, float] = {}
    for name in (part.name for part in fields(body) if part.name not in _NO_NUMBERS):
        value = getattr(body, name)
        if is_dataclass(value):
            numbers |= _numbers(value, f"{before}{name}.")
        elif isinstance(value, Real):
            numbers[before + name] = float(value)
    return numbers


def _camera(
    place: str, image: Any, info: Callable[..., StreamInfo], unit: str, scale: stills.Scale | None
) -> _Topic:
    is_kelvin = image.encoding == "32FC1"
    meant = stills.temperature_unit(unit) if is_kelvin else None
    if is_kelvin and meant is None:
        fix = Argument("unit", "K") + ", or C, F"
        raise ConfigError("its temperatures state no unit", place=place, fix=fix)
    scale = stills.Scale(0.01) if is_kelvin else scale
    if scale is None:
        fix = Argument("kelvin_per_count", 0.01) + "; NaN (none) for frames only"
        raise ConfigError("what one count means is not known", place=place, fix=fix)
    settings = {NO_VALUE: stills.NO_VALUE} if is_kelvin else {}
    shape = (image.height, image.width)
    return _Topic(info("brightness_temperature", "K", shape, *astuple(scale), settings=settings), (), meant)


def _samples(path: Path, topics: Mapping[str, _Topic], messages: Iterable[_Message]) -> Iterator[Sample]:
    empty, bounds = np.empty((0, 0), np.uint16), {name: bounds_of(of.info) for name, of in topics.items()}
    for name, _, at_ns, body in messages:
        if (topic := topics.get(name)) is None:
            continue
        info, names, unit = topic
        if info.is_camera:
            yield Frame(info.name, at_ns, at_ns, _counts(f"{path}, {name}", topic, body), empty)
            continue
        numbers, (_, _, add, by, *_) = _numbers(body), unit or Unit("")
        values = tuple((numbers[field] + add) / by for field in names)
        yield flag_implausible(imported_reading(info.name, at_ns, values), bounds[name])


def _counts(place: str, topic: _Topic, image: Any) -> CountArray:
    if (image.height, image.width) != topic.info.shape or image.encoding not in _PIXELS:
        problem = f"an image of {image.height} x {image.width} {image.encoding} among others"
        raise ConfigError(problem, place=place, fix="record images of each size as a topic of their own")
    numbers = np.dtype(f"{'>' if image.is_bigendian else '<'}{_PIXELS[image.encoding]}")
    try:
        rows = np.asarray(image.data, np.uint8).reshape(image.height, image.step)
        pixels: AnyArray = rows[:, : image.width * numbers.itemsize].copy().view(numbers)
    except ValueError as error:
        fix = "record it again: it is not whole"
        raise ConfigError("an image is cut short", place=place, fix=fix) from error
    return stills.counts_of(pixels, (1.0, 0.0), topic.unit) if topic.unit else pixels.astype(np.uint16)
