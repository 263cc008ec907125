"""Samples and events on their way from the reading threads to the recorder, and minutes once estimated.

Bounded per stream: while the disk stalls, memory grows for a few seconds, then samples are dropped and
counted. A reading thread never waits here.
"""

from __future__ import annotations

import math
import queue
import threading
from collections import Counter
from concurrent.futures import Future

from fieldkit.estimation.estimator import Minute
from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import Event, EventKind, Frame, Quality, Reading, Sample, Severity

Item = Sample | Event | Future[Minute]
QUEUED_S, QUEUED_BYTES, MIN_QUEUED = 5.0, 32_000_000, 64


def queue_limit(info: StreamInfo) -> int:
    """Maximum number of queued samples of a stream: 5 s, 32 MB or 64 samples, whichever is most."""
    sample_bytes = 1000 + 2 * math.prod(info.shape)
    return max(MIN_QUEUED, round(QUEUED_S * info.rate_hz), QUEUED_BYTES // sample_bytes)


class SampleQueue:
    """A bounded queue of samples and events: what does not fit is dropped, counted and reported.

    `limits` gives the maximum number of queued samples of each stream; events and minutes always fit.
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
        """Queue a sample; False if the stream's limit is reached and the sample is lost.

        The next sample that fits carries `Quality.DROPPED_BEFORE`, after an event with the number lost.
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
            text = f"{sample.stream}: {lost} samples lost because the computer could not keep up"
            stamps, data = (sample.mono_ns, sample.time_ns), {"lost": lost}
            self.put_event(Event(EventKind.GAP, *stamps, text, sample.stream, Severity.WARNING, data))
            sample = sample._replace(quality=sample.quality | Quality.DROPPED_BEFORE)
        self._queue.put(sample)
        return True

    def put_event(self, event: Event) -> None:
        """Queue an event."""
        with self._lock:
            self._unfinished += 1
        self._queue.put(event)

    def put_when_done(self, minute: Future[Minute]) -> None:
        """Queue a minute as soon as it is estimated; until it is processed the queue is not settled."""
        with self._lock:
            self._unfinished += 1
        minute.add_done_callback(self._queue.put)

    def get(self, timeout_s: float) -> Item | None:
        """The next item in order of arrival, or None; call `done` once it has been processed."""
        try:
            return self._queue.get(timeout=timeout_s)
        except queue.Empty:
            return None

    def finish(self, item: Item) -> None:
        """Mark an item returned by `get` as processed."""
        with self._lock:
            if isinstance(item, Frame | Reading):
                self._waiting[item.stream] -= 1
            self._unfinished -= 1
            if not self._unfinished:
                self._settled.notify_all()

    def waiting(self, stream: str) -> int:
        """Number of samples of a stream that were put and are not yet processed."""
        return self._waiting[stream]

    def is_busy(self) -> bool:
        """True if anything was put that is not yet processed."""
        return self._unfinished > 0

    def is_settled(self, timeout_s: float) -> bool:
        """True if everything that was put is processed within `timeout_s`; see `Clock.hold_until`."""
        if not self._unfinished:  # asked before every step of a simulated clock
            return True
        with self._lock:
            return self._settled.wait_for(lambda: not self._unfinished, timeout_s)
