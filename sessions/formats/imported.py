"""Writing what was recorded elsewhere as a session; where it came from is told in an event.

Foreign recordings have no monotonic clock, so their UTC stands for it. Stamps are kept as
they came: pictures that waited somewhere and arrived in bunches are flagged, not moved.
"""

from __future__ import annotations

import select
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fieldkit.model.clock import ClockCheck
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError
from fieldkit.model.samples import Event, EventKind, Frame, Quality, Sample, Severity
from fieldkit.model.site import Site
from fieldkit.sessions.header import SessionHeader
from fieldkit.sessions.seal import SealReport
from fieldkit.sessions.writer import SessionWriter


@dataclass(frozen=True, slots=True)
class Foreign:
    """A recording of another program: its streams, its samples in order of time, remarks on it.

    `site` is where it was made, if the recording itself knows.
    """

    streams: tuple[StreamInfo, ...]
    samples: Iterable[Sample]
    remarks: tuple[tuple[Severity, str], ...] = ()
    site: Site | None = None


class StampedClock:
    """A clock that stands where the imported stamps are; `anchor_ns` is UTC less its monotonic time."""

    is_real = False

    def __init__(self, start_ns: int, anchor_ns: int = 0) -> None:
        self.now_ns = start_ns
        self._anchor_ns = anchor_ns

    def mono_ns(self) -> int:
        """The last stamp."""
        return self.now_ns

    def to_utc_ns(self, mono_ns: int) -> int:
        """That plus the anchor."""
        return mono_ns + self._anchor_ns

    def check(self) -> ClockCheck:
        """Nothing to compare."""
        return ClockCheck(self.now_ns, 0, 0, "imported")

    def sleep(self, seconds: float) -> None:
        """Nobody waits."""

    def wait_readable(self, fd: int, timeout_s: float) -> bool:
        """Whether there is something to read now."""
        return bool(select.select([fd], [], [], 0)[0])

    def taking_part(self) -> AbstractContextManager[None]:
        """Nothing to do."""
        return nullcontext()

    def hold_until(self, settled: Callable[[float], bool]) -> None:
        """Nothing to do: the writer reads back what it was not handed."""


def write_foreign(path: Path, header: SessionHeader, foreign: Foreign, source: str) -> SealReport:
    """Write a foreign recording as a session and seal it; `source` names the files it came from.

    Raises `ConfigError` where it has no samples, `StorageError`, `RefusedError`.
    """
    samples = iter(foreign.samples)
    first = next(samples, None)
    if first is None:
        raise ConfigError(f"{source} has no samples", fix="check that it is the right file, and whole")
    clock = StampedClock(first.time_ns)
    writer = SessionWriter(path, header, clock)
    try:
        _tell(writer, clock, Severity.INFO, f"imported from {source}")
        for severity, text in foreign.remarks:
            _tell(writer, clock, severity, text)
        for sample in _chain(first, samples):
            clock.now_ns = max(clock.now_ns, sample.time_ns)
            writer.append(sample)
    except BaseException:
        writer.discard()
        raise
    return writer.close()


def _chain(first: Sample, rest: Iterator[Sample]) -> Iterator[Sample]:
    yield first
    yield from rest


def _tell(writer: SessionWriter, clock: StampedClock, severity: Severity, text: str) -> None:
    writer.event(Event(EventKind.IMPORTED, clock.now_ns, clock.now_ns, text, "", severity))


def usual_rate_hz(time_ns: Sequence[int] | NDArray[np.int64]) -> float:
    """Samples a second by the median interval; 0 where there is none."""
    intervals = np.diff(np.asarray(time_ns, np.int64))
    usual = float(np.median(intervals)) if intervals.size else 0.0
    return 1e9 / usual if usual > 0 else 0.0


def bunched(time_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which pictures came together, having waited: half the usual interval apart or less."""
    intervals = np.diff(time_ns)
    late = np.zeros(len(time_ns), np.bool_)
    if intervals.size >= 3:
        close = intervals < 0.5 * np.median(intervals)
        late[1:] |= close
        late[:-1] |= close
    return late


@dataclass(frozen=True, slots=True)
class _Flagged:
    """Pictures that are read again whenever they are asked for, the late ones flagged."""

    read: Callable[[], Iterable[Frame]]
    late: NDArray[np.bool_]

    def __iter__(self) -> Iterator[Frame]:
        for is_late, frame in zip(self.late, self.read(), strict=False):  # what came after was left out
            yield frame._replace(quality=frame.quality | Quality.INTERPOLATED) if is_late else frame


def flag_bunched(
    read: Callable[[], Iterable[Frame]], time_ns: Sequence[int]
) -> tuple[Iterable[Frame], tuple[tuple[Severity, str], ...]]:
    """The pictures that `read` gives, never all in memory; those that came in bunches flagged `INTERPOLATED`.

    `time_ns` are their stamps, known from a look before; also what to say about bunches.
    """
    late = bunched(np.array(time_ns, np.int64))
    if not late.any():
        return _Flagged(read, late), ()
    text = (
        f"{int(late.sum())} of {late.size} pictures came in bunches: stamps of arrival, flagged interpolated"
    )
    return _Flagged(read, late), ((Severity.WARNING, text),)
