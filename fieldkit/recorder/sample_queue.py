"""Samples and events on their way from the reading threads to the recorder.

Bounded per stream, so that a stalled disk costs memory for a few seconds and then samples,
which are counted; a reading thread never waits here.
"""

from __future__ import annotations

import math
import queue
import threading
from collections import Counter

from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import Event, EventKind, Quality, Sample, Severity

Item = Sample | Event
ROOM_S, ROOM_BYTES, BURST = 3.0, 32_000_000, 64


def queue_limit(info: StreamInfo) -> int:
    """How many samples of a stream may wait: three seconds, 32 MB or a burst of them, whichever is most."""
    sample_bytes = 1000 + 2 * math.prod(info.shape)
    return max(BURST, round(ROOM_S * info.rate_hz), ROOM_BYTES // sample_bytes)


class SampleQueue:
    """A queue of samples and events that drops, counts and tells what does not fit.

    `limits` gives the most samples of each stream that may wait; events always fit.
    """

    def __init__(self, limits: dict[str, int]) -> None:
        self._limits = dict(limits)
        self._queue: queue.SimpleQueue[Item] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._settled = threading.Condition(self._lock)
        self._unfinished = 0
        self._waiting: Counter[str] = Counter()
        self._dropping: Counter[str] = Counter()
        self.dropped: Counter[str] = Counter()

    def put(self, sample: Sample) -> bool:
        """Hand over a sample; False if there was no room and it is lost.

        The next sample that fits carries `Quality.DROPPED_BEFORE`, behind an event that
        says how many were lost.
        """
        with self._lock:
            if self._waiting[sample.stream] >= self._limits[sample.stream]:
                self._dropping[sample.stream] += 1
                self.dropped[sample.stream] += 1
                return False
            lost = self._dropping.pop(sample.stream, 0)
            self._waiting[sample.stream] += 1
            self._unfinished += 1
        if lost:
            self.tell(_gap(sample, lost))
            sample = sample._replace(quality=sample.quality | Quality.DROPPED_BEFORE)
        self._queue.put(sample)
        return True

    def tell(self, event: Event) -> None:
        """Hand over an event."""
        with self._lock:
            self._unfinished += 1
        self._queue.put(event)

    def get(self, timeout_s: float) -> Item | None:
        """The next item in order of arrival, or None; call `done` when it has been dealt with."""
        try:
            return self._queue.get(timeout=timeout_s)
        except queue.Empty:
            return None

    def done(self, item: Item) -> None:
        """Say that an item taken by `get` has been dealt with."""
        with self._lock:
            if not isinstance(item, Event):
                self._waiting[item.stream] -= 1
            self._unfinished -= 1
            if not self._unfinished:
                self._settled.notify_all()

    def waiting(self, stream: str) -> int:
        """Samples of a stream that were put and are not done."""
        return self._waiting[stream]

    def is_busy(self) -> bool:
        """Whether anything was put that is not done."""
        return self._unfinished > 0

    def settled(self, timeout_s: float) -> bool:
        """Whether everything that was put is done, now or within `timeout_s`; see `Clock.hold_until`."""
        with self._lock:
            return self._settled.wait_for(lambda: not self._unfinished, timeout_s)


def _gap(sample: Sample, lost: int) -> Event:
    return Event(
        kind=EventKind.GAP,
        mono_ns=sample.mono_ns,
        time_ns=sample.time_ns,
        stream=sample.stream,
        severity=Severity.WARNING,
        text=f"{sample.stream}: {lost} samples lost because the computer could not keep up",
        data={"lost": lost},
    )
