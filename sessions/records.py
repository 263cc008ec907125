"""Records of a session, one after the other, and their bytes.

A record is a sample (`Frame`, `Reading`) or an entry: an `Event`, a `Health`, a
`ClockCheck`, a `MinuteRecord` or a `RegionRecord`. Samples keep their bytes; entries become
JSON, in which Python writes every float exactly.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from isal.isal_zlib import crc32

from fieldkit.model.arrays import AnyArray, FlagArray
from fieldkit.model.clock import ClockCheck
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import SessionError, message_of
from fieldkit.model.learnt import Learnt
from fieldkit.model.samples import Event, Frame, Health, Quality, Reading, Sample
from fieldkit.model.site import RegionRecord as RegionRecord
from fieldkit.model.slope import SlopeEstimate
from fieldkit.sessions import sample_fields
from fieldkit.sessions.json_forms import build

_NAN = float("nan")


@dataclass(frozen=True, slots=True)
class MinuteRecord:
    """The estimates made when a minute closed, and what the data had taught by then."""

    time_ns: int
    estimates: tuple[SlopeEstimate, ...]
    irradiance_w_m2: float = _NAN
    irradiance_model: str = ""
    flags: Quality = Quality.GOOD
    learnt: Learnt | None = None


Entry = Event | Health | ClockCheck | MinuteRecord | RegionRecord
Record = Sample | Entry

_KINDS: Mapping[str, type[Entry]] = {
    "event": Event,
    "health": Health,
    "clock": ClockCheck,
    "minute": MinuteRecord,
    "region": RegionRecord,
}
_NAMES = {kind: name for name, kind in _KINDS.items()}


@cache
def field_names(kind: type) -> tuple[str, ...]:
    """The fields of a dataclass, none of another class; an entry is written or read every second."""
    return tuple(field.name for field in fields(kind)) if is_dataclass(kind) else ()


def encode_entry(entry: Entry) -> tuple[str, str]:
    """Kind and JSON of an entry."""
    return _NAMES[type(entry)], _encode(entry)


def _as_json(value: Any) -> Any:
    """A dataclass as its fields by name, anything else that JSON does not know as text."""
    names = field_names(type(value))  # type: ignore[arg-type]  # mypy takes no type[T] for hashable
    return {name: getattr(value, name) for name in names} if names else str(value)


_encode: Callable[[Entry], str] = json.JSONEncoder(default=_as_json).encode


def decode_entry(kind: str, body: str) -> Entry:
    """The entry that `encode_entry` wrote; raises `SessionError` where it is none."""
    try:
        return build(_KINDS[kind], json.loads(body))
    except (KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
        raise SessionError(f"a journal entry of kind {kind!r} makes no sense: {message_of(error)}") from error


def sample_bytes(sample: Sample) -> tuple[memoryview, memoryview]:
    """Measured values and what came with them: counts and metadata rows, or values and raw bytes."""
    if isinstance(sample, Frame):
        return _bytes_of(sample.counts), _bytes_of(sample.metadata_rows)
    return _bytes_of(np.array(sample.values, "<f8")), memoryview(sample.raw)


def _bytes_of(array: AnyArray) -> memoryview:
    """The array's memory, little-endian; an empty array has none to cast."""
    kind = "<f8" if array.dtype.kind == "f" else "<u2"
    return memoryview(np.ascontiguousarray(array, kind).data).cast("B") if array.size else memoryview(b"")


def sample_crc32(sample: Sample, data: memoryview, more: memoryview) -> int:
    """CRC-32 of a sample: its bytes, then its stamps, counters and flags as they are stored.

    The same value stands in the journal and in the file, so a changed bit anywhere in a
    sample is noticed.
    """
    return sample_fields.with_stamps(crc32(more, crc32(data)), sample_fields.stamps_of(sample))


def stored_crc32s(columns: Mapping[str, AnyArray], bodies: Iterable[tuple[AnyArray, AnyArray]]) -> FlagArray:
    """`sample_crc32` of stored rows, from their columns and what was measured and came with it in each."""
    return sample_fields.with_stored([crc32(more.data, crc32(data.data)) for data, more in bodies], columns)


# --- samples in the journal


def encode_sample(sample: Sample) -> tuple[tuple[bytes, memoryview, memoryview], int]:
    """A sample as the journal keeps it, in parts, and its checksum; its number is the record's."""
    data, more = sample_bytes(sample)
    crc = sample_crc32(sample, data, more)
    return (sample_fields.to_journal(sample_fields.stamps_of(sample), crc, len(data)), data, more), crc


@dataclass(frozen=True, slots=True)
class SampleRow:
    """One sample as the journal keeps it; `data` is None once only the session file has the frame."""

    stream: int
    seq: int
    stamps: sample_fields.Stamps
    crc32: int
    data: bytes | None = None
    more: bytes | None = None

    @classmethod
    def decode(cls, stream: int, seq: int, payload: bytes) -> SampleRow:
        """Sample that `encode_sample` wrote, or its stamps alone."""
        stamps, crc, size = sample_fields.from_journal(payload, seq)
        row = cls(stream, seq, stamps, crc)
        body = payload[sample_fields.STAMPS_BYTES :]
        return replace(row, data=body[:size], more=body[size:]) if body else row

    def sample(self, info: StreamInfo) -> Sample | None:
        """The sample, or None where its bytes are gone or do not match their checksum."""
        if self.data is None or self.more is None:
            return None
        try:
            sample = build_sample(info, self.stamps, self.data, self.more)
            matches = sample_crc32(sample, *sample_bytes(sample)) == self.crc32
        except (ValueError, TypeError, OverflowError, struct.error):
            return None
        return sample if matches else None


def build_sample(info: StreamInfo, stamps: sample_fields.Stamps, data: bytes, more: bytes) -> Sample:
    """A sample from its stored bytes; raises `ValueError` if they do not fill what was declared."""
    numbers = sample_fields.by_attribute(stamps, is_frame=info.is_camera)
    if info.is_camera:
        counts = np.frombuffer(data, "<u2").reshape(info.shape)
        rows = np.frombuffer(more, "<u2").reshape(info.metadata_shape)
        return Frame(info.name, counts=counts, metadata_rows=rows, **numbers)
    values = np.frombuffer(data, "<f8").reshape(info.shape)
    return Reading(info.name, values=tuple(values.tolist()), raw=more, **numbers)
