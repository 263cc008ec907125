r"""FLIR files as pure functions: FFF, SEQ and CSQ (FFF one after another) and radiometric JPEG.

Container, camera information and Planck constants as ExifTool and two public readers agree. Two traps: the
file header may be big-endian while the pixels are little-endian (the record's first word decides), and the
bytes ``FFF\0`` occur inside pixels, so a SEQ is walked by its directories, never searched.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from mmap import mmap
from typing import Any

import numpy as np

from fieldkit import native_code
from fieldkit.drivers.decoding import text_of
from fieldkit.model.arrays import CountArray, SingleArray
from fieldkit.model.errors import DecodeError
from fieldkit.model.installation import install_extra
from fieldkit.model.next_step import Argument
from fieldkit.physics.camera_laws import Planck, path_transmission, planck_k

MAGIC = (b"FFF\0", b"AFF\0")
HEADER, ENTRY, RAW_HEADER = 64, 32, 32
RAW_IMAGE, CAMERA_INFORMATION = 0x01, 0x20
MOST_RECORDS = 1024
MOST_PIXELS = 1 << 24
_APP1, _APP2, _APP3 = 0xE1, 0xE2, 0xE3
_PNG, _JPEG_LS = b"\x89PNG", (b"\xff\xd8\xff\xf7", b"\xff\xd8\xff\xe8")
_INFORMATION_END = 0x394
_CONSTANTS = (
    # of the camera information: where they begin, as `struct` has them, their names in `Planck`
    (0x20, "6f4xf", "emissivity distance_m reflected_k air_k window_k window_transmission humidity"),
    (0x58, "3f", "r1 b f"),
    (0x70, "5f", "alpha1 alpha2 beta1 beta2 x"),
    (0x308, "if", "o r2"),
)
_SHORT_PADDING, _MOST_PADDING = 16, 1 << 16
"""Bytes after any frame, or before another: some models fill up to whole words, others to blocks or pages."""

_EXPORT_TIFF = "export 16-bit TIFF by the maker's program; import that with " + Argument("kelvin_per_count")
_RANGES = {
    # wider than any camera writes: other numbers would only fail later, inside the law
    "emissivity": (1e-3, 1.0), "window_transmission": (1e-3, 1.0), "humidity": (0.0, 1.0),
    "reflected_k": (100.0, 1000.0), "air_k": (100.0, 1000.0), "window_k": (100.0, 1000.0),
    "distance_m": (0.0, 1e5), "b": (100.0, 1e4), "r1": (1e-9, 1e12), "r2": (1e-9, 1e12), "f": (1e-9, 1e12),
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class FlirFrame:
    """One frame of a file: counts (rows, cols), its Planck constants and path, and where it came from.

    `time_ns` is UTC nanoseconds since 1970 as the camera's clock had it, 0 if the file has no time.
    """

    counts: CountArray
    constants: Planck
    model: str = ""
    serial_number: str = ""
    time_ns: int = 0
    rate_hz: float = 0.0

    def temperature_k(self) -> SingleArray:
        """Object temperature in kelvin with the emissivity and path stored in the file."""
        return planck_k(self.counts, self.constants)


def frames(data: bytes | mmap) -> Iterator[FlirFrame]:
    """Every frame of an FFF, SEQ, CSQ or radiometric JPEG file; raises `DecodeError` where it is none."""
    if data[:2] == b"\xff\xd8":
        data = embedded_fff(data)
    start, padding = 0, _SHORT_PADDING
    while start < len(data):
        end = start + frame_length(data, start)
        yield read_frame(data[start:end])
        start = _after_padding(data, end, padding)
        padding = max(padding, start - end)


def _after_padding(data: bytes | mmap, end: int, padding: int) -> int:
    """Start of the next frame, or the end of the data if no more than `padding` follows; else `end`."""
    if data[end : end + 4] in MAGIC:
        return end
    gap = data[end : end + _MOST_PADDING + 4]
    places = [gap.find(magic) for magic in MAGIC if magic in gap]
    if places:
        return end + min(places)
    return len(data) if len(data) - end <= padding else end


def embedded_fff(jpeg: bytes | mmap) -> bytes:
    """The FFF inside a radiometric JPEG: its APP1 segments "FLIR", joined in order."""
    segments = list(_segments(jpeg))
    parts = {
        body[6]: body[8:]
        for marker, body in segments
        if marker == _APP1 and body.startswith(b"FLIR\0") and len(body) >= 8
    }
    if not parts:
        raise _without_fff(segments, jpeg[:32])
    return b"".join(parts[number] for number in sorted(parts))


def _segments(jpeg: bytes | mmap) -> Iterator[tuple[int, bytes]]:
    """Marker and body of the segments before the image."""
    start = 2
    while start + 4 <= len(jpeg) and jpeg[start] == 0xFF and jpeg[start + 1] != 0xDA:
        length = int.from_bytes(jpeg[start + 2 : start + 4], "big")
        yield jpeg[start + 1], jpeg[start + 4 : start + 2 + length]
        start += 2 + max(length, 2)


def _without_fff(segments: list[tuple[int, bytes]], head: bytes) -> DecodeError:
    """The error of a JPEG of another maker (as ExifTool distinguishes them), or without temperatures."""
    is_dji = any(marker == _APP1 and b"DJI\0" in body for marker, body in segments)
    if is_dji and any(marker == _APP3 for marker, _ in segments):
        # the counts are in APP3 (GDAL reads them, pull request 12972), but nobody has published their law
        fix = "convert it to 32-bit TIFF with Thermal Tools (UAV4GEO) or DJI's SDK: " + Argument("unit", "C")
        words = "a radiometric JPEG of DJI, whose temperatures only DJI's own program finds"
        return DecodeError(words, head, fix=fix)
    if any(marker == _APP2 and body[4:10] == b"IJPEG\0" for marker, body in segments):
        words = "a radiometric JPEG of InfiRay, which fieldkit does not read"
        return DecodeError(words, head, fix=_EXPORT_TIFF)
    else_tiff = "if it is of a FLIR camera, export it as radiometric JPEG; else " + _EXPORT_TIFF
    return DecodeError("a JPEG without FLIR's thermal data", head, fix=else_tiff)


def frame_length(data: bytes | mmap, start: int = 0) -> int:
    """Bytes of the FFF at `start`: the end of its last record."""
    directory_end, entries = _entries(data, start)
    return max([directory_end, *(offset + length for _, offset, length in entries)])


def read_frame(data: bytes) -> FlirFrame:
    """Decode one FFF; raises `DecodeError`."""
    _, entries = _entries(data, 0)
    records = {kind: data[offset : offset + length] for kind, offset, length in entries}
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


def _entries(data: bytes | mmap, start: int) -> tuple[int, list[tuple[int, int, int]]]:
    """End of the directory, and (type, offset, length) of every record, from the start of the FFF."""
    order, directory, count = _header(data, start)
    entries = []
    directory_end = directory + count * ENTRY
    for place in range(start + directory, start + directory_end, ENTRY):
        if place + ENTRY > len(data):
            raise DecodeError("the FFF ends inside its directory", data[start : start + HEADER])
        kind, offset, length = struct.unpack_from(f"{order}H10xII", data, place)
        if kind and start + offset + length > len(data):
            raise DecodeError("the FFF is cut short", data[start : start + HEADER])
        if kind:
            entries.append((kind, offset, length))
    return directory_end, entries


def _order(record: bytes) -> str:
    """Byte order of a record: its first word is 2."""
    return "<" if record[:2] == b"\x02\0" else ">"


def _pixels(record: bytes) -> CountArray:
    if len(record) < RAW_HEADER:
        raise DecodeError("the raw frame has no header", record)
    order = _order(record)
    width, height = struct.unpack_from(f"{order}HH", record, 2)
    body = record[RAW_HEADER:]
    if body.startswith(_PNG):
        return _png(body, height, width)
    if body.startswith(_JPEG_LS):
        return _jpeg_ls(body, height, width)
    if not 0 < width * height <= MOST_PIXELS or len(body) < 2 * width * height:
        raise DecodeError(f"the raw frame of {width}x{height} has {len(body)} bytes", record[:RAW_HEADER])
    return (
        np.frombuffer(body, f"{order}u2", width * height).reshape(height, width).astype(np.uint16, copy=False)
    )


def _png(body: bytes, height: int, width: int) -> CountArray:
    """A frame stored as PNG, whose samples FLIR writes in the other byte order."""
    if width * height > MOST_PIXELS or body[16:24] != struct.pack(">II", width, height):
        raise DecodeError(f"the raw frame's PNG is not of {width}x{height} pixels", body[:32])
    image = native_code.decode_image(body)
    if image is None or image.dtype != np.uint16 or image.shape != (height, width):
        raise DecodeError("the raw frame's PNG does not decode", body[:32])
    return np.asarray(image, np.uint16).byteswap()


def _jpeg_ls(body: bytes, height: int, width: int) -> CountArray:
    """A frame of a ``.csq``; its size is compared before anything is unpacked."""
    try:
        from imagecodecs import jpegls_decode
    except ImportError as error:
        words = f"the raw frame of {width}x{height} is compressed as JPEG-LS (a .csq)"
        raise DecodeError(words, body[:32], fix=install_extra("files")) from error
    frame = body.find(b"\xff\xf7")  # SOF55: length, precision, rows, columns
    is_whole = body[frame + 5 : frame + 9] == struct.pack(">HH", height, width)
    try:
        image = jpegls_decode(body) if is_whole and width * height <= MOST_PIXELS else None
    except RuntimeError:
        image = None
    if image is None or image.dtype != np.uint16 or image.shape != (height, width):
        raise DecodeError("the raw frame's JPEG-LS does not decode", body[:32])
    return np.asarray(image, np.uint16)


def _with_information(counts: CountArray, record: bytes) -> FlirFrame:
    if len(record) < _INFORMATION_END:
        raise DecodeError("the camera information is too short", record[:32])
    order = _order(record)
    numbers: dict[str, float] = {}
    for offset, kinds, names in _CONSTANTS:
        numbers |= zip(names.split(), struct.unpack_from(order + kinds, record, offset), strict=True)
    if 1.0 < numbers["humidity"] <= 100.0:  # some models write percent
        numbers["humidity"] /= 100.0
    constants = Planck(**numbers)
    _refuse_nonsense(constants, record)
    seconds, milliseconds = struct.unpack_from(f"{order}II", record, 0x384)
    return FlirFrame(
        counts,
        constants,
        model=text_of(record[0xD4:0xF4]),
        serial_number=text_of(record[0x104:0x114]),
        time_ns=(seconds * 1000 + milliseconds % 1000) * 1_000_000 if seconds else 0,
        rate_hz=float(struct.unpack_from(f"{order}H", record, 0x464)[0]) if len(record) >= 0x466 else 0.0,
    )


def _refuse_nonsense(constants: Planck, record: bytes) -> None:
    wrong = []
    for name, value in asdict(constants).items():
        low, high = _RANGES.get(name, (-1e12, 1e12))
        if not low <= value <= high:
            wrong.append(f"{name} {value:g}")
    if not wrong and not _transmits(constants):
        wrong = ["a path through the air that transmits nothing"]
    if wrong:
        raise DecodeError(
            f"the camera information holds {', '.join(wrong)}: no temperatures follow from it",
            record[:64],
            fix="correct it in the maker's program, and save the file again",
        )


def _transmits(constants: Planck) -> bool:
    try:
        return 0 < path_transmission(constants) < 2
    except OverflowError:
        return False


def settings(frame: FlirFrame) -> dict[str, Any]:
    """Values of a frame that a stream with law ``planck`` records: brightness temperature, without the path.

    The emissivity set in the camera is kept as `camera_emissivity` and not applied.
    """
    camera_emissivity = frame.constants.emissivity
    return {**asdict(frame.constants), "emissivity": 1.0, "camera_emissivity": camera_emissivity}
