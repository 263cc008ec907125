"""The recorder's thread: every item goes to the session first, then to the estimator and the views."""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import InitVar, dataclass, field, replace
from functools import partial
from itertools import chain
from typing import Any, Protocol, TypeAlias

from fieldkit.estimation.estimator import Estimator, Minute
from fieldkit.model.alarm import Phase
from fieldkit.model.clock import Clock, ClockCheck
from fieldkit.model.device import Device
from fieldkit.model.errors import StorageError, message_of
from fieldkit.model.next_step import Action
from fieldkit.model.samples import Event, EventKind, Frame, Health, Sample, Severity
from fieldkit.model.site import RegionRecord
from fieldkit.model.units import SECOND_NS
from fieldkit.phrases import Words, counted
from fieldkit.recorder.alarm_outputs import AlarmWatch
from fieldkit.recorder.device_reader import DeviceReader, Sampling
from fieldkit.recorder.estimator_thread import LONGEST_WAIT_S, EstimatorThread
from fieldkit.recorder.health import DiskMonitor, EstimatorMonitor, FlagMonitor, HealthMonitor, StorageMonitor
from fieldkit.recorder.sample_queue import Item, SampleQueue, queue_limit
from fieldkit.sessions.records import MinuteRecord
from fieldkit.sessions.seal import SealReport
from fieldkit.sessions.writer import SessionWriter

log: logging.Logger = logging.getLogger(__name__)
_VIEWS_LOCK = threading.RLock()
"""Of all views: where one session follows another, two recorders have the same."""

Shown: TypeAlias = Sample | Event | RegionRecord | Minute | Health


class View(Protocol):
    """Shows a recording while it runs; a view that raises is removed and the recording continues."""

    def show(self, item: Shown) -> None:
        """Receive an item; must return at once."""

    def close(self) -> None:
        """The recording is over."""


@dataclass(frozen=True, slots=True)
class ShutterRequest:
    """A shutter correction is to run now; `request` is the id for the event that answers."""

    request: str


@dataclass(frozen=True, slots=True)
class Summary:
    """The outcome of a recording: samples stored and lost per stream, the last minute, the seal.

    `failure` is the error that ended the recording early, if any.
    """

    counts: dict[str, int]
    dropped: dict[str, int]
    last_minute: Minute | None
    seal: SealReport
    failure: StorageError | None = None


@dataclass
class Recorder:
    """Records opened devices into a session until `stop`, the planned end, or a full disk.

    `reopen(name)` reopens a device by its identity; `free_bytes` returns the disk's free space; `requests`
    yields what was asked for since its last call, `last_requests` what is left at the end. `end_ns` is
    monotonic; `stopping` may be set before the recorder exists. `earlier` are samples from before the
    start, in order, that the session begins with; `readers` read already, and from the stamp `since_ns` on
    for this session. Call `run` once.

    From `split_ns` (monotonic) on samples belong to the session of another recorder, whose `previous` is this
    one and which has its instruments, views and alarms: call `record`, then `finish` in a thread of its own.
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
    requests: Callable[[], Iterable[Event | RegionRecord | ShutterRequest]] = tuple
    last_requests: Callable[[], Iterable[Event | RegionRecord | ShutterRequest]] = tuple
    disk_reserve_bytes: int = 64_000_000
    alarms: AlarmWatch = field(default_factory=AlarmWatch)
    stopping: threading.Event = field(default_factory=threading.Event)
    earlier: Iterable[Sample] = ()
    readers: Sequence[DeviceReader] = ()
    since_ns: int = 0
    split_ns: int | None = None
    previous: InitVar[Recorder | None] = None

    def __post_init__(self, previous: Recorder | None) -> None:
        self._start_text = "recording started"
        if previous is None:
            self._queue = self._new_queue()
            self._readers = list(self.readers) or [self._reader(device) for device in self.devices]
            for reader in self.readers:
                reader.go_on(self._queue, self.since_ns, self.sampling, self.end_ns)
        else:
            self._queue, self._readers = previous._next_queue, previous._readers
            self._start_text = f"the recording {previous.writer.path.stem} goes on"
        if self.split_ns is not None:
            self._next_queue: SampleQueue = self._new_queue()
            for reader in self._readers:
                reader.hand_over(self.split_ns, self._next_queue)
        self._is_split = False
        disk = DiskMonitor(self.disk_reserve_bytes)
        self._health = HealthMonitor(
            self.clock, self._readers, self._queue, self.writer, self.free_bytes, disk
        )
        self._shown = list(self.views)
        self._estimating: EstimatorThread | None = EstimatorThread(self.estimator, self._queue)
        self._flags, self._late = FlagMonitor(), EstimatorMonitor()
        self._misfits: set[str] = set()
        """Streams whose last sample did not match their declaration."""
        self._counts: Counter[str] = Counter()
        self._last_minute: Minute | None = None
        self._storage = StorageMonitor()
        self._failure: StorageError | None = None

    def stop(self) -> None:
        """Ask for an orderly end; safe from any thread and from signal handlers."""
        self.stopping.set()

    def end(self) -> None:
        """End as at the planned end, which now is; safe from any thread."""
        for reader in self._readers:
            reader.stop()

    def run(self) -> Summary:
        """Record; returns when the session is sealed.

        Raises `StorageError` only if sealing fails too: on a full disk the session is sealed early and
        `Summary.failure` holds the error.
        """
        self.record()
        return self.finish()

    def record(self) -> bool:
        """Record until the end, or until the next session begins; whether it does."""
        with self._abandoning_on_failure():
            self._report(EventKind.START, self._start_text, session=self.writer.path.stem)
            self._keep_present_alarms()
            self._start_readers()
            self._keep_earlier()
            while self._is_active() and not self._is_due():
                self._take(self._queue.get(0.1))
        self._is_split = self._failure is None and self._is_due()
        return self._is_split

    def finish(self, next_session: str = "") -> Summary:
        """Store what is left and seal; instruments and views stay open for the next session."""
        with self._abandoning_on_failure():
            self._stop_readers()
            self._finish_events()
            self._finish_estimates()
            data = {"next_session": next_session} if self._is_split else {}
            text = Words("event.stop.next_session", **data) if data else Words("event.stop")
            self._report(EventKind.STOP, text, Severity.INFO, **data)
            seal = self.writer.close()
        self._close()
        counts = {reader.info.name: self._counts[reader.info.name] for reader in self._readers}
        return Summary(counts, dict(self._queue.dropped), self._last_minute, seal, self._failure)

    def note_failure(self, finished: Future[Any]) -> None:
        """Report, from any thread, that the session before could not be sealed."""
        if (error := finished.exception()) is not None:
            now = self.clock.mono_ns()
            text = f"the session before was not sealed: {message_of(error)}"
            event = Event(EventKind.DISK, now, self.writer.utc_ns(now), text, "", Severity.ERROR)
            self._queue.put_event(event)

    @contextmanager
    def _abandoning_on_failure(self) -> Iterator[None]:
        try:
            yield
        except BaseException:  # a second Ctrl-C or a bug: the journal keeps everything
            self.writer.abandon()
            self._close()
            raise

    def _close(self) -> None:
        if self._estimating is not None:
            self._estimating.close()
        if not self._is_split:
            self._to_views(lambda view: view.close())
            self.alarms.close()

    def _new_queue(self) -> SampleQueue:
        queue = SampleQueue({device.info.name: queue_limit(device.info) for device in self.devices})
        self.clock.hold_until(queue.is_settled)
        return queue

    # --- reading threads

    def _reader(self, device: Device) -> DeviceReader:
        return DeviceReader(
            device, lambda: self.reopen(device.info.name), self._queue, self.clock, self.sampling, self.end_ns
        )

    def _start_readers(self) -> None:
        with self.clock.taking_part():  # simulated time stands still until every reader takes part
            for reader in self._readers:
                if not reader.ready.is_set():
                    reader.start()
            for reader in self._readers:
                reader.ready.wait()

    def _is_active(self) -> bool:
        if self.stopping.is_set() or self._failure is not None:
            return False
        return any(reader.is_running for reader in self._readers)

    def _is_due(self) -> bool:
        return self.split_ns is not None and self.clock.mono_ns() >= self.split_ns

    def _stop_readers(self) -> None:
        """Let the readers end, or go over to the next session; process what they still queue.

        A blocked one is abandoned.
        """
        for reader in self._readers:
            if not self._is_split:
                reader.stop()
        deadline = time.monotonic() + 5.0
        while any(reader.feeds(self._queue) for reader in self._readers) and time.monotonic() < deadline:
            self._take(self._queue.get(0.02))
        while (item := self._queue.get(0.0)) is not None:
            self._take(item)
        for reader in self._readers:
            if not (self._is_split or reader.join(0.0)):
                text = f"{reader.info.name}: its driver does not come back and is left behind"
                self._report(EventKind.LOST, text, Severity.ERROR)

    def _finish_events(self) -> None:
        """Carry out the last requests, store the pending events, and the reason for an early end.

        Raises `StorageError` if an answer cannot be stored even in the space reserved for the end: the
        session is then left to recovery, which reads the request.
        """
        self.writer.release_reserve()  # an event may need the space
        if not self.carry_out(self.last_requests()):
            problem = "the last marks could not be stored; they are kept beside it"
            fix = "free some space, then: " + Action.RECOVER(self.writer.path)
            raise StorageError(problem, place=self.writer.path, fix=fix)
        now = self.clock.mono_ns()
        utc = self.writer.utc_ns(now)
        checks, events = self._health.inspect(now, utc, at_end=True)
        self._keep_checks(checks)
        for event in chain(events, self._storage.summary(now, utc, at_end=True)):
            self._keep_event(event)
        if self._failure is not None:
            text = f"the recording ended early: {self._failure.message}"
            self._report(EventKind.DISK, text, Severity.ERROR, ended="early")

    # --- items: the session first

    def _keep_present_alarms(self) -> None:
        """Store the alarms that were raised in an earlier session, which then is complete without it."""
        now = self.clock.mono_ns()
        for alarm in self.alarms.present:
            phase = Phase.ACKNOWLEDGED if alarm.acknowledged else Phase.RAISED
            self._keep_event(alarm.event(phase, now, self.writer.utc_ns(now)))

    def _keep_earlier(self) -> None:
        """Store what was measured before the start; the queue keeps what comes meanwhile."""
        for sample in self.earlier:
            self._keep_sample(sample)
        was_before = self.clock.mono_ns() - self.since_ns > SECOND_NS  # and not while readers went over
        if was_before and (count := self._counts.total()):
            text = f"{counted(count, 'sample')} of the preview before included"
            self._report(EventKind.START, text, samples=count)

    def _take(self, item: Item | None) -> None:
        if item is not None:
            self._keep(item)
        if not self._is_split:
            self._check_health()
        if item is not None:
            self._queue.finish(item)  # only now may a simulated clock move on
        if self._estimating is not None and not self.clock.is_real:
            self._give_up_after(self._estimating.waited_s())

    def _keep(self, item: Item) -> None:
        if isinstance(item, Event):
            self._keep_event(replace(item, time_ns=self.writer.utc_ns(item.mono_ns)))
        elif isinstance(item, Future):
            self._keep_estimated(item)
        else:
            self._keep_sample(item)

    def _keep_sample(self, sample: Sample) -> None:
        self._health.sample_arrived(sample)
        if isinstance(sample, Frame) and (
            self._storage.skips_frame(self.clock.mono_ns()) or not self._health.disk.stores_frames
        ):
            return
        # what was read around the start of a session may have been stamped by the anchor of another
        time_ns = self.writer.utc_ns(sample.mono_ns)
        sample = sample._replace(seq=self._counts[sample.stream], time_ns=time_ns)
        try:
            if not self._store(lambda: self.writer.append(sample)):
                return
        except ValueError as error:  # a driver's mistake costs this sample, not the recording
            if sample.stream not in self._misfits:  # of a run of them the first is reported
                self._misfits.add(sample.stream)
                at, text = (sample.mono_ns, time_ns), f"not stored: {message_of(error)}"
                self._keep_event(Event(EventKind.GARBLED, *at, text, sample.stream, Severity.WARNING))
            return
        self._misfits.discard(sample.stream)
        self._counts[sample.stream] += 1
        for event in self._flags.update(sample):
            self._keep_event(event)
        self._estimate(sample)
        self._pass_on(sample)

    def _keep_event(self, event: Event) -> None:
        self._store(lambda: self.writer.put(event))
        self._pass_on(event)

    def _keep_checks(self, checks: Iterable[ClockCheck]) -> None:
        for check in checks:
            self._store(partial(self.writer.put, check))

    def carry_out(self, requests: Iterable[Event | RegionRecord | ShutterRequest]) -> bool:
        """Store and follow requests; stops at the first that cannot be stored, which comes again."""
        for request in requests:
            if isinstance(request, ShutterRequest):
                self._run_shutter(request.request)
                continue
            if not self._store(partial(self.writer.put, request)):
                return False
            self._pass_on(request)
            self._estimate(request)
        return True

    def _run_shutter(self, request: str) -> None:
        """Ask the cameras' readers, whose events answer; without any camera the answer is here."""
        cameras = [reader for reader in self._readers if reader.info.is_camera and reader.is_running]
        for reader in cameras:
            reader.run_shutter(request)
        if not cameras:
            text = "no shutter correction: no camera is being read"
            self._report(EventKind.SHUTTER, text, Severity.WARNING, request=request)

    def _report(
        self, kind: EventKind, text: str, severity: Severity = Severity.INFO, **data: int | str
    ) -> None:
        now = self.clock.mono_ns()
        self._keep_event(Event(kind, now, self.writer.utc_ns(now), text, "", severity, data))

    def _store(self, write: Callable[[], None]) -> bool:
        """Write; a failure pauses frames, and a second one during the pause ends the recording."""
        try:
            write()
        except StorageError as error:
            log.error("cannot store: %s", error.message)
            if self._storage.ends_recording(error, self.clock.mono_ns()):
                self._failure = error
            return False
        return True

    def _check_health(self) -> None:
        if (snapshot := self._health.update()) is None:
            return
        self._store(lambda: self.writer.put(snapshot.health))
        self._keep_checks(snapshot.clock_checks)
        health = snapshot.health
        now, utc = health.mono_ns, health.time_ns
        late = self._late.update(self._estimating.waited_s(), now, utc) if self._estimating else ()
        for event in chain(snapshot.events, self._storage.summary(now, utc), late):
            self._keep_event(event)
        self.carry_out(self.requests())
        self._pass_on(health)
        if self._health.disk.is_full and self._failure is None:
            fix = "free some space before the next session; this one was sealed in time"
            self._failure = StorageError("the disk is full", fix=fix)

    # --- estimates and views

    def _estimate(self, sample: Sample | Event | RegionRecord) -> None:
        if self._estimating is None:
            return
        try:
            self._estimating.add(sample)
        except Exception as error:
            self._drop_estimator(error)

    def _finish_estimates(self) -> None:
        """Close the open minutes too, and wait for all that are not estimated yet, though not for long."""
        ended_s = time.monotonic()
        try:
            if self._estimating is not None:
                self._estimating.finish()
        except Exception as error:
            self._drop_estimator(error)
        while self._queue.is_busy():
            if (item := self._queue.get(0.1)) is not None:
                self._keep(item)
                self._queue.finish(item)
            self._give_up_after(time.monotonic() - ended_s)

    def _give_up_after(self, waited_s: float) -> None:
        """Go on without estimates once the end, or simulated time, has waited for them too long."""
        if self._estimating is not None and waited_s > LONGEST_WAIT_S:
            self._stop_estimating(f"none came for {LONGEST_WAIT_S:g} s; a later estimate finds them")

    def _keep_estimated(self, estimated: Future[Minute]) -> None:
        if self._estimating is None:  # a minute before this one failed
            return
        try:
            minute = estimated.result()
        except Exception as error:
            self._drop_estimator(error)
            return
        self._last_minute = minute
        record = MinuteRecord(
            minute.time_ns, tuple(minute.estimates), minute.dni_w_m2, minute.irradiance_model, minute.flags,
            minute.learnt,
        )  # fmt: skip
        self._store(lambda: self.writer.put(record))
        for notice in minute.events:
            self._keep_event(notice)
        self._pass_on(minute)

    def _drop_estimator(self, error: Exception) -> None:
        log.error("estimator failed", exc_info=error)
        self._stop_estimating(f"{error!r}; recording goes on")

    def _stop_estimating(self, why: str) -> None:
        if self._estimating is not None:
            self._estimating.close()
        self._estimating = None
        self._report(EventKind.ESTIMATOR, f"live estimates stopped: {why}", Severity.ERROR)

    def _pass_on(self, item: Shown) -> None:
        """Show an item that is stored, and store the alarms that follow from it."""
        self._to_views(lambda view: view.show(item))
        if self._is_split:  # alarms are the next session's
            return
        try:
            events = self.alarms.update(item)
        except Exception as error:
            log.exception("alarms failed")
            self.alarms.close()
            self.alarms = AlarmWatch()
            self._report(EventKind.ALARM, f"alarms stopped: {error!r}; recording goes on", Severity.ERROR)
            return
        for event in events:
            self._keep_event(event)

    def _to_views(self, act: Callable[[View], None]) -> None:
        """Act on every view; one that raises is removed and reported."""
        for view in tuple(self._shown):
            try:
                with _VIEWS_LOCK:
                    act(view)
            except Exception as error:
                log.exception("view failed")
                self._shown.remove(view)
                if not self.writer.is_closed:
                    text = f"a view stopped: {error!r}; recording goes on"
                    self._report(EventKind.VIEW, text, Severity.WARNING)
