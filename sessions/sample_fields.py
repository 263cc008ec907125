"""The numbers stored of every sample beside what was measured: one table for file, journal and checksum."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import repeat
from typing import Any

import numpy as np
from isal.isal_zlib import crc32

from fieldkit.model.arrays import AnyArray, FlagArray
from fieldkit.model.samples import NO_COUNTER, Quality, Sample

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
        """Type of the column, in the terms of NumPy."""
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
"""In the order in which they enter a sample's checksum and stand in the journal."""

ATTRIBUTES = tuple(field.attribute for field in SAMPLE_FIELDS)
_OF_ALL = tuple(field.attribute for field in SAMPLE_FIELDS if not field.of_frames)
_TIME, _SEQ, _FLAGS = (ATTRIBUTES.index(name) for name in ("time_ns", "seq", "quality"))
_CHECKED = struct.Struct("<" + "".join(field.code for field in SAMPLE_FIELDS))
_CHECKED_COLUMNS = np.dtype([(field.column, field.dtype) for field in SAMPLE_FIELDS])
_JOURNAL = struct.Struct("<" + "".join(field.code for field in SAMPLE_FIELDS if field.column != "seq") + "II")
STAMPS_BYTES = _JOURNAL.size
"""Of a journalled sample, what stands before its bytes."""


def stamps_of(sample: Sample) -> Stamps:
    """The numbers of a sample; those of frames alone, which come last, are unknown of a reading."""
    return tuple(getattr(sample, field.attribute, field.fill) for field in SAMPLE_FIELDS)


def by_attribute(stamps: Stamps, *, is_frame: bool) -> dict[str, Any]:
    """The numbers that a frame or a reading has, by their attributes."""
    return dict(zip(ATTRIBUTES if is_frame else _OF_ALL, stamps, strict=False))


def to_columns(stamps: Stamps) -> dict[str, Any]:
    """The numbers by the columns of the session file."""
    row = {sample_field.column: value for sample_field, value in zip(SAMPLE_FIELDS, stamps, strict=True)}
    return {**row, "time": row["time"] // 1000, "flags": int(row["flags"])}


def from_columns(columns: Mapping[str, AnyArray]) -> Iterator[Stamps]:
    """The numbers of rows of the session file, at ``time_ns``; unknown those whose column is missing."""
    values: list[Iterable[Any]] = [
        columns[field.column].tolist() if field.column in columns else repeat(field.fill)
        for field in SAMPLE_FIELDS
    ]
    values[_TIME], values[_FLAGS] = columns["time_ns"].tolist(), map(Quality, values[_FLAGS])
    return zip(*values, strict=False)


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
    """CRC-32 of a sample from that of its bytes: its numbers follow as they are stored."""
    values = list(stamps)
    values[_TIME] //= 1000
    # every NaN is the same NaN
    return crc32(_CHECKED.pack(*[value if value == value else math.nan for value in values]), crc)


def with_stored(crcs: Sequence[int], columns: Mapping[str, AnyArray]) -> FlagArray:
    """`with_stamps` of stored rows, from the CRC-32 of the bytes of each."""
    stamps = np.zeros(len(crcs), _CHECKED_COLUMNS)
    for sample_field in SAMPLE_FIELDS:
        values: Any = columns.get(sample_field.column, sample_field.fill)  # a meter has no sensor temperature
        stamps[sample_field.column] = (
            np.where(np.isnan(values), math.nan, values) if sample_field.code == "d" else values
        )
    packed, size = stamps.tobytes(), _CHECKED_COLUMNS.itemsize
    rows = (packed[place : place + size] for place in range(0, len(packed), size))
    return np.array([crc32(row, crc) for row, crc in zip(rows, crcs, strict=True)], np.uint32)
