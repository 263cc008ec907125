"""What a session is made of, one record after the other, and how each becomes bytes.

A record is a sample (`Frame`, `Reading`) or an entry: an `Event`, a `Health`, a
`ClockCheck`, a `MinuteRecord` or a `RegionRecord`. Samples keep their bytes; entries become
JSON, in which Python writes every float exactly.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np
from isal.isal_zlib import crc32
from numpy.typing import NDArray

from fieldkit.model.clock import ClockCheck
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import SessionError, message_of
from fieldkit.model.learnt import Learnt
from fieldkit.model.samples import Event, Frame, Health, Quality, Reading, Sample
from fieldkit.model.site import RegionRecord as RegionRecord
from fieldkit.model.slope import SlopeEstimate
from fieldkit.sessions.json_forms import build

_STAMPS = struct.Struct("<qqqqqHd")
_STAMP_COLUMNS = np.dtype(
    {
        "names": ["mono_ns", "time", "device_time", "seq", "device_seq", "flags", "fpa_temperature"],
        "formats": ["<i8", "<i8", "<i8", "<i8", "<i8", "<u2", "<f8"],
    }
)
"""The same stamps by the names of their columns."""
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


def encode_entry(entry: Entry) -> tuple[str, str]:
    """Kind and JSON of an entry."""
    return _NAMES[type(entry)], json.dumps(entry, default=_as_json)


def _as_json(value: Any) -> Any:
    """A dataclass as its fields by name, anything else that JSON does not know as text."""
    if is_dataclass(value):
        return {field.name: getattr(value, field.name) for field in fields(value)}
    return str(value)


def decode_entry(kind: str, body: str) -> Entry:
    """The entry that `encode_entry` wrote; raises `SessionError` where it is none."""
    try:
        return build(_KINDS[kind], json.loads(body))
    except (KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
        raise SessionError(f"a journal entry of kind {kind!r} makes no sense: {message_of(error)}") from error


def sample_bytes(sample: Sample) -> tuple[memoryview, memoryview]:
    """What was measured and what came with it: counts and metadata rows, or values and raw bytes."""
    if isinstance(sample, Frame):
        return _bytes_of(sample.counts), _bytes_of(sample.metadata_rows)
    return _bytes_of(np.array(sample.values, "<f8")), memoryview(sample.raw)


def _bytes_of(array: NDArray[Any]) -> memoryview:
    """The array's memory, little-endian; an empty array has none to cast."""
    kind = "<f8" if array.dtype.kind == "f" else "<u2"
    return memoryview(np.ascontiguousarray(array, kind).data).cast("B") if array.size else memoryview(b"")


def sample_crc32(sample: Sample, data: memoryview, more: memoryview) -> int:
    """CRC-32 of a sample: its bytes, then its stamps, counters and flags as they are stored.

    The same value stands in the journal and in the file, so a changed bit anywhere in a
    sample is noticed.
    """
    fpa = sample.fpa_temperature_k if isinstance(sample, Frame) else _NAN
    stamps = _STAMPS.pack(
        sample.mono_ns, sample.time_ns // 1000, sample.device_time, sample.seq, sample.device_seq,
        int(sample.quality), fpa if fpa == fpa else _NAN,  # every NaN is the same NaN
    )  # fmt: skip
    return crc32(stamps, crc32(more, crc32(data)))


def stored_crc32s(
    columns: Mapping[str, NDArray[Any]], bodies: Iterable[tuple[NDArray[Any], NDArray[Any]]]
) -> NDArray[np.uint32]:
    """`sample_crc32` of stored rows, from their columns and what was measured and came with it in each."""
    stamps = np.zeros(len(columns["seq"]), _STAMP_COLUMNS)
    for name in _STAMP_COLUMNS.names or ():
        stamps[name] = columns.get(name, _NAN)  # a meter has no sensor temperature
    stamps["fpa_temperature"][np.isnan(stamps["fpa_temperature"])] = _NAN  # every NaN is the same NaN
    packed, size = stamps.tobytes(), _STAMP_COLUMNS.itemsize
    crcs = (
        crc32(packed[place * size : (place + 1) * size], crc32(more.data, crc32(data.data)))
        for place, (data, more) in enumerate(bodies)
    )
    return np.fromiter(crcs, np.uint32, len(stamps))


def build_frame(info: StreamInfo, stamps: dict[str, Any], data: bytes, more: bytes, fpa: float) -> Frame:
    """A frame from its stored bytes; raises `ValueError` if they do not fill the declared shape."""
    counts = np.frombuffer(data, "<u2").reshape(info.shape)
    rows = np.frombuffer(more, "<u2").reshape(info.metadata_shape)
    return Frame(info.name, counts=counts, metadata_rows=rows, fpa_temperature_k=fpa, **stamps)


def build_reading(info: StreamInfo, stamps: dict[str, Any], data: bytes, raw: bytes) -> Reading:
    """A reading from its stored bytes; raises `ValueError` if they do not fill the declared channels."""
    values = np.frombuffer(data, "<f8").reshape(info.shape)
    return Reading(info.name, values=tuple(values.tolist()), raw=raw, **stamps)
