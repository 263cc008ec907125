"""A write that fails, at any moment, costs at most the record it was for."""

import errno
import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import h5py
import pytest

import fieldkit.disk
from fieldkit.model.errors import FieldkitError, StorageError
from fieldkit.recording.campaign import init_campaign
from fieldkit.results.cache import Cache
from fieldkit.sessions.check import check
from fieldkit.sessions.lock import journal_path
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.recovery import recover
from fieldkit.sessions.writer import SessionWriter
from tests.harness import disk
from tests.harness.faulty_recorder import ESTIMATES, HEADER, LATER, Task
from tests.harness.recording import CountedClock, header, same, sample

WRITES, HALVES, SYNCS, GONE = range(4)  # as in disk.c
WAYS = [
    (errno.ENOSPC, WRITES), (errno.ENOSPC, HALVES), (errno.EROFS, WRITES), (errno.EIO, WRITES),
    (errno.EIO, SYNCS), (errno.EIO, GONE),
]  # fmt: skip
FOR_EVER = 0
STUMBLES_MS = (10, 300)  # 0.1 s and 3 s, in the recorder's hurry
AT_ONCE = 50


def outcomes(
    folder: Path, task: Task, error: int, how: int, milliseconds: int, chosen: Iterable[int]
) -> list[dict[str, object]]:
    words = ("fail", str(folder / "disk"), task, *map(str, (error, how, milliseconds, *chosen)))
    process = disk.run_watched(folder, "-m", "tests.harness.faulty_recorder", *words)
    assert process.returncode == 0, process.stderr
    return [json.loads(line) for line in process.stdout.splitlines()]


def check_kept(folder: Path, task: Task, outcome: dict[str, object], *, survives: bool) -> None:
    """Whatever failed: an ordinary end, and every stored sample is there and right."""
    path = folder / f"kept-{outcome['n']}" / "field.h5"
    assert outcome["status"] == 0, f"the process did not end in order: {outcome}"
    assert not survives or outcome["outcome"] == "whole", outcome
    ends = ("whole", "stopped", "StorageError 6", "SessionError 3", "OSError")
    assert str(outcome["outcome"]) in ends, outcome
    for copy in [*path.parent.glob("*.nc"), *path.parent.glob("exported/*.nc")]:
        with h5py.File(copy) as file:
            names: list[str] = []
            file.visit(names.append)
            assert [file[name].name for name in names], copy  # one that is there is whole
    kept = Cache(path.parent / "cache", checksums=["sealed"]).load(LATER)
    assert kept is None or (kept["estimates"] == ESTIMATES).all()
    if not path.exists() and not journal_path(path).exists():
        assert outcome["stored"] == 0
        return
    try:
        recover(path)
    except FieldkitError:
        assert outcome["stored"] == 0  # it failed before there was a session
        return
    with open_session(path) as session:
        samples, steps = list(session.samples(recorded=True)), session.time_map()
        added = [*(event.text for event in session.events()), *(step.reason for step in steps)]
    assert len(samples) >= int(str(outcome["stored"]))
    assert all(same(item, sample(HEADER.stream(item.stream), item.seq)) for item in samples)
    is_added = task in (Task.MARK, Task.CORRECT) and outcome["outcome"] == "whole"
    assert added.count(LATER) in ([1] if is_added else [0, 1])
    assert [finding for finding in check(path) if finding.level == "fail"] == []


def survives(task: Task, milliseconds: int) -> bool:
    """Whether a task goes on after a failure so long; a copy for others may be made again."""
    return milliseconds != FOR_EVER and task not in (Task.EXPORT, Task.MAP)


@cache
def total(task: Task) -> int:
    """How many changes a task makes on an undisturbed disk, about."""
    with tempfile.TemporaryDirectory() as folder:
        (undisturbed,) = outcomes(Path(folder), task, 0, WRITES, FOR_EVER, [10**9])
    assert undisturbed["outcome"] == "whole"
    return int(str(undisturbed["changes"]))


@pytest.mark.parametrize(
    ("error", "how", "milliseconds"), [(*WAYS[1], STUMBLES_MS[1]), (*WAYS[5], FOR_EVER)]
)  # and all, at every write, below
@pytest.mark.parametrize("task", Task)
def test_failure_at_some_write(tmp_path, task, error, how, milliseconds):
    for outcome in outcomes(tmp_path, task, error, how, milliseconds, [1 + total(task) // 3]):
        check_kept(tmp_path, task, outcome, survives=survives(task, milliseconds))


@pytest.fixture
def quick_disk(tmp_path):
    """A folder in memory where there is one: thousands of recordings need no real syncs to fail."""
    memory = Path("/dev/shm")
    if not os.access(memory, os.W_OK):
        yield tmp_path
        return
    with tempfile.TemporaryDirectory(dir=memory) as folder:
        yield Path(folder)


@pytest.mark.slow
@pytest.mark.parametrize("milliseconds", [*STUMBLES_MS, FOR_EVER])
@pytest.mark.parametrize(("error", "how"), WAYS)
@pytest.mark.parametrize("task", Task)
def test_failure_at_every_write(quick_disk, task, error, how, milliseconds):
    def fail_at(start: int) -> None:
        folder = quick_disk / str(start)
        folder.mkdir()
        for outcome in outcomes(folder, task, error, how, milliseconds, range(start, start + AT_ONCE)):
            check_kept(folder, task, outcome, survives=survives(task, milliseconds))
        shutil.rmtree(folder)

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(fail_at, range(1, total(task) + 20, AT_ONCE)))


SLOW = pytest.mark.slow


@pytest.mark.parametrize("start", [1, pytest.param(30, marks=SLOW), 300, pytest.param(1500, marks=SLOW)])
@pytest.mark.parametrize(("code", "how"), [(errno.EROFS, WRITES), (errno.EIO, GONE)])
def test_record_on_a_disk_that_fails_for_good_ends_in_words(tmp_path, start, code, how):
    (tmp_path / "disk").mkdir()
    campaign = init_campaign(tmp_path / "disk" / "field", simulated=True)
    words = ("-m", "fieldkit", "record", "-C", str(campaign.config.directory), "--for", "1m", "--json")
    done = disk.run_watched(tmp_path, *words, fail=f"{start} {code} {how} {FOR_EVER}")
    assert done.returncode == 6, done.stderr
    (error,) = (json.loads(line) for line in done.stderr.splitlines() if line.startswith("{"))
    assert error["fix"]
    assert "Traceback" not in done.stderr


def fill_up(writer: SessionWriter, stream: int, count: int) -> int:
    """Append samples until the disk takes no more; how many it took."""
    for seq in range(count):
        try:
            writer.append(sample(writer.header.streams[stream], seq))
        except StorageError:
            return seq
    return count


def finished(writer: SessionWriter, place: Path, elsewhere: Path) -> Path:
    """The session sealed where it is, or where there is no room for that, recovered elsewhere."""
    try:
        writer.close()
    except StorageError:
        subprocess.run(["cp", "-r", str(place), str(elsewhere)], check=True)
        recover(elsewhere / "field.h5")
        return elsewhere / "field.h5"
    return place / "field.h5"


def test_full_small_disk_keeps_everything_that_was_stored(tmp_path, monkeypatch):
    monkeypatch.setattr(fieldkit.disk, "PATIENCE_S", 0.1)  # a full disk stays full
    head = header((120, 160))
    with disk.small_disk(tmp_path, "12m") as place:
        writer = SessionWriter(place / "field.h5", head, CountedClock())
        stored = fill_up(writer, 0, 1000)
        assert 50 < stored < 1000
        readings = fill_up(writer, 1, 3)  # meters need little room; what fits goes in
        path = finished(writer, place, tmp_path / "elsewhere")
        with open_session(path) as session:
            assert session.count("camera") == stored
            assert session.count("lux") == readings
            assert all(same(item, sample(head.stream(item.stream), item.seq)) for item in session.samples())
