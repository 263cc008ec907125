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
from fieldkit.model.errors import StorageError
from fieldkit.model.samples import Event, EventKind, Health, Quality, Sample, Severity, StreamHealth
from fieldkit.model.units import SECOND_NS
from fieldkit.recorder.device_reader import DeviceReader
from fieldkit.recorder.sample_queue import SampleQueue
from fieldkit.sessions.writer import SessionWriter

PAUSE_NS = 10 * SECOND_NS
WARN_S = 900
CLOCK_STEP_NS = SECOND_NS // 2
SLEEP_NS = 5 * SECOND_NS
CLOCK_CHECK_EVERY_NS = 60 * SECOND_NS

_TOLD = {
    Quality.SHUTTER: (EventKind.SHUTTER, Severity.INFO, "shutter correction"),
    Quality.FROZEN: (EventKind.FROZEN, Severity.WARNING, "the picture is frozen"),
    Quality.OVERRANGE: (EventKind.OVERRANGE, Severity.WARNING, "reading at the end of the meter's range"),
    Quality.SATURATED: (EventKind.OVERRANGE, Severity.WARNING, "pixels at the end of the camera's range"),
    Quality.NO_VALUE: (
        EventKind.OVERRANGE,
        Severity.WARNING,
        "no value: open probe, overload, relative display or unknown scale",
    ),
}
_TOLD_ALL = Quality(sum(_TOLD))


@dataclass
class FlagMonitor:
    """Tells when a flag of a stream begins, not every sample that carries it."""

    _flags: dict[str, Quality] = field(default_factory=dict)

    def look(self, sample: Sample) -> Iterator[Event]:
        """Events for flags of this sample that the stream's previous sample did not have."""
        before = self._flags.get(sample.stream, Quality.GOOD)
        self._flags[sample.stream] = sample.quality
        begun = sample.quality & ~before & _TOLD_ALL
        if not begun:
            return
        for flag, (kind, severity, text) in _TOLD.items():
            if flag in begun:
                said = f"{sample.stream}: {text}"
                yield Event(kind, sample.mono_ns, sample.time_ns, said, sample.stream, severity)


@dataclass
class GarbleMonitor:
    """Reports at most once a minute, and at the end, how many records of a stream made no sense."""

    _seen: dict[str, int] = field(default_factory=dict)
    _told_ns: dict[str, int] = field(default_factory=dict)

    def look(
        self, stream: str, rejected: int, mono_ns: int, time_ns: int, *, at_end: bool = False
    ) -> Iterator[Event]:
        """An event if `rejected` (since the start) grew and a minute has passed since the last one."""
        new = rejected - self._seen.get(stream, 0)
        told_ns = self._told_ns.get(stream)
        waits = not at_end and told_ns is not None and mono_ns - told_ns < 60 * SECOND_NS
        if new <= 0 or waits:
            return
        self._seen[stream], self._told_ns[stream] = rejected, mono_ns
        text = f"{stream}: {new} garbled {'record' if new == 1 else 'records'} dropped"
        yield Event(EventKind.GARBLED, mono_ns, time_ns, text, stream, Severity.WARNING, {"records": new})


@dataclass
class MisfitMonitor:
    """Tells of the first of a run of samples that are not as their stream was declared."""

    _streams: set[str] = field(default_factory=set)

    def stored(self, stream: str) -> None:
        """Note a sample that is: the next misfit begins another run."""
        self._streams.discard(stream)

    def left_out(self, sample: Sample, error: ValueError) -> Iterator[Event]:
        """An event if the stream's previous sample was stored."""
        if sample.stream not in self._streams:
            self._streams.add(sample.stream)
            text = f"left out: {error}"
            yield Event(
                EventKind.GARBLED, sample.mono_ns, sample.time_ns, text, sample.stream, Severity.WARNING
            )


@dataclass
class ClockCheckSchedule:
    """Chooses, of a comparison each second, those to store: one a minute, and both beside a sleep.

    So the times between which the computer slept are known to a second.
    """

    _last: ClockCheck | None = None
    _stored: ClockCheck | None = None

    def look(self, check: ClockCheck) -> tuple[ClockCheck, ...]:
        """The comparisons to store now, in their order; none of them has been given before."""
        last, stored, self._last = self._last, self._stored, check
        slept = last is not None and check.suspended_ns - last.suspended_ns > SECOND_NS
        if stored is not None and not slept and check.mono_ns - stored.mono_ns < CLOCK_CHECK_EVERY_NS:
            return ()
        self._stored = check
        return (last, check) if last is not None and slept and last is not stored else (check,)


@dataclass
class ClockMonitor:
    """Tells when the system clock was stepped or the computer slept, from one check to the next."""

    _last: ClockCheck | None = None

    def look(self, check: ClockCheck, time_ns: int) -> Iterator[Event]:
        """Events for what happened since the previous check; nothing recorded is changed."""
        last, self._last = self._last, check
        if last is None:
            return
        slept_ns = check.suspended_ns - last.suspended_ns
        step_ns = check.utc_minus_mono_ns - last.utc_minus_mono_ns - slept_ns
        if slept_ns >= SLEEP_NS:
            text = f"the computer slept for {slept_ns / SECOND_NS:.0f} s"
            yield Event(
                EventKind.SLEPT, check.mono_ns, time_ns, text, "", Severity.WARNING, {"slept_ns": slept_ns}
            )
        if abs(step_ns) >= CLOCK_STEP_NS:
            text = f"the system clock was stepped by {step_ns / SECOND_NS:+.3f} s; recorded times go on"
            yield Event(
                EventKind.CLOCK_STEP, check.mono_ns, time_ns, text, "", Severity.WARNING, {"step_ns": step_ns}
            )


@dataclass
class StorageMonitor:
    """How errors of storing are met: pictures pause for 10 s, a second error meanwhile ends the recording."""

    _error: StorageError | None = None
    _until_ns: int = 0
    _left_out: int = 0

    def failed(self, error: StorageError, mono_ns: int) -> bool:
        """Note an error; True if it is one too many."""
        if self._error is not None and mono_ns < self._until_ns:
            return True
        self._error, self._until_ns = error, mono_ns + PAUSE_NS
        return False

    def holds(self, mono_ns: int) -> bool:
        """Whether a picture that comes now is left out; it is counted."""
        pauses = self._error is not None and mono_ns < self._until_ns
        self._left_out += pauses
        return pauses

    def over(self, mono_ns: int, time_ns: int, *, at_end: bool = False) -> Iterator[Event]:
        """What to tell, once, when a pause is over, or the recording in the middle of one."""
        if self._error is None or (mono_ns < self._until_ns and not at_end):
            return
        pictures = "picture" if self._left_out == 1 else "pictures"
        text = f"{self._left_out} {pictures} left out after an error of storing: {self._error}"
        self._error, self._left_out = None, 0
        yield _disk(mono_ns, time_ns, Severity.ERROR, text)


@dataclass
class DiskMonitor:
    """Decides what a shrinking disk still allows.

    Warns when less than 15 minutes are left at the present rate, stops pictures at
    `reserve_bytes` until twice as much is free again, and asks to seal at a quarter of it.
    """

    reserve_bytes: int = 64_000_000
    pictures: bool = True
    is_full: bool = False
    _warned: bool = False

    def look(self, free_bytes: int, bytes_per_s: float, mono_ns: int, time_ns: int) -> Iterator[Event]:
        """Events for limits passed since the last look; sets `pictures` and `is_full`."""
        left_s = (free_bytes - self.reserve_bytes) / bytes_per_s if bytes_per_s > 0 else float("inf")
        free = f"{free_bytes / 1e6:.0f} MB free"
        if left_s > 2 * WARN_S:
            self._warned = False
        if left_s < WARN_S and not self._warned:
            self._warned = True
            left = f"{free}, about {max(0, left_s) / 60:.0f} min left"
            yield _disk(mono_ns, time_ns, Severity.WARNING, left)
        if free_bytes < self.reserve_bytes and self.pictures:
            self.pictures = False
            text = f"{free}: disk reserve reached, pictures off, meters continue"
            yield _disk(mono_ns, time_ns, Severity.ERROR, text)
        if free_bytes > 2 * self.reserve_bytes and not self.pictures:
            self.pictures = True
            yield _disk(mono_ns, time_ns, Severity.INFO, f"{free}: pictures on again")
        if free_bytes < self.reserve_bytes // 4 and not self.is_full:
            self.is_full = True
            yield _disk(mono_ns, time_ns, Severity.ERROR, f"{free}: sealing the session")


def _disk(mono_ns: int, time_ns: int, severity: Severity, text: str) -> Event:
    return Event(EventKind.DISK, mono_ns, time_ns, text, "", severity)


@dataclass(frozen=True, slots=True)
class HealthSnapshot:
    """What a look around gave; `clock_checks` once a minute, and where the computer slept."""

    health: Health
    clock_checks: tuple[ClockCheck, ...]
    events: tuple[Event, ...]


@dataclass
class HealthMonitor:
    """Looks around when a second of the session's clock has passed."""

    clock: Clock
    feeds: Sequence[DeviceReader]
    inbox: SampleQueue
    writer: SessionWriter
    free_bytes: Callable[[], int]
    disk: DiskMonitor = field(default_factory=DiskMonitor)

    def __post_init__(self) -> None:
        self._garbled, self._clock_watch, self._pace = GarbleMonitor(), ClockMonitor(), _Pace()
        self._check_pace = ClockCheckSchedule()
        self._late_max_us: Counter[str] = Counter()
        self._next_ns = self.clock.mono_ns()
        self._free_bytes = sys.maxsize  # until the disk tells

    def arrived(self, sample: Sample) -> None:
        """Note how old a sample is when the recorder takes it."""
        late_us = (self.clock.mono_ns() - sample.mono_ns) // 1000
        self._late_max_us[sample.stream] = max(self._late_max_us[sample.stream], late_us)

    def look(self) -> HealthSnapshot | None:
        """Findings if a second has passed since the last look."""
        now = self.clock.mono_ns()
        if now < self._next_ns:
            return None
        self._next_ns = now + SECOND_NS
        utc = self.clock.to_utc_ns(now)
        with suppress(OSError):  # a network drive that hiccups has as much room as before
            self._free_bytes = self.free_bytes()
        free = self._free_bytes
        events = self.garbled(now, utc)
        events += self.disk.look(free, self._pace.bytes_per_s(self.writer.bytes_written, now), now, utc)
        checks = self._check_pace.look(self.clock.check())
        for check in checks:
            events += self._clock_watch.look(check, utc)
        return HealthSnapshot(self._health(now, utc, free), checks, tuple(events))

    def garbled(self, mono_ns: int, time_ns: int, *, at_end: bool = False) -> list[Event]:
        """Events for records that made no sense, once a minute for each stream, and `at_end` for the rest."""
        return [
            event
            for feed in self.feeds
            for event in self._garbled.look(feed.info.name, feed.rejected, mono_ns, time_ns, at_end=at_end)
        ]

    def _health(self, now: int, utc: int, free: int) -> Health:
        streams = tuple(self._stream_health(feed) for feed in self.feeds)
        lag_ms = max(self._late_max_us.values(), default=0) / 1000.0
        self._late_max_us.clear()
        cpu = self._pace.cpu_percent()
        return Health(now, utc, streams, free, self.writer.bytes_written, self.writer.sync_ms, cpu, lag_ms)

    def _stream_health(self, feed: DeviceReader) -> StreamHealth:
        name = feed.info.name
        dropped, waiting = self.inbox.dropped[name], self.inbox.waiting(name)
        return StreamHealth(name, feed.received, dropped, waiting, self._late_max_us[name], feed.rejected)


@dataclass
class _Pace:
    """Rates between one look and the next."""

    _cpu_s: float = field(default_factory=time.process_time)
    _wall_s: float = field(default_factory=time.monotonic)
    _start: tuple[int, int] | None = None

    def cpu_percent(self) -> float:
        cpu, wall = time.process_time(), time.monotonic()
        used = 100.0 * (cpu - self._cpu_s) / max(wall - self._wall_s, 1e-6)
        self._cpu_s, self._wall_s = cpu, wall
        return used

    def bytes_per_s(self, written: int, mono_ns: int) -> float:
        """Mean rate since the first call; a burst now and then must not look like a flood."""
        if self._start is None:
            self._start = (written, mono_ns)
        seconds = (mono_ns - self._start[1]) / SECOND_NS
        return (written - self._start[0]) / seconds if seconds > 0 else 0.0
