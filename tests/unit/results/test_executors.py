"""Who may work on a sweep, and what happens when workers die."""

import os
import signal
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import distributed
import pytest

from fieldkit.model.errors import FieldkitError, RefusedError
from fieldkit.results import executors
from fieldkit.results.executors import RETRIES, OtherVersionError, Processes, dask, results, workers


def squared(number: int) -> int:
    return number * number


def test_work_on_a_dask_cluster_comes_back():
    """A scheduler, and first no worker, then one, in threads of this process, reached over loopback."""
    cluster = distributed.LocalCluster(
        n_workers=0, threads_per_worker=1, processes=False, dashboard_address=None, protocol="tcp",
        host="127.0.0.1", silence_logs=50,
    )  # fmt: skip
    with cluster:
        with pytest.raises(RefusedError, match="no workers"), dask(cluster.scheduler_address):
            pass
        cluster.scale(1)
        cluster.wait_for_workers(1)
        with dask(cluster.scheduler_address) as executor:
            pieces = [(number, partial(squared, number)) for number in range(5)]
            assert sorted(results(executor, pieces)) == [(number, number**2) for number in range(5)]
            with pytest.raises(OtherVersionError) as caught:
                list(results(executor, [(0, worker_without_fieldkit)]))
            assert "install fieldkit-slope" in str(caught.value.fix)


def worker_without_fieldkit() -> None:
    """A worker that has no fieldkit would need a second installation."""
    raise ModuleNotFoundError("No module named 'fieldkit'")


def test_workers_of_another_version_refuse(monkeypatch):
    with ThreadPoolExecutor(1) as executor:
        pieces = results(executor, [(0, partial(squared, 2))])
        versions = iter(("here", "another", "another"))
        monkeypatch.setattr(executors, "code_version", lambda: next(versions))
        with pytest.raises(OtherVersionError, match="another, not here") as caught:
            list(pieces)
    assert str(os.getpid()) in str(caught.value.place)
    assert caught.value.fix


def killed(tries: Path) -> None:
    """End this process as the kernel does for lack of memory, once it is counted."""
    with tries.open("a") as file:
        file.write("x")
    os.kill(os.getpid(), signal.SIGKILL)


def test_processes_that_die_again_and_again_end_a_sweep_with_advice(tmp_path):
    with pytest.raises(FieldkitError, match="killed repeatedly") as caught:
        list(results(Processes(1), [(0, partial(killed, tmp_path / "tries"))]))
    assert "fewer processes" in str(caught.value.fix)
    assert len((tmp_path / "tries").read_text()) == RETRIES + 1


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_piece_comes_back_with_its_note(jobs):
    pieces = [(f"n{number}", partial(squared, number)) for number in range(6)]
    with workers(jobs) as executor:
        assert (executor is None) == (jobs == 1)
        assert dict(results(executor, pieces)) == {f"n{number}": number**2 for number in range(6)}
