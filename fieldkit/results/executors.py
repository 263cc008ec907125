"""Workers that carry out runs: in this process, in others of this computer, or on a running Dask cluster."""

from __future__ import annotations

import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any, TypeVar

from fieldkit.model.errors import ConfigError, FieldkitError, RefusedError
from fieldkit.model.installation import DISTRIBUTION, install_extra
from fieldkit.model.next_step import Argument
from fieldkit.model.version import __version__
from fieldkit.results.cache import code_version

Note = TypeVar("Note")

RETRIES = 3
"""Number of times that work is given to another worker after its worker died."""
CONNECT_WITHIN_S = 5
"""Time limit for connecting to a Dask scheduler."""


def results(
    executor: Executor, pieces: Iterable[tuple[Note, Callable[[], Any]]]
) -> Iterator[tuple[Note, Any]]:
    """Note and result of every piece of work, as they come; a piece is a callable that can be pickled.

    A `FieldkitError` that was raised is the result. The piece of a killed process is submitted again. Raises
    `FieldkitError` if processes are killed repeatedly.
    """
    under_way: dict[Future[Any], tuple[Note, Callable[[], Any]]] = {}
    finished: SimpleQueue[Future[Any]] = SimpleQueue()

    def submit(piece: tuple[Note, Callable[[], Any]]) -> None:
        future = _submit(executor, piece[1])
        under_way[future] = piece
        future.add_done_callback(finished.put)

    for piece in pieces:
        submit(piece)
    while under_way:
        future = finished.get()
        note, work = under_way.pop(future)
        try:
            result = future.result()
        except BrokenProcessPool:
            submit((note, work))
            continue
        except FieldkitError as error:
            result = error
        yield note, result


def _submit(executor: Executor, work: Callable[[], Any]) -> Future[Any]:
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


@dataclass(frozen=True)
class Workers:
    """Workers that carry out runs: `jobs` processes of this computer, or the Dask cluster at `address`.

    Without `jobs` there is one process for each core.
    """

    jobs: int | None = None
    address: str | None = None

    def executor(self, runs: int) -> AbstractContextManager[Executor]:
        """The executor for so many runs; no more processes than runs."""
        if self.address is not None:
            return dask(self.address)
        return local(max(1, min(self.jobs or cores(), runs)))


THIS_PROCESS: Workers = Workers(1)


@contextmanager
def local(processes: int) -> Iterator[Executor]:
    """Processes of this computer; a single one is this process itself, in a thread."""
    pool: Executor = ThreadPoolExecutor(1) if processes == 1 else Processes(processes)
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

    Raises `ConfigError` if no scheduler responds or Dask is not installed, `RefusedError` if a worker has
    another fieldkit.
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
        _refuse_other_versions(client.run(_version_probe()))
        executor = client.get_executor(pure=False, retries=RETRIES)
        try:
            yield executor
        finally:
            executor.shutdown(wait=False)


def _version_probe() -> Callable[[], str]:
    """A function that returns a worker's version of the code, empty if it cannot import fieldkit.

    It is nested so that Dask sends its code; a module's function would be sent by name, which an older
    worker cannot import.
    """

    def version() -> str:
        try:
            from fieldkit.results import cache
        except ImportError:
            return ""
        return cache.code_version()

    return version


def _refuse_other_versions(versions: dict[str, str]) -> None:
    if not versions:
        raise RefusedError("the Dask cluster has no workers", fix="start some: dask worker ADDRESS")
    if without := [worker for worker, version in versions.items() if not version]:
        raise RefusedError(
            "cannot import fieldkit",
            place=f"Dask worker {without[0]}",
            fix=f"install {DISTRIBUTION} {__version__} and the same libraries in that worker's environment",
        )
    other = {worker: version for worker, version in versions.items() if version != code_version()}
    if other:
        worker, version = next(iter(other.items()))
        raise RefusedError(
            f"has fieldkit {version}, here is {code_version()}",
            place=f"Dask worker {worker}",
            fix="install the same fieldkit and libraries there; slopes would not be comparable",
        )


def _start_worker() -> None:
    """In a new worker: leave Ctrl-C to the parent process, and end with it, however it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, name="end-with-parent", daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    multiprocessing.connection.wait([parent.sentinel])
    os._exit(1)
