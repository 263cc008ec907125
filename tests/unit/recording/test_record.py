import signal
import subprocess
import sys
from datetime import UTC, datetime, time

import numpy as np
import pytest

import fieldkit
from fieldkit.config.template import SIMULATED
from fieldkit.model.errors import ConfigError
from fieldkit.model.marks import Mark
from fieldkit.model.samples import EventKind
from fieldkit.model.site import Site
from fieldkit.recording.campaign import create_campaign
from fieldkit.recording.record import ns_until
from fieldkit.recording.request_reader import RequestReader
from fieldkit.recording.requests import send_to_recorder
from fieldkit.recording.status_request import feed_path, present_status, recorder_status
from fieldkit.sessions.reader import open_session
from fieldkit.views import formatting
from tests.harness.simulated import simulated_config


def utc_ns(moment: datetime) -> int:
    return round(moment.timestamp()) * 10**9


@pytest.mark.parametrize(
    ("now", "until", "hours"),
    [
        # Zurich, 22:00 until 06:00: clocks go forward on 2026-03-29 and back on 2026-10-25
        (datetime(2026, 3, 28, 21, tzinfo=UTC), "06:00", 7.0),
        (datetime(2026, 10, 24, 20, tzinfo=UTC), "06:00", 9.0),
        (datetime(2026, 10, 25, 0, 45, tzinfo=UTC), "02:30", 0.75),
        (datetime(2026, 10, 25, 1, 45, tzinfo=UTC), "02:30", 23.75),
        (datetime(2026, 7, 1, 20, tzinfo=UTC), "06:00", 8.0),
        (datetime(2026, 7, 1, 20, tzinfo=UTC), "23:30", 1.5),
    ],
)
def test_until_a_clock_time_also_where_the_clocks_are_changed(now, until, hours):
    site = Site(47.4, 8.5, 400, "Europe/Zurich")
    assert ns_until(time.fromisoformat(until), formatting.local_time(utc_ns(now), site)) == 3600e9 * hours


@pytest.mark.parametrize("zone", ["Mars/Jezero", "Asia", "", "x" * 5000])
def test_until_a_clock_time_where_the_zone_is_unknown_on_this_computer_is_utc(zone):
    now = datetime(2026, 7, 1, 20, tzinfo=UTC)
    assert ns_until(time(23, 30), formatting.local_time(utc_ns(now), Site(0, 0, 0, zone))) == 3.5 * 3600e9


def test_a_recording_without_length_is_refused(tmp_path):
    create_campaign(tmp_path / "field", SIMULATED)
    with pytest.raises(ConfigError):
        fieldkit.record(tmp_path / "field", duration="0m")
    assert list((tmp_path / "field" / "recordings").iterdir()) == []


NOTEBOOK = """
import sys, fieldkit

campaign, times = sys.argv[1], []

def minute_closed(minute):
    if not times:
        print("recording", flush=True)
    times.append(minute.time_ns)

session = fieldkit.record(campaign, on_minute=minute_closed)
print(session.state, len(session.minutes()) >= 1, flush=True)
sys.stdin.read()  # back in the notebook an interrupt is one again
"""


def test_an_interrupted_record_in_a_notebook_is_sealed_and_returned(tmp_path):
    simulation = {**SIMULATED["simulation"], "speed": 600}
    create_campaign(tmp_path, {**SIMULATED, "simulation": simulation})
    process = subprocess.Popen(
        [sys.executable, "-c", NOTEBOOK, str(tmp_path)], text=True, stdin=-1, stdout=-1, stderr=-1
    )
    with process:
        assert process.stdout.readline() == "recording\n"
        process.send_signal(signal.SIGINT)
        assert process.stdout.readline() == "sealed True\n"
        process.send_signal(signal.SIGINT)
        assert "KeyboardInterrupt" in process.communicate(timeout=60)[1]
    (path,) = (tmp_path / "recordings").glob("*.h5")
    with fieldkit.open_session(path) as session:
        assert session.state == "sealed"


def test_meters_slower_than_usual_are_waited_for_and_not_taken_for_silent(tmp_path):
    """One that sends by itself, and one that is polled."""
    intervals = [f"{key}={value}" for key, value in (("lux.every_s", 20), ("thermometer.every_s", 30))]
    config = simulated_config(tmp_path / "sand", "simulation.speed=max", *intervals)
    session = fieldkit.record(config, duration="3m")
    with open_session(session.path) as stored:
        assert not [
            event.text for event in stored.events() if event.kind in (EventKind.LOST, EventKind.ALARM)
        ]
        for name, every_s in (("lux", 20.0), ("thermometer", 30.0)):
            times_s = stored.times_ns(name) / 1e9
            assert times_s.size >= 5
            assert np.diff(times_s) == pytest.approx(every_s, abs=0.5)


def test_without_a_socket_a_recording_goes_on_its_status_comes_from_its_files_and_marks_are_kept(
    tmp_path, monkeypatch, caplog
):
    replies, marks = [], []

    def occupy(self, folder, *others):
        (folder.parent / "feed").touch()
        genuine(self, folder, *others)

    def look(minute):
        if not marks:
            marks.append(send_to_recorder(campaign / "recordings", Mark("windy")))
            session = marks[0].session
            assert feed_path(session).is_file()
            assert recorder_status(session) is None
            replies.append(present_status(session))

    genuine = RequestReader.__init__
    # a plain file where the socket is to be: between two steps, which nothing outside can time
    monkeypatch.setattr(RequestReader, "__init__", occupy)
    campaign = tmp_path / "sand"
    config = simulated_config(campaign, "simulation.speed=max")
    session = fieldkit.record(config, duration=150, on_minute=look)
    (warning,) = [record for record in caplog.records if record.levelname == "WARNING"]
    assert isinstance(warning.args[0], OSError)
    (status,) = replies
    assert 0 < status["document"]["counts"]["thermometer"] < session.count("thermometer")
    (mark,) = [event for event in session.events() if event.kind is EventKind.MARK]
    assert (mark.text, mark.data["request"]) == ("windy", marks[0].id)
    assert session.state == "sealed"
