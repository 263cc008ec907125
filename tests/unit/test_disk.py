"""Replacing a file as a whole: the old one or the new one, whenever the power is cut."""

import contextlib
import select
import subprocess
import sys

import pytest

from fieldkit.disk import Patience, one_at_a_time, replacing
from tests.harness import disk


def test_a_draft_is_on_the_disk_before_it_takes_a_place_and_its_place_after(tmp_path):
    place = tmp_path / "disk"
    place.mkdir()
    (place / "old").write_text("old")
    (place / "draft").write_text("new")
    code = f"from pathlib import Path; from fieldkit.disk import put_in_place; p = Path({str(place)!r});"
    done = disk.run_watched(
        tmp_path, "-c", f"{code} put_in_place(p / 'draft', p / 'old')", log=tmp_path / "log"
    )
    assert done.returncode == 0, done.stderr
    changes = [(one.kind, one.path) for one in disk.read_log(tmp_path / "log", place) if one.kind in "ER"]
    assert changes == [("E", "draft"), ("R", "draft"), ("E", ".")]
    assert [(path.name, path.read_text()) for path in place.iterdir()] == [("old", "new")]


def test_an_error_that_is_its_own_cause_is_no_disk_that_comes_back():
    error = ValueError("no disk's")
    error.__cause__ = error

    def fail():
        raise error

    with pytest.raises(ValueError, match="no disk's"):
        Patience()(fail)


def test_a_block_that_fails_leaves_the_old_file_and_no_draft(tmp_path):
    path = tmp_path / "file"
    path.write_text("old")
    with contextlib.suppress(ValueError), replacing(path) as draft:
        draft.write_text("half")
        raise ValueError
    assert [(one.name, one.read_text()) for one in tmp_path.iterdir()] == [("file", "old")]
    for synced, text in ((True, "new"), (False, "newer")):
        with replacing(path, synced=synced) as draft:
            draft.write_text(text)
        assert [(one.name, one.read_text()) for one in tmp_path.iterdir()] == [("file", text)]


def test_the_next_one_waits_until_a_process_has_ended(tmp_path):
    code = (
        "import sys, time; from pathlib import Path; from fieldkit.disk import one_at_a_time\n"
        "with one_at_a_time(Path(sys.argv[1])):\n    print('in', flush=True); time.sleep(60)"
    )
    held = subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE)
    assert held.stdout is not None
    assert held.stdout.readline() == b"in\n"
    waits = subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE)
    assert waits.stdout is not None
    assert select.select([waits.stdout], [], [], 1.5)[0] == []
    held.kill()  # the kernel lets go of its lock
    assert waits.stdout.readline() == b"in\n"
    waits.kill()
    for process in (held, waits):
        process.communicate()
    with one_at_a_time(tmp_path):
        pass
