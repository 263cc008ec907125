"""Who may work on a sweep, and what happens when workers die."""

import os
import re
import signal
from functools import partial
from pathlib import Path

import distributed
import pytest

from fieldkit.model.errors import FieldkitError, RefusedError
from fieldkit.results import executors
from fieldkit.results.cache import code_version
from fieldkit.results.executors import RETRIES, Processes, dask, local, results


def squared(number: int) -> int:
    return number * number


def test_work_on_a_dask_cluster_comes_back_and_other_versions_are_refused(monkeypatch):
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
        # a worker of another fieldkit would need a second installation
        monkeypatch.setattr(executors, "code_version", lambda: "another")
        refused = rf"tcp://127\.0\.0\.1:\d+: .* {re.escape(code_version())}, .* another"
        with pytest.raises(RefusedError, match=refused) as caught, dask(cluster.scheduler_address):
            pass
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


def test_every_piece_comes_back_with_its_note():
    with local(1) as executor:
        pieces = [(f"n{number}", partial(squared, number)) for number in range(6)]
        assert dict(results(executor, pieces)) == {f"n{number}": number**2 for number in range(6)}
