"""Every fault of the simulated field raises its alarm once, in time, and clears it; replay finds the same."""

from __future__ import annotations

import socket
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

import pytest

from fieldkit.config import FILE_NAME, load_config, toml_schema
from fieldkit.config.template import SIMULATED
from fieldkit.estimation.estimator import Estimator
from fieldkit.model.alarm import Condition, Phase, phase_of
from fieldkit.model.errors import ConfigError
from fieldkit.model.samples import Event, EventKind, Severity
from fieldkit.recorder.recorder import Recorder
from fieldkit.sessions.reader import open_session
from fieldkit.workflows.campaign import create_campaign
from fieldkit.workflows.record import RecordedSession, prepare
from fieldkit.workflows.replay import replay

FAST = [
    "simulation.speed=max",
    'estimator.model="paper"',
    'estimator.azimuth="known"',
    "estimator.window_s=300",
]


def recorded(folder: Path, minutes: int, *settings: str, marks: Any = None) -> RecordedSession:
    create_campaign(folder, SIMULATED)
    config = load_config(folder / FILE_NAME, settings=[*FAST, *settings])
    with prepare(config, duration_s=60.0 * minutes) as prepared:
        return prepared.run()


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
    ("fault", "minutes", "settings", "expected"),
    [
        # within: of the fault's begin, with the minute of a burst or bin and the hold time
        ("cable", 8, (), {"lost:camera": (10, True)}),
        ("silent", 8, (), {"lost:camera": (70, True)}),
        ("frozen", 8, (), {"frozen:camera": (65, True)}),
        ("overrange", 8, (), {"overrange:lux": (15, True)}),
        ("garbled", 10, (), {"garbled:lux": (60, True)}),
        ("clock", 12, (), {"clock": (2, True)}),
        ("disk", 24, (), {"disk": (300, True), "silent:camera": (420, True)}),
        ("moved", 36, (), {"moved": (180, True)}),
        ("shade", 36, (), {"shade:b25": (180, True)}),
        (
            "drift",
            40,
            (
                'estimator.model="learned"',
                B25 % "tilt_max_deg = 28, tilt_probability = 0.5",
                "alarms.hold_s={tilt = 0, tilt-probability = 0}",
            ),
            {"drift:b25": (300, True), "tilt:b25": (300, True), "tilt-probability:b25": (300, True)},
        ),
        (
            "cloud",
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
def test_a_fault_raises_its_alarms_once_in_time_and_clears_them(tmp_path, fault, minutes, settings, expected):
    done = recorded(tmp_path / "field", minutes, f'simulation.faults=["{fault}"]', *settings)
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


def test_a_quiet_field_raises_no_alarm(tmp_path):
    done = recorded(tmp_path / "field", 20)
    assert alarms_of(done.path) == []
    assert replay(done.path).alarms == ()


def test_replay_with_other_limits_finds_other_alarms(tmp_path):
    done = recorded(tmp_path / "field", 10)
    (found,) = replay(done.path, settings=[B25 % "temperature_max_c = 10"]).alarms
    assert (found.data["alarm"], phase_of(found)) == ("temperature:b25", Phase.RAISED)


def test_an_estimator_that_fails_is_an_alarm(tmp_path, monkeypatch):
    def fail(self: Estimator, sample: object) -> None:
        raise ZeroDivisionError("no light at all")

    with monkeypatch.context() as patched:
        patched.setattr(Estimator, "collect", fail)
        done = recorded(tmp_path / "field", 3)
    live = alarms_of(done.path)
    assert [event.data["alarm"] for event in live] == ["estimator"]
    assert as_rows(replay(done.path).alarms) == as_rows(live)


def test_alarms_that_fail_do_not_end_the_recording(tmp_path, monkeypatch):
    def fail(self: object, item: object) -> None:
        raise ZeroDivisionError("no alarm at all")

    monkeypatch.setattr("fieldkit.recorder.alarms.AlarmEngine.update", fail)
    done = recorded(tmp_path / "field", 3)
    with open_session(done.path) as session:
        assert session.state == "sealed"
        (told,) = [event for event in session.events() if event.kind is EventKind.ALARM]
    assert "no alarm at all" in told.text
    assert told.severity is Severity.ERROR


def test_an_acknowledgement_is_stored_and_replayed(tmp_path, monkeypatch):
    genuine = Recorder._keep_event

    def acknowledging(self: Recorder, event: Event) -> None:
        genuine(self, event)
        if phase_of(event) is Phase.RAISED:
            data = {"acknowledge": event.data["alarm"]}
            now = self.clock.mono_ns()
            self._carry_out([Event(EventKind.MARK, now, self.clock.to_utc_ns(now), "seen", data=data)])

    monkeypatch.setattr(Recorder, "_keep_event", acknowledging)
    done = recorded(tmp_path / "field", 8, 'simulation.faults=["cable"]')
    live = alarms_of(done.path)
    assert [phase_of(event) for event in live] == [Phase.RAISED, Phase.ACKNOWLEDGED, Phase.CLEARED]
    assert as_rows(replay(done.path).alarms) == as_rows(live)


def counts(done: RecordedSession) -> dict[str, int]:
    assert done.summary.failure is None
    assert not any(done.summary.dropped.values())
    return done.summary.counts


def test_a_command_that_hangs_and_a_broker_that_is_away_leave_the_recording_alone(tmp_path):
    pytest.importorskip("paho.mqtt.client")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]  # closed again: nothing listens there
    cable = 'simulation.faults=["cable"]'
    undisturbed = recorded(tmp_path / "one", 8, cable)
    started = time.monotonic()
    hanging = f'alarms.command=["{sys.executable}", "-c", "import time; time.sleep(600)"]'
    away = f'alarms.mqtt="mqtt://127.0.0.1:{port}/sand"'
    done = recorded(tmp_path / "two", 8, cable, hanging, away)
    assert time.monotonic() - started < 60.0
    assert counts(done) == counts(undisturbed)
    assert as_rows(alarms_of(done.path)) == as_rows(alarms_of(undisturbed.path))
    for thread in threading.enumerate():
        if thread.name == "alarms to the command":  # it is killed, and reaped, a moment later
            thread.join(5.0)
            assert not thread.is_alive()


def test_an_output_that_fails_is_one_event(tmp_path):
    settings = ['alarms.command=["/nonexistent/alarm"]', "simulation.speed=60", 'simulation.faults=["clock"]']
    settings.append("alarms.clear_s={clock = 5}")
    done = recorded(tmp_path / "field", 2, *settings)
    with open_session(done.path) as session:
        told = [event.text for event in session.events() if event.data.get("output") == "the command"]
    assert len(told) == 1
    assert "/nonexistent/alarm" in told[0]


def test_a_secret_is_read_from_its_file_and_must_be_there(tmp_path):
    with pytest.raises(ConfigError, match="ntfy_token_file"):
        recorded(tmp_path / "f", 1, 'alarms.ntfy="http://127.0.0.1:1/t"', 'alarms.ntfy_token_file="token"')


def test_the_configuration_knows_every_condition():
    assert set(get_args(toml_schema.Condition)) == {condition.value for condition in Condition}


def test_limits_of_a_region_that_is_not_there_are_noticed_before_the_recording(tmp_path):
    create_campaign(tmp_path, SIMULATED)
    config = load_config(tmp_path / FILE_NAME, settings=["alarms.region={b27 = {tilt_max_deg = 30}}"])
    noticed: list[str] = []
    with prepare(config, duration_s=60.0, notify=noticed.append):
        assert "alarms.region.b27: no region is called b27, so its limits watch nothing" in noticed
