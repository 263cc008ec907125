"""One device's reading thread: read, stamp, queue; a lost device is reopened.

A device is lost when its driver reports it or fails, when it stays silent past its deadline, or when its
image is frozen. It is closed, and reopened by its identity after 1, 2, 4 ... 30 s for as long as the
recording lasts, also where its driver hangs in closing or opening; the other devices continue. One that does
not come back from a read is reported by the recorder's thread, and the end of the recording does not wait.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import wait
from dataclasses import dataclass
from queue import SimpleQueue

import numpy as np

from fieldkit.model.clock import Clock
from fieldkit.model.device import Camera, Device, StreamInfo
from fieldkit.model.durations import precise_duration
from fieldkit.model.errors import DeviceError, DeviceLostError
from fieldkit.model.limits import bounds_of, flag_implausible
from fieldkit.model.samples import Event, EventKind, Frame, Quality, Sample, Severity, is_usable
from fieldkit.model.units import MINUTE_NS, SECOND_NS
from fieldkit.recorder import daemon
from fieldkit.recorder.sample_queue import SampleQueue

READ_TIMEOUT_S = 0.5
LONGEST_BACK_OFF_S = 30.0
INDICATORS_EVERY_NS = MINUTE_NS
HANGS_AFTER_S = 10.0
LAST_READ_NS = 2 * SECOND_NS  # a read takes 0.5 s, skipping frames 1 s: the end waits no longer
CLOSED_WITHIN_S = 1.0
LATE_NS = 2 * SECOND_NS
"""A sample may be read this long after its stamp: minutes of the estimator wait as long for it."""
SHUTTER_LEAD_S = 12.0  # the correction takes 1-3 s, then the level settles within 10 s


@dataclass(frozen=True, slots=True)
class Sampling:
    """Choice of the frames that are kept: all, or a burst of `burst_frames` every `every_s` seconds.

    With `shutter_before_burst` the camera's shutter correction runs 12 s before each burst.
    Readings of meters are always kept.
    """

    every_s: float | None = None
    burst_frames: int = 3
    shutter_before_burst: bool = True


class DeviceReader:
    """Reads one device into the queue until `end_ns` (monotonic, None: open end) or `stop`.

    `reopen` opens the same instrument again by its identity. `received` counts its samples, `rejected` the
    records dropped because their bytes were invalid, over all openings; `rejected_because` is the reason for
    the last one, as far as the driver states it.
    """

    def __init__(
        self,
        device: Device,
        reopen: Callable[[], Device],
        queue: SampleQueue,
        clock: Clock,
        sampling: Sampling,
        end_ns: int | None = None,
    ) -> None:
        self.info: StreamInfo = device.info
        self.received: int = 0
        self.implausible: int = 0
        self.rejected: int = 0
        self.rejected_because: str = ""
        self._device: Device | None = device
        self._bounds = bounds_of(self.info)
        self._reopen, self._clock, self._sampling = reopen, clock, sampling
        self._queues: tuple[tuple[int, SampleQueue], ...] = ((0, queue),)
        self._end_ns = end_ns
        self._seconds_away = 0
        self._shutter_requests: SimpleQueue[str] = SimpleQueue()
        self._last: Sample | None = None
        self._before_loss: Sample | None = None
        self._quality = Quality.GOOD
        self._indicators: tuple[str, ...] = ()
        self._indicators_until_ns = 0
        self._rejected_before = 0
        self._has_begun = False
        self._started_ns = self._next_burst_ns = clock.mono_ns()
        self._thread = threading.Thread(target=self._run, name=f"read-{self.info.name}", daemon=True)
        self.ready: threading.Event = threading.Event()

    def start(self) -> None:
        """Start the thread; `ready` is set once it takes part in the clock."""
        self._thread.start()

    def stop(self) -> None:
        """Ask the thread to end; it ends within one read."""
        now_ns = self._clock.mono_ns()
        self._end_ns = now_ns if self._end_ns is None else min(self._end_ns, now_ns)
        self._queues = tuple(queue for queue in self._queues if queue[0] <= now_ns)

    def hand_over(self, mono_ns: int, queue: SampleQueue) -> None:
        """Put what is stamped from a time on into another queue, whose session begins then."""
        self._queues = (*self._queues[-2:], (mono_ns, queue))

    def go_on(self, queue: SampleQueue, since_ns: int, sampling: Sampling, end_ns: int | None) -> None:
        """Read for a recording from a stamp on what was read for a preview: the instrument stays open."""
        self._sampling, self._started_ns, self._end_ns = sampling, since_ns, end_ns
        self._queues, self._next_burst_ns = ((0, queue),), self._clock.mono_ns()

    def feeds(self, queue: SampleQueue) -> bool:
        """Whether a sample may still come to a queue."""
        return self.is_running and self._queue_of(0) is queue

    def _queue_of(self, mono_ns: int) -> SampleQueue:
        """The queue of a stamp; one that comes too late for its session goes to the next."""
        at_ns = max(mono_ns, self._clock.mono_ns() - LATE_NS)
        return next(queue for since_ns, queue in reversed(self._queues) if since_ns <= at_ns)

    def run_shutter(self, request: str) -> None:
        """Ask for a shutter correction, from any thread; an event with ``data["request"]`` answers."""
        self._shutter_requests.put(request)

    def join(self, timeout_s: float) -> bool:
        """Wait for the thread; False if it is still blocked in a read."""
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    @property
    def is_running(self) -> bool:
        """True if the thread was started and has not ended; False also once it is overdue."""
        end_ns = self._end_ns
        is_overdue = end_ns is not None and self._clock.mono_ns() >= end_ns + LAST_READ_NS
        return self._thread.is_alive() and not is_overdue

    def count_second(self) -> None:
        """Note that a second has passed, from any thread; report a driver that hangs.

        Seconds are counted, not subtracted: a process that stood still itself finds no driver hanging.
        """
        self._seconds_away += 1
        limit_s = max(HANGS_AFTER_S, self._deadline_s())
        if limit_s <= self._seconds_away < limit_s + 1.0 and self._device is not None and self.is_running:
            self._report(EventKind.LOST, f"its driver has not come back for {limit_s:.0f} s", Severity.ERROR)

    def _run(self) -> None:
        with self._clock.taking_part():
            self.ready.set()
            try:
                while self._is_active():
                    self._read_or_reconnect()
            except BaseException as error:  # becomes an event, so that the other devices continue
                text = f"reading stopped by an unexpected error: {error!r}"
                self._report(EventKind.LOST, text, Severity.ERROR)
            finally:
                self._answer_shutter_requests()
                self._close()

    def _begin(self) -> None:
        """Skip what was buffered while the device was opened.

        Its time of arrival is unknown, and it may be of before the driver's commands (gain, temperatures).
        """
        self._started_ns, self._has_begun = self._clock.mono_ns(), True
        self._seconds_away = 0
        if isinstance(self._device, Camera):
            period_s = 1.0 / self.info.rate_hz if self.info.rate_hz > 0 else 0.0
            self._device.skip_until(self._started_ns + round(period_s * SECOND_NS))

    def _is_active(self) -> bool:
        return self._end_ns is None or self._clock.mono_ns() < self._end_ns

    def _read_or_reconnect(self) -> None:
        try:
            if not self._has_begun:
                self._begin()
            device, every_s = self._device, self._sampling.every_s
            # in this order: to check a protocol would take a tenth of a meter's time
            if every_s is not None and self.info.is_camera and isinstance(device, Camera):
                self._read_burst(device, round(every_s * SECOND_NS))
            else:
                self._read_one()
        except DeviceError as error:
            self._reconnect(error.message)
        except BaseException as error:  # a driver's mistake, or its SystemExit, costs a moment
            self._reconnect(f"unexpected error: {error!r}", Severity.ERROR)

    def _read_burst(self, camera: Camera, period_ns: int) -> None:
        late_ns = self._clock.mono_ns() - self._next_burst_ns
        self._next_burst_ns += max(0, late_ns // period_ns) * period_ns
        if self._sampling.shutter_before_burst:
            self._skip(camera, self._next_burst_ns - round(SHUTTER_LEAD_S * SECOND_NS))
            if self._is_active() and self._clock.mono_ns() < self._next_burst_ns:
                camera.run_shutter()
        self._skip(camera, self._next_burst_ns)
        for _ in range(self._sampling.burst_frames):
            if self._is_active():
                self._read_one()
        self._next_burst_ns += period_ns

    def _skip(self, camera: Camera, until_ns: int) -> None:
        """Skip frames, at most a second at a time so that `stop` takes effect."""
        if self._end_ns is not None:
            until_ns = min(until_ns, self._end_ns)
        while self._is_active() and (now := self._clock.mono_ns()) < until_ns:
            self._answer_shutter_requests()
            camera.skip_until(min(until_ns, now + SECOND_NS))
            self._seconds_away = 0

    def _read_one(self) -> None:
        """Queue the next sample; raises `DeviceLostError` past the deadline or on a frozen image."""
        assert self._device is not None
        deadline_ns = self._clock.mono_ns() + round(self._deadline_s() * SECOND_NS)
        while self._is_active():
            self._answer_shutter_requests()
            sample = self._device.read(READ_TIMEOUT_S)
            self._note_return(self._device)
            if sample is not None and not self._was_buffered(sample):
                self.received += 1
                sample = self._in_order(self._across_openings(flag_implausible(sample, self._bounds)))
                self._last = sample
                self.implausible += Quality.IMPLAUSIBLE in sample.quality
                if Quality.DROPPED_BEFORE in sample.quality:
                    self._report(EventKind.GAP, "the device or its driver lost samples", Severity.WARNING)
                self._queue_of(sample.mono_ns).put(sample)
                self._report_indicators(sample)
                if Quality.FROZEN in sample.quality:
                    raise DeviceLostError("the image is frozen")
                return
            if self._clock.mono_ns() >= deadline_ns:
                raise DeviceLostError(f"silent for {self._deadline_s():.1f} s")

    def _note_return(self, device: Device) -> None:
        """Note that the driver came back, and its counts; raises `DeviceLostError` if it hung."""
        self.rejected = self._rejected_before + device.rejected
        self.rejected_because = getattr(device, "rejected_because", "")
        away_s, self._seconds_away = self._seconds_away, 0
        if away_s >= max(HANGS_AFTER_S, self._deadline_s()):
            raise DeviceLostError(f"its driver came back after {away_s} s")

    def _was_buffered(self, sample: Sample) -> bool:
        """True for a stamp before the start; one that arrives long after it is wrong, and corrected."""
        is_early = self._clock.mono_ns() < self._started_ns + round(self._deadline_s() * SECOND_NS)
        return is_early and sample.mono_ns < self._started_ns

    def _answer_shutter_requests(self) -> None:
        """Run the shutter in the thread that reads: a camera's commands and frames share its cable."""
        while not self._shutter_requests.empty():
            request, can = self._shutter_requests.get(), False
            if isinstance(self._device, Camera) and self._is_active():
                can = self._device.run_shutter()
            text = "shutter correction started" if can else "this camera cannot run its shutter now"
            self._report(EventKind.SHUTTER, text, Severity.INFO if can else Severity.WARNING, request=request)

    def _report_indicators(self, sample: Sample) -> None:
        """Report a change of the meter's indicators (hold, low battery ...), at most once a minute."""
        indicators = getattr(self._device, "states", ())  # cameras have none
        if indicators == self._indicators or sample.mono_ns < self._indicators_until_ns:
            return
        self._indicators, self._indicators_until_ns = indicators, sample.mono_ns + INDICATORS_EVERY_NS
        severity = Severity.INFO if is_usable(sample.quality) else Severity.WARNING
        text = ", ".join(indicators).replace("_", " ") or "–"
        self._report(EventKind.MODE, f"the meter shows: {text}", severity, shows=text)

    def _across_openings(self, sample: Sample) -> Sample:
        """Add the flags that a reopened device cannot set: it has no earlier samples to compare with."""
        before, self._before_loss = self._before_loss, None
        same = (
            isinstance(before, Frame)
            and isinstance(sample, Frame)
            and np.array_equal(before.counts, sample.counts)
        )
        flags = self._quality | (Quality.DUPLICATE if same else Quality.GOOD)
        return sample._replace(quality=sample.quality | flags) if flags else sample

    def _in_order(self, sample: Sample) -> Sample:
        """Keep the stamp between the previous sample's and now; one outside the session becomes now."""
        now_ns = self._clock.mono_ns()
        is_inside = self._started_ns <= sample.mono_ns <= now_ns
        mono_ns = sample.mono_ns if is_inside else now_ns
        if self._last is not None:
            mono_ns = max(mono_ns, self._last.mono_ns)
        time_ns = self._clock.to_utc_ns(mono_ns)
        # the next session of a split recording may have taken its anchor since
        is_as_stamped = mono_ns == sample.mono_ns and abs(sample.time_ns - time_ns) < SECOND_NS
        flags = Quality.GOOD if is_as_stamped else Quality.INTERPOLATED
        return sample._replace(mono_ns=mono_ns, time_ns=time_ns, quality=sample.quality | flags)

    def _deadline_s(self) -> float:
        """Two sampling intervals, but at least 2 s: cameras pause briefly, slow meters skip a reading."""
        interval_s = 1.0 / self.info.rate_hz if self.info.rate_hz > 0 else 5.0
        return max(2.0 * interval_s, 2.0)

    def _reconnect(self, reason: str, severity: Severity = Severity.WARNING) -> None:
        lost_ns = self._clock.mono_ns()
        self._report(EventKind.LOST, f"lost: {reason}", severity)
        self._close()
        wait_s = 1.0
        while self._is_active():
            self._pause(wait_s)
            wait_s = min(2.0 * wait_s, LONGEST_BACK_OFF_S)
            if self._is_active() and (device := self._reopen_device()) is not None:
                self._device, self._before_loss, self._has_begun = device, self._last, False
                gap_s = (self._clock.mono_ns() - lost_ns) / SECOND_NS
                changed = _changes(self.info, device.info)
                text = "; ".join([f"back after {precise_duration(gap_s)}", *changed])
                severity = Severity.WARNING if changed else Severity.INFO
                self._report(EventKind.BACK, text, severity, gap_s=gap_s)
                self._flag_another_scale(device.info)
                return

    def _reopen_device(self) -> Device | None:
        """The reopened device, or None while it does not respond or its samples do not fit the stream."""
        try:
            device = self._reopen()
        except BaseException:  # a driver may fail in any way; the next try is due
            return None
        if self.info.has_the_columns_of(device.info):
            return device
        self._close_in_time(device)  # a different instrument with the same name
        return None

    def _flag_another_scale(self, info: StreamInfo) -> None:
        """Flag further samples as without value if the reopened device scales its counts differently."""
        same = self.info.is_read_as(info)
        self._quality = Quality.GOOD if same else Quality.NO_VALUE
        if not same:
            now = f"{info.law}, {info.scale:g} x counts + {info.offset:g}"
            text = f"came back with another scale ({now}); its samples are kept and have no value"
            self._report(EventKind.LOST, text, Severity.ERROR)

    def _pause(self, seconds: float) -> None:
        until_ns = self._clock.mono_ns() + round(seconds * SECOND_NS)
        while self._is_active() and (left := until_ns - self._clock.mono_ns()) > 0:
            self._answer_shutter_requests()
            self._clock.sleep(min(left / SECOND_NS, READ_TIMEOUT_S))

    def _close(self) -> None:
        device, self._device = self._device, None
        if device is not None:
            self._rejected_before = self.rejected
            self._close_in_time(device)

    def _close_in_time(self, device: Device) -> None:
        """Close in a thread, which is left behind if the driver hangs: it is opened again all the same."""
        if not wait([daemon.start(device.close, f"close-{self.info.name}")], CLOSED_WITHIN_S).done:
            self._report(EventKind.LOST, "its driver does not come back from closing it", Severity.ERROR)

    def _report(self, kind: EventKind, text: str, severity: Severity, **data: float | str) -> None:
        now = self._clock.mono_ns()
        utc = self._clock.to_utc_ns(now)
        name = self.info.name
        self._queue_of(now).put_event(Event(kind, now, utc, f"{name}: {text}", name, severity, data))


def _changes(before: StreamInfo, now: StreamInfo) -> list[str]:
    """Differences in the report of a reopened instrument: it is another, or lost its settings."""
    names = ("model", "serial_number", "firmware")
    old, new = ({name: getattr(info, name) for name in names} | dict(info.settings) for info in (before, now))
    return [
        f"its {key.replace('_', ' ')} is {new[key]}, was {old[key]}"
        for key in old
        if old[key] != "" and new.get(key, "") != "" and repr(old[key]) != repr(new[key])  # NaN is as before
    ]
