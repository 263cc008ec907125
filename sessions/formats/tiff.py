"""16-bit TIFF frames: pages of any program's files, and frames written with what a count means and when.

Scale, offset and unit stand in GDAL's metadata, which geographic programs read, the time in TIFF's own tag,
and all of it with the time to the microsecond and the flags as JSON in the description.
"""

from __future__ import annotations

import json
import math
import mmap
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from fieldkit.model.arrays import AnyArray, CountArray

# TIFF 6.0, sections 4, 8, 12 and 19; 42112 is GDAL's
_NEW_SUBFILE, _SUBFILE, _BITS, _ORIENTATION, _SAMPLES, _SAMPLE_FORMAT = 254, 255, 258, 274, 277, 339
_WIDTH, _LENGTH, _DESCRIPTION, _SOFTWARE, _DATE_TIME, _GDAL_METADATA = 256, 257, 270, 305, 306, 42112
_ASCII, _SHORT, _LONG = 2, 3, 4
_DEFLATE, _BLACK_IS_ZERO = 8, 1
_REDUCED_OR_MASK, _REDUCED = 0b101, 2  # of NewSubfileType; of its predecessor
_NUMBERS = {1: "B", _SHORT: "H", _LONG: "I", 16: "Q"}
_MOST_DESCRIPTION_BYTES = 65_536
_MOST_BYTES = 1 << 31  # of OpenCV's arrays


@dataclass(frozen=True, slots=True)
class TiffTags:
    """The tags of a frame.

    Kelvin = counts * `scale` + `offset`, NaN where the temperature is not known. `time` is ISO 8601 with its
    offset; `flags` are names of `Quality`.
    """

    time: str
    scale: float
    offset: float = 0.0
    flags: tuple[str, ...] = ()


def write_tiff(path: Path, counts: CountArray, tags: TiffTags, software: str) -> None:
    """One frame (rows, cols) with its tags; raises `OSError`."""
    rows, cols = counts.shape
    strip = zlib.compress(counts.astype("<u2").tobytes(), 1)
    moment = datetime.fromisoformat(tags.time).strftime("%Y:%m:%d %H:%M:%S")
    entries: dict[int, tuple[int, Any]] = {
        _WIDTH: (_LONG, cols), _LENGTH: (_LONG, rows), _BITS: (_SHORT, 16), 259: (_SHORT, _DEFLATE),
        262: (_SHORT, _BLACK_IS_ZERO), _DESCRIPTION: (_ASCII, _description(tags)), 273: (_LONG, 8),
        _SAMPLES: (_SHORT, 1), 278: (_LONG, rows), 279: (_LONG, len(strip)), _SOFTWARE: (_ASCII, software),
        _DATE_TIME: (_ASCII, moment), _GDAL_METADATA: (_ASCII, _gdal(tags)),
    }  # fmt: skip
    strip += b"\0" * (len(strip) % 2)  # a directory begins at an even byte
    at = 8 + len(strip)
    path.write_bytes(struct.pack("<2sHI", b"II", 42, at) + strip + _directory(entries, at))


def _description(tags: TiffTags) -> str:
    meaning = {} if math.isnan(tags.scale) else {"unit": "K", "scale": tags.scale, "offset": tags.offset}
    return json.dumps({"time": tags.time, **meaning, "flags": tags.flags})


def _gdal(tags: TiffTags) -> str:
    if math.isnan(tags.scale):
        return "<GDALMetadata></GDALMetadata>"
    items = (("SCALE", "scale", tags.scale), ("OFFSET", "offset", tags.offset), ("UNITTYPE", "unittype", "K"))
    lines = (f'<Item name="{name}" sample="0" role="{role}">{value}</Item>' for name, role, value in items)
    return f"<GDALMetadata>{''.join(lines)}</GDALMetadata>"


def _directory(entries: Mapping[int, tuple[int, Any]], at: int) -> bytes:
    """The image file directory that begins at byte `at`, with the texts behind it."""
    behind, packed = b"", [struct.pack("<H", len(entries))]
    texts_at = at + 2 + 12 * len(entries) + 4
    for tag, (kind, value) in sorted(entries.items()):
        if kind == _ASCII:
            text = value.encode("ascii", "replace") + b"\0"
            packed.append(struct.pack("<HHII", tag, kind, len(text), texts_at + len(behind)))
            behind += text
        else:
            packed.append(struct.pack("<HHII", tag, kind, 1, value))
    return b"".join(packed) + struct.pack("<I", 0) + behind


@dataclass(frozen=True, slots=True)
class _Layout:
    """Form of a file's directories: byte order, and struct's codes; byte `first_at` names the first."""

    order: str
    first_at: int
    place: str
    count: str
    entry: str


_LAYOUTS = {
    magic + struct.pack(f"{order}H", version): _Layout(order, *more)
    for magic, order in ((b"II", "<"), (b"MM", ">"))
    for version, more in ((42, (4, "I", "H", "HHI4s")), (43, (8, "Q", "Q", "HHQ8s")))  # 43: BigTIFF
}


@dataclass(frozen=True, slots=True)
class Page:
    """One page of a TIFF, as its directory describes it.

    `shape` is (rows, cols); `kind` of its numbers 1 for unsigned, 2 signed, 3 floating-point (SampleFormat);
    `is_frame` holds of all but smaller copies and masks of other pages; `tags` are what `write_tiff` wrote.
    """

    shape: tuple[int, int]
    channels: int
    bits: int
    kind: int
    orientation: int
    is_frame: bool
    tags: TiffTags | None
    _layout: _Layout
    _at: int
    _oriented_at: int

    def read(self, path: Path) -> AnyArray | None:
        """The image as it is stored, (rows, cols); None where it does not decode. Raises `OSError`."""
        import cv2

        with path.open("rb") as file:
            data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY)
        # OpenCV reads the page that comes first, and turns it by its tag
        struct.pack_into(self._layout.order + self._layout.place, data, self._layout.first_at, self._at)
        if self._oriented_at:
            struct.pack_into(self._layout.order + "H", data, self._oriented_at, 1)
        try:
            cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)  # unknown tags are harmless
            return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        except cv2.error:  # larger than OpenCV allows
            return None


@dataclass(frozen=True, slots=True)
class _Entry:
    """A tag: how many values, the first as a number (0 of text), and the bytes of them or of their place."""

    length: int
    number: int
    value: bytes
    at: int


def read_pages(path: Path) -> Iterator[Page]:
    """The pages of a TIFF or BigTIFF, in order; raises `OSError`, or `ValueError` where it is damaged."""
    if path.stat().st_size >= _MOST_BYTES:
        raise ValueError("it has more than 2 GB")
    with path.open("rb") as file:
        layout = _LAYOUTS.get(file.read(4))
        if layout is None:
            raise ValueError("it does not begin as a TIFF")
        try:
            yield from _pages(file, layout)
        except struct.error as error:
            raise ValueError("it ends within a directory") from error


def _pages(file: BinaryIO, layout: _Layout) -> Iterator[Page]:
    (at,), places = _unpack(file, layout.first_at, layout, layout.place), set[int]()
    while at:
        if at in places:
            raise ValueError("its directories form a circle")
        places.add(at)
        entries = _entries(file, layout, at)
        (following,) = _unpack(file, file.tell(), layout, layout.place)
        yield _page(file, layout, at, entries)
        at = following


def _entries(file: BinaryIO, layout: _Layout, at: int) -> dict[int, _Entry]:
    """The tags of the directory at byte `at`, after which the file stands at the place of the next."""
    (count,) = _unpack(file, at, layout, layout.count)
    entries = {}
    for _ in range(count):
        tag, kind, length, value = _unpack(file, file.tell(), layout, layout.entry)
        code = _NUMBERS.get(kind)
        number = struct.unpack_from(layout.order + code, value)[0] if code else 0
        entries[tag] = _Entry(length, number, value, file.tell() - len(value))
    return entries


def _page(file: BinaryIO, layout: _Layout, at: int, entries: Mapping[int, _Entry]) -> Page:
    def number(tag: int, default: int) -> int:
        return entries[tag].number if tag in entries else default

    return Page(
        shape=(number(_LENGTH, 0), number(_WIDTH, 0)),
        channels=number(_SAMPLES, 1),
        bits=number(_BITS, 1),
        kind=number(_SAMPLE_FORMAT, 1),
        orientation=number(_ORIENTATION, 1),
        is_frame=not number(_NEW_SUBFILE, 0) & _REDUCED_OR_MASK and number(_SUBFILE, 1) != _REDUCED,
        tags=_tags(file, layout, entries[_DESCRIPTION]) if _DESCRIPTION in entries else None,
        _layout=layout, _at=at, _oriented_at=entries[_ORIENTATION].at if _ORIENTATION in entries else 0,
    )  # fmt: skip


def _unpack(file: BinaryIO, at: int, layout: _Layout, codes: str) -> tuple[Any, ...]:
    file.seek(at)
    return struct.unpack(layout.order + codes, file.read(struct.calcsize("=" + codes)))


def _tags(file: BinaryIO, layout: _Layout, description: _Entry) -> TiffTags | None:
    """Content that `write_tiff` wrote; another program may have written anything there."""
    try:
        file.seek(struct.unpack(layout.order + layout.place, description.value)[0])
        plain = json.loads(file.read(min(description.length, _MOST_DESCRIPTION_BYTES)).rstrip(b"\0"))
        scale, offset = float(plain.get("scale", math.nan)), float(plain.get("offset", 0.0))
        return TiffTags(str(plain["time"]), scale, offset, tuple(map(str, plain["flags"])))
    except (OSError, struct.error, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None
