r"""FLIR files as pure functions: FFF, SEQ (FFF one after another) and radiometric JPEG.

Container, camera information and Planck constants as ExifTool and two public readers agree. Two traps: the
file header may be big-endian while the pixels are little-endian (the record's first word decides), and the
bytes ``FFF\0`` occur inside pixels, so a SEQ is walked by its directories, never searched.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from mmap import mmap
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldkit.model.errors import DecodeError
from fieldkit.physics.camera_laws import Planck, path_transmission, planck_k

MAGIC = (b"FFF\0", b"AFF\0")
HEADER, ENTRY, RAW_HEADER = 64, 32, 32
RAW_IMAGE, CAMERA_INFORMATION = 0x01, 0x20
MOST_RECORDS = 1024
MOST_PIXELS = 1 << 24
_PNG, _JPEG_LS = b"\x89PNG", b"\xff\xd8\xff\xf7"
_INFORMATION_END = 0x394


@dataclass(frozen=True, slots=True)
class FlirFrame:
    """One frame of a file: counts (rows, cols), its Planck constants and path, and where it came from.

    `time_ns` is UTC nanoseconds since 1970 as the camera's clock had it, 0 if the file has no time.
    """

    counts: NDArray[np.uint16]
    constants: Planck
    model: str = ""
    serial_number: str = ""
    time_ns: int = 0
    rate_hz: float = 0.0

    def temperature_k(self) -> NDArray[np.float32]:
        """Object temperature in kelvin with the emissivity and path stored in the file."""
        return planck_k(self.counts, self.constants)


def frames(data: bytes | mmap) -> Iterator[FlirFrame]:
    """Every frame of an FFF, SEQ or radiometric JPEG file; raises `DecodeError` where it is none."""
    if data[:2] == b"\xff\xd8":
        data = embedded(data)
    start = 0
    while start < len(data):
        length = frame_length(data, start)
        yield read_frame(data[start : start + length])
        start += length


def embedded(jpeg: bytes | mmap) -> bytes:
    """The FFF inside a radiometric JPEG: its APP1 segments "FLIR", joined in order."""
    parts: dict[int, bytes] = {}
    start = 2
    while start + 4 <= len(jpeg) and jpeg[start] == 0xFF and jpeg[start + 1] != 0xDA:
        length = int.from_bytes(jpeg[start + 2 : start + 4], "big")
        segment = jpeg[start + 4 : start + 2 + length]
        if jpeg[start + 1] == 0xE1 and segment.startswith(b"FLIR\0") and len(segment) >= 8:
            parts[segment[6]] = segment[8:]
        start += 2 + max(length, 2)
    if not parts:
        raise DecodeError(
            "a JPEG without FLIR's thermal data", jpeg[:32], fix="export it as radiometric JPEG"
        )
    return b"".join(parts[number] for number in sorted(parts))


def frame_length(data: bytes | mmap, start: int = 0) -> int:
    """Bytes of the FFF at `start`: the end of its last record."""
    order, directory, count = _header(data, start)
    ends = [directory + count * ENTRY]
    ends += [offset + length for _, offset, length in _entries(data, start, order, directory, count)]
    return max(ends)


def read_frame(data: bytes) -> FlirFrame:
    """Decode one FFF; raises `DecodeError`."""
    order, directory, count = _header(data, 0)
    records = {
        kind: data[offset : offset + length]
        for kind, offset, length in _entries(data, 0, order, directory, count)
    }
    if RAW_IMAGE not in records or CAMERA_INFORMATION not in records:
        raise DecodeError("an FFF without raw frame or camera information", data[:32])
    return _with_information(_pixels(records[RAW_IMAGE]), records[CAMERA_INFORMATION])


def _header(data: bytes | mmap, start: int) -> tuple[str, int, int]:
    """(byte order, directory offset, number of records); the version gives the byte order."""
    if data[start : start + 4] not in MAGIC or len(data) < start + HEADER:
        raise DecodeError(f"no FFF file at byte {start}", data[start : start + 32])
    for order in "<>":
        version, directory, count = struct.unpack_from(f"{order}III", data, start + 0x14)
        if 100 <= version < 200 and 0 < count <= MOST_RECORDS and directory >= HEADER:
            return order, directory, count
    raise DecodeError(f"the FFF header at byte {start} makes no sense", data[start : start + HEADER])


def _entries(
    data: bytes | mmap, start: int, order: str, directory: int, count: int
) -> list[tuple[int, int, int]]:
    """(type, offset, length) of every record, offsets from the start of the FFF."""
    found = []
    for number in range(count):
        place = start + directory + number * ENTRY
        if place + ENTRY > len(data):
            raise DecodeError("the FFF ends inside its directory", data[start : start + HEADER])
        (kind,) = struct.unpack_from(f"{order}H", data, place)
        offset, length = struct.unpack_from(f"{order}II", data, place + 0x0C)
        if kind and start + offset + length > len(data):
            raise DecodeError("the FFF is cut short", data[start : start + HEADER])
        if kind:
            found.append((kind, offset, length))
    return found


def _order(record: bytes) -> str:
    """Byte order of a record: its first word is 2."""
    return "<" if record[:2] == b"\x02\0" else ">"


def _pixels(record: bytes) -> NDArray[np.uint16]:
    if len(record) < RAW_HEADER:
        raise DecodeError("the raw frame has no header", record)
    order = _order(record)
    width, height = struct.unpack_from(f"{order}HH", record, 2)
    body = record[RAW_HEADER:]
    if body.startswith(_PNG):
        return _png(body, height, width)
    if body.startswith(_JPEG_LS):
        raise DecodeError(
            f"the raw frame of {width}x{height} is compressed as JPEG-LS (a .csq)",
            record[:RAW_HEADER],
            fix="save it as .seq, or its frames as radiometric JPEG, in the maker's program",
        )
    if not 0 < width * height <= MOST_PIXELS or len(body) < 2 * width * height:
        raise DecodeError(f"the raw frame of {width}x{height} has {len(body)} bytes", record[:RAW_HEADER])
    return (
        np.frombuffer(body, f"{order}u2", width * height).reshape(height, width).astype(np.uint16, copy=False)
    )


def _png(body: bytes, height: int, width: int) -> NDArray[np.uint16]:
    """A frame stored as PNG, whose samples FLIR writes in the other byte order."""
    import cv2

    if width * height > MOST_PIXELS or body[16:24] != struct.pack(">II", width, height):
        raise DecodeError(f"the raw frame's PNG is not of {width}x{height} pixels", body[:32])
    image = cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None or image.dtype != np.uint16 or image.shape != (height, width):
        raise DecodeError("the raw frame's PNG does not decode", body[:32])
    return np.asarray(image, np.uint16).byteswap()


def _with_information(counts: NDArray[np.uint16], record: bytes) -> FlirFrame:
    if len(record) < _INFORMATION_END:
        raise DecodeError("the camera information is too short", record[:32])
    order = _order(record)

    def number(offset: int) -> float:
        return float(struct.unpack_from(f"{order}f", record, offset)[0])

    constants = Planck(
        r1=number(0x58),
        b=number(0x5C),
        f=number(0x60),
        o=struct.unpack_from(f"{order}i", record, 0x308)[0],
        r2=number(0x30C),
        emissivity=number(0x20),
        distance_m=number(0x24),
        reflected_k=number(0x28),
        air_k=number(0x2C),
        window_k=number(0x30),
        window_transmission=number(0x34),
        humidity=number(0x3C),
        alpha1=number(0x70),
        alpha2=number(0x74),
        beta1=number(0x78),
        beta2=number(0x7C),
        x=number(0x80),
    )
    _refuse_nonsense(constants, record)
    seconds, milliseconds = struct.unpack_from(f"{order}II", record, 0x384)
    return FlirFrame(
        counts,
        constants,
        model=_text(record[0xD4:0xF4]),
        serial_number=_text(record[0x104:0x114]),
        time_ns=(seconds * 1000 + milliseconds % 1000) * 1_000_000 if seconds else 0,
        rate_hz=float(struct.unpack_from(f"{order}H", record, 0x464)[0]) if len(record) >= 0x466 else 0.0,
    )


def _refuse_nonsense(constants: Planck, record: bytes) -> None:
    """Numbers no camera writes would only fail later, inside the law."""
    fractions = (constants.emissivity, constants.window_transmission)
    temperatures = (constants.reflected_k, constants.air_k, constants.window_k)
    physical = (
        all(math.isfinite(getattr(constants, name)) for name in Planck.__slots__)
        and all(0 < one <= 1 for one in fractions)
        and all(100 < one < 1000 for one in temperatures)
        and 0 <= constants.humidity <= 1
        and 0 <= constants.distance_m < 1e5
        and 100 < constants.b < 1e4
        and min(constants.r1, constants.r2, constants.f) > 0
    )
    try:
        physical = physical and 0 < path_transmission(constants) < 2
    except OverflowError:
        physical = False
    if not physical:
        raise DecodeError("the camera information holds no Planck constants", record[:64])


def _text(raw: bytes) -> str:
    return raw.split(b"\0")[0].decode("ascii", "replace").strip()


def settings(frame: FlirFrame) -> dict[str, Any]:
    """What a stream with law ``planck`` records of a frame: brightness temperature, the path taken out.

    The emissivity set in the camera is kept as `camera_emissivity` and not applied.
    """
    kept = {name: getattr(frame.constants, name) for name in Planck.__slots__}
    return {**kept, "emissivity": 1.0, "camera_emissivity": frame.constants.emissivity}
