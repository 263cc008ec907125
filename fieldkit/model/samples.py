"""Samples of instruments: frames, readings and events, immutable and stamped near the wire.

Two clocks stamp each sample: `mono_ns` (host monotonic nanoseconds, never steps) and
`time_ns` (UTC nanoseconds since 1970, the monotonic stamp plus the one anchor taken at
the start). Values are stored as they came; `Quality` flags travel beside them.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple, Self, overload

if TYPE_CHECKING:
    from fieldkit.model.arrays import AnyIntArray, BoolArray, CountArray

NO_COUNTER = -(2**63)
"""Stands for "the device has no clock or counter of its own" in int64 columns."""

UNNUMBERED = -1
"""`seq` of a sample that is not recorded yet."""


class Quality(enum.IntFlag):
    """Reasons to trust a sample, a bin or an estimate less; 32 bits in the session file."""

    GOOD = 0
    STALE = 1  # a value of another moment: held, a maximum, a minimum, or declared void by the device
    FROZEN = 2  # identical frames for longer than a shutter correction lasts
    DUPLICATE = 4  # the same frame once more (frame counter or pixels)
    DROPPED_BEFORE = 8  # samples were lost between the previous one and this
    SHUTTER = 16  # during, or within 10 s after, a shutter correction (FFC, NUC)
    SATURATED = 32  # at the end of the camera's counts
    OVERRANGE = 64  # at the end of the meter's range
    CLOCK_STEP = 128  # the system clock was stepped since the previous sample
    BAD_CRC = 256  # stored bytes do not match their checksum
    INTERPOLATED = 512  # sound value, time not measured: it was delayed and arrived with others
    LOW_SUN = 1024  # sun too low for the estimate to mean anything
    SHADED = 2048  # this region alone is shaded
    CLOUD = 4096  # irradiance changed faster than the sun can
    UNRESOLVED = 8192  # data fit more than one slope
    NO_VALUE = 16384  # open probe, overload, or no temperature scale known
    MOVED = 32768  # the camera moved too far to be followed: the regions are lost
    IMPLAUSIBLE = 65536  # channels beyond what their quantity can be have no value (model/limits.py)


UNUSABLE = (
    Quality.STALE
    | Quality.FROZEN
    | Quality.DUPLICATE
    | Quality.SHUTTER
    | Quality.SATURATED
    | Quality.OVERRANGE
    | Quality.BAD_CRC
    | Quality.NO_VALUE
)
"""Flags of samples whose numbers enter no result, frames and readings alike."""
OUT_OF_RANGE = Quality.SATURATED | Quality.OVERRANGE | Quality.NO_VALUE | Quality.IMPLAUSIBLE
"""Flags of samples that are beyond what their instrument can show, or what their quantity can be."""
REPEATED = Quality.FROZEN | Quality.DUPLICATE
"""Flags of frames that show what the one before showed."""
_UNUSABLE_BITS = int(UNUSABLE)
_UNSHOWABLE_BITS = int(UNUSABLE & ~(Quality.SATURATED | Quality.NO_VALUE))


@overload
def is_usable(flags: int) -> bool: ...
@overload
def is_usable(flags: AnyIntArray) -> BoolArray: ...
def is_usable(flags: int | AnyIntArray) -> bool | BoolArray:
    """True if a sample's numbers may enter a result, from its `Quality`.

    One sample's flags, or an array of them as stored (any shape, any integer type).
    """
    return (flags & _UNUSABLE_BITS) == 0


def is_damaged(flags: AnyIntArray) -> BoolArray:
    """True if stored bytes do not match their checksum: the numbers are not those that were measured."""
    damaged: BoolArray = (flags & int(Quality.BAD_CRC)) != 0
    return damaged


def is_showable(flags: int) -> bool:
    """True if a frame may serve to find regions: also one at the end of its scale, or without a scale."""
    return (flags & _UNSHOWABLE_BITS) == 0


class NumberedEnum(enum.IntEnum):
    """An enumeration, stored by its numbers, that also represents members added by a newer version.

    A number without a name keeps its number and is named ``UNKNOWN_<number>``, so that files of a newer
    version can be read, shown and copied.
    """

    @classmethod
    def _missing_(cls, value: object) -> Self | None:
        if not isinstance(value, int) or not 0 <= value <= 255:  # one byte in the file
            return None
        member = int.__new__(cls, value)
        member._name_, member._value_ = f"UNKNOWN_{value}", value
        return member


class Severity(NumberedEnum):
    """Severity of an event."""

    INFO = 0
    WARNING = 1
    ERROR = 2


class EventKind(NumberedEnum):
    """Kinds of events in a session; the numbers are stored in the file."""

    START = 0
    STOP = 1
    MARK = 2
    LOST = 3
    BACK = 4
    GAP = 5
    SHUTTER = 6
    FROZEN = 7
    GARBLED = 8
    CLOUD = 9
    CLOCK_STEP = 10
    CLOCK_CHECK = 11
    DISK = 12
    ESTIMATOR = 13
    VIEW = 14
    RECOVERED = 15
    IMPORTED = 16
    SLEPT = 17
    MOVED = 18
    OVERRANGE = 19
    REGION = 20
    MODE = 21
    ALARM = 22


class Frame(NamedTuple):
    """One frame of a camera.

    `counts` has shape (rows, cols), uint16; `metadata_rows` (extra rows, cols), uint16, is
    what the camera sent with it (telemetry), possibly of zero rows. `fpa_temperature_k` is
    NaN where the camera does not report it. `seq` is given by the recorder.
    """

    stream: str
    mono_ns: int
    time_ns: int
    counts: CountArray
    metadata_rows: CountArray
    quality: Quality = Quality.GOOD
    device_time: int = NO_COUNTER
    device_seq: int = NO_COUNTER
    fpa_temperature_k: float = float("nan")
    seq: int = UNNUMBERED


class Reading(NamedTuple):
    """One reading of a meter: a value per channel in the stream's unit, NaN where there is none.

    `raw` keeps the bytes as they came. `seq` is given by the recorder.
    """

    stream: str
    mono_ns: int
    time_ns: int
    values: tuple[float, ...]
    raw: bytes = b""
    quality: Quality = Quality.GOOD
    device_time: int = NO_COUNTER
    device_seq: int = NO_COUNTER
    seq: int = UNNUMBERED


@dataclass(frozen=True, slots=True)
class Event:
    """One thing that happened, as text with machine-readable details in `data`."""

    kind: EventKind
    mono_ns: int
    time_ns: int
    text: str
    stream: str = ""
    severity: Severity = Severity.INFO
    data: Mapping[str, Any] = field(default_factory=dict)

    def document(self) -> dict[str, Any]:
        """The event as a JSON object; `time_ms` is UTC, milliseconds."""
        levels = {"kind": self.kind.name.lower(), "severity": self.severity.name.lower()}
        about = {"text": self.text, "stream": self.stream, "data": dict(self.data)}
        return {"time_ms": round(self.time_ns / 1000) / 1000, **levels, **about}


@dataclass(frozen=True, slots=True)
class StreamHealth:
    """Health of one stream: samples so far, lost so far, waiting now, worst delay of the last second.

    `rejected` records were invalid, `implausible` readings beyond what their quantity can be.
    """

    stream: str
    received: int
    dropped: int
    queued: int
    late_max_us: int = 0
    rejected: int = 0
    implausible: int = 0


@dataclass(frozen=True, slots=True)
class Health:
    """Health of the recording, once a second."""

    mono_ns: int
    time_ns: int
    streams: tuple[StreamHealth, ...]
    disk_free_bytes: int
    written_bytes: int = 0
    sync_ms: float = 0.0
    cpu_percent: float = 0.0
    lag_ms: float = 0.0


Sample = Frame | Reading
