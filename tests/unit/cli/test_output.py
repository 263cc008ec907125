"""Where the output of a command goes: a pipe that closes, a full disk, a terminal with few letters."""

import errno
import json
import os
import subprocess
import sys

import pytest

import fieldkit
from fieldkit.sessions.reader import open_session
from tests.harness.command_line import program

PLACE = ["--site", "35.56,139.4,9"]
SUN = ["sun", *PLACE, "--at", "2026-12-11T12:00+09:00"]
PLAN = ["plan", "--for", "20m", *PLACE, "--on", "2026-12-11", "--facet", "5,180"]


@pytest.mark.parametrize("words", [SUN, [*SUN, "--json"]])
def test_a_reader_that_had_enough_is_no_error(words):
    process = program(*words)
    process.stdout.close()
    said = process.communicate(timeout=60)[1]
    assert process.returncode == 0, said
    assert "error" not in said


@pytest.mark.parametrize("words", [SUN, [*SUN, "--json"]])
def test_output_that_does_not_fit_its_disk_is_an_error_of_storage(words):
    with open("/dev/full", "wb") as full:
        process = program(*words, stdout=full)
        said = process.communicate(timeout=60)[1]
    assert process.returncode == 6
    assert os.strerror(errno.ENOSPC) in said
    assert "bug" not in said


def test_a_terminal_with_ascii_alone_shows_what_it_can(monkeypatch):
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    process = program(*PLAN)
    printed, said = process.communicate(timeout=60)
    assert process.returncode == 0, said
    assert "W/m? per ?" in printed
    document, _ = program(*PLAN, "--json").communicate(timeout=60)
    assert document.isascii()
    assert json.loads(document)["irradiance"] == "S 800 W/m² assumed"  # data are escaped, never replaced


def test_a_recording_goes_on_where_nobody_reads_its_messages(tmp_path):
    fieldkit.init_campaign(tmp_path, simulated=True)
    reader, closed = os.pipe()
    os.close(reader)
    words = ["record", "--for", "1m", "--set", "simulation.speed=max", "-C", str(tmp_path)]
    done = subprocess.run([sys.executable, "-m", "fieldkit", *words], stderr=closed, check=False, timeout=60)
    os.close(closed)
    assert done.returncode == 0
    (session,) = (tmp_path / "recordings").glob("*.h5")
    with open_session(session) as found:
        assert found.state == "sealed"
