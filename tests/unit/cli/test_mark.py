import json
import os
import re
import subprocess
import sys
import threading
from datetime import UTC, datetime
from pathlib import Path

import pytest
from click.testing import Result

import fieldkit
from fieldkit.model.errors import ConfigError, RefusedError
from fieldkit.model.samples import Event, EventKind
from fieldkit.recording.campaign import init_campaign
from fieldkit.recording.request_reader import RequestReader
from fieldkit.recording.running import session_in_progress
from fieldkit.sessions.lock import SessionLock
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.writer import SessionWriter
from fieldkit.simulation.simulated_clock import SimulatedClock
from tests.harness.command_line import document, invoke, succeed
from tests.harness.command_line import fieldkit as run
from tests.harness.next_steps import at
from tests.harness.recorder_process import recorder
from tests.harness.recording import CountedClock, fill, header, session_of
from tests.harness.waiting import wait_until

NOON_NS = 1_451_674_800_000_000_000


@pytest.fixture
def campaign(tmp_path):
    succeed("init", tmp_path)
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


def mark(campaign: Path, *arguments: str) -> Result:
    return succeed("mark", "-C", campaign, *arguments)


def events_in(recording: Path) -> list[Event]:
    """The events of the marks that wait for the recorder."""
    return list(RequestReader(recording / "running.h5.journal" / "marks", SimulatedClock(NOON_NS))())


def test_a_mark_reaches_the_session_that_is_recorded(campaign, recording):
    result = mark(campaign, "ridge", "-k", "cloud", "--at", "-30s", "--json")
    (event,) = events_in(recording)
    assert (event.text, event.data["label"]) == ("ridge", "cloud")
    assert event.time_ns == NOON_NS - 30 * 10**9
    assert json.loads(result.stdout)["session"].endswith("running.h5")


def stored(folder: Path, event: Event) -> Event:
    """The event as a session gives it back."""
    with open_session(session_of(folder / "a.h5", header((24, 32)), event)) as session:
        return session.events()[0]


@pytest.mark.parametrize(
    "text",
    ["shade", "y" * 700, "風が強くなった、" * 35, 'a "quoted" word, ' * 40],
    ids=["short", "letters", "Japanese", "quotes"],
)
def test_a_mark_is_stored_whole_with_its_span(campaign, recording, tmp_path, text):
    mark(campaign, text, "-k", "cloud", "--from", "-4m", "--until", "-1m")
    (event,) = events_in(recording)
    assert event.time_ns == NOON_NS - 240 * 10**9
    whole = stored(tmp_path, event)
    assert whole.text == text
    assert whole.data == {**event.data, "label": "cloud", "end_ns": NOON_NS - 60 * 10**9}


@pytest.mark.parametrize("arguments", [("x" * 3000,), ("shade", "-k", "k" * 1100), ("\x01" * 300,)])
def test_a_mark_that_cannot_be_kept_whole_is_refused_not_cut(campaign, recording, arguments):
    with pytest.raises(ConfigError):
        invoke("mark", "-C", campaign, *arguments, "--from", "-4m", "--until", "-1m")
    assert list((recording / "running.h5.journal" / "marks").iterdir()) == []


def test_bytes_of_a_latin_1_terminal_are_kept_as_they_were_typed(campaign, recording):
    done = subprocess.run(
        [sys.executable, "-m", "fieldkit", "mark", "-C", str(campaign), b"caf\xe9 opens", "-k", b"\xfcbel"],
        capture_output=True, check=False, env={**os.environ, "PYTHONUTF8": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert b"caf\\xe9 opens" in done.stderr
    (event,) = events_in(recording)
    assert (event.text, event.data["label"]) == ("caf\\xe9 opens", "\\xfcbel")


def test_a_mark_on_a_session_that_is_being_sealed_is_refused_not_lost(campaign, recording):
    RequestReader(recording / "running.h5.journal" / "marks", SimulatedClock(NOON_NS)).close()
    with pytest.raises(RefusedError, match=r"running\.h5"):
        invoke("mark", "-C", campaign, "packed up")


def test_a_mark_right_after_the_start_waits_until_the_recording_accepts_it(campaign, recording):
    folder = recording / "running.h5.journal" / "marks"
    folder.rmdir()  # as between the lock of a session and its first look for requests
    later = threading.Timer(0.5, folder.mkdir)
    later.start()
    mark(campaign, "sun")
    later.join()
    assert [event.text for event in events_in(recording)] == ["sun"]


def test_interrupted_sessions_are_not_in_progress(campaign):
    (campaign / "recordings" / "old.h5.journal").mkdir()
    assert session_in_progress(campaign / "recordings") is None
    assert session_in_progress(campaign / "nowhere") is None


def test_times_that_cannot_be_meant_leave_no_mark(campaign, recording):
    result = run("mark", "-C", campaign, "x", "--from", "-1m", "--until", "-4m")
    assert result.exit_code == ConfigError.exit_code
    assert "--until: " in result.stderr
    longest = run("mark", "-C", campaign, "wind", "--for", "5m")  # only a shade test that begins has one
    assert longest.exit_code == ConfigError.exit_code
    assert not any((recording / "running.h5.journal" / "marks").iterdir())


@pytest.fixture
def b15(campaign, recording):
    """A region of the campaign that is being recorded."""
    corners = ("--points", "18,77", "64,74", "65,101", "15,106")
    succeed("roi", "add", "-C", campaign, "b15", "--reference", *corners)


def test_a_shade_test_needs_no_quotes(campaign, recording, b15):
    mark(campaign, "shade-test", "b15", "end", "--at", "-30s")
    *_, event = events_in(recording)
    del event.data["request"]
    assert event.data == {"shade_test": "b15", "phase": "end", "noted_ns": NOON_NS}


@pytest.mark.parametrize(
    ("arguments", "effect", "minutes"),
    [
        ((), "shaded .* latest", [20]),
        (("--for", "7m"), "shaded .* latest", [7]),
        (("end",), "sunlit", []),
        (("--from", "12:10", "--until", "12:14"), "shaded", [4]),
    ],
)
def test_a_shade_test_says_at_once_what_it_does(campaign, recording, b15, arguments, effect, minutes):
    said = mark(campaign, "shade-test", "b15", *arguments).stderr
    assert re.search(f"b15 .*{effect}", said)
    times = [datetime.strptime(clock_time, "%H:%M") for clock_time in re.findall(r"\d\d:\d\d", said)]
    assert [(end - times[0]).seconds // 60 for end in times[1:]] == minutes
    *_, event = events_in(recording)
    assert event.data.get("for_s") == (420.0 if "--for" in arguments else None)


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
    mark(campaign, "--take-back", "1")
    assert "squalls" in mark(campaign, "--edit", "wind", "squalls", "-k", "air", "--session", path).stderr
    listed = document("mark", "-C", campaign, "--list")["marks"]
    assert [(row["mark"], row["text"]) for row in listed] == [(2, "air: squalls")]
    with pytest.raises(ConfigError, match="1 wolke über b05; 2 squalls", check=at("'rain'")):
        invoke("mark", "-C", campaign, "--take-back", "rain")


@pytest.fixture
def simulated(tmp_path):
    """A simulated campaign, its session, and the process that records it."""
    init_campaign(tmp_path / "field", simulated=True)
    with recorder(tmp_path / "field") as (session, process):
        yield tmp_path / "field", session, process


def test_a_running_recording_is_marked_in_the_time_of_its_scene_corrected_and_stopped_from_python(simulated):
    """The scene begins on the first of January 2016 at noon in Alamosa, seven hours behind UTC."""
    campaign, path, process = simulated
    moments = ("12:02", "20:01+01:00", "2016-01-01T12:00")
    for moment in moments:  # at once: nothing may be recorded yet
        mark(campaign, moment, "--at", moment)
    for outside in ("12:02+01:00", "2016-01-01T11:59"):
        assert run("mark", "-C", campaign, "x", "--at", outside).exit_code == ConfigError.exit_code
    for text in ("wind", "shade-test b15"):
        mark(campaign, text)
    take_back = ("mark", "-C", campaign, "--take-back", "shade-test b15")
    wait_until(lambda: run(*take_back).exit_code == 0, "the marks are not stored", every_s=0.1)
    mark(campaign, "--edit", "wind", "gusts")
    assert fieldkit.status(campaign)["session"] == str(path)
    assert fieldkit.mark("dust", fieldkit.open_campaign(campaign), kind="air").session == path
    assert fieldkit.stop(campaign) == path
    assert process.wait(60) == 0
    with open_session(path) as session:
        marks = {note.text: note for note in session.marks().values()}
        made = [event.text for event in session.events(recorded=True) if event.kind is EventKind.MARK]
    assert [datetime.fromtimestamp(marks[moment].time_ns / 1e9, UTC) for moment in moments] == [
        datetime(2016, 1, 1, 19, 2, tzinfo=UTC),
        datetime(2016, 1, 1, 19, 1, tzinfo=UTC),
        datetime(2016, 1, 1, 19, 0, tzinfo=UTC),
    ]
    assert set(marks) == {*moments, "gusts", "dust"}
    assert marks["dust"].data["label"] == "air"
    assert made == [*moments, "wind", "shade-test b15", "taken back: shade-test b15", "gusts", "dust"]


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("x", "--from", "-4m"),  # half an interval
        ("x", "--until", "-4m"),
        ("x", "--at", "-1m", "--from", "-4m", "--until", "-1m"),
        ("--take-back", "1", "x"),
        ("--take-back", "1", "--for", "5m"),
        ("--list", "--edit", "1"),
        ("x", "--session", "a.h5"),
        ("--list", "--at", "-1s"),
    ],
)
def test_what_does_not_go_together_is_wrong_usage(campaign, recording, arguments):
    assert run("mark", "-C", campaign, *arguments).exit_code == 2


def requests_in(recording: Path) -> list[dict]:
    files = (recording / "running.h5.journal" / "marks").glob("*.json")
    return [json.loads(file.read_text()) for file in files]


def test_a_new_region_is_sent_to_the_running_recording(campaign, recording):
    result = succeed("roi", "add", "-C", campaign, "b15", "--rect", "60,60,30,30", "--tilt", "15")
    assert "running.h5" in result.stderr
    (request,) = requests_in(recording)
    assert request["do"] == "regions"
    assert [region["name"] for region in request["regions"]] == ["b15"]


def test_a_region_that_a_recording_could_not_use_is_not_written_either(campaign, recording):
    succeed("roi", "add", "-C", campaign, "a", "--rect", "0,0,30,30")
    before = (campaign / "fieldkit.toml").read_bytes()
    with pytest.raises(ConfigError, match="400 px"):
        invoke("roi", "add", "-C", campaign, "b", "--rect", "10,10,30,30")
    assert (campaign / "fieldkit.toml").read_bytes() == before
    assert len(requests_in(recording)) == 1


def test_the_shutter_is_asked_for_in_the_running_recording(campaign, recording):
    assert len(document("shutter", "-C", campaign)["request"]) == 32
    assert requests_in(recording) == [{"do": "shutter"}]
