"""``fieldkit page --record`` as systemd starts it: which of its processes feeds the watchdog, and when."""

import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

from fieldkit.page.service import REPORT_EVERY_S
from fieldkit.recording.running import session_in_progress
from fieldkit.sessions.lock import journal_path, owner
from tests.harness.command_line import PROGRAM, succeed
from tests.harness.page import free_port
from tests.harness.service_manager import ServiceManager

SILENCE_S = REPORT_EVERY_S + 3.0


@pytest.fixture
def manager(tmp_path):
    manager = ServiceManager(tmp_path / "notify")
    yield manager
    manager.socket.close()


@pytest.fixture
def recordings(tmp_path):
    folder = tmp_path / "campaign"
    succeed("init", "--simulated", folder)
    return folder / "recordings"


@pytest.fixture
def page(recordings, manager):
    """The main process of the service, recording; ended with what it started."""
    # as a unit's ExecStart is: SYSTEMD_EXEC_PID is the page's own process
    own_pid = ("sh", "-c", 'SYSTEMD_EXEC_PID=$$ exec "$@"', "sh")
    campaign = ("-C", recordings.parent, "--set", "simulation.speed=1")
    words = [*own_pid, *PROGRAM, "page", "--record", *campaign, "--port", f"{free_port()}"]
    environment = {**os.environ, "NOTIFY_SOCKET": manager.address}
    page = subprocess.Popen(
        words, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    yield page
    page.kill()
    page.communicate()
    if (pid := recorder(recordings)) is not None:
        os.kill(pid, signal.SIGKILL)


def recorder(recordings: Path) -> int | None:
    session = session_in_progress(recordings)
    return None if session is None else owner(journal_path(session))


def feeding(manager: ServiceManager, words: str, within_s: float = 60.0) -> bool:
    """Whether a watchdog's feed with a status of these words arrives."""
    deadline = time.monotonic() + within_s
    while time.monotonic() < deadline:
        seen = len(manager.states)
        if manager.waits_for("WATCHDOG=1", 1.0) and any(words in one for one in manager.states[seen:]):
            return True
    return False


def test_the_page_is_silent_while_its_recorder_should_feed_the_watchdog(page, manager, recordings):
    assert manager.waits_for("READY=1")
    assert feeding(manager, "samples"), manager.states
    pid = recorder(recordings)
    assert pid is not None
    os.kill(pid, signal.SIGSTOP)
    manager.drain()
    assert not manager.waits_for("WATCHDOG=1", SILENCE_S), manager.states[-4:]
    os.kill(pid, signal.SIGKILL)  # it is gone, and the page can do its work: nothing hangs
    assert feeding(manager, "STATUS=preview"), manager.states[-4:]
    page.send_signal(signal.SIGTERM)
    assert manager.waits_for("STOPPING=1")
    said = page.communicate(timeout=30)[0]
    assert "code -9; " in said
    assert " 30 s" in said
    assert "#" not in said, "a key in a log"


def test_a_recording_that_a_person_stops_is_not_begun_again(page, manager, recordings, monkeypatch):
    assert feeding(manager, "samples")
    succeed("stop", "-C", recordings.parent)
    assert feeding(manager, "STATUS=preview")
    assert "STOPPING=1" not in manager.states
    page.send_signal(signal.SIGTERM)
    assert "next one" not in page.communicate(timeout=30)[0]
