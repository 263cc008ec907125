"""GenICam cameras (GigE Vision, USB3 Vision) by aravis: FLIR A-series, and any other that gives Mono16.

FLIR's A-series states in its feature ``IRFormat`` what a pixel means: ``TemperatureLinear10mK`` kelvin x 100,
``TemperatureLinear100mK`` kelvin x 10 (three public programs agree). It is set when the camera is opened, and
read back. Others are counts unless the scale is configured. A camera that gives only 8 bits is refused.

Aravis and its typelib come from the system (``gir1.2-aravis-0.8``), PyGObject from the extra ``genicam``.
The network is not searched: `port` is the camera's address, or aravis' name of it. Frames that lost packets,
which aravis asks for again first, count as damaged; the numbers are block ids (16 bits in GigE Vision 1).
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any

from fieldkit.drivers import options
from fieldkit.drivers.cameras import camera
from fieldkit.drivers.cameras.source import CameraDriver, OpenedSource
from fieldkit.drivers.cameras.streaming import StreamSource
from fieldkit.drivers.cameras.y16 import Y16, decode, size_of
from fieldkit.drivers.decoding import Decoded
from fieldkit.model.clock import Clock
from fieldkit.model.device import Buffer, DeviceSettings
from fieldkit.model.errors import ConfigError, DeviceAccessError, DeviceError, DeviceNotFoundError
from fieldkit.model.installation import install_extra
from fieldkit.model.units import SECOND_NS

IR_FORMATS = {"10mK": ("TemperatureLinear10mK", 0.01), "100mK": ("TemperatureLinear100mK", 0.1)}
"""Values of FLIR's ``IRFormat`` and kelvin per count, by the option `resolution`."""

MONO16, EMISSIVITY = "Mono16", "ObjectEmissivity"
BUFFERS = 16
BLOCK_IDS = 65_535  # of GigE Vision 1: 0 is never used
LATE_NS = SECOND_NS  # an older stamp is of a clock that was set
_LIBRARIES = "gir1.2-aravis-0.8 libgirepository1.0-dev libcairo2-dev"


def _aravis() -> Any:
    """The library; raises `DeviceAccessError` with how to install it."""
    try:
        import gi

        gi.require_version("Aravis", "0.8")
        from gi.repository import Aravis
    except (ImportError, ValueError) as error:
        raise DeviceAccessError(
            f"GenICam cameras need aravis 0.8: {error}",
            fix=f"sudo apt install {_LIBRARIES}; {install_extra('genicam')}",
        ) from error
    return Aravis


@contextmanager
def _errors(place: str) -> Iterator[None]:
    """Around aravis' calls: their errors become `DeviceError`."""
    from gi.repository import GLib

    try:
        yield
    except GLib.Error as error:
        raise DeviceError(
            f"refused: {error.message}", place=place, fix="switch the camera off and on"
        ) from error


class GenicamSource(StreamSource):
    """A camera of which aravis receives the frames, in threads of its own."""

    backend = "aravis"

    def __init__(self, address: str, clock: Clock) -> None:
        super().__init__(address, clock)
        self._aravis = _aravis()
        from gi.repository import GLib

        try:
            self.camera = self._aravis.Camera.new(address)
        except GLib.Error as error:
            raise DeviceNotFoundError(
                f"no GenICam camera: {error.message}",
                place=address,
                fix="check its power and address; arv-tool-0.8 lists those in the network",
            ) from error
        self._stream: Any = None
        self._id, self._sequence = -1, -1

    def start(self) -> None:
        """Let the camera send; raises `DeviceError`."""
        with _errors(self.port):
            self._stream = self.camera.create_stream(None, None)
            for _ in range(BUFFERS):
                self._stream.push_buffer(self._aravis.Buffer.new_allocate(self.camera.get_payload()))
            self.camera.start_acquisition()

    def close(self) -> None:
        """Stop the camera and let go of it; a second call does nothing."""
        camera, self.camera, self._stream = self.camera, None, None
        with suppress(DeviceError), _errors(self.port):
            if camera is not None:
                camera.stop_acquisition()

    def _receive(self, timeout_s: float) -> Buffer | None:
        block = self._stream.timeout_pop_buffer(int(timeout_s * 1e6))
        if block is None:
            return None
        is_whole = block.get_status() == self._aravis.BufferStatus.SUCCESS
        number = self._number(block.get_frame_id())
        buffer = Buffer(block.get_data(), self._stamp_ns(block), number, error=not is_whole)
        self._stream.push_buffer(block)
        return buffer

    def _stamp_ns(self, block: Any) -> int:
        """When the first packet arrived, by aravis' stamp of the system's clock."""
        age_ns = time.time_ns() - block.get_system_timestamp()
        return self._clock.mono_ns() - (age_ns if 0 <= age_ns < LATE_NS else 0)

    def _number(self, block_id: int) -> int:
        self._sequence += blocks_between(self._id, block_id) if self._id >= 0 else 1
        self._id = block_id
        return self._sequence


def blocks_between(before: int, after: int) -> int:
    """Blocks from one id to a later one, also through the wrap of 16 bits."""
    return after - before if after > before else after - before + BLOCK_IDS


class Genicam(CameraDriver):
    """Driver of GenICam cameras; `port` is the camera's address.

    Options: those of every camera, `resolution` (``10mK`` or ``100mK``, of FLIR's A-series), `width` and
    `height` of the part that is read, `kelvin_per_count` with `kelvin_offset` for other cameras.
    """

    name = "genicam"
    title = "GenICam camera (GigE Vision, USB3 Vision)"
    host_port = 3956  # of GigE Vision's control channel
    options: tuple[str, ...] = (
        *(option for option in camera.OPTIONS if option != "backend"),
        *("resolution", "width", "height", "kelvin_per_count", "kelvin_offset"),
    )

    def decode(self, data: bytes, options: Mapping[str, Any]) -> Decoded:
        """Explain bytes; options `width`, `height`, `kelvin_per_count`, `kelvin_offset`."""
        return Y16().decode(data, options)

    def open(self, settings: DeviceSettings, clock: Clock) -> camera.ThermalCamera:
        """Open the camera, choose Mono16 and temperatures, and let it send."""
        if not settings.port:
            raise ConfigError(
                "genicam needs the camera's address",
                place=settings.name,
                fix='set port to its address, such as "192.168.1.20"',
            )
        source = GenicamSource(settings.port, clock)
        handle = OpenedSource(source, settings.identity)
        facts = _set_up(source.camera, settings)
        source.start()
        (width, height), scale = facts.pop("size"), facts.pop("kelvin_per_count")
        offset = options.number(settings, "kelvin_offset", 0.0)
        read = partial(decode, width=width, height=height, scale=scale, offset=offset)
        first = camera.first_frame(source, read, settings.name, clock)
        rate_hz = facts.pop("rate_hz")
        info = camera.describe(settings, handle, first, facts, vendor=facts.pop("vendor"), rate_hz=rate_hz)
        return camera.ThermalCamera(info, source, read, clock)


def _set_up(device: Any, settings: DeviceSettings) -> dict[str, Any]:
    """Choose region, Mono16 and FLIR's linear temperatures; what the camera reports of itself."""
    with _errors(settings.name):
        vendor, model = device.get_vendor_name(), device.get_model_name()
        formats = device.dup_available_pixel_formats_as_strings()
        if MONO16 not in formats:
            raise DeviceError(
                f"{vendor} {model} gives {', '.join(formats)}: images without temperatures",
                place=settings.name,
                fix=f"use a camera that has {MONO16}",
            )
        device.set_pixel_format_from_string(MONO16)
        width, height = size_of(settings)
        if width > 0 and height > 0:
            device.set_region(0, 0, width, height)
        region = device.get_region()
        return {
            "vendor": vendor, "model": model, "serial_number": device.get_device_serial_number() or "",
            "size": (region.width, region.height), "rate_hz": device.get_frame_rate(),
            **_temperatures(device, settings),
        }  # fmt: skip


def _temperatures(device: Any, settings: DeviceSettings) -> dict[str, Any]:
    """Kelvin per count, by FLIR's ``IRFormat`` as read back, else by the configuration; NaN if unknown."""
    if not device.is_feature_available("IRFormat"):
        scale = options.kelvin_per_count(settings)
        return {"kelvin_per_count": scale, "scale_from": "unknown" if math.isnan(scale) else "configuration"}
    ir_format, scale = IR_FORMATS[options.text(settings, "resolution", "10mK", tuple(IR_FORMATS))]
    device.set_string("IRFormat", ir_format)
    if (read_back := device.get_string("IRFormat")) != ir_format:
        raise DeviceError(
            f"the camera keeps IRFormat {read_back}, not {ir_format}",
            place=settings.name,
            fix="end the maker's program, which may hold the camera's settings",
        )
    facts = {"kelvin_per_count": scale, "scale_from": "camera", "ir_format": ir_format}
    if device.is_feature_available(EMISSIVITY):  # the camera has applied it
        facts["emissivity"] = round(device.get_float(EMISSIVITY), 4)
    return facts
