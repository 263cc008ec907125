"""Sweeps by real worker processes, here and on a Dask cluster on loopback, killed while they work."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import pytest
from distributed import Client

import fieldkit
from fieldkit.results.report import ReportOptions
from fieldkit.results.sweep import sweep
from tests.harness.command_line import program, run_program
from tests.harness.two_sessions import copy_of_both
from tests.harness.waiting import PATIENCE_S, wait_until

QUICKEST = ("--set", "estimator.model=full")  # a seventh of the time of the learned one
GRID = ("--set", "surface.albedo=0.15:0.25:0.1", "--set", "surface.emissivity=0.88,0.90", *QUICKEST)
RUNS, MINUTES = 2 * 2 * 2, 2 * 2
ENTRIES = RUNS + MINUTES
"""In the cache afterwards: each run, and the minutes of two sessions at two emissivities."""


def run(*arguments: object, cache: Path) -> subprocess.CompletedProcess[str]:
    return run_program(*arguments, env={**os.environ, "XDG_CACHE_HOME": str(cache)})


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    return copy_of_both(tmp_path_factory, tmp_path_factory.mktemp("dask")) / "recordings"


@contextmanager
def dask(*arguments: str, folder: Path, **environment: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A scheduler or worker, and the address it says it listens at."""
    log = folder / f"{arguments[0]}-{time.monotonic_ns()}.log"
    with log.open("w") as file:
        words, env = [sys.executable, "-m", "dask", *arguments], {**os.environ, **environment}
        process = subprocess.Popen(words, stdout=file, stderr=file, text=True, cwd=folder, env=env)
    try:
        yield process, said(log, r"(?:Scheduler|Start worker) at:\s+(tcp://\S+)")
    finally:
        process.terminate()
        process.wait()


def said(log: Path, pattern: str) -> str:
    wait_until(lambda: re.search(pattern, log.read_text()), f"no {pattern}", PATIENCE_S)
    return re.findall(pattern, log.read_text())[0]


@contextmanager
def sweep_held_still(recordings: Path, cache: Path, *options: object) -> Iterator[subprocess.Popen[str]]:
    """A sweep with some of its runs done, asleep within the block so that it cannot finish the others."""
    sweep = program("sweep", recordings, *GRID, *options, env={**os.environ, "XDG_CACHE_HOME": str(cache)})
    wait_until(lambda: entries(cache) > 4 or sweep.poll() is not None, "no runs are done", PATIENCE_S)
    sweep.send_signal(signal.SIGSTOP)
    assert sweep.poll() is None, sweep.communicate()
    assert entries(cache) < ENTRIES
    yield sweep
    sweep.send_signal(signal.SIGCONT)


def entries(cache: Path) -> int:
    return len(list(cache.rglob("*.arrays")))


def workers_of(process: subprocess.Popen[str]) -> list[int]:
    """The spawned processes of a pool, by the kernel's account."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    commands = {int(pid): Path(f"/proc/{pid}/cmdline").read_bytes() for pid in children}
    return [pid for pid, command in commands.items() if b"spawn_main" in command]


def finished(sweep: subprocess.Popen[str]) -> str:
    """What a sweep says in the end, if that is well."""
    _, told = sweep.communicate(timeout=PATIENCE_S)
    assert sweep.returncode == 0, told
    return told


@pytest.fixture(scope="module")
def undisturbed(recordings, tmp_path_factory):
    """The table of the same sweep by one process."""
    folder = tmp_path_factory.mktemp("undisturbed")
    done = run("sweep", recordings, *GRID, "-j", 1, "-o", folder / "local", cache=folder)
    assert done.returncode == 0, done.stderr
    return (folder / "local.csv").read_bytes()


def test_a_killed_process_of_this_computer_costs_nothing_but_time(recordings, undisturbed, tmp_path):
    with sweep_held_still(recordings, tmp_path, "-j", 2, "-o", tmp_path / "two") as sweep:
        os.kill(workers_of(sweep)[0], signal.SIGKILL)
    finished(sweep)
    assert entries(tmp_path) == ENTRIES
    assert (tmp_path / "two.csv").read_bytes() == undisturbed


@pytest.fixture
def cluster(tmp_path):
    """The scheduler's address and two worker processes, on loopback."""
    quiet = ("--no-dashboard", "--host", "127.0.0.1")
    with ExitStack() as stack:
        _, address = stack.enter_context(dask("scheduler", "--port", "0", *quiet, folder=tmp_path))
        words = ("worker", address, "--no-nanny", "--nthreads", "1", *quiet)
        yield address, [stack.enter_context(dask(*words, folder=tmp_path))[0] for _ in range(2)]


def test_a_killed_worker_of_a_cluster_costs_nothing_but_time(cluster, recordings, undisturbed, tmp_path):
    address, workers = cluster
    options = ("--address", address, "-o", tmp_path / "remote")
    with sweep_held_still(recordings, tmp_path / "cache", *options) as sweep:
        workers[0].send_signal(signal.SIGKILL)
    finished(sweep)
    assert entries(tmp_path / "cache") == ENTRIES
    assert (tmp_path / "remote.csv").read_bytes() == undisturbed


class KillingExecutor(Executor):
    """An executor that kills a worker of its cluster when its first piece of work is done."""

    def __init__(self, executor: Executor, worker: subprocess.Popen[str]) -> None:
        self._executor, self._worker = executor, worker

    def submit(self, fn, /, *arguments, **options):
        future = self._executor.submit(fn, *arguments, **options)
        future.add_done_callback(lambda _: self._worker.send_signal(signal.SIGKILL))
        return future


def test_everything_comes_from_an_executor_of_a_cluster_as_from_here(
    cluster, recordings, tmp_path, monkeypatch
):
    """One of two workers is killed after the first piece; the cache here is another for each side."""
    address, workers = cluster
    paths = sorted(recordings.glob("*.h5"))

    def everything(name: str, executor: Executor | None) -> dict[str, object]:
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / name))
        by = {"executor": executor}
        folder, full = tmp_path / name, {"estimator.model": "full"}
        grid, options = {"albedo": [0.2, 0.3], "estimator.model": ["full"]}, ReportOptions(settings=full)
        written = [
            fieldkit.estimate(paths, full, **by).write(folder / "slopes")[0],
            sweep(paths, grid, **by).write(folder / "sweep")[0],
            fieldkit.report(paths, folder / "all.html", options, **by).path,
            *fieldkit.export(paths, "csv", folder / "tables", **by)[paths[0]].files,
        ]
        maps = fieldkit.slope_map(paths, settings=full, **by)
        checks = fieldkit.check(paths, estimates=False, **by)
        return {
            "files": [path.read_bytes() for path in written],
            "maps": [session_map.slopes.tilt_deg.tobytes() for session_map in maps.values()],
            "checks": [checked.findings for checked in checks.values()],
        }

    with Client(address, set_as_default=False) as client:
        remote = everything("remote", KillingExecutor(client.get_executor(), workers[0]))
    assert workers[0].wait() == -signal.SIGKILL
    assert remote == everything("here", None)


def test_an_address_where_nobody_answers_is_told(recordings, tmp_path):
    options = ("--address", "tcp://127.0.0.1:9")
    found = run("sweep", recordings, *GRID, *options, "-o", tmp_path / "r", cache=tmp_path)
    assert found.returncode == 3
    assert "tcp://127.0.0.1:9: " in found.stderr


def test_workers_end_with_a_sweep_that_is_killed(recordings, tmp_path):
    with sweep_held_still(recordings, tmp_path / "cache", "-j", "2", "-o", tmp_path / "r") as sweep:
        workers = workers_of(sweep)
        sweep.send_signal(signal.SIGKILL)
    assert len(workers) == 2
    try:
        processes = [Path(f"/proc/{worker}") for worker in workers]
        wait_until(lambda: not any(map(Path.exists, processes)), "workers live on", PATIENCE_S)
    finally:
        for worker in workers:
            with suppress(ProcessLookupError):
                os.kill(worker, signal.SIGKILL)
        sweep.communicate()
