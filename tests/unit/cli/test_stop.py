"""``fieldkit stop`` on recordings of other processes: one that seals, one whose disk says no."""

import json
import os
import re
import signal
import subprocess
import sys
from datetime import datetime
from zoneinfo import ZoneInfo

import pytest

from fieldkit.recording.running import unresponsive_recorder
from fieldkit.sessions.lock import journal_path, owner
from tests.harness.command_line import fieldkit, succeed
from tests.harness.waiting import wait_until

RECORDING = """
import os, signal, sys, time
from pathlib import Path
from fieldkit.recording.requests import inbox
from fieldkit.sessions.writer import SessionWriter
from tests.harness.recording import CountedClock, fill, header

clock = CountedClock()
writer = SessionWriter(Path(sys.argv[1]), header((24, 32)), clock)
fill(writer, 10, clock)
inbox(Path(sys.argv[1])).mkdir()
signal.signal(signal.SIGTERM, lambda *_: (getattr(writer, sys.argv[2])(), sys.exit()))
print("recording", flush=True)
while True:
    os.utime(inbox(Path(sys.argv[1])).parent / "lock")  # as if it wrote, all the time
    time.sleep(0.05)
"""


@pytest.fixture
def campaign(tmp_path):
    folder = tmp_path / "some sand"
    succeed("init", folder)
    return folder


@pytest.fixture
def recording(campaign):
    """Begins a recording whose process ends by the writer's method of that name; kills what is left."""
    begun = []

    def begin(ending: str):
        path = campaign / "recordings" / "a.h5"
        words = [sys.executable, "-c", RECORDING, str(path), ending]
        begun.append(subprocess.Popen(words, stdout=subprocess.PIPE))
        assert begun[-1].stdout.readline() == b"recording\n"
        return path

    yield begin
    for process in begun:
        process.kill()
        process.communicate()


def stop(campaign, *words: str):
    return fieldkit("stop", "-C", campaign, *words)


def test_a_recording_is_stopped_and_sealed(campaign, recording):
    path = recording("close")
    done = stop(campaign, "--json")
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["session"] == str(path)
    assert f"sealed {path}" in done.stderr


def test_a_recording_that_could_not_be_sealed_is_told(campaign, recording):
    path = recording("abandon")
    done = stop(campaign)
    assert done.exit_code == 3
    assert "a.h5: " in done.stderr
    assert f"fieldkit recover '{path}'" in done.stderr


@pytest.fixture
def stopped(recording):
    """A recording whose process was stopped, as by Ctrl-Z, two seconds ago."""
    path = recording("close")
    pid = owner(journal_path(path))
    os.kill(pid, signal.SIGSTOP)
    wait_until(lambda: unresponsive_recorder(path), "it runs on")  # the kernel stops it when it runs next
    return path, pid


def said_since(text: str) -> str:
    return re.search(r"since (\d\d:\d\d:\d\d)", text)[1]


def test_a_recorder_that_was_stopped_is_told_with_since_when(campaign, stopped):
    path, pid = stopped
    newest = max(file.stat().st_mtime for file in (path, *journal_path(path).glob("*")))
    asked = succeed("status", "-C", campaign)
    assert f"kill -CONT {pid}" in asked.output
    at = datetime.fromtimestamp(newest, ZoneInfo("Asia/Tokyo"))
    assert said_since(asked.output) == f"{at:%H:%M:%S}"
    document = json.loads(fieldkit("status", "-C", campaign, "--json").stdout)
    assert not document["responds"]
    assert document["silent_since_ns"] == pytest.approx(newest * 1e9, abs=1e6)


def test_a_mark_for_a_recorder_that_was_stopped_waits_and_says_so(campaign, stopped):
    _, pid = stopped
    marked = succeed("mark", "-C", campaign, "wind picks up")
    assert f"process {pid} " in marked.stderr
    assert "marked in" not in marked.stderr


def test_a_recorder_that_was_stopped_is_continued_to_seal(campaign, stopped):
    path, _ = stopped
    done = stop(campaign)
    assert done.exit_code == 0, done.output
    assert said_since(done.stderr)
    assert f"sealed {path}" in done.stderr


def test_a_recorder_that_writes_is_not_told_of(campaign, recording):
    recording("close")
    assert json.loads(fieldkit("status", "-C", campaign, "--json").stdout)["responds"]
    assert "a.h5: x" in fieldkit("mark", "-C", campaign, "x").stderr
