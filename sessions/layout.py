"""The session file on paper: names, tables, and how frames are cut into chunks.

The format itself, not how it is written or read. Every table is one HDF5
group, every `Column` one dataset in it; all numbers little-endian, all text UTF-8 of a
fixed width, no compound types. `time` counts microseconds since 1970, UTC; `mono_ns` is
the host's monotonic clock.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fieldkit.model.arrays import AnyArray, IntArray
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError, FormatError, SessionError, message_of
from fieldkit.model.installation import DISTRIBUTION
from fieldkit.model.learnt import LearntParameter
from fieldkit.model.samples import EventKind, Quality, Severity
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.model.slope import SLOPE_FIELDS, SlopeState
from fieldkit.sessions.json_forms import build
from fieldkit.sessions.sample_fields import SAMPLE_FIELDS

# --- what is declared before the first sample

MAX_VERTICES = 64

MAX_REGIONS = 256

MAX_LEARNT = 16
"""Parameters that a row of what was learnt has room for."""

RESERVED_NAMES = frozenset(
    (
        "entry", "irradiance", "estimates", "later_events", "learnt", "regions", "events", "clock", "health",
        "calibration", "config", "integrity", "time_map",
    )
)  # fmt: skip
"""Groups of the file itself; no stream may have such a name, nor one with "_" first, as later groups have."""


def is_stream_name(name: str) -> bool:
    """True if a stream of a session may have that name, which is its group's in the file."""
    return bool(name) and name not in RESERVED_NAMES and "/" not in name and not name.startswith((".", "_"))


@dataclass(frozen=True, slots=True)
class SessionHeader:
    """Facts known about a session before its first sample.

    `config_toml` is the configuration as it was used; `license` and `references` state how
    the data may be used and cited.
    """

    title: str
    site: Site
    streams: tuple[StreamInfo, ...]
    regions: tuple[Region, ...] = ()
    config_toml: str = ""
    command_line: str = ""
    operator: str = ""
    description: str = ""
    license: str = ""
    references: str = ""

    def __post_init__(self) -> None:
        names = [info.name for info in self.streams]
        if len(set(names)) < len(names):
            raise ValueError(f"two streams have the same name: {', '.join(names)}")
        for name in names:
            if not is_stream_name(name):
                raise ValueError(f"{name!r} cannot be the name of a stream")
        for info in self.streams:
            _check_stream(info)
        for region in self.regions:
            check_region(region)

    @property
    def region_names(self) -> tuple[str, ...]:
        """Names of the regions, each once, in order: the columns of the estimates."""
        return tuple(dict.fromkeys(region.name for region in self.regions))

    def stream(self, name: str) -> StreamInfo:
        """Declaration of one stream; raises `KeyError`."""
        return next(info for info in self.streams if info.name == name)

    def to_json(self) -> str:
        """The header as text, every number exact."""
        return json.dumps(asdict(self), default=str)

    @classmethod
    def from_json(cls, text: str) -> SessionHeader:
        """The header that `to_json` wrote; raises `SessionError` where the text is none."""
        try:
            check_room(header := build(cls, json.loads(text)))
            return header
        except (ConfigError, ValueError, TypeError, OverflowError, RecursionError) as error:
            raise SessionError(f"the session's header makes no sense: {message_of(error)}") from error


def _check_stream(info: StreamInfo) -> None:
    """Raise `ValueError` where no samples could be of a stream as it is declared.

    Arrays are made in these sizes: what claims more than any instrument has may not take all memory.
    """
    rows, values = math.prod(info.metadata_shape), math.prod(info.shape)
    most = MOST_PIXELS if info.is_camera else MOST_BYTES
    is_possible = len(info.shape) in (1, 2) and 1 <= min(info.shape) <= max(info.shape) <= MOST_BYTES
    if not is_possible or max(rows, values) > most:
        raise ValueError(f"stream {info.name!r} is declared with samples of shape {info.shape}")
    numbers = (*info.metadata_shape, info.raw_bytes, info.burst_frames)
    if min(numbers) < 0 or max(numbers) > MOST_BYTES or not 0.0 <= info.rate_hz < math.inf:
        raise ValueError(f"stream {info.name!r} is declared with {info.rate_hz} Hz, {info.raw_bytes} bytes")


def check_room(header: SessionHeader) -> None:
    """Raise `ConfigError` if a file has no room for so many regions."""
    if (count := len(header.region_names)) > MAX_REGIONS:
        problem = f"{count} regions; a session has room for {MAX_REGIONS}"
        raise ConfigError(problem, fix="remove some of them, and write it again")


def check_region(region: Region) -> None:
    """Raise `ValueError` if the file has no room for this outline."""
    if not 3 <= (count := len(region.points_px)) <= MAX_VERTICES:
        raise ValueError(f"region {region.name!r} has {count} corners; 3 to {MAX_VERTICES} fit")


# --- the tables

FORMAT_NAME = "fieldkit-session"

FORMAT_VERSION = "2.0"
"""Of the session file and of its journal; files of another major version are refused."""


def check_version(place: Path, version: str) -> None:
    """Raise `FormatError` where a session file or a journal is of another major version."""
    major, ours = (text.partition(".")[0] for text in (version, FORMAT_VERSION))
    if major != ours:
        is_newer = major.isdigit() and int(major) > int(ours)
        fix = f"pip install --upgrade {DISTRIBUTION}" if is_newer else "read it with what recorded it"
        raise FormatError(f"has format {version}; this fieldkit reads {FORMAT_VERSION}", place=place, fix=fix)


TIME_UNITS = "microseconds since 1970-01-01T00:00:00Z"

FILL_COUNT = 65535

RECORDING, SEALED, RECOVERED = 0, 1, 2
"""Values of `/entry/complete`; 0 stands for interrupted as well."""

FRAME_DATASETS = ("counts", "metadata_rows")
"""Datasets of a camera of frames, cut into chunks."""

MOST_PIXELS, MOST_BYTES = 16_777_216, 65_536
"""Largest frame of a camera; most channels, and bytes, of a reading."""

MOST_BLOCK_BYTES = 16 * MOST_PIXELS
"""All chunks over the same frames in memory: eight of the largest frames, 64 of two million pixels."""

_CHUNK_ROWS, _CHUNK_COLS, _MIN_DEPTH, _MAX_DEPTH = 60, 80, 8, 64

_TABLE_CHUNK_BYTES, _TABLE_CHUNK_S, _MIN_ROWS, _MAX_ROWS = 4096, 60.0, 2, 1024


@dataclass(frozen=True, slots=True)
class Column:
    """One dataset of a table: `shape` and `dims` of a row, what fills unknown places, its attributes.

    A `dtype` of ``S<n>`` is UTF-8 text of n bytes.
    """

    name: str
    dtype: str
    shape: tuple[int, ...] = ()
    dims: tuple[str, ...] = ()
    fill: float | None = None
    attributes: dict[str, Any] = field(default_factory=dict)

    @property
    def is_text(self) -> bool:
        """True if the column holds text."""
        return self.dtype.startswith("S")

    @property
    def is_time(self) -> bool:
        """True if the column holds moments."""
        return self.attributes.get("units") == TIME_UNITS

    @property
    def row_bytes(self) -> int:
        """Bytes of one row."""
        return np.dtype(self.dtype).itemsize * math.prod(self.shape)

    def unknown(self, rows: int) -> AnyArray:
        """Given number of rows of the fill value."""
        values = np.zeros((rows, *self.shape), self.dtype)
        if self.fill is not None:
            values[:] = self.fill
        return values


def _column(
    name: str,
    dtype: str,
    fill: float | None = None,
    shape: tuple[int, ...] = (),
    dims: tuple[str, ...] = (),
    **attributes: Any,
) -> Column:
    return Column(name, dtype, shape, dims, fill, attributes)


_TIME = _column(
    "time", "<i8", units=TIME_UNITS, calendar="proleptic_gregorian", standard_name="time", axis="T",
    units_metadata="leap_seconds: none",
)  # fmt: skip
_MONO = _column("mono_ns", "<i8", units="ns", long_name="host monotonic clock")


def flag_attributes(kind: type[Quality]) -> dict[str, Any]:
    """CF attributes that name the bits of a flags dataset."""
    members = [flag for flag in kind if flag.value]
    return {
        "long_name": "quality flags",
        "flag_masks": np.array([flag.value for flag in members], "<u4"),
        "flag_meanings": " ".join(str(flag.name).lower() for flag in members),
    }


def meaning_attributes(
    kind: type[EventKind | Severity | SlopeState | RegionKind], name: str
) -> dict[str, Any]:
    """CF attributes that name the values of an enumeration dataset."""
    return {
        "long_name": name,
        "flag_values": np.array([member.value for member in kind], "u1"),
        "flag_meanings": " ".join(member.name.lower() for member in kind),
    }


_FLAGS = _column("flags", "<u4", **flag_attributes(Quality))


def _stamps(info: StreamInfo) -> list[Column]:
    """The time first, those of frames alone last: sealed files have a checksum over that order."""
    unit = {"units": info.device_time_unit} if info.device_time_unit else {}
    columns = {"time": _TIME}
    for item in SAMPLE_FIELDS:
        about = {**item.about, **(unit if item.column == "device_time" else {})}
        columns.setdefault(item.column, _column(item.column, item.dtype, item.fill, **about))
    columns["flags"] = _FLAGS
    of_frames = [columns.pop(field.column) for field in SAMPLE_FIELDS if field.of_frames]
    crc = _column("crc32", "<u4", long_name="CRC-32 of the sample's bytes and stamps")
    return [*columns.values(), crc, *(of_frames if info.is_camera else ())]


def raw_width(info: StreamInfo) -> int:
    """Room for the bytes of one reading; 64 where the driver declares none."""
    return info.raw_bytes or 64


def stream_columns(info: StreamInfo) -> list[Column]:
    """The columns of a stream beside its frames."""
    if info.is_camera:
        return _stamps(info)
    value = {"units": info.unit, "long_name": info.quantity, "ancillary_variables": "flags"}
    if info.unit == "K":
        value["units_metadata"] = "temperature: on_scale"
    if info.measures:
        value["measures"] = " ".join(word or "unknown" for word in info.measures)
    shape, dims = (info.shape, ("channel",)) if info.shape[0] > 1 else ((), ())
    return [
        *_stamps(info),
        Column("value", "<f8", shape, dims, np.nan, value),
        _column("raw", "u1", None, (raw_width(info),), ("byte",), long_name="the bytes as received"),
        _column("raw_length", "<u2", long_name="how many bytes were received", units="1"),
    ]


def entry_columns(header: SessionHeader) -> dict[str, list[Column]]:
    """The tables of everything but samples, by group."""
    return {
        "irradiance": [
            _TIME,
            _column("value", "<f8", fill=np.nan, units="W m-2", long_name="direct irradiance"),
            _FLAGS,
            _column("model", "S64", long_name="model of the irradiance"),
        ],
        "estimates": _estimate_columns(),
        "learnt": [_TIME, *_learnt_columns(max(1, len(header.region_names)))],
        "regions": _region_columns(),
        "events": list(EVENT_COLUMNS),
        "clock": [
            _TIME,
            _MONO,
            _column("utc_minus_mono_ns", "<i8", units="ns", long_name="system clock less monotonic clock"),
            _column("offset_error_ns", "<i8", units="ns", long_name="half the time that the comparison took"),
            _column("suspended_ns", "<i8", units="ns", long_name="time asleep since boot"),
            _column("source", "S32", long_name="source of UTC: system, gps, ntp, ptp, phone"),
        ],
        "health": _health_columns(len(header.streams)),
    }


EVENT_COLUMNS = (
    _TIME,
    _MONO,
    _column("kind", "u1", **meaning_attributes(EventKind, "what happened")),
    _column("severity", "u1", **meaning_attributes(Severity, "how bad it is")),
    _column("stream", "S32", long_name="stream that it is about; empty: the session"),
    _column("text", "S256", long_name="words"),
    _column("data", "S1024", long_name="details, JSON"),
)

_ROW_CRC = _column("crc32", "<u4", long_name="CRC-32 of the row's other columns", units="1")

LATER_EVENTS = "later_events"
"""Group that a finished session gets with the first correction of a mark."""

LATER_EVENT_COLUMNS = (
    *EVENT_COLUMNS,
    _column("written", "<i8", units=TIME_UNITS, long_name="when this was written"),
    _ROW_CRC,
)
"""Events added afterwards: corrections of marks."""

TIME_MAP_COLUMNS = (
    _column("time", "<i8", units=TIME_UNITS, long_name="when this was written"),
    _column("mono_ns", "<i8", units="ns", long_name="holds from here on"),
    _column("add_ns", "<i8", units="ns", long_name="to be added to the time"),
    _column("version", "<u2", units="1", long_name="the newest counts"),
    _ROW_CRC,
    _column("reason", "S256", long_name="why the clock was corrected"),
)
"""Corrections of the clock, written afterwards."""


def added_rows(group: str) -> str:
    """The attribute of the file that says how many rows of a group were added since it was sealed."""
    return f"{group.strip('/')}_rows"


def _estimate_columns() -> list[Column]:
    return [
        _TIME,
        _column("region", "S64", long_name="name of the region"),
        *(
            _column(field.key, "<f8", field.unknown, units=field.unit, long_name=field.description)
            for field in SLOPE_FIELDS.values()
        ),
        _column("state", "u1", **meaning_attributes(SlopeState, "state of the slope")),
        _column("window_start", "<i8", units=TIME_UNITS, long_name="first minute used"),
        _column("n_bins", "<i4", units="1", long_name="minutes used"),
        _FLAGS,
        _column("model", "S64", long_name="model of the estimate"),
        _column("reason", "S160", long_name="why the state is not ok"),
    ]


LEARNT_NUMBERS = tuple(item.name for item in fields(LearntParameter) if item.type == "float")
"""Columns of what was learnt that are numbers, named as in `LearntParameter`."""


def _learnt_columns(regions: int) -> list[Column]:
    by_parameter = partial(_column, shape=(MAX_LEARNT,), dims=("parameter",))
    by_region = partial(_column, dtype="<f8", fill=np.nan, shape=(regions,), dims=("region",))
    return [
        by_parameter("name", "S32", long_name="parameter; empty: none"),
        by_parameter("unit", "S32", long_name="unit of the parameter"),
        *(by_parameter(name, "<f8", np.nan, long_name=name.replace("_", " ")) for name in LEARNT_NUMBERS),
        by_region("residual_k", units="K", long_name="root mean square of one-minute prediction errors"),
        by_region("autocorrelation", units="1", long_name="of these errors, from one minute to the next"),
        _column("chi_square", "<f8", fill=np.nan, units="1", long_name="of all errors"),
    ]


def _region_columns() -> list[Column]:
    on_ground = "corners on the ground in the system of the camera's pose"
    corners = partial(_column, dtype="<f8", fill=np.nan)
    return [
        _TIME,
        _column("kind", "u1", **meaning_attributes(RegionKind, "what the region is for")),
        _column("emissivity", "<f8", fill=np.nan, units="1", long_name="emissivity; NaN: the campaign's"),
        _column("tilt_deg", "<f8", fill=np.nan, units="degree"),
        _column("azimuth_deg", "<f8", fill=np.nan, units="degree"),
        _column("n_points", "<u2", units="1", long_name="corners that are used"),
        corners("points_px", shape=(MAX_VERTICES, 2), dims=("vertex", "xy"), units="1", long_name="corners"),
        _column("label", "S64", long_name="name of the region"),
        _column("removed", "u1", long_name="1: the region ends here", units="1"),
        _column("camera", "S64", long_name="stream of its camera; empty: the first camera"),
        corners("points_m", shape=(MAX_VERTICES, 3), dims=("vertex", "enu"), units="m", long_name=on_ground),
    ]


def _health_columns(streams: int) -> list[Column]:
    counts = {
        "received": "samples so far", "dropped": "samples lost so far", "queued": "samples waiting",
        "rejected": "invalid records so far", "implausible": "readings beyond their limits so far",
        "late_max_us": "longest delay of a sample in the last second",
    }  # fmt: skip
    by_stream = partial(_column, dtype="<i8", shape=(max(1, streams),), dims=("stream",))
    return [
        _TIME,
        _MONO,
        *(
            by_stream(name, units="us" if name.endswith("_us") else "1", long_name=about)
            for name, about in counts.items()
        ),
        _column("disk_free_bytes", "<i8", units="byte", long_name="free space of the disk"),
        _column("written_bytes", "<i8", units="byte", long_name="bytes written so far"),
        _column("sync_ms", "<f8", units="ms", long_name="duration of the journal's last sync"),
        _column("cpu_percent", "<f8", units="percent", long_name="processor time of the recorder"),
        _column("lag_ms", "<f8", units="ms", long_name="longest delay of all streams in the last second"),
    ]


def chunk_shape(info: StreamInfo) -> tuple[int, int, int]:
    """One second or one burst deep, near 60 x 80 pixels: a region's time series reads few chunks.

    What is not full after a second is written as it is, so that it can be seen, and takes its place for good.
    """
    rows, cols = info.shape
    most = max(1, MOST_BLOCK_BYTES // (2 * rows * cols))
    second = int(np.clip(round(info.rate_hz), _MIN_DEPTH, _MAX_DEPTH))
    burst = _divisor_near(info.burst_frames, _MAX_DEPTH) if info.burst_frames else second
    return min(burst, most), _divisor_near(rows, _CHUNK_ROWS), _divisor_near(cols, _CHUNK_COLS)


def chunk_rows(columns: Sequence[Column], rate_hz: float = 0.0) -> int:
    """Rows of a chunk of a table: some kilobytes of all columns, or the rows of a minute.

    The last chunk of each column is stored whole and written again each second, so a chunk must not hold much
    more than a short session has; a chunk of a few bytes would cost its place in the index.
    """
    by_size = _TABLE_CHUNK_BYTES // sum(column.row_bytes for column in columns)
    return int(np.clip(max(by_size, rate_hz * _TABLE_CHUNK_S), _MIN_ROWS, _MAX_ROWS))


def block_rows(info: StreamInfo) -> int:
    """Samples that are read and recovered together: of a camera those of a chunk."""
    return chunk_shape(info)[0] if info.is_camera else 1024


def _divisor_near(length: int, target: int) -> int:
    """Divisor of `length` nearest to `target` by ratio, so that no chunk is cut."""
    divisors = [n for n in range(1, length + 1) if length % n == 0]
    return min(divisors, key=lambda n: max(n / target, target / n))


def encode_text(text: str, width: int) -> bytes:
    """UTF-8 of at most `width` bytes, cut between characters; bytes that are not a character become ``?``."""
    data = text.encode(errors="replace")
    return data if len(data) <= width else data[: width - 3].decode(errors="ignore").encode() + "…".encode()


def decode_text(data: bytes) -> str:
    """Text of a fixed-width field."""
    return data.rstrip(b"\0").decode(errors="replace")


def exact_time_ns(time_us: IntArray, mono_ns: IntArray, anchor_ns: int) -> IntArray:
    """UTC nanoseconds of stored stamps: to the nanosecond by the anchor, else the microseconds as stored."""
    exact = mono_ns + anchor_ns
    return np.where(exact // 1000 == time_us, exact, time_us * 1000)
