"""A campaign is recorded by one process at a time, however close together two are started."""

import subprocess

import pytest

from fieldkit.recording.campaign import init_campaign
from fieldkit.recording.running import session_in_progress
from fieldkit.sessions.reader import open_session
from tests.harness.command_line import program
from tests.harness.waiting import wait_until

RECORD = ("record", "--quiet", "--name", "day", "--set", "simulation.speed=max", "--for")


def outcome(process: subprocess.Popen[str]) -> tuple[int, str]:
    _, errors = process.communicate(timeout=240)
    return process.returncode, errors


@pytest.fixture
def campaign(tmp_path):
    folder = tmp_path / "field"
    init_campaign(folder, simulated=True)
    return folder


def test_of_two_recorders_started_together_one_is_refused(campaign):
    both = [program(*RECORD, "2m", "-C", campaign) for _ in range(2)]
    ends = sorted(outcome(process) for process in both)
    assert [code for code, _ in ends] == [0, 9]
    assert " already" in ends[1][1]
    (path,) = (campaign / "recordings").glob("*.h5")
    with open_session(path) as session:
        assert session.state == "sealed"


def test_a_killed_recorder_does_not_keep_the_next_from_beginning_under_the_same_name(campaign):
    first = program(*RECORD, "3h", "--set", "simulation.speed=1", "-C", campaign)
    recordings = campaign / "recordings"
    wait_until(lambda: session_in_progress(recordings) or first.poll() is not None, "it does not begin")
    assert first.poll() is None
    first.kill()
    outcome(first)
    code, errors = outcome(program(*RECORD, "30s", "-C", campaign))
    assert code == 0, errors
    with open_session(next((campaign / "recordings").glob("*-2.h5"))) as session:
        assert session.state == "sealed"
