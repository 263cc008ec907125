"""A write that fails, at any moment, costs at most the record it was for."""

import errno
import json
import os
import shutil
import subprocess
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from fieldkit.model.errors import FieldkitError, StorageError
from fieldkit.sessions.lock import journal_path
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.recovery import recover
from fieldkit.sessions.writer import SessionWriter
from tests.harness import disk
from tests.harness.faulty_recorder import HEADER
from tests.harness.recording import CountedClock, header, same, sample

ONCE, FOR_EVER, SHORT_WRITE = 0, 1, 2
AT_ONCE = 50
WAYS = [
    (errno.ENOSPC, ONCE), (errno.ENOSPC, FOR_EVER), (errno.ENOSPC, SHORT_WRITE), (errno.EIO, ONCE),
    (errno.EIO, FOR_EVER),
]  # fmt: skip


def outcomes(folder: Path, error: int, how: int, chosen: list[int]) -> list[dict[str, object]]:
    words = ("fail", str(folder / "disk"), str(error), str(how), *map(str, chosen))
    done = disk.run_watched(folder, "-m", "tests.harness.faulty_recorder", *words)
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def check_kept(folder: Path, outcome: dict[str, object]) -> None:
    """Whatever failed: an ordinary end, and every stored sample is there and right."""
    path = folder / f"kept-{outcome['n']}" / "field.h5"
    assert outcome["status"] == 0, f"the process did not end in order: {outcome}"
    assert str(outcome["outcome"]) in ("sealed", "stopped", "StorageError 6"), outcome
    if not path.exists() and not journal_path(path).exists():
        assert outcome["stored"] == 0
        return
    try:
        recover(path)
    except FieldkitError:
        assert outcome["stored"] == 0  # it failed before there was a session
        return
    with open_session(path) as session:
        found = list(session.samples())
    assert len(found) >= int(str(outcome["stored"]))
    assert all(same(item, sample(HEADER.stream(item.stream), item.seq)) for item in found)


def total(folder: Path) -> int:
    """How many changes an undisturbed recording makes, about."""
    (undisturbed,) = outcomes(folder, 0, ONCE, [10**9])
    assert undisturbed["outcome"] == "sealed"
    return int(str(undisturbed["changes"]))


@pytest.fixture(scope="module")
def changes(tmp_path_factory):
    return total(tmp_path_factory.mktemp("undisturbed"))


@pytest.mark.parametrize(("error", "how"), WAYS[1:4])  # and all five at every write, below
def test_failure_at_some_writes(tmp_path, changes, error, how):
    chosen = [1 + changes * n // 3 for n in range(3)]
    for outcome in outcomes(tmp_path, error, how, chosen):
        check_kept(tmp_path, outcome)


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
@pytest.mark.parametrize(("error", "how"), WAYS)
def test_failure_at_every_write(quick_disk, error, how):
    def fail_at(start: int) -> None:
        folder = quick_disk / str(start)
        folder.mkdir()
        for outcome in outcomes(folder, error, how, list(range(start, start + AT_ONCE))):
            check_kept(folder, outcome)
        shutil.rmtree(folder)

    changes = total(quick_disk)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(fail_at, range(1, changes + 20, AT_ONCE)))


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


def test_full_small_disk_keeps_everything_that_was_stored(tmp_path):
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
