"""Workers that carry out runs: this process, other processes of this computer, a Dask cluster.

Any executor of `concurrent.futures` will do. Work, results and errors are pickled on the way, and a worker
whose fieldkit or libraries are others refuses: its slopes would not be comparable.
"""

from __future__ import annotations

import multiprocessing
import multiprocessing.connection
import os
import platform
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from queue import SimpleQueue
from typing import Any, TypeVar

from fieldkit.model.errors import ConfigError, FieldkitError, RefusedError
from fieldkit.model.installation import DISTRIBUTION, install_extra
from fieldkit.model.next_step import Argument
from fieldkit.model.version import __version__
from fieldkit.results.cache import code_version

Note = TypeVar("Note")
Work = Callable[[], Any]
"""A piece of work: a callable that can be pickled."""

RETRIES = 3
"""Number of times that work is given to another worker after its worker died."""
CONNECT_WITHIN_S = 5
"""Time limit for connecting to a Dask scheduler."""


class OtherVersionError(RefusedError):
    """A worker has another fieldkit, or none."""


def results(executor: Executor | None, pieces: Iterable[tuple[Note, Work]]) -> Iterator[tuple[Note, Any]]:
    """Note and result of every piece of work, as they come; without an executor by this process, in order.

    A `FieldkitError` that was raised is the result. The piece of a killed process is submitted again. Raises
    `FieldkitError` if processes are killed repeatedly, `OtherVersionError`.
    """
    if executor is None:
        yield from ((note, _result(work)) for note, work in pieces)
        return
    under_way: dict[Future[Any], tuple[Note, Work]] = {}
    finished: SimpleQueue[Future[Any]] = SimpleQueue()

    def submit(piece: tuple[Note, Work]) -> None:
        future = _submit(executor, partial(_carry_out, code_version(), piece[1]))
        under_way[future] = piece
        future.add_done_callback(finished.put)

    for piece in pieces:
        submit(piece)
    while under_way:
        future = finished.get()
        note, work = under_way.pop(future)
        try:
            result = _result(future.result)
        except BrokenProcessPool:
            submit((note, work))
            continue
        except (ImportError, RuntimeError) as error:
            if isinstance(error, RuntimeError) and "deserialization" not in str(error):  # of Dask's scheduler
                raise
            fix = f"install {DISTRIBUTION} {__version__} and the same libraries in the workers' environment"
            raise OtherVersionError(f"a worker cannot import fieldkit: {error}", fix=fix) from error
        if isinstance(result, OtherVersionError):
            raise result
        yield note, result


def _result(work: Work) -> Any:
    try:
        return work()
    except FieldkitError as error:
        return error


def _carry_out(version: str, work: Work) -> Any:
    """In a worker: the result of a piece of work of that version of the code."""
    if code_version() != version:
        raise OtherVersionError(
            f"has fieldkit {code_version()}, not {version}",
            place=f"worker {os.getpid()} on {platform.node()}",
            fix="install the same fieldkit and libraries there; slopes would not be comparable",
        )
    return work()


def _submit(executor: Executor, work: Work) -> Future[Any]:
    try:
        return executor.submit(work)
    except BrokenProcessPool as error:
        raise FieldkitError(
            "worker processes are killed repeatedly, perhaps for lack of memory",
            fix="what was finished is kept: run the same again, with fewer processes: " + Argument("jobs"),
        ) from error


def cores() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def workers(
    jobs: int | None = None, address: str | None = None, pieces: int = sys.maxsize
) -> Iterator[Executor | None]:
    """An executor of `jobs` processes, one for each core by default, or of the Dask cluster at `address`.

    For a single process, or a single of `pieces`, it is None: this process.
    """
    if address is not None:
        with dask(address) as cluster:
            yield cluster
    elif (count := min(jobs or cores(), pieces)) <= 1:
        yield None
    else:
        pool = Processes(count)
        try:
            yield pool
        finally:
            pool.shutdown(cancel_futures=True)


class Processes(Executor):
    """A process pool that is restarted when a process was killed; work under way must be submitted again."""

    def __init__(self, count: int) -> None:
        self._count, self._restarts = count, 0
        self._pool = self._start()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """See `Executor`; raises `BrokenProcessPool` when processes died once more than `RETRIES`."""
        while True:
            try:
                return self._pool.submit(fn, *args, **kwargs)
            except (BrokenProcessPool, OSError) as error:  # OSError: one died while another was being started
                if self._restarts == RETRIES:
                    raise BrokenProcessPool(str(error)) from error
            self._restarts += 1
            self._pool = self._start()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """See `Executor`."""
        self._pool.shutdown(wait, cancel_futures=cancel_futures)

    def _start(self) -> ProcessPoolExecutor:
        # spawned: a forked copy of a process with threads may hang
        spawn = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(self._count, spawn, initializer=_start_worker)


@contextmanager
def dask(address: str) -> Iterator[Executor]:
    """The workers of a Dask cluster whose scheduler is at an address such as ``tcp://10.0.0.5:8786``.

    Raises `ConfigError` if no scheduler responds or Dask is not installed, `RefusedError` without workers.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise ConfigError("Dask is not installed", fix=install_extra("dask")) from error
    try:
        client = Client(address, timeout=CONNECT_WITHIN_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ConfigError(
            f"no Dask scheduler replies: {error}",
            place=address,
            fix="start one: dask scheduler, and dask worker ADDRESS",
        ) from error
    with client:
        if not client.scheduler_info()["workers"]:
            raise RefusedError("the Dask cluster has no workers", fix="start some: dask worker ADDRESS")
        executor = client.get_executor(pure=False, retries=RETRIES)
        try:
            yield executor
        finally:
            executor.shutdown(wait=False)


def _start_worker() -> None:
    """In a new worker: leave Ctrl-C to the parent process, and end with it, however it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, name="end-with-parent", daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    multiprocessing.connection.wait([parent.sentinel])
    os._exit(1)
