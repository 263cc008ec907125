"""The estimator in a thread of its own: bins close where samples arrive, slopes come back through the queue.

On a small computer slopes take seconds now and then, for which neither samples nor marks nor the news of a
lost instrument should wait.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

from fieldkit.estimation.binner import Closed
from fieldkit.estimation.estimator import Estimator
from fieldkit.model.samples import Event, Sample
from fieldkit.model.site import RegionRecord
from fieldkit.recorder.sample_queue import SampleQueue


class EstimatorThread:
    """Passes samples to an estimator and puts each minute into the queue once it is estimated.

    A minute in the queue raises, by ``result()``, what the estimator raised; so do `add` and `finish`.
    """

    def __init__(self, estimator: Estimator, queue: SampleQueue) -> None:
        self._estimator, self._queue = estimator, queue
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="estimator")

    def add(self, sample: Sample | Event | RegionRecord) -> None:
        """Take one sample, mark or change of regions."""
        self._estimate(self._estimator.collect(sample))

    def finish(self) -> None:
        """Close the open bins at the end of a recording."""
        self._estimate(self._estimator.collect_rest())

    def close(self) -> None:
        """Give up what is not begun yet."""
        self._thread.shutdown(wait=False, cancel_futures=True)

    def _estimate(self, closed: list[Closed]) -> None:
        for one in closed:
            self._queue.put_when_done(self._thread.submit(self._estimator.minute, one))
