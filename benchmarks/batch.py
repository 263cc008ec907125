"""A campaign estimated again: twenty demo sessions with thirty sets of parameters, as a user types it.

Some twenty minutes on two cores; ``batch.run(2, 1.0)`` from Python is a smaller one.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path

from benchmarks.result import Result, Row
from benchmarks.sides import python_process, times_as_fast

SESSIONS, HOURS = 20, 3.0
GRID = (
    *("--set", "surface.albedo=0.15:0.35:0.05"),
    *("--set", "surface.emissivity=0.88,0.90,0.92"),
    *("--set", "irradiance.par_fraction=0.40,0.44"),
)
SETS = 5 * 3 * 2
SWEEP = Row(
    "sweep", "sweep of 20 sessions of 3 h, 30 sets of parameters: recorded time over real time", ">= 9000",
    included="whole command of two processes, nothing cached: reading, minute bins, slopes, table",
)  # fmt: skip
AGAIN = Row(
    "again", "the same sweep again, first run over this", ">= 50", included="whole command, slopes cached"
)
DASK = Row(
    "dask",
    "two Dask workers, one worker over two",
    ">= 1.7",
    included="whole command, a fifth of the sessions",
)
LOOPBACK = ("--no-dashboard", "--host", "127.0.0.1")
LISTENS = r"(?:Scheduler|Start worker) at:\s+(tcp://\S+)"
PATIENCE_S = 60.0


def run(sessions: int = SESSIONS, hours: float = HOURS) -> list[Result]:
    """First and second run by two processes, then one Dask worker against two on a part of the sessions."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        recordings = _record(folder, sessions, hours)
        first_s = _sweep(folder, recordings, "first", "-j", "2")
        repeated_s = [_sweep(folder, recordings, "first", "-j", "2") for _ in range(3)]
        part = recordings[: max(2, sessions // 5)]
        by_workers = {count: _on_dask(folder, part, count) for count in (1, 2)}
    size = f"{sessions} sessions of {hours:g} h, {SETS} sets, two processes: {first_s:.0f} s"
    return [
        SWEEP.result(sessions * hours * 3600.0 * SETS / first_s, size),
        times_as_fast(AGAIN, [(again_s, first_s) for again_s in repeated_s]),
        times_as_fast(DASK, [(by_workers[2], by_workers[1])], f"{len(part)} sessions"),
    ]


def _record(folder: Path, sessions: int, hours: float) -> list[Path]:
    """Each in a campaign of its own: one campaign is recorded once at a time."""

    def record(seed: int) -> Path:
        campaign = folder / f"campaign{seed}"
        _fieldkit(folder, "init", "--simulated", campaign)
        settings = ("--set", "simulation.speed=max", "--set", f"simulation.seed={seed}")
        _fieldkit(folder, "record", "-C", campaign, "--for", f"{hours:g}h", "--name", f"s{seed}", *settings)
        return next((campaign / "recordings").glob("*.h5"))

    with ThreadPoolExecutor(2) as two_at_a_time:
        return list(two_at_a_time.map(record, range(sessions)))


def _sweep(folder: Path, recordings: list[Path], cache: str, *options: str) -> float:
    """Seconds of the clock."""
    return _fieldkit(folder / cache, "sweep", *recordings, *GRID, "-o", folder / "results", *options)


def _on_dask(folder: Path, recordings: list[Path], count: int) -> float:
    with ExitStack() as stack:
        address = stack.enter_context(_dask(folder, "scheduler", "--port", "0"))
        for _ in range(count):
            stack.enter_context(_dask(folder, "worker", address, "--nthreads", "1"))
        return _sweep(folder, recordings, f"dask{count}", "--address", address)


@contextmanager
def _dask(folder: Path, *arguments: str) -> Iterator[str]:
    """A scheduler or worker on loopback, and the address it says it listens at."""
    log = folder / f"{time.monotonic_ns()}.log"
    with log.open("w") as file:
        process = subprocess.Popen(
            [sys.executable, "-m", "dask", *arguments, *LOOPBACK],
            stdout=file,
            stderr=subprocess.STDOUT,
            cwd=folder,
        )
    try:
        deadline = time.monotonic() + PATIENCE_S
        while (match := re.search(LISTENS, log.read_text())) is None:
            if time.monotonic() > deadline:
                raise TimeoutError(log.read_text())
            time.sleep(0.02)
        yield match.group(1)
    finally:
        process.terminate()
        process.wait()


def _fieldkit(cache: Path, *words: object) -> float:
    return python_process("-m", "fieldkit", *words, "-q", cache=cache)[1]
