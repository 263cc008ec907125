"""``fieldkit record`` that begins at a time of day, or in the background."""

import json
import os
import signal
from contextlib import nullcontext

import pytest

import fieldkit
from fieldkit.config import load_config
from fieldkit.model.errors import RefusedError
from fieldkit.recording import background
from fieldkit.recording.running import session_in_progress, waiting_recorder
from fieldkit.sessions.lock import journal_path, owner
from fieldkit.sessions.reader import open_session
from tests.harness import command_line
from tests.harness.command_line import run_program, succeed
from tests.harness.page import served
from tests.harness.waiting import wait_until
from tests.unit.recorder.test_fail_safe import Line


@pytest.fixture
def campaign(tmp_path):
    succeed("init", "--simulated", tmp_path / "sand")
    yield tmp_path / "sand"
    run(tmp_path / "sand", "stop")


def run(campaign, command, *words):
    return command_line.fieldkit(command, "-C", campaign, *words)


def detached(campaign, *words):
    """In a process of its own, which ends before the recording that it began."""
    return run_program("record", "-C", campaign, "--detach", *words)


def test_a_recording_begins_at_its_time_and_ends_at_the_other(campaign):
    """The simulated day begins at 12:00 at the site, UTC-7; nothing before 12:02 is stored."""
    done = run(campaign, "record", "--at", "12:02", "--until", "12:03", "--set", "simulation.speed=max")
    assert done.exit_code == 0, done.output
    assert " 12:02" in done.stderr
    (path,) = (campaign / "recordings").glob("*.h5")
    assert path.name == "20160101T190200Z.h5"
    with open_session(path) as session:
        times = [sample.time_ns / 1e9 - 1451674920 for sample in session.samples()]  # 2016-01-01T19:02Z
    assert 0 <= min(times) < 2
    assert 58 < max(times) < 61


def test_a_detached_recording_goes_on_until_it_is_stopped(campaign):
    done = detached(campaign, "--name", "far", "--json", "--set", "simulation.speed=30")
    assert done.returncode == 0, done.stderr
    begun = json.loads(done.stdout)
    session = session_in_progress(campaign / "recordings")
    assert (str(session), owner(journal_path(session))) == (begun["session"], begun["process"])
    assert "fieldkit status" in done.stderr
    assert run(campaign, "stop").exit_code == 0
    with open_session(session) as stored:
        assert stored.state == "sealed"
    messages = session.with_suffix(".log").read_text()
    assert session.stem in messages.splitlines()[0]
    assert f"sealed {session}" in messages or "sealed" not in messages  # --json prints no summary


@pytest.mark.slow
def test_kill_9_of_a_recording_drops_its_fail_safe_line(campaign):
    line = Line()
    done = detached(campaign, "--json", "--set", f"fail_safe.line={line.path}")
    process = json.loads(done.stdout)["process"]
    assert line.is_up
    os.kill(process, signal.SIGKILL)
    assert line.hangs_up_within_s() < 5.0


@pytest.mark.parametrize(("connect_s", "begins"), [(30.0, True), (0.01, False)])
def test_the_start_is_awaited_as_long_as_instruments_may_take(campaign, monkeypatch, connect_s, begins):
    monkeypatch.setattr(background, "STARTS_WITHIN_S", 0.0)
    settings = [f"{name}.connect_timeout_s={connect_s}" for name in ("camera", "lux", "thermometer")]
    config = load_config(campaign / "fieldkit.toml", settings=settings)
    recording = background.BackgroundRecording(campaign, background.RecordOptions())
    with nullcontext() if begins else pytest.raises(RefusedError):
        assert recording.await_start(config).parent == config.recordings
    wait_until(lambda: session_in_progress(config.recordings), "it does not begin")
    run(campaign, "stop")
    wait_until(lambda: recording.exit_code is not None, "it does not end")
    recording.forget()


def test_a_recording_that_waits_is_shown_and_called_off(campaign):
    done = detached(campaign, "--at", "20:00", "--set", "simulation.speed=1")
    assert done.returncode == 0, done.stderr
    pid = waiting_recorder(campaign / "recordings")
    asked = run(campaign, "status")
    assert asked.exit_code == 9
    assert f"process {pid} " in asked.stderr
    assert run(campaign, "record", "--for", "1m").exit_code == 9
    assert "called off" in run(campaign, "stop").stderr
    assert waiting_recorder(campaign / "recordings") is None
    assert not list((campaign / "recordings").glob("*.h5*"))


def test_python_and_the_page_call_off_a_recording_that_waits(campaign):
    waits = ("--at", "20:00", "--set", "simulation.speed=1")
    assert detached(campaign, *waits).returncode == 0
    assert fieldkit.stop(campaign) is None
    assert waiting_recorder(campaign / "recordings") is None
    with served(campaign) as page, page.browser() as browser:
        assert detached(campaign, *waits).returncode == 0
        browser.next("state", phase="waiting")
        assert browser.request(do="stop", confirm=True)["key"] == "done.called_off"
        assert waiting_recorder(campaign / "recordings") is None
        browser.next("state", phase="no-instruments")
    assert not list((campaign / "recordings").glob("*.h5*"))


def test_a_detached_recording_that_cannot_begin_says_why(campaign):
    (campaign / "recordings").mkdir(exist_ok=True)
    done = detached(campaign, "--set", "lux.driver=center-303", "--set", "lux.port=/dev/none")
    assert done.returncode == 9
    assert "/dev/none" in done.stderr
    assert run(campaign, "record", "--detach", "--page").exit_code == 2
