"""How a session begins: under a name of its own, alone, leaving nothing behind where it cannot."""

import gc
import os
from multiprocessing.queues import Queue
from multiprocessing.synchronize import Barrier
from pathlib import Path

import pytest

from fieldkit.model.errors import RefusedError, StorageError
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.writer import SessionWriter
from tests.harness.disk import full_disk
from tests.harness.next_steps import at
from tests.harness.recording import SPAWN, CountedClock, fill, header

HEADER = header((24, 32))


def test_session_is_never_written_over(tmp_path):
    SessionWriter(tmp_path / "a.h5", HEADER, CountedClock()).close()
    with pytest.raises(RefusedError, match="exists already"):
        SessionWriter(tmp_path / "a.h5", HEADER, CountedClock())


def begin_at_once(path: Path, barrier: Barrier, begun: Queue) -> None:
    """Begin a session when the other process does, and record a little."""
    clock = CountedClock()
    barrier.wait()
    try:
        writer = SessionWriter(path, HEADER, clock)
    except RefusedError:
        begun.put(False)
        barrier.wait()
        return
    begun.put(True)
    barrier.wait()  # the other one has given up
    fill(writer, 5, clock)
    writer.close()


def test_of_two_that_begin_the_same_session_at_once_one_has_it(tmp_path):
    barrier, begun = SPAWN.Barrier(2), SPAWN.Queue()
    for number in range(3):
        path = tmp_path / f"{number}.h5"
        pair = [SPAWN.Process(target=begin_at_once, args=(path, barrier, begun)) for _ in range(2)]
        for process in pair:
            process.start()
        for process in pair:
            process.join(500)
        assert sorted(begun.get(timeout=60) for _ in pair) == [False, True]
        with open_session(path) as session:
            assert (session.state, session.count("camera")) == ("sealed", 5)


def test_session_sealed_since_one_looked_is_left_alone(tmp_path, monkeypatch):
    path, exists = tmp_path / "a.h5", Path.exists

    def look(place: Path) -> bool:
        there = exists(place)
        monkeypatch.setattr(Path, "exists", exists)
        SessionWriter(path, HEADER, CountedClock()).close()
        return there

    # the other one comes and goes between two looks, which two processes hardly ever do
    monkeypatch.setattr(Path, "exists", look)
    with pytest.raises(RefusedError, match="exists already"):
        SessionWriter(path, HEADER, CountedClock())
    assert [item.name for item in tmp_path.iterdir()] == ["a.h5"]
    with open_session(path) as session:
        assert session.state == "sealed"


@pytest.mark.parametrize("room", [0, 10_000, 1_000_000])  # for nothing, the journal, all but its reserve
def test_start_that_fails_leaves_nothing_open_and_nothing_behind(tmp_path, room):
    with full_disk(room), pytest.raises(StorageError, check=at(tmp_path / "a.h5")):
        SessionWriter(tmp_path / "a.h5", HEADER, CountedClock())
    assert not list(tmp_path.iterdir())
    gc.collect()
    opened = [os.readlink(item) for item in Path("/proc/self/fd").iterdir() if item.is_symlink()]
    assert not [name for name in opened if str(tmp_path) in name]


def test_folder_that_cannot_be_written_is_a_storage_error(tmp_path):
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(StorageError, check=at(tmp_path / "file" / "a.h5")):
        SessionWriter(tmp_path / "file" / "a.h5", HEADER, CountedClock())
