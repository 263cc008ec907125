"""``fieldkit stop`` on recordings of other processes: one that seals, one whose disk says no."""

import json
import subprocess
import sys

import pytest
from click.testing import CliRunner

from fieldkit.commands import main

RECORDING = """
import signal, sys
from pathlib import Path
from fieldkit.sessions.writer import SessionWriter
from tests.harness.recording import CountedClock, fill, header

clock = CountedClock()
writer = SessionWriter(Path(sys.argv[1]), header((24, 32)), clock)
fill(writer, 10, clock)
signal.signal(signal.SIGTERM, lambda *_: (getattr(writer, sys.argv[2])(), sys.exit()))
print("recording", flush=True)
while True:
    signal.pause()
"""


@pytest.fixture
def campaign(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "home"))
    folder = tmp_path / "some sand"
    assert CliRunner().invoke(main, ["init", str(folder)]).exit_code == 0
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
    return CliRunner().invoke(main, ["stop", "-C", str(campaign), *words])


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
    assert "without sealing a.h5" in done.stderr
    assert f"fieldkit recover '{path}'" in done.stderr


def test_without_a_recording_there_is_nothing_to_stop(campaign):
    assert stop(campaign).exit_code == 9
