"""FLIR Boson, Boson+ and Boson R: Y16 pictures, and commands by a serial port of the same USB device.

320x256 or 640x512; a size with two more rows exists, whose place (above or below the picture) can be set in
the camera, so it is taken only where there is no other and its last rows are kept as they are. A plain Boson
gives counts, never temperatures. A radiometric one (Boson+ R, Boson R) gives kelvin x 100 once its output is
TLinear, which must be asked for (`radiometric = true`). In low gain public sources disagree (x 100 or x 50),
so there the scale must be told. The result is believed only if it gives a plausible scene.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

from fieldkit.drivers import options
from fieldkit.drivers.cameras import camera
from fieldkit.drivers.cameras.boson_serial import RUN_FFC, BosonSerial
from fieldkit.drivers.cameras.picture import Picture, decode_frames, doubts, extremes, words
from fieldkit.drivers.cameras.source import OpenedSource, Wanted, find_cameras, open_source
from fieldkit.drivers.identity import UsbIdentity
from fieldkit.drivers.options import for_bytes, kelvin_per_count
from fieldkit.drivers.ports import serial_ports
from fieldkit.drivers.records import Decoded, Rejected
from fieldkit.model.clock import Clock
from fieldkit.model.device import DeviceSettings, Found, StreamInfo
from fieldkit.model.errors import DeviceError
from fieldkit.model.samples import Quality

WANTED = Wanted(((0x09CB, 0x4007),), "Y16 ", ((640, 512), (320, 256), (640, 514), (320, 258)))
SHAPES = {2 * width * height: (height, width) for width, height in WANTED.sizes}
PICTURE_ROWS = {640: 512, 320: 256}
SCALE = 0.01
LOOK_NS = 1_000_000_000  # the serial side is asked once a second


def decode(data: bytes, scale: float = math.nan) -> Picture | Rejected:
    """A picture by its byte count; `scale` (K per count) is what the stream was told."""
    shape = SHAPES.get(len(data))
    if shape is None:
        sizes = " or ".join(str(size) for size in sorted(SHAPES))
        return Rejected(len(data), f"{len(data)} bytes; a Boson's picture has {sizes}")
    pixels = words(data, shape)
    height = PICTURE_ROWS[shape[1]]
    counts = pixels[:height]
    found = extremes(counts)
    return Picture(counts, found, pixels[height:], scale, quality=doubts(found, (0, 0xFFFF), scale))


class Boson:
    """Driver of the Boson family.

    Options: those of every camera, `radiometric` (true: ask for TLinear) and `kelvin_per_count` for
    cameras that were set up elsewhere.
    """

    name = "boson"
    title = "FLIR Boson"
    quantity = "brightness_temperature"
    options = (*camera.OPTIONS, "radiometric", "kelvin_per_count")

    def find(self) -> list[Found]:
        """Bosons that are plugged in."""
        return find_cameras(self.name, self.title, WANTED)

    def decode(self, data: bytes, options: Mapping[str, Any]) -> Decoded:
        """Explain bytes of one or more pictures; option `kelvin_per_count` (0.01 for TLinear)."""
        scale = kelvin_per_count(for_bytes(self.name, options))
        return decode_frames(data, partial(decode, scale=scale), tuple(SHAPES))

    def open(self, settings: DeviceSettings, clock: Clock) -> camera.ThermalCamera:
        """Open pictures and commands; a Boson without reachable commands still gives pictures."""
        scale = kelvin_per_count(settings)
        radiometric = options.flag(settings, "radiometric", False)
        opened = open_source(settings, WANTED, clock)
        serial, facts = connect(opened.usb, clock)
        try:
            if radiometric:
                scale = make_radiometric(serial, facts, scale)
        except DeviceError:
            opened.source.close()
            raise
        read = partial(decode, scale=scale)
        first = camera.first_picture(opened.source, read, settings.name, clock)
        if radiometric and first.quality & Quality.NO_VALUE:
            opened.source.close()
            raise DeviceError(
                f"{settings.name}: after asking for TLinear the pictures are no temperatures",
                fix="is it a radiometric model? without it leave radiometric out: counts are recorded",
            )
        info = describe(settings, opened, first, facts)
        run = partial(serial.ask, RUN_FFC) if serial else None
        return BosonCamera(info, opened.source, read, clock, run, serial)


class BosonCamera(camera.ThermalCamera):
    """A Boson: shutter and sensor temperature are asked once a second beside the pictures.

    Once the commands have failed they are not asked again: waiting for them would cost pictures.
    """

    def __init__(self, *given: Any) -> None:
        *rest, serial = given
        super().__init__(*rest)
        self._serial: BosonSerial | None = serial
        self._answers = serial is not None
        self._look_ns = 0
        self._told = (math.nan, False)

    def told(self, picture: Picture, mono_ns: int) -> Picture:
        """The picture with what the serial side said last."""
        if self._answers and mono_ns >= self._look_ns:
            self._look_ns = mono_ns + LOOK_NS
            self._told = self._ask()
        fpa, running = self._told
        return picture._replace(fpa_temperature_k=fpa, shutter=running or None)

    def _ask(self) -> tuple[float, bool]:
        """Temperature of the sensor, and whether a correction runs."""
        assert self._serial is not None
        try:
            return self._serial.fpa_temperature_k(), self._serial.is_shutter_running()
        except DeviceError:
            self._answers = False
            return math.nan, False

    def close(self) -> None:
        """Release pictures and commands."""
        super().close()
        if self._serial is not None:
            self._serial.close()


def serial_side(usb: UsbIdentity, clock: Clock) -> BosonSerial | None:
    """The command port of the same camera, None if it has none that may be opened."""
    path = next((path for path, port in serial_ports() if port.path == usb.path and usb.path), None)
    if path is None:
        return None
    try:
        return BosonSerial(path, clock)
    except DeviceError:
        return None


def connect(usb: UsbIdentity, clock: Clock) -> tuple[BosonSerial | None, dict[str, str]]:
    """The commands of a camera and what they tell; (None, reason) where they cannot be reached."""
    serial = serial_side(usb, clock)
    if serial is None:
        return None, {"commands": "not reachable"}
    try:
        return serial, serial.facts()
    except DeviceError as error:
        serial.close()
        return None, {"commands": error.message}


def make_radiometric(serial: BosonSerial | None, facts: Mapping[str, str], told: float) -> float:
    """Ask for TLinear; K per count then, which in low gain must be `told` (NaN if it is not)."""
    if serial is None:
        raise DeviceError(
            f"the Boson cannot be asked for temperatures; its commands: {facts['commands']}",
            fix="fieldkit doctor",
        )
    if facts["gain"] == "low" and math.isnan(told):
        raise DeviceError(
            "the Boson is in low gain, where public sources disagree about its kelvin per count",
            fix="set it to high gain, or look at something known and write kelvin_per_count = 0.01 or 0.02",
        )
    serial.make_radiometric()
    return SCALE if math.isnan(told) else told


def describe(
    settings: DeviceSettings, opened: OpenedSource, first: Picture, facts: Mapping[str, str]
) -> StreamInfo:
    """The stream of a Boson."""
    facts = dict(facts)
    known = not math.isnan(first.scale)
    return StreamInfo(
        name=settings.name,
        quantity="brightness_temperature" if known else "counts",
        unit="K" if known else "counts",
        shape=first.counts.shape,
        scale=first.scale,
        metadata_shape=first.metadata_rows.shape if first.metadata_rows.size else (0, 0),
        driver=settings.driver,
        vendor="FLIR",
        model=facts.pop("model", "") or opened.usb.title,
        serial_number=facts.pop("serial_number", "") or opened.usb.serial,
        port=opened.source.port,
        identity=opened.identity,
        latency_s=options.number(settings, "latency_s", 0.0),
        accuracy=options.number(settings, "accuracy", math.nan),
        settings={"backend": opened.source.backend, **facts},
    )
