"""``fieldkit record --page``: a page beside the recording, which ends with it and costs it nothing."""

import http.client
import json
import os
import re
import signal
import socket
import subprocess
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from fieldkit.recording.running import session_in_progress
from tests.harness.command_line import program
from tests.harness.page import campaign, lost_nothing
from tests.harness.waiting import PATIENCE_S, wait_until

ADDRESS, PORT = "127.0.0.77", 8765
"""Another address of this computer, so that no other page has its port."""


@contextmanager
def recording(folder: Path, *options: str) -> Iterator[subprocess.Popen[str]]:
    words = ("record", "-C", folder, "--set", "record.sampling=all")
    with program(*words, *options, stdout=None) as process:
        yield process
        if process.poll() is None:
            process.kill()


def link(process: subprocess.Popen[str]) -> str:
    assert process.stderr is not None
    for line in process.stderr:
        if found := re.search(r"^control  (http://\S+)", line):
            return found[1]
    raise AssertionError("no link was printed")


def children(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def listens() -> bool:
    with socket.socket() as probe:
        return probe.connect_ex((ADDRESS, PORT)) == 0


def test_the_page_is_reached_by_its_link_and_ends_with_the_recording(tmp_path):
    folder = campaign(tmp_path / "field")
    with recording(folder, f"--page={ADDRESS}", "--for", "12s") as process:
        address, _, key = link(process).partition("#")
        assert address == f"http://{ADDRESS}:{PORT}/"
        wait_until(listens, "the page does not listen")
        answer = ask(key)
        assert answer == 200
        assert process.wait(PATIENCE_S) == 0
    assert not listens()
    lost_nothing(folder, 12)


def ask(key: str) -> int:
    headers = {"Content-Type": "application/json", "Origin": f"http://{ADDRESS}:{PORT}"}
    with closing(http.client.HTTPConnection(ADDRESS, PORT, timeout=PATIENCE_S)) as connection:
        connection.request("POST", "/key", json.dumps({"key": key}), headers)
        return connection.getresponse().status


@pytest.mark.parametrize("number", [pytest.param(signal.SIGKILL, marks=pytest.mark.slow), signal.SIGSTOP])
def test_a_page_that_dies_or_hangs_costs_the_recording_nothing(tmp_path, number):
    folder = campaign(tmp_path / "field")
    with recording(folder, f"--page={ADDRESS}", "--for", "15s") as process:
        link(process)
        wait_until(listens, "the page does not listen")
        (page,) = children(process.pid)
        os.kill(page, number)
        assert session_in_progress(folder / "recordings") is not None
        assert process.wait(PATIENCE_S) == 0
    assert not Path(f"/proc/{page}").exists()
    lost_nothing(folder, 15)


def test_a_page_that_cannot_listen_costs_the_recording_nothing(tmp_path):
    folder = campaign(tmp_path / "field")
    with recording(folder, "--page=203.0.113.1", "--for", "5s") as process:  # RFC 5737: nobody's address
        _, words = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 0
    assert "203.0.113.1:8765" in words
    lost_nothing(folder, 5)
