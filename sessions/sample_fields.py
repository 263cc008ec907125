"""The numbers stored of every sample beside what was measured: one table for file, journal and checksum."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Any

import numpy as np
from isal.isal_zlib import crc32
from numpy.typing import NDArray

from fieldkit.model.samples import NO_COUNTER, Frame, Quality, Sample

Stamps = tuple[Any, ...]
"""The numbers of a sample in the order of `SAMPLE_FIELDS`."""


@dataclass(frozen=True, slots=True)
class SampleField:
    """One of them: its `column` in the file, its `attribute` of a sample, its `code` of `struct`.

    `fill` stands where it is not known; `about` are the column's attributes; `of_frames` alone some are.
    """

    column: str
    attribute: str
    code: str = "q"
    fill: float | None = None
    about: dict[str, Any] = field(default_factory=dict)
    of_frames: bool = False

    @property
    def dtype(self) -> str:
        """Of the column, in the terms of NumPy."""
        return {"q": "<i8", "I": "<u4", "d": "<f8"}[self.code]


SAMPLE_FIELDS: tuple[SampleField, ...] = (
    SampleField(
        "mono_ns", "mono_ns", about={"units": "ns", "long_name": "host monotonic clock at the first byte"}
    ),
    SampleField("time", "time_ns"),  # microseconds in the file, nanoseconds in the journal
    SampleField("device_time", "device_time", fill=NO_COUNTER, about={"long_name": "the device's own stamp"}),
    SampleField("seq", "seq", about={"long_name": "number of the sample, from 0", "units": "1"}),
    SampleField(
        "device_seq", "device_seq", fill=NO_COUNTER,
        about={"long_name": "the device's own counter, or the kernel's"},
    ),
    SampleField("flags", "quality", "I"),
    SampleField(
        "fpa_temperature", "fpa_temperature_k", "d", math.nan,
        {"units": "K", "long_name": "temperature of the camera's sensor"}, of_frames=True,
    ),
)  # fmt: skip
"""In the order in which they enter a sample's checksum; one that is added goes last.

It makes the stamps of the journal longer: recordings that an earlier version left interrupted are to be
recovered before. Earlier versions flag samples in which it is known as damaged.
"""

ATTRIBUTES = tuple(one.attribute for one in SAMPLE_FIELDS)
_OF_ALL = tuple(one.attribute for one in SAMPLE_FIELDS if not one.of_frames)
_UNKNOWN = tuple(one.fill for one in SAMPLE_FIELDS if one.of_frames)
_TIME, _SEQ, _FLAGS = (ATTRIBUTES.index(name) for name in ("time_ns", "seq", "quality"))
_LOW_FLAGS = 0xFFFF
_ALWAYS, _LATER = SAMPLE_FIELDS[:7], SAMPLE_FIELDS[7:]
"""In the checksum of every sample, and where they are known: samples of earlier formats keep theirs."""
_CHECKED = struct.Struct("<" + "".join(one.code for one in _ALWAYS).replace("I", "H"))
_CHECKED_COLUMNS = np.dtype([(one.column, one.dtype.replace("u4", "u2")) for one in _ALWAYS])
_JOURNAL = struct.Struct("<" + "".join(one.code for one in SAMPLE_FIELDS if one.column != "seq") + "II")
STAMPS_BYTES = _JOURNAL.size
"""Of a journalled sample, what stands before its bytes."""

_frame_stamps, _reading_stamps = attrgetter(*ATTRIBUTES), attrgetter(*_OF_ALL)


def stamps_of(sample: Sample) -> Stamps:
    """The numbers of a sample; those of frames alone, which come last, are unknown of a reading."""
    if isinstance(sample, Frame):
        return tuple(_frame_stamps(sample))
    return (*_reading_stamps(sample), *_UNKNOWN)


def of_frame(stamps: Stamps) -> dict[str, Any]:
    """The numbers of a frame by their attributes."""
    return dict(zip(ATTRIBUTES, stamps, strict=True))


def of_reading(stamps: Stamps) -> dict[str, Any]:
    """Those that a reading has, by their attributes."""
    return dict(zip(_OF_ALL, stamps, strict=False))


def to_columns(stamps: Stamps) -> dict[str, Any]:
    """The numbers by the columns of the session file."""
    row = {one.column: value for one, value in zip(SAMPLE_FIELDS, stamps, strict=True)}
    return {**row, "time": row["time"] // 1000, "flags": int(row["flags"])}


def from_columns(columns: Mapping[str, NDArray[Any]], row: int, time_ns: int) -> Stamps:
    """The numbers of a row of the session file at a time; unknown those whose column it does not have."""
    values: list[Any] = [
        columns[one.column][row].item() if one.column in columns else one.fill for one in SAMPLE_FIELDS
    ]
    values[_TIME], values[_FLAGS] = time_ns, Quality(values[_FLAGS])
    return tuple(values)


def to_journal(stamps: Stamps, crc: int, size: int) -> bytes:
    """The numbers as the journal has them, with the sample's checksum and the bytes of what was measured.

    `seq` is the record's own.
    """
    return _JOURNAL.pack(*stamps[:_SEQ], *stamps[_SEQ + 1 :], crc, size)


def from_journal(payload: bytes, seq: int) -> tuple[Stamps, int, int]:
    """Numbers, checksum and size that `to_journal` wrote; raises `ValueError` for too few bytes."""
    if len(payload) < STAMPS_BYTES:
        raise ValueError(f"a sample of {len(payload)} bytes")
    *values, crc, size = _JOURNAL.unpack_from(payload)
    values.insert(_SEQ, seq)
    values[_FLAGS] = Quality(values[_FLAGS])
    return tuple(values), crc, size


def with_stamps(crc: int, stamps: Stamps) -> int:
    """CRC-32 of a sample from that of its bytes: its numbers follow as they are stored.

    What formats before 1.5 do not have follows at the end, where there is any: flags above the sixteenth bit,
    then fields that were added later.
    """
    values, flags = list(stamps), int(stamps[_FLAGS])
    values[_TIME] //= 1000
    values[_FLAGS] = flags & _LOW_FLAGS
    first = [one if one == one else math.nan for one in values[: len(_ALWAYS)]]  # every NaN is the same NaN
    return _with_later(crc32(_CHECKED.pack(*first), crc), flags, values[len(_ALWAYS) :])


def with_stored(crcs: Sequence[int], columns: Mapping[str, NDArray[Any]]) -> NDArray[np.uint32]:
    """`with_stamps` of stored rows, from the CRC-32 of the bytes of each."""
    stamps = np.zeros(len(crcs), _CHECKED_COLUMNS)
    for one in _ALWAYS:
        values: Any = columns.get(one.column, one.fill)  # a meter has no sensor temperature
        stamps[one.column] = np.where(np.isnan(values), math.nan, values) if one.code == "d" else values
    stamps["flags"] = columns["flags"] & _LOW_FLAGS
    packed, size = stamps.tobytes(), _CHECKED_COLUMNS.itemsize
    later = [columns.get(one.column, np.full(len(crcs), one.fill)).tolist() for one in _LATER]
    found = (
        _with_later(crc32(packed[place * size : (place + 1) * size], crc), flags, values)
        for place, (crc, flags, *values) in enumerate(
            zip(crcs, columns["flags"].tolist(), *later, strict=True)
        )
    )
    return np.fromiter(found, np.uint32, len(crcs))


def _with_later(crc: int, flags: int, later: Sequence[Any]) -> int:
    high = flags & ~_LOW_FLAGS
    crc = crc32(high.to_bytes(4, "little"), crc) if high else crc
    for one, value in zip(_LATER, later, strict=True):
        if value == value and value != one.fill:
            crc = crc32(one.column.encode() + struct.pack(f"<{one.code}", value), crc)
    return crc
