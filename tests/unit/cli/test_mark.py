import json
import os
import re
import subprocess
import sys
import threading
from datetime import UTC, datetime
from pathlib import Path

import pytest
from click.testing import CliRunner

import fieldkit
from fieldkit.cli import main
from fieldkit.config import FILE_NAME, load_config
from fieldkit.model.samples import Event, EventKind
from fieldkit.recording.request_reader import RequestReader
from fieldkit.recording.running import session_in_progress
from fieldkit.sessions.lock import SessionLock
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.writer import SessionWriter
from fieldkit.simulation.simulated_clock import SimulatedClock
from tests.harness.recording import CountedClock, fill, header
from tests.harness.waiting import wait_until

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
    (event,) = RequestReader(recording / "running.h5.journal" / "marks", SimulatedClock(NOON_NS))()
    assert (event.text, event.data["label"]) == ("cloud over the ridge", "cloud")
    assert event.time_ns == NOON_NS - 30 * 10**9
    assert json.loads(result.stdout)["session"].endswith("running.h5")


def stored(folder: Path, event: Event) -> Event:
    """The event as a session gives it back."""
    writer = SessionWriter(folder / "a.h5", header((24, 32)), CountedClock())
    writer.put(event)
    writer.close()
    with open_session(folder / "a.h5") as session:
        return session.events()[0]


@pytest.mark.parametrize(
    "text",
    ["y" * 700, "風が強くなった、" * 35, 'a "quoted" word, ' * 40],
    ids=["letters", "Japanese", "quotes"],
)
def test_a_long_mark_is_kept_whole_with_its_span(campaign, recording, tmp_path, text):
    result = mark(campaign, text, "-k", "cloud", "--from", "-4m", "--until", "-1m")
    assert result.exit_code == 0
    (event,) = RequestReader(recording / "running.h5.journal" / "marks", SimulatedClock(NOON_NS))()
    kept = stored(tmp_path, event)
    assert kept.text == text
    assert kept.data == {**event.data, "label": "cloud", "end_ns": NOON_NS - 60 * 10**9}


@pytest.mark.parametrize("arguments", [("x" * 3000,), ("shade", "-k", "k" * 1100), ("\x01" * 300,)])
def test_a_mark_that_cannot_be_kept_whole_is_refused_not_cut(campaign, recording, arguments):
    result = mark(campaign, *arguments, "--from", "-4m", "--until", "-1m")
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
    (event,) = RequestReader(recording / "running.h5.journal" / "marks", SimulatedClock(NOON_NS))()
    assert (event.text, event.data["label"]) == ("caf\\xe9 opens", "\\xfcbel")


def test_a_span_has_two_ends(campaign, recording):
    assert mark(campaign, "shade", "--from", "-4m", "--until", "-1m").exit_code == 0
    (event,) = RequestReader(recording / "running.h5.journal" / "marks", SimulatedClock(NOON_NS))()
    assert event.time_ns == NOON_NS - 240 * 10**9
    assert event.data["end_ns"] == NOON_NS - 60 * 10**9


def test_a_mark_on_a_session_that_is_being_sealed_is_refused_not_lost(campaign, recording):
    RequestReader(recording / "running.h5.journal" / "marks", SimulatedClock(NOON_NS)).close()
    result = mark(campaign, "packed up")
    assert result.exit_code == 9
    assert "running.h5" in result.stderr


def test_a_mark_right_after_the_start_waits_until_the_recording_accepts_it(campaign, recording):
    folder = recording / "running.h5.journal" / "marks"
    folder.rmdir()  # as between the lock of a session and its first look for requests
    later = threading.Timer(0.5, folder.mkdir)
    later.start()
    result = mark(campaign, "sun is out")
    later.join()
    assert result.exit_code == 0, result.output
    (event,) = RequestReader(folder, SimulatedClock(NOON_NS))()
    assert event.text == "sun is out"


def test_a_clock_time_in_a_simulated_campaign_is_that_of_its_scene(tmp_path, monkeypatch):
    """Its scene begins on the first of January 2016 at noon in Alamosa, seven hours behind UTC."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    campaign = tmp_path / "field"
    assert CliRunner().invoke(main, ["init", "--simulated", str(campaign)]).exit_code == 0
    recordings = load_config(campaign / FILE_NAME).recordings
    process = subprocess.Popen([sys.executable, "-m", "fieldkit", "record", "-C", str(campaign), "--quiet"])
    try:
        wait_until(lambda: session_in_progress(recordings), "nothing is recorded", every_s=0.1)
        for at in ("12:02", "12:02+01:00", "2016-01-01T11:59"):  # at once: nothing may be recorded yet
            result = mark(campaign, at, "--at", at)
            assert result.exit_code == 0, result.output
    finally:
        process.terminate()
        process.wait(60)
    (path,) = recordings.glob("*.h5")
    with open_session(path) as session:
        marks = {event.text: event.time_ns for event in session.events() if event.kind is EventKind.MARK}
    assert {text: datetime.fromtimestamp(ns / 1e9, UTC) for text, ns in marks.items()} == {
        "12:02": datetime(2016, 1, 1, 19, 2, tzinfo=UTC),
        "12:02+01:00": datetime(2016, 1, 1, 11, 2, tzinfo=UTC),
        "2016-01-01T11:59": datetime(2016, 1, 1, 18, 59, tzinfo=UTC),
    }


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
    "arguments", [("--from", "-4m"), ("--until", "-4m"), ("--at", "-1m", "--from", "-4m", "--until", "-1m")]
)
def test_half_a_span_is_wrong_usage(campaign, arguments):
    assert mark(campaign, "x", *arguments).exit_code == 2


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--from", "-1m", "--until", "-4m"), "the end lies before the start"),
        (("--from", "-1m", "--until", "2026-01-01T00:00Z"), "the end lies before the start"),
        (("--at", "2926-12-11T12:31Z"), "2926-12-11T12:31:00+00:00 is more than 10 years from now"),
        (("--at", "-99999h"), "more than 10 years from now"),
    ],
)
def test_times_that_cannot_be_meant_leave_no_mark(campaign, recording, arguments, told):
    result = mark(campaign, "x", *arguments)
    assert result.exit_code == 2
    assert told in " ".join(result.stderr.split())
    assert not any((recording / "running.h5.journal" / "marks").iterdir())


def test_a_shade_test_needs_no_quotes(campaign, recording):
    corners = ["--points", "18,77", "64,74", "65,101", "15,106"]
    added = CliRunner().invoke(main, ["roi", "add", "-C", str(campaign), "b15", "--reference", *corners])
    assert added.exit_code == 0, added.output
    assert mark(campaign, "shade-test", "b15", "end", "--at", "-30s").exit_code == 0
    *_, event = RequestReader(recording / "running.h5.journal" / "marks", SimulatedClock(NOON_NS))()
    del event.data["request"]
    assert event.data == {"shade_test": "b15", "phase": "end", "noted_ns": NOON_NS}


@pytest.mark.parametrize(
    ("arguments", "effect", "minutes"),
    [
        ((), "shaded from HH:MM until you end it, at the latest until HH:MM", 20),
        (("--for", "7m"), "shaded from HH:MM until you end it, at the latest until HH:MM", 7),
        (("end",), "sunlit from HH:MM", None),
        (("--from", "12:10", "--until", "12:14"), "shaded from HH:MM until HH:MM", 4),
    ],
)
def test_a_shade_test_says_at_once_what_it_does(campaign, recording, arguments, effect, minutes):
    corners = ["--points", "18,77", "64,74", "65,101", "15,106"]
    CliRunner().invoke(main, ["roi", "add", "-C", str(campaign), "b15", "--reference", *corners])
    result = mark(campaign, "shade-test", "b15", *arguments)
    assert result.exit_code == 0, result.output
    said = " ".join(result.stderr.split())
    assert f"b15 counts as {effect}" in re.sub(r"\d\d:\d\d", "HH:MM", said)
    times = [datetime.strptime(one, "%H:%M") for one in re.findall(r"\d\d:\d\d", said)]
    assert minutes is None or (times[1] - times[0]).seconds == 60 * minutes
    *_, event = RequestReader(recording / "running.h5.journal" / "marks", SimulatedClock(NOON_NS))()
    assert event.data.get("for_s") == (420.0 if "--for" in arguments else None)


def test_only_a_shade_test_that_begins_has_a_longest_time(campaign, recording):
    assert mark(campaign, "wind", "--for", "5m").exit_code == 2
    assert mark(campaign, "--take-back", "1", "--for", "5m").exit_code == 2


def test_a_shade_test_of_an_unknown_region_is_refused(campaign, recording):
    result = mark(campaign, "shade-test", "b51")
    assert result.exit_code == 2
    assert "'b51'" in result.stderr


@pytest.fixture
def noted(campaign):
    """A session with two marks, and its writer, which still runs."""
    clock, path = CountedClock(), campaign / "recordings" / "noon.h5"
    path.parent.mkdir(exist_ok=True)
    writer = SessionWriter(path, header((24, 32)), clock)
    fill(writer, 10, clock)
    writer.put(Event(EventKind.MARK, 9 * 10**9, clock.to_utc_ns(9 * 10**9), "wind"))
    yield path, writer
    writer.abandon()


def test_marks_of_a_finished_session_are_listed_edited_and_taken_back(campaign, noted):
    path, writer = noted
    writer.close()
    assert mark(campaign, "--take-back", "1").exit_code == 0
    edited = mark(campaign, "--edit", "wind", "gusts", "of", "wind", "-k", "air", "--session", str(path))
    assert edited.exit_code == 0, edited.output
    assert "mark 2 is now: gusts of wind" in edited.stderr
    listed = json.loads(mark(campaign, "--list", "--json").stdout)["marks"]
    assert [(one["mark"], one["text"]) for one in listed] == [(2, "air: gusts of wind")]
    missing = mark(campaign, "--take-back", "rain")
    assert missing.exit_code == 3
    assert "its marks: 1 wolke über b05; 2 gusts of wind" in " ".join(missing.stderr.split())


def test_a_running_recording_corrects_its_marks_and_is_shown_marked_and_stopped_from_python(
    tmp_path, monkeypatch
):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    campaign = tmp_path / "field"
    assert CliRunner().invoke(main, ["init", "--simulated", str(campaign)]).exit_code == 0
    recordings = load_config(campaign / FILE_NAME).recordings
    process = subprocess.Popen([sys.executable, "-m", "fieldkit", "record", "-C", str(campaign), "--quiet"])
    try:
        wait_until(lambda: session_in_progress(recordings), "nothing is recorded", every_s=0.1)
        for text in ("wind", "shade-test b15"):
            assert mark(campaign, text).exit_code == 0
        wait_until(
            lambda: mark(campaign, "--take-back", "shade-test b15").exit_code == 0,
            "the marks are not stored",
            every_s=0.1,
        )
        assert mark(campaign, "--edit", "1", "gusts").exit_code == 0
        path = session_in_progress(recordings)
        assert fieldkit.status(campaign)["session"] == str(path)
        assert fieldkit.mark("dust", fieldkit.open_campaign(campaign), kind="air").session == path
        assert fieldkit.stop(campaign) == path
        assert process.wait(60) == 0
    finally:
        process.kill()
    with open_session(path) as session:
        marks = [(one.text, one.data.get("label")) for one in session.marks().values()]
        assert marks == [("gusts", None), ("dust", "air")]
        made = [one.text for one in session.events(recorded=True) if one.kind is EventKind.MARK]
    assert made == ["wind", "shade-test b15", "taken back: shade-test b15", "gusts", "dust"]


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("--take-back", "1", "x"),
        ("--list", "--edit", "1"),
        ("x", "--session", "a.h5"),
        ("--list", "--at", "-1s"),
    ],
)
def test_correcting_and_adding_are_not_mixed(campaign, arguments):
    assert mark(campaign, *arguments).exit_code == 2


def requests_in(recording: Path) -> list[dict]:
    files = (recording / "running.h5.journal" / "marks").glob("*.json")
    return [json.loads(file.read_text()) for file in files]


def test_a_new_region_is_sent_to_the_running_recording(campaign, recording):
    rect = ["--rect", "60,60,30,30"]
    result = CliRunner().invoke(main, ["roi", "add", "-C", str(campaign), "b15", *rect, "--tilt", "15"])
    assert result.exit_code == 0, result.output
    assert "running.h5" in result.stderr
    (request,) = requests_in(recording)
    assert request["do"] == "regions"
    assert [region["name"] for region in request["regions"]] == ["b15"]


def test_a_region_that_a_recording_could_not_use_is_not_written_either(campaign, recording):
    assert (
        CliRunner().invoke(main, ["roi", "add", "-C", str(campaign), "a", "--rect", "0,0,30,30"]).exit_code
        == 0
    )
    before = (campaign / "fieldkit.toml").read_bytes()
    result = CliRunner().invoke(main, ["roi", "add", "-C", str(campaign), "b", "--rect", "10,10,30,30"])
    assert result.exit_code == 3
    assert "400 px" in result.stderr
    assert (campaign / "fieldkit.toml").read_bytes() == before
    assert len(requests_in(recording)) == 1


def test_the_shutter_is_asked_for_in_the_running_recording(campaign, recording):
    result = CliRunner().invoke(main, ["shutter", "-C", str(campaign), "--json"])
    assert result.exit_code == 0, result.output
    assert requests_in(recording) == [{"do": "shutter"}]
    assert len(json.loads(result.stdout)["request"]) == 32
