"""16-bit TIFF frames whose tags hold what a count means and when they were taken.

Scale, offset and unit stand in GDAL's metadata, which geographic programs read, the time in TIFF's own tag,
and all of it with the time to the microsecond and the flags as JSON in the description.
"""

from __future__ import annotations

import json
import math
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

# TIFF 6.0, sections 4 and 8; 42112 is GDAL's
_WIDTH, _LENGTH, _DESCRIPTION, _SOFTWARE, _DATE_TIME, _GDAL_METADATA = 256, 257, 270, 305, 306, 42112
_ASCII, _SHORT, _LONG = 2, 3, 4
_DEFLATE, _BLACK_IS_ZERO = 8, 1
_MOST_DESCRIPTION_BYTES = 65_536


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


def write_tiff(path: Path, counts: NDArray[np.uint16], tags: TiffTags, software: str) -> None:
    """One frame (rows, cols) with its tags; raises `OSError`."""
    rows, cols = counts.shape
    strip = zlib.compress(counts.astype("<u2").tobytes(), 1)
    moment = datetime.fromisoformat(tags.time).strftime("%Y:%m:%d %H:%M:%S")
    entries: dict[int, tuple[int, Any]] = {
        _WIDTH: (_LONG, cols), _LENGTH: (_LONG, rows), 258: (_SHORT, 16), 259: (_SHORT, _DEFLATE),
        262: (_SHORT, _BLACK_IS_ZERO), _DESCRIPTION: (_ASCII, _description(tags)), 273: (_LONG, 8),
        277: (_SHORT, 1), 278: (_LONG, rows), 279: (_LONG, len(strip)), _SOFTWARE: (_ASCII, software),
        _DATE_TIME: (_ASCII, moment), _GDAL_METADATA: (_ASCII, _gdal(tags)),
    }  # fmt: skip
    strip += b"\0" * (len(strip) % 2)  # a directory begins at an even byte
    at = 8 + len(strip)
    path.write_bytes(struct.pack("<2sHI", b"II", 42, at) + strip + _directory(entries, at))


def _description(tags: TiffTags) -> str:
    known = {} if math.isnan(tags.scale) else {"unit": "K", "scale": tags.scale, "offset": tags.offset}
    return json.dumps({"time": tags.time, **known, "flags": tags.flags})


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


def read_tags(path: Path) -> TiffTags | None:
    """The tags of a frame written by `write_tiff`; None of any other."""
    try:
        plain = json.loads(_text(path, _DESCRIPTION))
        scale, offset = float(plain.get("scale", math.nan)), float(plain.get("offset", 0.0))
        return TiffTags(str(plain["time"]), scale, offset, tuple(map(str, plain["flags"])))
    except (OSError, struct.error, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None  # of another program, which may write anything there


def claimed_pixels(path: Path) -> int:
    """Width times height in the first directory, before memory is allocated; 0 if they are missing."""
    try:
        order, entries = _entries(path)
        sides = [
            struct.unpack_from(f"{order}{'I' if entries[tag][0] == _LONG else 'H'}", entries[tag][2])[0]
            for tag in (_WIDTH, _LENGTH)
            if tag in entries
        ]
    except (OSError, struct.error):
        return 0
    return math.prod(sides) if sides else 0


def _entries(path: Path) -> tuple[str, dict[int, tuple[int, int, bytes]]]:
    """Byte order, and type, count and four bytes of value of each tag of the first directory."""
    with path.open("rb") as file:
        head = file.read(8)
        order = ">" if head.startswith(b"MM") else "<"
        file.seek(struct.unpack_from(f"{order}I", head, 4)[0])
        (count,) = struct.unpack(f"{order}H", file.read(2))
        rows = [struct.unpack(f"{order}HHI4s", file.read(12)) for _ in range(count)]
    return order, {tag: (kind, length, value) for tag, kind, length, value in rows}


def _text(path: Path, tag: int) -> str:
    order, entries = _entries(path)
    _, length, value = entries[tag]
    with path.open("rb") as file:
        file.seek(struct.unpack(f"{order}I", value)[0])
        return file.read(min(length, _MOST_DESCRIPTION_BYTES)).rstrip(b"\0").decode("ascii")
