"""sd_notify(3): a real recording on simulated devices, and a real socket in systemd's place."""

import os
import signal
import socket
import subprocess
import threading

import pytest

from fieldkit.config import load_config
from fieldkit.model.samples import Frame, Reading
from fieldkit.recording.background import RecordOptions
from fieldkit.recording.record import prepare
from fieldkit.views.service_manager import RecordingReports, notify
from tests.harness.command_line import program, succeed
from tests.harness.service_manager import ServiceManager

SILENCE_S = 3.0  # of a feed that comes once a second


@pytest.fixture
def manager(tmp_path, monkeypatch):
    manager = ServiceManager(tmp_path / "notify")
    monkeypatch.setenv("NOTIFY_SOCKET", manager.address)
    monkeypatch.delenv("SYSTEMD_EXEC_PID", raising=False)
    yield manager
    manager.socket.close()


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / "campaign"
    succeed("init", "--simulated", folder)
    return folder


@pytest.fixture
def record(folder):
    """Begins a recording in a process of its own, at the pace of real time; ends what is left of it."""
    begun = []

    def begin(**environment: str) -> subprocess.Popen[str]:
        words = ("record", "-C", folder, "-q", "--name", "beds", "--set", "simulation.speed=1")
        begun.append(program(*words, stdout=None, stderr=None, env={**os.environ, **environment}))
        return begun[-1]

    yield begin
    for process in begun:
        process.kill()
        process.wait()


def test_a_manager_that_is_none_or_has_gone_does_no_harm(tmp_path, monkeypatch):
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    notify("READY=1")
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "gone"))
    notify("READY=1")


def test_an_abstract_address(monkeypatch):
    """An address that begins with @ is in the abstract namespace, whose first byte is 0: unix(7)."""
    name = f"fieldkit-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
        receiver.bind(f"\0{name}")
        receiver.settimeout(5.0)
        monkeypatch.setenv("NOTIFY_SOCKET", f"@{name}")
        notify("READY=1", "STATUS=three beds – 15°")
        assert receiver.recv(4096).decode() == "READY=1\nSTATUS=three beds – 15°"


def test_a_recording_is_ready_alive_and_stopping(manager, record):
    process = record()
    assert manager.waits_for("READY=1")
    assert manager.waits_for("WATCHDOG=1")
    assert manager.waits_for("WATCHDOG=1")
    assert any(state.startswith("STATUS=recording") and "samples" in state for state in manager.states)
    assert "STOPPING=1" not in manager.states
    process.send_signal(signal.SIGTERM)
    assert manager.waits_for("STOPPING=1")
    assert process.wait(60) == 0


def test_a_blocked_recorder_feeds_no_watchdog_while_its_reading_threads_go_on(manager, folder):
    blocked, release, stopping = threading.Event(), threading.Event(), threading.Event()

    class Blocks:
        samples = 0

        def show(self, item: object) -> None:
            self.samples += isinstance(item, Frame | Reading)
            if self.samples == 8 and not release.is_set():
                blocked.set()
                release.wait(60)

        def close(self) -> None:
            pass

    config = load_config(folder / "fieldkit.toml", settings=["simulation.speed=1"])
    with prepare(config, RecordOptions()) as prepared:
        views = (RecordingReports(), Blocks())
        recorder = threading.Thread(target=lambda: prepared.run(views, stopping=stopping))
        recorder.start()
        assert blocked.wait(60)
        manager.drain()
        assert not manager.waits_for("WATCHDOG=1", SILENCE_S)
        release.set()
        assert manager.waits_for("WATCHDOG=1")
        stopping.set()
        recorder.join(60)


def test_a_child_of_the_service_reports_progress_and_nothing_else(manager, record):
    """A child that reports STOPPING=1 would have systemd end the page with it."""
    process = record(SYSTEMD_EXEC_PID="1")
    assert manager.waits_for("WATCHDOG=1")
    process.send_signal(signal.SIGTERM)
    assert process.wait(60) == 0
    manager.drain()
    assert not {"READY=1", "STOPPING=1"} & set(manager.states)
