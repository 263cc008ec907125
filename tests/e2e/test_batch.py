"""A sweep on a Dask cluster of real worker processes on loopback, one of which is killed while it works."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

pytest.importorskip("distributed")

GRID = ("--set", "surface.albedo=0.15:0.35:0.02", "--set", "surface.emissivity=0.88,0.90")
RUNS = 11 * 2 * 2
PATIENCE_S = 60


def run(*arguments: object, cache: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "fieldkit", *map(str, arguments)]
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache)}
    return subprocess.run(command, capture_output=True, text=True, env=environment)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dask")
    assert run("init", "--simulated", folder, cache=folder).returncode == 0
    for seed in (1, 2):
        settings = ("--set", "simulation.speed=max", "--set", f"simulation.seed={seed}")
        made = run(
            "record", "-C", folder, "--for", "12m", "--name", f"s{seed}", "-q", *settings, cache=folder
        )
        assert made.returncode == 0, made.stderr
    return folder / "recordings"


@contextmanager
def dask(*arguments: str, folder: Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A scheduler or worker, and the address it says it listens at."""
    log = folder / f"{arguments[0]}-{time.monotonic_ns()}.log"
    with log.open("w") as file:
        process = subprocess.Popen(
            [sys.executable, "-m", "dask", *arguments],
            stdout=file,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=folder,
        )
    try:
        yield process, said(log, r"(?:Scheduler|Start worker) at:\s+(tcp://\S+)")
    finally:
        process.terminate()
        process.wait()


def said(log: Path, pattern: str) -> str:
    found: re.Match[str] | None = None

    def there() -> bool:
        nonlocal found
        found = re.search(pattern, log.read_text())
        return found is not None

    until(there)
    assert found is not None
    return found.group(1)


def until(true: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not true():
        assert time.monotonic() < deadline, "it did not come to that"
        time.sleep(0.01)


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen[str]]]]:
    """The scheduler's address and two worker processes, on loopback."""
    quiet = ("--no-dashboard", "--host", "127.0.0.1")
    with ExitStack() as stack:
        _, address = stack.enter_context(dask("scheduler", "--port", "0", *quiet, folder=tmp_path))
        workers = [
            stack.enter_context(
                dask("worker", address, "--no-nanny", "--nthreads", "1", *quiet, folder=tmp_path)
            )[0]
            for _ in range(2)
        ]
        yield address, workers


def test_a_killed_worker_costs_nothing_but_time(cluster, recordings, tmp_path):
    address, workers = cluster
    cache = tmp_path / "cluster"
    options = (*GRID, "--executor", "dask", "--address", address, "-o", tmp_path / "remote")
    command = [sys.executable, "-m", "fieldkit", "sweep", recordings, *options]
    sweep = subprocess.Popen(
        list(map(str, command)), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "XDG_CACHE_HOME": str(cache)},
    )  # fmt: skip
    until(lambda: len(list(cache.rglob("*.npz"))) > 10 or sweep.poll() is not None)
    assert sweep.poll() is None, sweep.communicate()
    workers[0].send_signal(signal.SIGKILL)
    _, told = sweep.communicate(timeout=PATIENCE_S)
    assert sweep.returncode == 0, told
    assert len(list(cache.rglob("*.npz"))) == RUNS + 4  # and the minutes of two sessions at two emissivities
    local = run("sweep", recordings, *GRID, "-j", 1, "-o", tmp_path / "local", cache=tmp_path / "here")
    assert local.returncode == 0, local.stderr
    assert (tmp_path / "remote.csv").read_bytes() == (tmp_path / "local.csv").read_bytes()


def test_an_address_where_nobody_answers_is_told(recordings, tmp_path):
    options = ("--executor", "dask", "--address", "tcp://127.0.0.1:9")
    found = run("sweep", recordings, *GRID, *options, "-o", tmp_path / "r", cache=tmp_path)
    assert found.returncode == 3
    assert "no Dask scheduler answers at tcp://127.0.0.1:9" in found.stderr


def test_a_cluster_without_workers_is_told(recordings, tmp_path):
    quiet = ("--no-dashboard", "--host", "127.0.0.1")
    with dask("scheduler", "--port", "0", *quiet, folder=tmp_path) as (_, address):
        options = ("--executor", "dask", "--address", address)
        found = run("sweep", recordings, *GRID, *options, "-o", tmp_path / "r", cache=tmp_path)
    assert found.returncode == 9
    assert "no workers" in found.stderr
