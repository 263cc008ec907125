"""Every fault of the simulated field raises its alarm once, in time, and clears it; replay finds the same."""

import base64
import json
import queue
import socket
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from fieldkit.config import FILE_NAME, load_config
from fieldkit.estimation.estimator import Estimator
from fieldkit.model.alarm import Alarm, Condition, Phase, phase_of
from fieldkit.model.errors import ConfigError
from fieldkit.model.samples import Event, EventKind, Severity
from fieldkit.recorder import alarm_outputs
from fieldkit.recorder.alarm_outputs import AlarmOutputs, CommandOutput, ServiceOutput
from fieldkit.recording.alarms import alarm_settings, outputs_of
from fieldkit.recording.background import RecordOptions
from fieldkit.recording.record import RecordedSession, prepare
from fieldkit.recording.replay import replay
from fieldkit.recording.requests import Acknowledgement, send_to_recorder
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.records import Entry
from fieldkit.sessions.writer import SessionWriter
from tests.harness.simulated import PAPER, record_simulated, simulated_config
from tests.harness.waiting import PATIENCE_S, wait_until

EACH_SECOND = ("lux.every_s=1", "thermometer.every_s=1")


def recording_of(folder: Path, minutes: int, *settings: str) -> RecordedSession:
    return record_simulated(folder, minutes, "estimator.window_s=300", *settings)


def alarms_of(path: Path) -> list[Event]:
    with open_session(path) as session:
        return [event for event in session.events() if phase_of(event) is not None]


def seconds(events: Sequence[Event], phase: Phase, name: str, start_ns: int) -> list[float]:
    return [
        (event.time_ns - start_ns) / 1e9
        for event in events
        if event.data["alarm"] == name and phase_of(event) is phase
    ]


def as_rows(events: Sequence[Event]) -> list[tuple[Any, ...]]:
    return sorted((one.time_ns, one.mono_ns, one.text, one.severity, str(one.data)) for one in events)


B25 = "alarms.region={b25 = {%s}}"


@pytest.mark.parametrize(
    ("faults", "minutes", "settings", "expected"),
    [
        # within: of the fault's begin, with the minute of a burst or bin and the hold time;
        # faults of two instruments, which do not depend on each other, share a recording
        (("cable", "overrange"), 8, EACH_SECOND, {"lost:camera": (10, True), "overrange:lux": (15, True)}),
        (("frozen", "garbled"), 10, EACH_SECOND, {"frozen:camera": (65, True), "garbled:lux": (60, True)}),
        (("silent", "clock"), 12, EACH_SECOND, {"lost:camera": (70, True), "clock": (2, True)}),
        (("disk",), 24, (), {"disk": (300, True), "silent:camera": (420, True)}),
        (("moved",), 36, (), {"moved": (180, True)}),
        (("shade",), 36, (), {"shade:b25": (180, True)}),
        (
            ("drift",),
            40,
            (
                *EACH_SECOND,
                'estimator.model="learned"',
                B25 % "tilt_max_deg = 27.85, tilt_probability = 0.5",
                "alarms.hold_s={tilt = 0, tilt-probability = 0}",
                "alarms.clear_s={tilt = 60, tilt-probability = 60}",  # the bed has no slope for minutes
            ),
            {"drift:b25": (300, True), "tilt:b25": (540, True), "tilt-probability:b25": (540, True)},
        ),
        (
            ("cloud",),
            34,
            (
                'estimator.window_s="weather"',
                B25 % "temperature_min_c = 15, temperature_rate_k_min = 4.5",
                "alarms.hold_s={held = 450}",
                "estimator.settle_s=60",
            ),
            {
                "cloud": (120, True),
                "temperature:b25": (240, True),
                "rate:b25": (240, True),
                "held:b25": (600, True),
            },
        ),
    ],
)
def test_a_fault_raises_its_alarms_once_in_time_and_clears_them(
    tmp_path, faults, minutes, settings, expected
):
    done = recording_of(tmp_path / "field", minutes, f"simulation.faults={json.dumps(faults)}", *settings)
    assert done.summary.failure is None
    live = alarms_of(done.path)
    with open_session(done.path) as session:
        begin_ns = session.start_ns + 30 * minutes * 10**9
    for name, (within_s, cleared) in expected.items():
        raised = seconds(live, Phase.RAISED, name, begin_ns)
        assert len(raised) == 1, (name, raised)
        assert -2 <= raised[0] <= within_s
        over = seconds(live, Phase.CLEARED, name, begin_ns)
        assert len(over) == cleared
        assert all(one > raised[0] for one in over)
    assert as_rows(replay(done.path).alarms) == as_rows(live) != []


def test_a_quiet_field_raises_no_alarm(recorded, tmp_path):
    path = recorded(tmp_path)
    assert alarms_of(path) == []
    assert replay(path).alarms == ()


def test_replay_with_other_limits_finds_other_alarms(recorded, tmp_path):
    path = recorded(tmp_path)
    (found,) = replay(path, settings=[B25 % "temperature_max_c = 10", *PAPER]).alarms
    assert (found.data["alarm"], phase_of(found)) == ("temperature:b25", Phase.RAISED)


def test_an_estimator_that_fails_is_an_alarm(tmp_path, monkeypatch):
    def fail(self: Estimator, sample: object) -> None:
        raise ZeroDivisionError("no light at all")

    with monkeypatch.context() as patched:
        patched.setattr(Estimator, "collect", fail)  # only a mistake of ours does
        done = recording_of(tmp_path / "field", 3)
    live = alarms_of(done.path)
    assert [event.data["alarm"] for event in live] == ["estimator"]
    assert as_rows(replay(done.path).alarms) == as_rows(live)


def test_alarms_that_fail_do_not_end_the_recording(tmp_path, monkeypatch):
    def fail(self: object, item: object) -> None:
        raise ZeroDivisionError("broken")

    monkeypatch.setattr("fieldkit.recorder.alarms.AlarmEngine.update", fail)  # only a mistake of ours does
    done = recording_of(tmp_path / "field", 3)
    with open_session(done.path) as session:
        assert session.state == "sealed"
        (told,) = [event for event in session.events() if event.kind is EventKind.ALARM]
    assert "broken" in told.text
    assert told.severity is Severity.ERROR


def test_an_acknowledgement_is_stored_and_replayed(tmp_path, monkeypatch):
    genuine = SessionWriter.put

    def acknowledging(self: SessionWriter, entry: Entry) -> None:
        genuine(self, entry)
        if isinstance(entry, Event) and phase_of(entry) is Phase.RAISED:
            send_to_recorder(self.path.parent, Acknowledgement(entry.data["alarm"]))

    # only here does simulated time wait for who acknowledges
    monkeypatch.setattr(SessionWriter, "put", acknowledging)
    done = recording_of(tmp_path / "field", 8, 'simulation.faults=["cable"]')
    live = alarms_of(done.path)
    assert [phase_of(event) for event in live] == [Phase.RAISED, Phase.ACKNOWLEDGED, Phase.CLEARED]
    assert as_rows(replay(done.path).alarms) == as_rows(live)


def counts(done: RecordedSession) -> dict[str, int]:
    assert done.summary.failure is None
    assert not any(done.summary.dropped.values())
    return done.summary.counts


def test_a_command_that_hangs_and_a_broker_that_is_away_leave_the_recording_alone(tmp_path):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]  # closed again: nothing listens there
    cable = 'simulation.faults=["cable"]'
    undisturbed = recording_of(tmp_path / "one", 6, cable)
    started = time.monotonic()
    hanging = f'alarms.command=["{sys.executable}", "-c", "import time; time.sleep(600)"]'
    away = services(tmp_path, f"mqtt://127.0.0.1:{port}/sand")
    done = recording_of(tmp_path / "two", 6, cable, hanging, away)
    assert time.monotonic() - started < 60.0
    assert counts(done) == counts(undisturbed)
    assert as_rows(alarms_of(done.path)) == as_rows(alarms_of(undisturbed.path))
    for thread in threading.enumerate():
        if thread.name == "alarms to the command":  # it is killed, and reaped, a moment later
            thread.join(5.0)
            assert not thread.is_alive()


def test_an_output_that_fails_is_one_event(tmp_path):
    settings = [
        'alarms.command=["/nonexistent/alarm", "s3cr3t"]',
        "simulation.speed=30",
        'simulation.faults=["clock"]',
    ]
    settings.append("alarms.clear_s={clock = 5}")
    done = recording_of(tmp_path / "field", 2, *settings)
    with open_session(done.path) as session:
        (text,) = [event.text for event in session.events() if event.data.get("output") == "the command"]
    assert "/nonexistent/alarm" in text
    assert b"s3cr3t" not in done.path.read_bytes()  # the words of a command are not stored


def test_a_command_gets_the_image_while_it_runs(tmp_path):
    copy = f"import os, shutil; shutil.copy(os.environ['FIELDKIT_IMAGE'], {str(tmp_path / 'alarm.png')!r})"
    output, frame = CommandOutput([sys.executable, "-c", copy]), b"\x89PNG"
    outputs = AlarmOutputs([output])
    alarm = Alarm("shade", "b25", Severity.WARNING, 0, "b25")
    asked: list[str] = []
    outputs.send(alarm.event(Phase.RAISED, 0, 0), lambda subject: asked.append(subject) or frame)
    outputs.close()
    assert asked == ["b25"]
    wait_until((tmp_path / "alarm.png").exists, "no image is copied")
    assert (tmp_path / "alarm.png").read_bytes() == frame
    assert not list(outputs.failures(0, 0))


def test_an_image_that_cannot_be_drawn_leaves_the_alarm(tmp_path):
    command = CommandOutput(
        [sys.executable, "-c", "import os, sys; sys.exit(len(os.environ['FIELDKIT_IMAGE']))"]
    )
    outputs = AlarmOutputs([command])
    alarm = Alarm("lost", "camera", Severity.ERROR, 0, "no frame")
    outputs.send(alarm.event(Phase.RAISED, 0, 0), lambda _: b""[1])
    outputs.close()
    assert not list(outputs.failures(0, 0))


class Dripping(BaseHTTPRequestHandler):
    """Answers alarms with a header that never ends, except at one address."""

    def do_POST(self) -> None:
        self.rfile.read(int(self.headers["Content-Length"]))
        self.server.paths.put(self.path)
        self.wfile.write(b"HTTP/1.1 200 OK\r\n")
        with suppress(OSError):
            while self.path != "/fourth" and not self.server.ended.wait(0.05):
                self.wfile.write(b"X")
            self.wfile.write(b"Content-Length: 0\r\n\r\n")

    def log_message(self, *words: object) -> None:
        """Nothing to print."""


def test_three_servers_that_answer_in_drips_hold_up_neither_a_fourth_nor_their_next_alarm(monkeypatch):
    pytest.importorskip("apprise")
    monkeypatch.setattr(alarm_outputs, "HUNG_AFTER_S", 1.0)  # a shorter wait
    paths = ["/first", "/second", "/third", "/fourth"]
    with ThreadingHTTPServer(("127.0.0.1", 0), Dripping) as server:
        server.paths, server.ended = queue.Queue(), threading.Event()
        threading.Thread(target=server.serve_forever, daemon=True).start()
        address = f"json://127.0.0.1:{server.server_port}"
        outputs = AlarmOutputs([ServiceOutput(address + path, line) for line, path in enumerate(paths, 1)])
        for name in ("camera", "lux"):
            alarm = Alarm("lost", name, Severity.ERROR, 0, name)
            outputs.send(alarm.event(Phase.RAISED, 0, 0))
        posted = [server.paths.get(timeout=PATIENCE_S) for _ in 2 * paths]
        assert sorted(posted) == sorted(2 * paths)
        assert posted.index("/fourth", posted.index("/fourth") + 1) <= 4  # both, before any next drip
        failures: list[Event] = []
        wait_until(lambda: failures.extend(outputs.failures(0, 0)) or len(failures) == 3, "three fail")
        assert {event.data["output"] for event in failures} == {
            f"JSON (line {line} of alarms.services_file)" for line in (1, 2, 3)
        }
        server.ended.set()
        outputs.close()
        server.shutdown()


def services(folder: Path, text: str, mode: int = 0o600) -> str:
    """The setting that names a file of services with this text."""
    path = folder / "services.txt"
    path.write_text(text, encoding="latin-1")
    path.chmod(mode)
    return f"alarms.services_file={path}"


@pytest.mark.parametrize(
    ("text", "mode", "fix"),
    [
        ("# mine\nnowhere://s3cr3t", 0o600, "tgram://"),
        ("s3cr3t", 0o600, "tgram://"),
        ("mqtt://me:s3cr3t/more@host/sand", 0o600, "%2F"),
        ("mqtt:///s3cr3t", 0o600, "mqtt://"),
        ("tgram://s3cr3t\xfc", 0o600, "a line"),
        ("json://127.0.0.1/s3cr3t", 0o640, "chmod 600"),
        ("json://127.0.0.1/s3cr3t", 0o604, "chmod 600"),
    ],
)
def test_a_file_of_services_that_cannot_be_used_is_named_but_not_quoted(tmp_path, caplog, text, mode, fix):
    pytest.importorskip("apprise")
    config = simulated_config(tmp_path / "f", services(tmp_path, text, mode))
    with pytest.raises(ConfigError) as caught:
        list(outputs_of(config))
    assert fix in caught.value.fix
    assert "alarms.services_file" in str(caught.value.place)
    assert "s3cr3t" not in f"{caught.value}{caught.value.__cause__}{caplog.text}"


def test_a_file_of_services_is_there_and_lies_outside_the_campaign(tmp_path):
    inside = simulated_config(tmp_path, services(tmp_path, "json://127.0.0.1/s3cr3t"))
    away = load_config(tmp_path / FILE_NAME, settings=["alarms.services_file=/nonexistent/services.txt"])
    for config, fix in ((inside, "~/.config/fieldkit/services.txt"), (away, "one address a line")):
        with pytest.raises(ConfigError) as caught:
            list(outputs_of(config))
        assert fix in caught.value.fix


class Service(BaseHTTPRequestHandler):
    """A service that takes messages at one address."""

    def do_POST(self) -> None:
        message = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        self.server.posted.append((self.path, message["type"], message["message"]))
        self.server.images += [base64.b64decode(one["base64"]) for one in message["attachments"]]
        self.send_response(200 if self.path == "/s3cr3t" else 404)
        self.end_headers()

    def log_message(self, *_: object) -> None:
        """Quiet."""


def test_alarms_reach_a_service_and_its_token_nothing_else(tmp_path, caplog, capsys):
    pytest.importorskip("apprise")
    caplog.set_level("DEBUG")
    with ThreadingHTTPServer(("127.0.0.1", 0), Service) as server:
        server.posted, server.images = [], []
        threading.Thread(target=server.serve_forever, daemon=True).start()
        address = f"json://127.0.0.1:{server.server_port}"
        setting = services(tmp_path, f"\n{address}/s3cr3t\n{address}/s3cr3t-of-nobody\n")
        done = recording_of(
            tmp_path / "f", 3, setting, 'simulation.faults=["clock"]', "simulation.speed=60", "lux.every_s=1"
        )
        server.shutdown()
    (alarm,) = [event for event in alarms_of(done.path) if phase_of(event) is Phase.RAISED]
    assert ("/s3cr3t", "warning", alarm.text) in server.posted
    image = cv2.imdecode(np.frombuffer(server.images[0], np.uint8), cv2.IMREAD_COLOR)
    assert image.shape[1] > 960  # of the camera, enlarged, with its scale
    with open_session(done.path) as session:
        texts = [event.text for event in session.events()]
        stored = session.config_toml
    assert len([text for text in texts if "JSON (line 3 of alarms.services_file)" in text]) == 1
    assert not any("line 2" in text for text in texts)
    assert "services.txt" in stored
    printed = capsys.readouterr()
    everything = [stored, *texts, caplog.text, printed.out, printed.err]
    files = [path.read_bytes() for path in (tmp_path / "f").rglob("*") if path.is_file()]
    assert not any("s3cr3t" in text for text in everything)
    assert not any(b"s3cr3t" in content for content in files)


@pytest.mark.parametrize("key", ["services", "services_file"])
def test_an_address_in_the_configuration_begins_no_recording(tmp_path, key):
    with pytest.raises(ConfigError) as caught:
        recording_of(tmp_path / "f", 1, f"alarms.{key}=tgram://s3cr3t/1")
    assert "s3cr3t" not in str(caught.value)
    assert not list(tmp_path.rglob("*.h5*"))


def test_every_condition_can_be_configured_by_its_name(tmp_path):
    names = [condition.value for condition in Condition]
    config = simulated_config(tmp_path, f"alarms.off={json.dumps(names)}")
    assert all(rule.off for rule in alarm_settings(config, ()).rules.values())
    assert f"off = {json.dumps(names)}" in config.to_toml()
    with pytest.raises(ConfigError, match=", ".join(map(json.dumps, names))):
        load_config(tmp_path / FILE_NAME, settings=['alarms.off=["rain"]'])


def test_limits_of_a_region_that_is_not_there_are_noticed_before_the_recording(tmp_path):
    config = simulated_config(tmp_path, "alarms.region={b27 = {tilt_max_deg = 30}}")
    noticed: list[str] = []
    with prepare(config, RecordOptions(duration_s=60.0), noticed.append):
        assert any(note.startswith("alarms.region.b27: ") for note in noticed)
