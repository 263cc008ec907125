"""The recorder's own thread: every item to the session first, then to the estimator and the views."""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from typing import Protocol, TypeAlias

from fieldkit.estimation.estimator import Estimator, Minute
from fieldkit.model.clock import Clock
from fieldkit.model.device import Device
from fieldkit.model.errors import StorageError
from fieldkit.model.samples import Event, EventKind, Frame, Health, Sample, Severity
from fieldkit.recorder.device_reader import DeviceReader, Sampling
from fieldkit.recorder.health import DiskMonitor, FlagMonitor, HealthMonitor, MisfitMonitor, StorageMonitor
from fieldkit.recorder.sample_queue import Item, SampleQueue, queue_limit
from fieldkit.sessions.seal import SealReport
from fieldkit.sessions.writer import SessionWriter

log = logging.getLogger(__name__)

Shown: TypeAlias = Sample | Event | Minute | Health


class View(Protocol):
    """Something that looks on; it may fail without harm, and is then left out."""

    def show(self, item: Shown) -> None:
        """Take note of an item; must return at once."""

    def close(self) -> None:
        """The recording is over."""


@dataclass(frozen=True, slots=True)
class Summary:
    """How a recording went: samples stored and lost per stream, the last minute, the seal.

    `failure` says why storing had to end early, if it had to.
    """

    counts: dict[str, int]
    dropped: dict[str, int]
    last_minute: Minute | None
    seal: SealReport
    failure: StorageError | None = None


@dataclass
class Recorder:
    """Records opened devices into a session until `stop`, the planned end, or a full disk.

    `reopen(name)` opens a device again by its identity; `free_bytes` tells the disk's free
    space; `marks` yields events that people dropped in meanwhile, `last_marks` those left when no
    more are taken. `end_ns` is monotonic; `stopping` may be set before the recorder exists. Call `run` once.
    """

    devices: Sequence[Device]
    reopen: Callable[[str], Device]
    writer: SessionWriter
    estimator: Estimator
    clock: Clock
    free_bytes: Callable[[], int]
    sampling: Sampling = field(default_factory=Sampling)
    views: Sequence[View] = ()
    end_ns: int | None = None
    marks: Callable[[], Iterable[Event]] = tuple
    last_marks: Callable[[], Iterable[Event]] = tuple
    disk_reserve_bytes: int = 64_000_000
    stopping: threading.Event = field(default_factory=threading.Event)

    def __post_init__(self) -> None:
        self._inbox = SampleQueue({device.info.name: queue_limit(device.info) for device in self.devices})
        self._feeds = [self._feed(device) for device in self.devices]
        disk = DiskMonitor(self.disk_reserve_bytes)
        self._house = HealthMonitor(self.clock, self._feeds, self._inbox, self.writer, self.free_bytes, disk)
        self._audience = ViewDispatcher(self.views, self._view_lost)
        self._estimator: Estimator | None = self.estimator
        self._flags, self._misfits = FlagMonitor(), MisfitMonitor()
        self._counts: Counter[str] = Counter()
        self._last_minute: Minute | None = None
        self._storage = StorageMonitor()
        self._failure: StorageError | None = None

    def stop(self) -> None:
        """Ask for an orderly end; safe from any thread and from signal handlers."""
        self.stopping.set()

    def run(self) -> Summary:
        """Record; returns when the session is sealed.

        Raises `StorageError` only if not even sealing is possible; a disk that fills up
        seals what is there and is told in `Summary.failure`.
        """
        self._say(EventKind.START, "recording started")
        self.clock.hold_until(self._inbox.settled)
        try:
            self._start_feeds()
            while self._goes_on():
                self._take(self._inbox.get(0.1))
            self._stop_feeds()
            self._finish_events()
            self._finish_estimates()
            self._say(EventKind.STOP, "recording stopped")
            seal = self.writer.close()
        except BaseException:  # a second Ctrl-C, or our own mistake: the journal keeps everything
            self.writer.abandon()
            raise
        finally:
            self._audience.close()
        counts = {feed.info.name: self._counts[feed.info.name] for feed in self._feeds}
        return Summary(counts, dict(self._inbox.dropped), self._last_minute, seal, self._failure)

    # --- reading threads

    def _feed(self, device: Device) -> DeviceReader:
        name = device.info.name
        return DeviceReader(
            device, lambda: self.reopen(name), self._inbox, self.clock, self.sampling, self.end_ns
        )

    def _start_feeds(self) -> None:
        with self.clock.taking_part():  # time stands until every reader takes part
            for feed in self._feeds:
                feed.start()
            for feed in self._feeds:
                feed.ready.wait()

    def _goes_on(self) -> bool:
        if self.stopping.is_set() or self._failure is not None:
            return False
        return self._inbox.is_busy() or any(feed.is_running for feed in self._feeds)

    def _stop_feeds(self) -> None:
        """Let the readers end and take what they still hand over; a stuck one is left behind."""
        for feed in self._feeds:
            feed.stop()
        deadline = time.monotonic() + 5.0
        while any(feed.is_running for feed in self._feeds) and time.monotonic() < deadline:
            self._take(self._inbox.get(0.02))
        while (item := self._inbox.get(0.0)) is not None:
            self._take(item)
        for feed in self._feeds:
            if feed.is_running:
                log.warning("%s is stuck in a read and was left behind", feed.info.name)

    def _finish_events(self) -> None:
        """Events that would follow if the recording went on, and why it does not.

        Raises `StorageError` if not even now, in the room kept for the end, a mark can be stored: the session
        is then left to recovery, which takes it.
        """
        with suppress(OSError):  # an event may need the room; if it cannot be had, closing will tell
            self.writer.release_reserve()
        if not self._keep_marks(self.last_marks()):
            raise StorageError(
                f"the last marks could not be stored in {self.writer.path}; they are kept beside it",
                fix=f"free some space, then: fieldkit recover {self.writer.path}",
            )
        now = self.clock.mono_ns()
        utc = self.clock.to_utc_ns(now)
        for event in chain(
            self._house.garbled(now, utc, at_end=True), self._storage.over(now, utc, at_end=True)
        ):
            self._keep_event(event)
        if self._failure is not None:
            text = f"the recording ended early: {self._failure}"
            self._say(EventKind.DISK, text, Severity.ERROR)

    # --- items: the session first

    def _take(self, item: Item | None) -> None:
        if isinstance(item, Event):
            self._keep_event(item)
        elif item is not None:
            self._keep_sample(item)
        self._look_around()
        if item is not None:
            self._inbox.done(item)  # only now may a simulated clock move on

    def _keep_sample(self, sample: Sample) -> None:
        self._house.arrived(sample)
        now = self.clock.mono_ns()
        if isinstance(sample, Frame) and (self._storage.holds(now) or not self._house.disk.pictures):
            return
        sample = sample._replace(seq=self._counts[sample.stream])
        try:
            if not self._stored(lambda: self.writer.append(sample)):
                return
        except ValueError as error:  # a driver broke its promise: that costs this sample, not the others
            for event in self._misfits.left_out(sample, error):
                self._keep_event(event)
            return
        self._misfits.stored(sample.stream)
        self._counts[sample.stream] += 1
        for event in self._flags.look(sample):
            self._keep_event(event)
        self._estimate(sample)
        self._audience.show(sample)

    def _keep_event(self, event: Event) -> None:
        self._stored(lambda: self.writer.event(event))
        self._audience.show(event)

    def _keep_marks(self, marks: Iterable[Event]) -> bool:
        """Store marks up to one that cannot be: its file stays, and it comes again."""
        for mark in marks:
            if not self._stored(partial(self.writer.event, mark)):
                return False
            self._audience.show(mark)
        return True

    def _say(self, kind: EventKind, text: str, severity: Severity = Severity.INFO) -> None:
        now = self.clock.mono_ns()
        self._keep_event(Event(kind, now, self.clock.to_utc_ns(now), text, "", severity))

    def _stored(self, write: Callable[[], None]) -> bool:
        """Write; a failure lets pictures pause, a further one meanwhile ends the recording."""
        try:
            write()
        except StorageError as error:
            log.error("cannot store: %s", error)
            if self._storage.failed(error, self.clock.mono_ns()):
                self._failure = error
            return False
        return True

    def _look_around(self) -> None:
        findings = self._house.look()
        if findings is None:
            return
        self._stored(lambda: self.writer.health(findings.health))
        for check in findings.clock_checks:
            self._stored(partial(self.writer.clock_check, check))
        health = findings.health
        for event in chain(findings.events, self._storage.over(health.mono_ns, health.time_ns)):
            self._keep_event(event)
        self._keep_marks(self.marks())
        self._audience.show(health)
        if self._house.disk.is_full and self._failure is None:
            fix = "free some space before the next session; this one was sealed in time"
            self._failure = StorageError("the disk is full", fix=fix)

    # --- estimates and views

    def _estimate(self, sample: Sample) -> None:
        if self._estimator is None:
            return
        try:
            minutes = self._estimator.add(sample)
        except Exception as error:
            self._lose_estimator(error)
            return
        for minute in minutes:
            self._keep_minute(minute)

    def _finish_estimates(self) -> None:
        try:
            minutes = self._estimator.finish() if self._estimator is not None else []
        except Exception as error:
            self._lose_estimator(error)
            return
        for minute in minutes:
            self._keep_minute(minute)

    def _lose_estimator(self, error: Exception) -> None:
        log.exception("estimator failed")
        self._estimator = None
        self._say(
            EventKind.ESTIMATOR, f"live estimates stopped: {error!r}; recording goes on", Severity.ERROR
        )

    def _keep_minute(self, minute: Minute) -> None:
        self._last_minute = minute
        irradiance, model = minute.dni_w_m2, minute.irradiance_model
        self._stored(
            lambda: self.writer.minute(minute.time_ns, minute.estimates, irradiance, model, minute.flags)
        )
        for notice in minute.events:
            self._keep_event(notice)
        self._audience.show(minute)

    def _view_lost(self, error: Exception) -> None:
        if not self.writer.is_closed:
            self._say(EventKind.VIEW, f"a view stopped: {error!r}; recording goes on", Severity.WARNING)


class ViewDispatcher:
    """All views of a recording; `lost` is told why one is left out from now on."""

    def __init__(self, views: Sequence[View], lost: Callable[[Exception], None]) -> None:
        self._views = list(views)
        self._lost = lost

    def show(self, item: Shown) -> None:
        """Show an item to every view."""
        for view in tuple(self._views):
            self._guarded(view, partial(view.show, item))

    def close(self) -> None:
        """Tell every view that the recording is over."""
        for view in tuple(self._views):
            self._guarded(view, view.close)

    def _guarded(self, view: View, act: Callable[[], None]) -> None:
        try:
            act()
        except Exception as error:
            log.exception("view failed")
            self._views.remove(view)
            self._lost(error)
