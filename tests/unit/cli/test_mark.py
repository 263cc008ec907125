import json
import os
import subprocess
import sys
from datetime import datetime
from pathlib import Path
from zoneinfo import ZoneInfo

import pytest
from click.testing import CliRunner

from fieldkit.cli import main
from fieldkit.model.errors import ConfigError
from fieldkit.model.samples import Event
from fieldkit.recorder.marks import Mark, MarkInbox
from fieldkit.sessions.lock import SessionLock
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.writer import SessionWriter
from fieldkit.simulation.simulated_clock import SimulatedClock
from fieldkit.workflows.running import FAR_IN_SIMULATION_S, parse_when, reject_impossible, session_in_progress
from tests.harness.recording import CountedClock, header

TOKYO = ZoneInfo("Asia/Tokyo")
NOON = datetime(2026, 12, 11, 12, 0, tzinfo=TOKYO)
NOON_NS = 1_451_674_800_000_000_000


@pytest.fixture
def campaign(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "home"))
    assert CliRunner().invoke(main, ["init", str(tmp_path)]).exit_code == 0
    return tmp_path


@pytest.fixture
def recording(campaign):
    """The recordings folder with an interrupted session and one whose journal somebody holds."""
    recordings = campaign / "recordings"
    for name in ("a-interrupted", "running", "z-interrupted"):
        (recordings / f"{name}.h5.journal" / "marks").mkdir(parents=True)
    SessionLock(recordings / "z-interrupted.h5.journal").release()
    lock = SessionLock(recordings / "running.h5.journal")
    yield recordings
    lock.release()


def mark(campaign, *arguments: str):
    return CliRunner().invoke(main, ["mark", "-C", str(campaign), *arguments])


def test_a_mark_reaches_the_session_that_is_recorded(campaign, recording):
    result = mark(campaign, "cloud over the ridge", "-k", "cloud", "--at", "-30s", "--json")
    assert result.exit_code == 0
    (event,) = MarkInbox(recording / "running.h5.journal" / "marks", SimulatedClock(NOON_NS))()
    assert (event.text, event.data) == ("cloud over the ridge", {"label": "cloud"})
    assert event.time_ns == NOON_NS - 30 * 10**9
    assert json.loads(result.stdout)["session"].endswith("running.h5")


def stored(folder: Path, event: Event) -> Event:
    """The event as a session gives it back."""
    writer = SessionWriter(folder / "a.h5", header((24, 32)), CountedClock())
    writer.event(event)
    writer.close()
    with open_session(folder / "a.h5") as session:
        return session.events()[0]


@pytest.mark.parametrize(
    "text",
    ["y" * 700, "風が強くなった、" * 35, 'a "quoted" word, ' * 40],
    ids=["letters", "Japanese", "quotes"],
)
def test_a_long_mark_is_kept_whole_with_its_span(campaign, recording, tmp_path, text):
    result = mark(campaign, text, "-k", "cloud", "--from", "-4m", "--to", "-1m")
    assert result.exit_code == 0
    (event,) = MarkInbox(recording / "running.h5.journal" / "marks", SimulatedClock(NOON_NS))()
    kept = stored(tmp_path, event)
    assert kept.text == text
    assert kept.data == {"label": "cloud", "end_ns": NOON_NS - 60 * 10**9}


@pytest.mark.parametrize("arguments", [("x" * 3000,), ("shade", "-k", "k" * 1100), ("\x01" * 300,)])
def test_a_mark_that_cannot_be_kept_whole_is_refused_not_cut(campaign, recording, arguments):
    result = mark(campaign, *arguments, "--from", "-4m", "--to", "-1m")
    assert result.exit_code == 3
    assert "too long to be stored whole" in result.stderr
    assert list((recording / "running.h5.journal" / "marks").iterdir()) == []


def test_bytes_of_a_latin_1_terminal_are_kept_as_they_were_typed(campaign, recording):
    done = subprocess.run(
        [sys.executable, "-m", "fieldkit", "mark", "-C", str(campaign), b"caf\xe9 opens", "-k", b"\xfcbel"],
        capture_output=True, check=False, env={**os.environ, "PYTHONUTF8": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert b"caf\\xe9 opens" in done.stderr
    (event,) = MarkInbox(recording / "running.h5.journal" / "marks", SimulatedClock(NOON_NS))()
    assert (event.text, event.data) == ("caf\\xe9 opens", {"label": "\\xfcbel"})


def test_a_span_has_two_ends(campaign, recording):
    assert mark(campaign, "shade", "--from", "-4m", "--to", "-1m").exit_code == 0
    (event,) = MarkInbox(recording / "running.h5.journal" / "marks", SimulatedClock(NOON_NS))()
    assert event.time_ns == NOON_NS - 240 * 10**9
    assert event.data == {"end_ns": NOON_NS - 60 * 10**9}


def test_a_mark_on_a_session_that_is_being_sealed_is_refused_not_lost(campaign, recording):
    MarkInbox(recording / "running.h5.journal" / "marks", SimulatedClock(NOON_NS)).close()
    result = mark(campaign, "packed up")
    assert result.exit_code == 9
    assert "running.h5 has just ended and is being sealed" in result.stderr


def test_without_a_recording_it_says_so_and_exits_9(campaign):
    result = mark(campaign, "hello")
    assert result.exit_code == 9
    assert "no recording is running" in result.stderr


def test_only_the_session_that_is_being_written_is_in_progress(recording):
    assert session_in_progress(recording) == recording / "running.h5"


def test_interrupted_sessions_are_not_in_progress(campaign):
    (campaign / "recordings" / "old.h5.journal").mkdir()
    assert session_in_progress(campaign / "recordings") is None
    assert session_in_progress(campaign / "nowhere") is None


@pytest.mark.parametrize(
    "arguments", [("--from", "-4m"), ("--to", "-4m"), ("--at", "-1m", "--from", "-4m", "--to", "-1m")]
)
def test_half_a_span_is_wrong_usage(campaign, arguments):
    assert mark(campaign, "x", *arguments).exit_code == 2


@pytest.mark.parametrize(("text", "seconds"), [("-30s", -30.0), ("-5m", -300.0), ("-1.5h", -5400.0)])
def test_times_before_now(text, seconds):
    assert parse_when(text, TOKYO, NOON) == seconds


@pytest.mark.parametrize(
    ("text", "moment"),
    [
        ("11:31", "2026-12-11T11:31:00+09:00"),
        ("11:31:05", "2026-12-11T11:31:05+09:00"),
        # a zone that is given stays, and its own day counts: in Denver it is still the tenth
        ("02:00Z", "2026-12-11T02:00:00+00:00"),
        ("19:00-07:00", "2026-12-10T19:00:00-07:00"),
        # somebody's watch is a little ahead; what is further ahead was yesterday
        ("12:04", "2026-12-11T12:04:00+09:00"),
        ("12:06", "2026-12-10T12:06:00+09:00"),
    ],
)
def test_a_clock_time_is_the_last_one_in_its_zone_or_the_sites(text, moment):
    assert parse_when(text, TOKYO, NOON) == moment


def test_around_midnight_a_clock_time_is_the_one_nearby():
    after = datetime(2026, 12, 11, 0, 3, tzinfo=TOKYO)
    before = datetime(2026, 12, 10, 23, 58, tzinfo=TOKYO)
    assert parse_when("23:58", TOKYO, after) == "2026-12-10T23:58:00+09:00"
    assert parse_when("00:01", TOKYO, before) == "2026-12-11T00:01:00+09:00"


def test_an_iso_time_keeps_its_zone_and_without_one_is_the_sites():
    assert parse_when("2026-12-11T12:31-07:00", TOKYO, NOON) == "2026-12-11T12:31:00-07:00"
    assert parse_when("2026-12-11T12:31", TOKYO, NOON) == "2026-12-11T12:31:00+09:00"


@pytest.mark.parametrize("text", ["30s", "-30", "noon", "25:00", "-1d", "2026-12"])
def test_what_is_no_time_is_refused(text):
    with pytest.raises(ConfigError, match="is not a valid time"):
        parse_when(text, TOKYO, NOON)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--from", "-1m", "--to", "-4m"), "the end lies before the start"),
        (("--from", "-1m", "--to", "2026-01-01T00:00Z"), "the end lies before the start"),
        (("--at", "2926-12-11T12:31Z"), "2926-12-11T12:31:00+00:00 is more than 10 years from now"),
        (("--at", "-999999h"), "more than 10 years from now"),
    ],
)
def test_times_that_cannot_be_meant_leave_no_mark(campaign, recording, arguments, told):
    result = mark(campaign, "x", *arguments)
    assert result.exit_code == 2
    assert told in " ".join(result.stderr.split())
    assert not any((recording / "running.h5.journal" / "marks").iterdir())


def test_a_simulated_day_may_be_decades_ago():
    reject_impossible(Mark("x", at="1996-01-01T12:00:00-07:00"), NOON, FAR_IN_SIMULATION_S)
    with pytest.raises(ConfigError, match="100 years"):
        reject_impossible(Mark("x", at="2926-01-01T12:00:00-07:00"), NOON, FAR_IN_SIMULATION_S)
