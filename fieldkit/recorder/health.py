"""The health of a recording: once a second its numbers, and an event when something begins to go wrong.

`HealthMonitor` gathers streams, clock and disk. The small monitors before it only do bookkeeping
on samples and numbers; the recorder stores and shows the events they return.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

from fieldkit.model.clock import Clock, ClockCheck
from fieldkit.model.durations import rounded_duration
from fieldkit.model.errors import StorageError
from fieldkit.model.samples import Event, EventKind, Health, Quality, Sample, Severity, StreamHealth
from fieldkit.model.units import MINUTE_NS, SECOND_NS
from fieldkit.phrases import Words, counted
from fieldkit.recorder.device_reader import DeviceReader
from fieldkit.recorder.sample_queue import SampleQueue
from fieldkit.sessions.writer import SessionWriter

PAUSE_NS = 10 * SECOND_NS
WARN_S = 900
LATE_S = 60.0
CLOCK_STEP_NS = SECOND_NS // 2
SUSPENDED_NS = 5 * SECOND_NS
CLOCK_CHECK_EVERY_NS = MINUTE_NS

_FLAG_EVENTS = {
    Quality.SHUTTER: (EventKind.SHUTTER, Severity.INFO, "event.shutter.info"),
    Quality.FROZEN: (EventKind.FROZEN, Severity.WARNING, "event.frozen"),
    Quality.OVERRANGE: (EventKind.OVERRANGE, Severity.WARNING, "event.overrange.flag.overrange"),
    Quality.SATURATED: (EventKind.OVERRANGE, Severity.WARNING, "event.overrange.flag.saturated"),
    Quality.IMPLAUSIBLE: (EventKind.OVERRANGE, Severity.WARNING, "event.overrange.flag.implausible"),
    Quality.NO_VALUE: (EventKind.OVERRANGE, Severity.WARNING, "event.overrange.flag.no_value"),
}


@dataclass
class FlagMonitor:
    """Reports when a flag of a stream begins, not every sample that carries it."""

    _flags: dict[str, Quality] = field(default_factory=dict)

    def update(self, sample: Sample) -> Iterator[Event]:
        """Events for flags of this sample that the stream's previous sample did not have."""
        before = self._flags.get(sample.stream, Quality.GOOD)
        if sample.quality == before:
            return
        self._flags[sample.stream] = sample.quality
        begun = sample.quality & ~before
        for flag, (kind, severity, key) in _FLAG_EVENTS.items():
            if flag in begun:
                text, about = Words(key, stream=sample.stream), {"flag": str(flag.name).lower()}
                yield Event(kind, sample.mono_ns, sample.time_ns, text, sample.stream, severity, about)


@dataclass
class GarbleMonitor:
    """Reports at most once a minute, and at the end, how many records of a stream were invalid."""

    _reported: dict[str, int] = field(default_factory=dict)
    _reported_ns: dict[str, int] = field(default_factory=dict)

    def update(
        self, stream: str, rejected: int, mono_ns: int, time_ns: int, why: str = "", *, at_end: bool = False
    ) -> Iterator[Event]:
        """An event if `rejected` (since the start) grew and a minute has passed since the last one.

        `why` is the reason for the last rejection, if known.
        """
        new = rejected - self._reported.get(stream, 0)
        reported_ns = self._reported_ns.get(stream)
        waits = not at_end and reported_ns is not None and mono_ns - reported_ns < MINUTE_NS
        if new <= 0 or waits:
            return
        self._reported[stream], self._reported_ns[stream] = rejected, mono_ns
        text = f"{stream}: {counted(new, 'garbled record')} dropped"
        text += f"; the last one: {why}" if why else ""
        yield Event(EventKind.GARBLED, mono_ns, time_ns, text, stream, Severity.WARNING, {"records": new})


@dataclass
class EstimatorMonitor:
    """Reports when live estimates fall a minute behind, and when they have caught up."""

    _is_late: bool = False

    def update(self, waited_s: float, mono_ns: int, time_ns: int) -> Iterator[Event]:
        """An event if the wait of the oldest minute, real seconds, has come to a minute or is over."""
        if (waited_s >= LATE_S) == self._is_late:
            return
        self._is_late = not self._is_late
        phase, severity = ("begin", Severity.WARNING) if self._is_late else ("end", Severity.INFO)
        text = Words(f"event.estimator.late.{phase}")
        yield Event(EventKind.ESTIMATOR, mono_ns, time_ns, text, "", severity, {"late": phase})


@dataclass
class ClockMonitor:
    """Judges a clock check each second: which are stored, and whether the clock was stepped or has slept.

    One a minute is stored, the first and the last, and both around a step or sleep, of which the times are
    thus known to a second.
    """

    _last: ClockCheck | None = None
    _stored: ClockCheck | None = None

    def update(
        self, check: ClockCheck, time_ns: int, *, at_end: bool = False
    ) -> tuple[list[ClockCheck], list[Event]]:
        """The checks to store now, in order and each only once, and the events since the previous check."""
        last, self._last = self._last or check, check
        slept_ns = check.suspended_ns - last.suspended_ns
        step_ns = check.utc_minus_mono_ns - last.utc_minus_mono_ns - slept_ns
        has_moved = slept_ns > SECOND_NS or abs(step_ns) >= CLOCK_STEP_NS
        is_due = self._stored is None or check.mono_ns - self._stored.mono_ns >= CLOCK_CHECK_EVERY_NS
        checks = [last] if has_moved and last is not self._stored else []
        if has_moved or is_due or at_end:
            self._stored = check
            checks.append(check)
        return checks, list(_clock_events(check.mono_ns, time_ns, slept_ns, step_ns))


def _clock_events(mono_ns: int, time_ns: int, slept_ns: int, step_ns: int) -> Iterator[Event]:
    warning = Severity.WARNING
    if slept_ns >= SUSPENDED_NS:
        text = f"the computer slept for {rounded_duration(slept_ns / SECOND_NS)}"
        yield Event(EventKind.SLEPT, mono_ns, time_ns, text, "", warning, {"slept_ns": slept_ns})
    if abs(step_ns) >= CLOCK_STEP_NS:
        text = f"the system clock was stepped by {step_ns / SECOND_NS:+.3f} s; recorded times go on"
        yield Event(EventKind.CLOCK_STEP, mono_ns, time_ns, text, "", warning, {"step_ns": step_ns})


@dataclass
class StorageMonitor:
    """Handles storage errors: frames pause for 10 s; a second error meanwhile ends the recording."""

    _error: StorageError | None = None
    _until_ns: int = 0
    _skipped: int = 0

    def ends_recording(self, error: StorageError, mono_ns: int) -> bool:
        """Note an error; True if it is the second, which ends the recording."""
        if self._error is not None and mono_ns < self._until_ns:
            return True
        self._error, self._until_ns = error, mono_ns + PAUSE_NS
        return False

    def skips_frame(self, mono_ns: int) -> bool:
        """True if a frame that arrives now is skipped; it is counted."""
        is_paused = self._error is not None and mono_ns < self._until_ns
        self._skipped += is_paused
        return is_paused

    def summary(self, mono_ns: int, time_ns: int, *, at_end: bool = False) -> Iterator[Event]:
        """The number of skipped frames, once, when a pause ends or the recording ends within one."""
        if self._error is None or (mono_ns < self._until_ns and not at_end):
            return
        text = f"{counted(self._skipped, 'frame')} skipped after a storage error: {self._error}"
        skipped, self._error, self._skipped = self._skipped, None, 0
        yield _disk(mono_ns, time_ns, Severity.ERROR, text, skipped=skipped)


@dataclass
class DiskMonitor:
    """Reacts to a disk that fills up.

    Warns when less than 15 minutes are left at the present rate, stops frames at `reserve_bytes` until
    twice as much is free again, and asks to seal the session at a quarter of it.
    """

    reserve_bytes: int = 64_000_000
    stores_frames: bool = True
    is_full: bool = False
    _warned: bool = False

    def update(self, free_bytes: int, bytes_per_s: float, mono_ns: int, time_ns: int) -> Iterator[Event]:
        """Events for limits passed since the last call; sets `stores_frames` and `is_full`."""
        left_s = (free_bytes - self.reserve_bytes) / bytes_per_s if bytes_per_s > 0 else float("inf")
        free = f"{free_bytes / 1e6:.0f} MB free"
        phase = "end" if left_s > 2 * WARN_S and self._warned else ""
        if phase:
            self._warned = False
        if left_s < WARN_S and not self._warned:
            self._warned = True
            left = f"{free}, about {max(0, left_s) / 60:.0f} min left"
            yield _disk(mono_ns, time_ns, Severity.WARNING, left, "begin")
        if free_bytes < self.reserve_bytes and self.stores_frames:
            self.stores_frames = False
            text = f"{free}: disk reserve reached, frames off, meters continue"
            yield _disk(mono_ns, time_ns, Severity.ERROR, text, frames="off")
        if free_bytes > 2 * self.reserve_bytes and not self.stores_frames:
            self.stores_frames = True
            yield _disk(mono_ns, time_ns, Severity.INFO, f"{free}: frames on again", phase, frames="on")
        elif phase:
            yield _disk(mono_ns, time_ns, Severity.INFO, f"{free}: enough again", phase)
        if free_bytes < self.reserve_bytes // 4 and not self.is_full:
            self.is_full = True
            yield _disk(mono_ns, time_ns, Severity.ERROR, f"{free}: sealing the session", full=1)


def _disk(
    mono_ns: int, time_ns: int, severity: Severity, text: str, phase: str = "", **data: int | str
) -> Event:
    about = data | ({"phase": phase} if phase else {})
    return Event(EventKind.DISK, mono_ns, time_ns, text, "", severity, about)


@dataclass(frozen=True, slots=True)
class HealthSnapshot:
    """The health of one second, with the clock checks to store and the events to report."""

    health: Health
    clock_checks: list[ClockCheck]
    events: list[Event]


@dataclass
class HealthMonitor:
    """Measures streams, clock and disk once for every second of the session's clock."""

    clock: Clock
    readers: Sequence[DeviceReader]
    queue: SampleQueue
    writer: SessionWriter
    free_bytes: Callable[[], int]
    disk: DiskMonitor = field(default_factory=DiskMonitor)

    def __post_init__(self) -> None:
        # readers may have read for an earlier session, of which nothing is counted here
        self._before = {
            reader.info.name: (reader.received, reader.rejected, reader.implausible)
            for reader in self.readers
        }
        self._garbled = GarbleMonitor({name: rejected for name, (_, rejected, _) in self._before.items()})
        self._clock_monitor, self._rates = ClockMonitor(), _Rates()
        self._late_max_us: Counter[str] = Counter()
        self._next_ns = self.clock.mono_ns()
        self._free_bytes = sys.maxsize  # until the disk is first queried

    def sample_arrived(self, sample: Sample) -> None:
        """Note the age of a sample when the recorder receives it."""
        late_us = (self.clock.mono_ns() - sample.mono_ns) // 1000
        self._late_max_us[sample.stream] = max(self._late_max_us[sample.stream], late_us)

    def update(self) -> HealthSnapshot | None:
        """A snapshot if a second has passed since the last one."""
        now = self.clock.mono_ns()
        if now < self._next_ns:
            return None
        self._next_ns = now + SECOND_NS
        for reader in self.readers:
            reader.count_second()
        utc = self.writer.utc_ns(now)
        with suppress(OSError):  # a network drive may fail for a moment: keep the last value
            self._free_bytes = self.free_bytes()
        free = self._free_bytes
        checks, events = self.inspect(now, utc)
        events += self.disk.update(free, self._rates.bytes_per_s(self.writer.bytes_written, now), now, utc)
        return HealthSnapshot(self._health(now, utc, free), checks, events)

    def inspect(
        self, mono_ns: int, time_ns: int, *, at_end: bool = False
    ) -> tuple[list[ClockCheck], list[Event]]:
        """Clock checks to store, events of clock and invalid records; `at_end` also those not due yet."""
        checks, events = self._clock_monitor.update(self.clock.check(), time_ns, at_end=at_end)
        for reader in self.readers:
            events += self._garbled.update(
                reader.info.name, reader.rejected, mono_ns, time_ns, reader.rejected_because, at_end=at_end
            )
        return checks, events

    def _health(self, now: int, utc: int, free: int) -> Health:
        streams = tuple(self._stream_health(reader) for reader in self.readers)
        lag_ms = max(self._late_max_us.values(), default=0) / 1000.0
        self._late_max_us.clear()
        return Health(
            mono_ns=now,
            time_ns=utc,
            streams=streams,
            disk_free_bytes=free,
            written_bytes=self.writer.bytes_written,
            sync_ms=self.writer.sync_ms,
            cpu_percent=self._rates.cpu_percent(),
            lag_ms=lag_ms,
        )

    def _stream_health(self, reader: DeviceReader) -> StreamHealth:
        name = reader.info.name
        received, rejected, implausible = self._before[name]
        return StreamHealth(
            name,
            reader.received - received,
            self.queue.dropped[name],
            self.queue.waiting(name),
            self._late_max_us[name],
            reader.rejected - rejected,
            reader.implausible - implausible,
        )


@dataclass
class _Rates:
    """CPU load and write rate between one snapshot and the next."""

    _cpu_s: float = field(default_factory=time.process_time)
    _wall_s: float = field(default_factory=time.monotonic)
    _start: tuple[int, int] | None = None

    def cpu_percent(self) -> float:
        cpu, wall = time.process_time(), time.monotonic()
        used = 100.0 * (cpu - self._cpu_s) / max(wall - self._wall_s, 1e-6)
        self._cpu_s, self._wall_s = cpu, wall
        return used

    def bytes_per_s(self, written: int, mono_ns: int) -> float:
        """Mean rate since the first call, so that a short burst does not trigger the disk warning."""
        if self._start is None:
            self._start = (written, mono_ns)
        seconds = (mono_ns - self._start[1]) / SECOND_NS
        return (written - self._start[0]) / seconds if seconds > 0 else 0.0
