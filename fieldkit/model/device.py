"""The contract between instruments and the recorder: declare, then stream.

A `Driver` knows one kind of instrument and finds and opens it; a `Device` is one that has
been opened. Before its first sample a device declares its stream in a `StreamInfo`.
Exceptions of libraries (pyserial, V4L2, libusb) end inside the driver: a device raises only
`fieldkit.model.errors.DeviceError` and its children.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

from fieldkit.model.clock import Clock
from fieldkit.model.samples import Frame, Reading
from fieldkit.model.site import Region


@dataclass(frozen=True, slots=True)
class StreamInfo:
    """Declaration of a device's stream, made before its first sample.

    `shape` is (rows, cols) of a camera, (channels,) of a meter. A camera's kelvin are
    ``counts * scale + offset``; `scale` is NaN where no temperature is known or the law is
    not linear (then `law` names it). `rate_hz` 0 means irregular. `latency_s` is from the
    measured instant to the stamp, `wire_time_s` the part of it spent on the wire,
    `response_s` the sensor's own time constant, `accuracy` the standard uncertainty in `unit`.
    `limits` are rows of the table of limits (`fieldkit.model.limits`) that differ for this stream.
    `measures` names the component of radiation that each channel measures (`fieldkit.model.radiation`), ""
    where that is unknown; empty for anything else.
    """

    name: str
    quantity: str  # "brightness_temperature", "illuminance", "temperature", "irradiance", ...
    unit: str  # "K", "lx", "W m-2"
    shape: tuple[int, ...]
    scale: float = 1.0
    offset: float = 0.0
    law: str = "linear"
    metadata_shape: tuple[int, int] = (0, 0)
    channels: tuple[str, ...] = ()
    measures: tuple[str, ...] = ()
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    rate_hz: float = 0.0
    burst_frames: int = 0  # frames stored together; 0: all, at the stream's rate
    driver: str = ""
    vendor: str = ""
    model: str = ""
    serial_number: str = ""
    firmware: str = ""
    port: str = ""
    identity: str = ""
    latency_s: float = 0.0
    wire_time_s: float = 0.0
    response_s: float = 0.0
    accuracy: float = float("nan")
    raw_bytes: int = 0  # longest raw record of a meter
    device_time_unit: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)  # gain, emissivity, backend ... as read back

    @property
    def is_camera(self) -> bool:
        """True if the stream consists of frames."""
        return len(self.shape) == 2

    @property
    def is_radiometric(self) -> bool:
        """True for frames of known temperature."""
        return self.is_camera and self.quantity == "brightness_temperature"

    @property
    def channel_names(self) -> tuple[str, ...]:
        """Channels of a meter by name, or else by number from 1."""
        count = self.shape[0]
        return self.channels if len(self.channels) == count else tuple(map(str, range(1, count + 1)))

    def channel(self, text: str) -> int | None:
        """Index of the channel of that name, or else of that number from 1; None if there is none."""
        names = self.channel_names
        if text in names:
            return names.index(text)
        return int(text) - 1 if text.isdecimal() and 1 <= int(text) <= len(names) else None

    def has_the_columns_of(self, other: StreamInfo) -> bool:
        """True if samples of `other` can be stored in this stream."""
        mine, theirs = (
            (info.shape, info.metadata_shape, info.channels, info.is_camera or info.unit)
            for info in (self, other)
        )
        return mine == theirs

    def is_read_as(self, other: StreamInfo) -> bool:
        """True if the numbers of `other` mean the same here; of two unknown scales (NaN) nothing is known."""
        return repr((self.law, self.scale, self.offset)) == repr((other.law, other.scale, other.offset))


def find_camera(streams: Iterable[StreamInfo], name: str = "") -> StreamInfo | None:
    """The camera of that name, by default the first, preferably one of known temperature; None without."""
    cameras = [info for info in streams if info.is_camera and name in ("", info.name)]
    return min(cameras, key=lambda info: not info.is_radiometric, default=None)


def cameras_by_name(streams: Iterable[StreamInfo]) -> dict[str, StreamInfo]:
    """The cameras by name, and the first of them also by ""."""
    streams = tuple(streams)
    names = ("", *(info.name for info in streams))
    return {name: camera for name in names if (camera := find_camera(streams, name)) is not None}


def regions_on(stream: str, regions: Iterable[Region], streams: Iterable[StreamInfo]) -> tuple[Region, ...]:
    """The regions that lie in the frames of a stream."""
    streams = tuple(streams)
    cameras = ((region, find_camera(streams, region.camera)) for region in regions)
    return tuple(region for region, camera in cameras if camera is not None and camera.name == stream)


@dataclass(frozen=True, slots=True)
class Buffer:
    """One frame as the video driver delivered it.

    `mono_ns` is the kernel's stamp where there is one; `sequence` counts the frames the
    kernel saw (a gap is a loss on this computer), -1 where the backend does not report it;
    `error`: the video driver marked the bytes as damaged.
    """

    data: bytes
    mono_ns: int
    sequence: int = -1
    error: bool = False


class FrameSource(Protocol):
    """Source of a camera's bytes: the V4L2 reader, OpenCV, or the simulated field."""

    backend: str
    port: str

    def read(self, timeout_s: float) -> Buffer | None:
        """The next frame, or None; raises `DeviceLostError`."""

    def skip_until(self, mono_ns: int) -> None:
        """Skip frames until a monotonic time, keeping the stream alive."""

    def close(self) -> None:
        """Release the camera; a second call does nothing."""


@dataclass(frozen=True, slots=True)
class DeviceSettings:
    """Configuration of one device; `options` are the driver's own, `limits` rows as in `StreamInfo`.

    `source` stands in for the camera's port when the field is simulated. Opening is given up after
    `connect_timeout_s`.
    """

    name: str
    driver: str
    port: str = ""
    identity: str = ""
    every_s: float = 1.0
    options: Mapping[str, Any] = field(default_factory=dict)
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    source: FrameSource | None = None
    connect_timeout_s: float = 30.0


@dataclass(frozen=True, slots=True)
class DiscoveredDevice:
    """One connected instrument that a driver recognises.

    `identity` is what to write into the configuration: ``vendor:product[:serial]`` or a USB
    path, never an index. `caveat` explains why the driver is not certain, or is empty.
    """

    driver: str
    identity: str
    port: str
    title: str
    caveat: str = ""


@runtime_checkable
class Device(Protocol):
    """An opened instrument: mostly a `cameras.camera.ThermalCamera` or a `meters.meter.Meter`."""

    info: StreamInfo

    def read(self, timeout_s: float) -> Frame | Reading | None:
        """The next sample, or None if none came within `timeout_s`.

        Raises `DeviceLostError` when the instrument is gone; garbled bytes are skipped and
        counted in `rejected`.
        """

    def close(self) -> None:
        """Release the instrument; a second call does nothing."""

    @property
    def rejected(self) -> int:
        """Number of records dropped because their bytes made no sense."""


@runtime_checkable
class Camera(Device, Protocol):
    """A camera: frames, and a shutter."""

    def read(self, timeout_s: float) -> Frame | None:
        """The next frame; see `Device.read`."""

    def run_shutter(self) -> bool:
        """Start a shutter correction; False if this camera cannot."""

    def skip_until(self, mono_ns: int) -> None:
        """Skip frames undecoded until a monotonic time, keeping the stream alive."""


class Driver(Protocol):
    """The code that knows one kind of instrument.

    A driver may declare the names of its `options`; any others are then rejected. Its `needs` are those that
    state what a stream measures where its bytes do not show it, each with values to choose from.
    """

    name: str
    title: str
    quantity: str

    def find(self) -> list[DiscoveredDevice]:
        """Connected instruments of this kind; never raises for absent libraries."""

    def open(self, settings: DeviceSettings, clock: Clock) -> Device:
        """Open the instrument that `settings` names.

        Raises `DeviceNotFoundError` (with what is there instead), `DeviceAccessError`,
        `DeviceTimeoutError` or `DecodeError`.
        """
