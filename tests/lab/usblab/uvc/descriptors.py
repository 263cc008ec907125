"""What a camera says about itself: device, configuration and string descriptors."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from itertools import pairwise

CONTROL_INTERFACE, STREAMING_INTERFACE = 0, 1
CAMERA_TERMINAL, PROCESSING_UNIT, OUTPUT_TERMINAL = 1, 2, 100
ZOOM_ABSOLUTE = 0x0B
ZOOM_BIT = 1 << 9
_FOURCC_TAIL = bytes.fromhex("00001000800000aa00389b71")


def fourcc_guid(name: str) -> bytes:
    """The format's GUID: its four letters and the tail all such formats share."""
    return name.encode("ascii") + _FOURCC_TAIL


BGR24_GUID = bytes.fromhex("7deb36e44f52ce119f530020af0ba770")


@dataclass(frozen=True)
class PictureFormat:
    """One pixel format with its picture sizes (width, height), all at the same rate."""

    guid: bytes
    bits: int
    sizes: tuple[tuple[int, int], ...]

    def frame_bytes(self, frame: int) -> int:
        """Bytes of one picture; `frame` counts from 1 as in the descriptors."""
        width, height = self.sizes[frame - 1]
        return width * height * self.bits // 8


@dataclass(frozen=True)
class ExtensionUnit:
    """A unit of the maker's own controls; selectors count from 1."""

    unit: int
    guid: bytes
    selectors: tuple[int, ...]


@dataclass(frozen=True)
class Endpoint:
    """The pipe pictures come through; `interval` as in the descriptor (bInterval)."""

    address: int
    isochronous: bool
    max_packet: int
    interval: int = 0

    @property
    def packet_bytes(self) -> int:
        """Bytes in one service interval, the extra transactions of a high-bandwidth endpoint included."""
        return (self.max_packet & 0x7FF) * ((self.max_packet >> 11 & 3) + 1)


@dataclass(frozen=True)
class CameraShape:
    """Everything the descriptors of one camera model are made from."""

    vendor: int
    product: int
    maker: str
    title: str
    formats: tuple[PictureFormat, ...]
    interval_100ns: int
    endpoint: Endpoint
    serial_number: str = ""
    release: int = 0x0100
    high_speed: bool = True
    extensions: tuple[ExtensionUnit, ...] = ()
    terminal_controls: int = 0
    status_endpoint: int = 0

    @property
    def rate_hz(self) -> float:
        """Pictures a second."""
        return 1e7 / self.interval_100ns

    @property
    def strings(self) -> tuple[str, ...]:
        """String descriptors 1, 2, 3."""
        return (self.maker, self.title, self.serial_number)


def device(shape: CameraShape) -> bytes:
    """The device descriptor: miscellaneous class with interface association."""
    numbers = [number if text else 0 for number, text in enumerate(shape.strings, 1)]
    return struct.pack(
        "<BBHBBBBHHHBBBB",
        18, 1, 0x0200, 0xEF, 2, 1, 64, shape.vendor, shape.product, shape.release, *numbers, 1,
    )  # fmt: skip


def qualifier() -> bytes:
    """What the device would be at the other speed; asked at high speed only."""
    return struct.pack("<BBHBBBBBB", 10, 6, 0x0200, 0xEF, 2, 1, 64, 1, 0)


def string(text: str) -> bytes:
    """A string descriptor."""
    encoded = text.encode("utf-16-le")
    return struct.pack("BB", 2 + len(encoded), 3) + encoded


LANGUAGES = struct.pack("<BBH", 4, 3, 0x0409)


def configuration(shape: CameraShape) -> bytes:
    """The whole configuration: association, control interface with its units, streaming interface."""
    association = struct.pack("8B", 8, 0x0B, CONTROL_INTERFACE, 2, 0x0E, 3, 0, 0)
    body = association + _control_interface(shape) + _streaming_interface(shape)
    return struct.pack("<BBHBBBBB", 9, 2, 9 + len(body), 2, 1, 0, 0x80, 50) + body


def _interface(number: int, alternate: int, endpoints: int, subclass: int) -> bytes:
    return struct.pack("9B", 9, 4, number, alternate, endpoints, 0x0E, subclass, 0, 0)


def _endpoint(address: int, attributes: int, max_packet: int, interval: int) -> bytes:
    return struct.pack("<BBBBHB", 7, 5, address, attributes, max_packet, interval)


def _control_interface(shape: CameraShape) -> bytes:
    chain = [PROCESSING_UNIT, *(extension.unit for extension in shape.extensions)]
    units = struct.pack("<BBBBHBBHHHB", 18, 0x24, 2, CAMERA_TERMINAL, 0x0201, 0, 0, 0, 0, 0, 3)
    units += shape.terminal_controls.to_bytes(3, "little")
    units += struct.pack("<BBBBBHBHB", 11, 0x24, 5, PROCESSING_UNIT, CAMERA_TERMINAL, 0, 2, 0, 0)
    for extension, (source, _) in zip(shape.extensions, pairwise(chain), strict=True):
        units += _extension_unit(extension, source)
    units += struct.pack("<BBBBHBBB", 9, 0x24, 3, OUTPUT_TERMINAL, 0x0101, 0, chain[-1], 0)
    header = struct.pack(
        "<BBBHHIBB", 13, 0x24, 1, 0x0100, 13 + len(units), 48_000_000, 1, STREAMING_INTERFACE
    )
    status = b""
    if shape.status_endpoint:
        status = _endpoint(shape.status_endpoint, 3, 8, 8) + struct.pack("<BBBH", 5, 0x25, 3, 8)
    return _interface(CONTROL_INTERFACE, 0, bool(status), 1) + header + units + status


def _extension_unit(extension: ExtensionUnit, source: int) -> bytes:
    controls = sum(1 << (selector - 1) for selector in extension.selectors).to_bytes(4, "little")
    head = struct.pack(
        "<BBBB16sBBBB", 29, 0x24, 6, extension.unit, extension.guid, len(extension.selectors), 1, source, 4
    )
    return head + controls + b"\0"


def _streaming_interface(shape: CameraShape) -> bytes:
    formats = b"".join(_format(number, shape) for number in range(1, len(shape.formats) + 1))
    count = len(shape.formats)
    pipe, size = shape.endpoint, 13 + count
    head = struct.pack("<BBBBHB", size, 0x24, 1, count, size + len(formats), pipe.address)
    classes = head + bytes((0, OUTPUT_TERMINAL, 0, 0, 0, 1)) + bytes(count) + formats
    idle = _interface(STREAMING_INTERFACE, 0, int(not pipe.isochronous), 2) + classes
    if not pipe.isochronous:
        return idle + _endpoint(pipe.address, 2, pipe.max_packet, 0)
    streaming = _endpoint(pipe.address, 5, pipe.max_packet, pipe.interval)
    return idle + _interface(STREAMING_INTERFACE, 1, 1, 2) + streaming


def _format(number: int, shape: CameraShape) -> bytes:
    pixels = shape.formats[number - 1]
    head = struct.pack(
        "<BBBBB16sBBBBBB", 27, 0x24, 4, number, len(pixels.sizes), pixels.guid, pixels.bits, 1, 0, 0, 0, 0
    )
    frames = b"".join(_frame(frame, pixels, shape) for frame in range(1, len(pixels.sizes) + 1))
    return head + frames + struct.pack("6B", 6, 0x24, 0x0D, 1, 1, 4)


def _frame(frame: int, pixels: PictureFormat, shape: CameraShape) -> bytes:
    width, height = pixels.sizes[frame - 1]
    size = pixels.frame_bytes(frame)
    bit_rate, interval = int(size * 8 * shape.rate_hz), shape.interval_100ns
    return struct.pack(
        "<BBBBBHHIIIIBI",
        30, 0x24, 5, frame, 0, width, height, bit_rate, bit_rate, size, interval, 1, interval,
    )  # fmt: skip
