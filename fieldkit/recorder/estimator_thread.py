"""The estimator in a thread of its own: bins close where samples arrive, slopes come back through the queue.

On a small computer slopes take seconds now and then, for which neither samples nor marks nor the news of a
lost instrument should wait. A minute that never comes holds up nothing either: it can be given up while it is
being estimated, and its thread does not keep the program from ending.
"""

from __future__ import annotations

import time
import weakref
from concurrent.futures import Future, InvalidStateError
from contextlib import suppress
from queue import SimpleQueue
from threading import Thread
from typing import TypeAlias

from fieldkit.estimation.binner import Closed
from fieldkit.estimation.estimator import Estimator, Minute
from fieldkit.model.samples import Event, Sample
from fieldkit.model.site import RegionRecord
from fieldkit.recorder.sample_queue import SampleQueue

LONGEST_WAIT_S = 30.0
"""Time that the end of a recording, and simulated time, wait for estimates, in real seconds."""

_Tasks: TypeAlias = SimpleQueue[tuple[Closed, Future[Minute]] | None]


class EstimatorThread:
    """Passes samples to an estimator and puts each minute into the queue once it is estimated.

    A minute in the queue raises, by ``result()``, what the estimator raised; so do `add` and `finish`.
    """

    def __init__(self, estimator: Estimator, queue: SampleQueue) -> None:
        self._estimator, self._queue = estimator, queue
        self._tasks: _Tasks = SimpleQueue()
        self._pending: list[tuple[float, Future[Minute]]] = []
        self._end = weakref.finalize(self, self._tasks.put, None)
        # a thread pool would wait at the end of the program for a minute that hangs
        Thread(target=_work, args=(estimator, self._tasks), name="estimator", daemon=True).start()

    def add(self, sample: Sample | Event | RegionRecord) -> None:
        """Take one sample, mark or change of regions."""
        self._estimate(self._estimator.collect(sample))

    def finish(self) -> None:
        """Close the open bins at the end of a recording."""
        self._estimate(self._estimator.collect_rest())

    def waited_s(self) -> float:
        """For how long, in real seconds, the oldest minute has not been estimated; 0 if none is waiting."""
        now = time.monotonic()
        return next((now - begun for begun, minute in self._pending if not minute.done()), 0.0)

    def close(self) -> None:
        """Give up what is not estimated yet, also what is being estimated: it comes cancelled."""
        self._end()
        for _, minute in self._pending:
            minute.cancel()

    def _estimate(self, closed: list[Closed]) -> None:
        self._pending = [pending for pending in self._pending if not pending[1].done()]
        for entry in closed:
            minute: Future[Minute] = Future()
            self._pending.append((time.monotonic(), minute))
            self._queue.put_when_done(minute)
            self._tasks.put((entry, minute))


def _work(estimator: Estimator, tasks: _Tasks) -> None:
    while (task := tasks.get()) is not None:
        closed, minute = task
        if minute.cancelled():
            continue
        with suppress(InvalidStateError):  # given up meanwhile
            try:
                minute.set_result(estimator.minute(closed))
            except Exception as error:
                minute.set_exception(error)
