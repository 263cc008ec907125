"""FLIR Boson, Boson+ and Boson R: Y16 frames, and commands on a serial port of the same USB device.

Frames are 320x256 or 640x512. A size with two more rows exists, whose place (above or below the image) can be
set in the camera, so it is used only where there is no other, and its last rows are kept as they are. A plain
Boson gives counts, never temperatures. A radiometric one (Boson+ R, Boson R) gives kelvin x 100 once its
output is TLinear, which is requested by `radiometric = true`. In low gain, public sources disagree (x 100 or
x 50), so the scale must be configured. The result is accepted only if it gives a plausible scene.

The commands run at 921600 baud. A packet is 8E, channel 00, u32 sequence, u32 function, u32 status (FFFFFFFF
in a request), payload, u16 CRC, AE, all big-endian. CRC-16 CCITT with start 1D0F over channel to payload,
before escaping: inside a packet 8E becomes 9E 81, 9E becomes 9E 91, AE becomes 9E A1. A reply counts only
with the sequence number of its request: late ones do occur. Two independent public programs agree on the
packet; function numbers rest mostly on one of them.
"""

from __future__ import annotations

import binascii
import math
import struct
from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

from fieldkit.drivers import options
from fieldkit.drivers.cameras import camera
from fieldkit.drivers.cameras.camera import Decode, DecodedFrame, decode_frames, pixel_view
from fieldkit.drivers.cameras.source import CameraDriver, CameraFormat, open_source
from fieldkit.drivers.decoding import Decoded, Layout, Parsed, Record, Rejected, skip_to, text_of
from fieldkit.drivers.framing import Line
from fieldkit.drivers.identity import UsbIdentity
from fieldkit.drivers.options import decoding_settings, kelvin_per_count
from fieldkit.drivers.ports import SerialPort, serial_ports
from fieldkit.model.clock import Clock
from fieldkit.model.device import DeviceSettings, FrameSource
from fieldkit.model.errors import DecodeError, DeviceError, DeviceTimeoutError
from fieldkit.model.next_step import Action
from fieldkit.model.samples import Quality
from fieldkit.model.units import CELSIUS_ZERO_K, SECOND_NS

# --- commands on the serial port

LINE = Line(921_600)
START, ESCAPE, END = 0x8E, 0x9E, 0xAE
LONGEST = 1544
REPLY_TIMEOUT_S = 0.5
SERIAL_NUMBER, PART_NUMBER, RUN_FFC, FFC_STATE = 0x0005_0002, 0x0005_0004, 0x0005_0007, 0x0005_000C
FFC_MODE, GAIN, FPA_TEMPERATURE = 0x0005_0013, 0x0005_0015, 0x0005_0030
TLINEAR, USB_MODE = 0x003E_0001, 0x000E_000D
USB_MODE_TLINEAR = 2
ERRORS = {0x0161: "unknown command", 0x0162: "bad payload", 0x0203: "out of range"}
GAINS = ("high", "low", "automatic", "dual", "manual")
FFC_MODES = ("manual", "automatic", "external")
FFC_RUNNING = 2
_HEADER = struct.Struct(">BIII")


class Message(NamedTuple):
    """One packet, parsed."""

    sequence: int
    function: int
    status: int
    payload: bytes


def pack(sequence: int, function: int, payload: bytes = b"", status: int = 0xFFFF_FFFF) -> bytes:
    """A packet, ready to send."""
    body = _HEADER.pack(0, sequence, function, status) + payload
    body += binascii.crc_hqx(body, 0x1D0F).to_bytes(2, "big")
    escaped = b"".join(
        bytes([ESCAPE, byte - 0xD]) if byte in (START, ESCAPE, END) else bytes([byte]) for byte in body
    )
    return bytes([START]) + escaped + bytes([END])


def unpack(frame: bytes) -> Message | str:
    """Parse a packet from 8E to AE; a text is the reason why it cannot be parsed."""
    body = bytearray()
    inside = iter(frame[1:-1])
    for byte in inside:
        body.append((next(inside, 0) + 0xD) & 0xFF if byte == ESCAPE else byte)
    if len(body) < _HEADER.size + 2:
        return "too short"
    if binascii.crc_hqx(bytes(body[:-2]), 0x1D0F) != int.from_bytes(body[-2:], "big"):
        return "the CRC does not fit"
    _, sequence, function, status = _HEADER.unpack_from(body)
    return Message(sequence, function, status, bytes(body[_HEADER.size : -2]))


def parse(buffer: bytes) -> Parsed:
    """The packet at the start of `buffer`."""
    if buffer[0] != START:
        return Rejected(skip_to(bytes([START]), buffer), "does not begin with 8E")
    end = buffer.find(bytes([END]))
    if end < 0:
        return None
    message = unpack(buffer[: end + 1])
    if isinstance(message, str):
        return Rejected(end + 1, message)
    return Record(
        end + 1,
        note=f"function {message.function:#010x}, status {message.status:#x}, {message.payload.hex(' ')}",
    )


LAYOUT = Layout(parse, LONGEST)


class BosonSerial:
    """Commands to one Boson; raises `DeviceError` when it refuses, `DeviceTimeoutError` when it is silent."""

    def __init__(self, path: str, clock: Clock) -> None:
        self._port = SerialPort(path, LINE, clock)
        self._sequence = 0

    def request(self, function: int, payload: bytes = b"") -> bytes:
        """Send a command, return the payload of its reply."""
        self._sequence += 1
        self._port.write(pack(self._sequence, function, payload))
        while reply := self._port.read(LAYOUT, REPLY_TIMEOUT_S):
            message = unpack(reply.raw)
            if isinstance(message, str) or message[:2] != (self._sequence, function):
                continue
            if message.status:
                reason = ERRORS.get(message.status, f"error {message.status:#x}")
                raise DeviceError(f"refuses {function:#010x}: {reason}", place=self._port.path)
            return message.payload
        raise DeviceTimeoutError(
            "the Boson does not reply", place=self._port.path, fix="stop ModemManager: " + Action.DOCTOR()
        )

    def number(self, function: int) -> int:
        """A reply as an unsigned integer."""
        return int.from_bytes(self.request(function), "big")

    def fpa_temperature_k(self) -> float:
        """Temperature of the sensor."""
        return int.from_bytes(self.request(FPA_TEMPERATURE)[:2], "big", signed=True) / 10 + CELSIUS_ZERO_K

    def is_shutter_running(self) -> bool:
        """True if a correction runs now."""
        return self.number(FFC_STATE) == FFC_RUNNING

    def make_radiometric(self) -> None:
        """Pixels in hundredths of a kelvin; only radiometric models accept it."""
        self.request(TLINEAR, (1).to_bytes(4, "big"))
        self.request(USB_MODE, USB_MODE_TLINEAR.to_bytes(4, "big"))

    def facts(self) -> dict[str, str]:
        """Serial number, part number, gain and FFC mode as read back."""
        gain, mode = self.number(GAIN), self.number(FFC_MODE)
        part = text_of(self.request(PART_NUMBER))
        return {
            "serial_number": str(self.number(SERIAL_NUMBER)),
            "model": part,
            "gain": GAINS[gain] if gain < len(GAINS) else "unknown",
            "ffc_mode": FFC_MODES[mode] if mode < len(FFC_MODES) else "unknown",
        }

    def close(self) -> None:
        """Release the port; a second call does nothing."""
        self._port.close()


WANTED = CameraFormat(((0x09CB, 0x4007),), "Y16 ", ((640, 512), (320, 256), (640, 514), (320, 258)))
SHAPES = {2 * width * height: (height, width) for width, height in WANTED.sizes}
IMAGE_ROWS = {640: 512, 320: 256}
SCALE = 0.01
HOUSEKEEPING_NS = SECOND_NS  # seconds between requests for housekeeping


def decode(data: bytes, scale: float = math.nan) -> DecodedFrame | Rejected:
    """A frame by its byte count; `scale` (K per count) is configured."""
    shape = SHAPES.get(len(data))
    if shape is None:
        sizes = " or ".join(str(size) for size in sorted(SHAPES))
        return Rejected(len(data), f"{len(data)} bytes; a Boson's frame has {sizes}")
    pixels = pixel_view(data, shape)
    height = IMAGE_ROWS[shape[1]]
    return DecodedFrame(pixels[:height], pixels[height:], scale)


class Boson(CameraDriver):
    """Driver of the Boson family.

    Options: those of every camera, `radiometric` (true: request TLinear) and `kelvin_per_count` for
    cameras that were set up elsewhere.
    """

    name = "boson"
    title = "FLIR Boson"
    options: tuple[str, ...] = (*camera.OPTIONS, "radiometric", "kelvin_per_count")
    video = WANTED

    def decode(self, data: bytes, options: Mapping[str, Any]) -> Decoded:
        """Explain bytes of one or more frames; option `kelvin_per_count` (0.01 for TLinear)."""
        scale = kelvin_per_count(decoding_settings(self.name, options))
        return decode_frames(data, partial(decode, scale=scale), tuple(SHAPES))

    def open(self, settings: DeviceSettings, clock: Clock) -> camera.ThermalCamera:
        """Open frames and commands; a Boson without reachable commands still gives frames."""
        scale = kelvin_per_count(settings)
        radiometric = options.flag(settings, "radiometric", False)
        source = open_source(settings, WANTED, clock)
        serial, facts = connect(source.usb, clock)
        if radiometric:
            scale = make_radiometric(serial, facts, scale)
        read = partial(decode, scale=scale)
        first = _first_frame(source.source, read, settings.name, clock, radiometric)
        info = camera.describe(settings, source, first, facts, vendor="FLIR")
        run = partial(serial.request, RUN_FFC) if serial else None
        return BosonCamera(info, source.source, read, clock, run, serial)


class BosonCamera(camera.ThermalCamera):
    """A Boson: shutter and sensor temperature are requested once a second beside the frames.

    Once a command has failed none is sent again: waiting for replies would cost frames.
    """

    def __init__(self, *given: Any) -> None:
        *rest, serial = given
        super().__init__(*rest)
        self._serial: BosonSerial | None = serial
        self._has_commands = serial is not None
        self._due_ns = 0
        self._housekeeping = (math.nan, False)

    def with_housekeeping(self, frame: DecodedFrame, mono_ns: int) -> DecodedFrame:
        """The frame with the latest housekeeping from the serial port."""
        if self._has_commands and mono_ns >= self._due_ns:
            self._due_ns = mono_ns + HOUSEKEEPING_NS
            self._housekeeping = self._request()
        fpa, running = self._housekeeping
        return frame._replace(fpa_temperature_k=fpa, shutter=running or None)

    def _request(self) -> tuple[float, bool]:
        """Temperature of the sensor, and whether a correction runs."""
        assert self._serial is not None
        try:
            return self._serial.fpa_temperature_k(), self._serial.is_shutter_running()
        except DeviceError:
            self._has_commands = False
            return math.nan, False

    def close(self) -> None:
        """Release frames and commands."""
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
    """The commands of a camera and the facts they report; (None, reason) where they cannot be reached."""
    serial = serial_side(usb, clock)
    if serial is None:
        return None, {"commands": "not reachable"}
    try:
        return serial, serial.facts()
    except DeviceError as error:
        serial.close()
        return None, {"commands": error.message}


def _first_frame(
    source: FrameSource, read: Decode, name: str, clock: Clock, radiometric: bool
) -> DecodedFrame:
    """The first frame, of a camera that was switched to temperatures the first one after the switch."""

    def temperatures(data: bytes) -> DecodedFrame | Rejected:
        frame = read(data)
        is_without = isinstance(frame, DecodedFrame) and frame.quality & Quality.NO_VALUE
        return Rejected(len(data), "no temperatures") if is_without else frame

    try:
        return camera.first_frame(source, temperatures if radiometric else read, name, clock)
    except DecodeError as error:
        if not radiometric:
            raise
        raise DeviceError(
            "TLinear was requested, but the frames hold no temperatures",
            place=name,
            fix="omit radiometric if the model is not: counts are recorded",
        ) from error


def make_radiometric(serial: BosonSerial | None, facts: Mapping[str, str], configured_scale: float) -> float:
    """Request TLinear; returns K per count, which in any gain but high must be configured (NaN if not)."""
    if serial is None:
        raise DeviceError(
            f"the Boson cannot be switched to temperatures; its commands: {facts['commands']}",
            fix=Action.DOCTOR(),
        )
    if facts["gain"] != "high" and math.isnan(configured_scale):
        raise DeviceError(
            f"the Boson is in {facts['gain']} gain; public sources disagree about the low one's scale",
            fix="set it to high gain, or compare a known temperature and set kelvin_per_count = 0.01 or 0.02",
        )
    serial.make_radiometric()
    return SCALE if math.isnan(configured_scale) else configured_scale
