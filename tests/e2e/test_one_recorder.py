"""A campaign is recorded by one process at a time, however close together two are started."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from fieldkit.recording.campaign import init_campaign
from fieldkit.recording.running import session_in_progress
from fieldkit.sessions.reader import open_session
from tests.harness.waiting import wait_until

PROJECT = Path(__file__).parents[2]
RECORD = ("record", "--quiet", "--name", "day", "--set", "simulation.speed=max", "--for")


def fieldkit(campaign: Path, *arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "fieldkit", *arguments, "-C", str(campaign)]
    environment = {**os.environ, "PYTHONPATH": str(PROJECT)}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen(command, cwd=campaign.parent, env=environment, text=True, **pipes)  # type: ignore[call-overload,no-any-return]


def outcome(process: subprocess.Popen[str]) -> tuple[int, str]:
    _, errors = process.communicate(timeout=240)
    return process.returncode, errors


@pytest.fixture
def campaign(tmp_path):
    folder = tmp_path / "field"
    init_campaign(folder, simulated=True)
    return folder


def test_of_two_recorders_started_together_one_is_refused(campaign):
    both = [fieldkit(campaign, *RECORD, "2m") for _ in range(2)]
    ends = sorted(outcome(process) for process in both)
    assert [code for code, _ in ends] == [0, 9]
    assert "this campaign is being recorded already" in ends[1][1]
    (path,) = (campaign / "recordings").glob("*.h5")
    with open_session(path) as session:
        assert session.state == "sealed"


def test_a_killed_recorder_does_not_keep_the_next_from_beginning_under_the_same_name(campaign):
    first = fieldkit(campaign, *RECORD, "3h", "--set", "simulation.speed=1")
    recordings = campaign / "recordings"
    wait_until(lambda: session_in_progress(recordings) or first.poll() is not None, "it does not begin")
    assert first.poll() is None
    first.kill()
    outcome(first)
    code, errors = outcome(fieldkit(campaign, *RECORD, "30s"))
    assert code == 0, errors
    with open_session(next((campaign / "recordings").glob("*-2.h5"))) as session:
        assert session.state == "sealed"
