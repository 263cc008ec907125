"""Once a second: how the streams, the clock and the disk are doing."""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

from fieldkit.model.clock import Clock, ClockCheck
from fieldkit.model.samples import Event, Health, Sample, StreamHealth
from fieldkit.recorder.feed import Feed
from fieldkit.recorder.inbox import Inbox
from fieldkit.recorder.watch import CheckPace, ClockWatch, DiskWatch, GarbleWatch
from fieldkit.sessions.writer import SessionWriter

SECOND_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Findings:
    """What a look around gave; `clock_checks` once a minute, and where the computer slept."""

    health: Health
    clock_checks: tuple[ClockCheck, ...]
    events: tuple[Event, ...]


@dataclass
class Housekeeping:
    """Looks around when a second of the session's clock has passed."""

    clock: Clock
    feeds: Sequence[Feed]
    inbox: Inbox
    writer: SessionWriter
    free_bytes: Callable[[], int]
    disk: DiskWatch = field(default_factory=DiskWatch)

    def __post_init__(self) -> None:
        self._garbled, self._clock_watch, self._pace = GarbleWatch(), ClockWatch(), _Pace()
        self._check_pace = CheckPace()
        self._late_max_us: Counter[str] = Counter()
        self._next_ns = self.clock.mono_ns()
        self._free_bytes = sys.maxsize  # until the disk tells

    def arrived(self, sample: Sample) -> None:
        """Note how old a sample is when the recorder takes it."""
        late_us = (self.clock.mono_ns() - sample.mono_ns) // 1000
        self._late_max_us[sample.stream] = max(self._late_max_us[sample.stream], late_us)

    def look(self) -> Findings | None:
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
        return Findings(self._health(now, utc, free), checks, tuple(events))

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

    def _stream_health(self, feed: Feed) -> StreamHealth:
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
