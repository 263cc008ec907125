import json
import os
from contextlib import contextmanager
from dataclasses import replace

import pytest

from fieldkit.estimation.region_check import CameraView
from fieldkit.model.errors import StorageError
from fieldkit.model.marks import Mark
from fieldkit.model.next_step import Action
from fieldkit.model.samples import EventKind, Severity
from fieldkit.model.site import Region, RegionKind, RegionRecord, Site
from fieldkit.phrases import text_of
from fieldkit.recording.redrawing import NewRegions, Redrawing
from fieldkit.recording.request_reader import RequestReader, left_requests
from fieldkit.recording.requests import Acknowledgement, Shutter, inbox, send
from fieldkit.simulation.simulated_clock import SimulatedClock
from tests.harness.next_steps import steps
from tests.harness.rights import ordinary_rights

NOON_NS = 1_451_674_800_000_000_000  # 2016-01-01T19:00:00Z, noon in Denver


# a mistyped century, a journey of a thousand years, and JSON's way to write what is no number
TOO_FAR = [
    "2926-12-11T12:31+09:00",
    "1026-12-11T12:31+09:00",
    3.2e10,
    -3.2e10,
    10**25,
    float("inf"),
    float("nan"),
]


@pytest.fixture
def clock():
    return SimulatedClock(NOON_NS)


def noted(event):
    """What an event keeps of a mark, apart from the id of the request."""
    return {key: value for key, value in event.data.items() if key != "request"}


@pytest.fixture
def folder(tmp_path):
    folder = inbox(tmp_path / "x.h5")
    folder.mkdir(parents=True)
    return folder


def test_a_mark_becomes_an_event_now_and_is_read_once(folder, clock):
    number = send(folder, Mark("windy"))
    (event,) = RequestReader(folder, clock)()
    assert (event.kind, event.text) == (EventKind.MARK, "windy")
    assert (event.time_ns, event.mono_ns) == (NOON_NS, clock.mono_ns())
    assert event.data == {"request": number}
    assert list(RequestReader(folder, clock)()) == []


def test_seconds_before_now_count_from_the_recordings_own_now(folder, clock):
    send(folder, Mark("cloud", "cloud", at=-240.0, to=-60.0))
    (event,) = RequestReader(folder, clock)()
    assert event.time_ns == NOON_NS - 240 * 10**9
    assert event.mono_ns == clock.mono_ns() - 240 * 10**9
    assert noted(event) == {"label": "cloud", "end_ns": NOON_NS - 60 * 10**9}


@pytest.mark.parametrize(
    ("text", "phase"),
    [("shade-test b15", "begin"), ("Shade test of b15 begin", "begin"), ("shade-test b15 end", "end")],
)
def test_a_shade_test_says_which_region_and_when_that_was_known(folder, clock, text, phase):
    send(folder, Mark(text, at=-30.0))
    (event,) = RequestReader(folder, clock)()
    assert (event.text, event.time_ns) == (text, NOON_NS - 30 * 10**9)
    assert noted(event) == {"shade_test": "b15", "phase": phase, "noted_ns": NOON_NS}


def test_a_shade_test_told_afterwards_has_both_ends(folder, clock):
    send(folder, Mark("shade-test b15", at=-360.0, to=-60.0))
    (event,) = RequestReader(folder, clock)()
    assert noted(event) == {"shade_test": "b15", "end_ns": NOON_NS - 60 * 10**9, "noted_ns": NOON_NS}


def test_an_absolute_time_is_taken_in_its_own_zone(folder, clock):
    send(folder, Mark("shadow", at="2016-01-01T11:59:30.25-07:00"))
    (event,) = RequestReader(folder, clock)()
    assert event.time_ns == NOON_NS - 29_750_000_000
    assert event.mono_ns == clock.mono_ns() - 29_750_000_000


def test_a_half_written_mark_is_not_seen(folder, clock):
    (folder / ".half").write_text('{"text": "ha')
    assert list(RequestReader(folder, clock)()) == []


@pytest.mark.parametrize("content", ["{", "[]", "3", '{"nonsense": 1}'])
def test_a_file_that_is_no_mark_becomes_a_warning_and_stops_nothing(folder, clock, content):
    send(folder, Mark("good"))
    (folder / "0.json").write_text(content)
    events = {event.severity: event for event in RequestReader(folder, clock)()}
    assert events[Severity.INFO].text == "good"
    assert content in events[Severity.WARNING].text


@pytest.mark.parametrize(
    "times", [{"at": "12:31"}, *({key: when} for key in ("at", "to") for when in TOO_FAR)], ids=str
)
def test_a_mark_of_an_impossible_time_is_kept_with_its_text_and_time_in_words(folder, clock, times):
    (folder / "0.json").write_text(json.dumps({"do": "mark", "text": "windy", **times}))
    (event,) = RequestReader(folder, clock)()
    assert event.severity is Severity.WARNING
    assert "windy (at " in event.text
    assert str(*times.values()) in event.text
    assert "{" not in event.text


def test_a_folder_that_cannot_be_made_is_no_marks(tmp_path, clock):
    marks = RequestReader(tmp_path / "absent" / "marks", clock)
    assert [*marks(), *marks.close()] == []


def test_after_the_last_look_no_mark_can_be_dropped(folder, clock):
    marks = RequestReader(folder, clock)
    send(folder, Mark("the last"))
    last = marks.close()
    with pytest.raises(FileNotFoundError):
        send(folder, Mark("too late"))
    assert [event.text for event in last] == ["the last"]


def test_marks_of_a_recording_that_was_killed_at_its_last_look_are_left(folder, clock):
    marks = RequestReader(folder, clock)
    send(folder, Mark("the last"))
    marks.close()  # nobody goes through them
    assert [event.text for event in left_requests(folder)] == ["the last"]


@pytest.fixture
def hiccup(folder):
    """While in it, the folder of the marks cannot be looked into, as on a network drive that is away."""

    @contextmanager
    def hiccup():
        folder.parent.chmod(0)
        try:
            with ordinary_rights():
                yield
        finally:
            folder.parent.chmod(0o700)

    return hiccup


def test_marks_that_cannot_be_looked_at_just_now_are_found_later(folder, clock, hiccup):
    send(folder, Mark("wind"))
    marks = RequestReader(folder, clock)
    with hiccup():
        assert list(marks()) == []
    assert [event.text for event in marks()] == ["wind"]


def test_marks_that_cannot_be_read_at_the_end_keep_the_session_from_being_sealed(folder, clock, hiccup):
    send(folder, Mark("wind"))
    marks = RequestReader(folder, clock)
    with hiccup():
        with pytest.raises(StorageError, match="Permission denied") as caught:
            marks.close()
        with pytest.raises(StorageError, match="Permission denied"):
            left_requests(folder)
    assert [step.action for step in steps(caught.value)] == [Action.RECOVER]
    assert [event.text for event in left_requests(folder)] == ["wind"]


def test_a_mark_that_cannot_be_removed_is_taken_once(folder, clock):
    send(folder, Mark("sudo"))
    folder.chmod(0o500)
    marks = RequestReader(folder, clock)
    with ordinary_rights():
        assert [event.text for event in (*marks(), *marks())] == ["sudo"]
    assert list(folder.glob("*.json"))


def test_a_mark_that_could_not_be_stored_stays_and_comes_again(folder, clock):
    """As on a full disk: the recorder stops at it, and looks again a second later."""
    for number in range(3):
        file = folder / f"{send(folder, Mark(f'mark {number}'))}.json"
        os.utime(file, (1e9 + number, 1e9 + number))
    marks = RequestReader(folder, clock)
    events = marks()
    assert [next(events).text, next(events).text] == ["mark 0", "mark 1"]
    events.close()  # the second was not stored
    assert len(list(folder.glob("*.json"))) == 2
    assert [event.text for event in marks()] == ["mark 1", "mark 2"]
    assert list(folder.glob("*.json")) == []


def test_a_time_without_a_zone_is_not_guessed(folder, clock):
    send(folder, Mark("shadow", at="2016-01-01T11:59:30"))
    (event,) = RequestReader(folder, clock)()
    assert event.severity is Severity.WARNING
    assert "time zone" in event.text
    assert event.time_ns == NOON_NS


VIEWS, SITE = {"": CameraView((120, 160))}, Site(37.7, -105.9, 2317.0)


@pytest.fixture
def bed():
    return Region("b15", RegionKind.TARGET, ((60.0, 60.0), (89.0, 60.0), (89.0, 89.0), (60.0, 89.0)), 15.0)


def test_new_regions_hold_from_the_next_full_minute(folder, clock, bed):
    number = send(folder, NewRegions.of((bed,)))
    reader = RequestReader(folder, clock, Redrawing((), VIEWS, SITE))
    record, event = reader()
    assert (repr(record.region), record.time_ns) == (repr(bed), NOON_NS + 60 * 10**9)
    assert event.data == {"request": number, "from_ns": record.time_ns, "added": ["b15"]}
    assert reader.redrawing.regions == (record.region,)


@pytest.mark.parametrize(
    ("corners", "why"),
    [
        (((60, 60), (200, 60), (200, 90)), "160 x 120"),
        (((60, 60), (65, 60), (65, 65)), "too small"),
        (((60, 60), (90, 90), (90, 60), (60, 90)), "crosses itself"),
        (((10, 10), (40, 10), (40, 40), (10, 40)), "shares"),
    ],
)
def test_a_bad_region_is_refused_and_the_others_stay(folder, clock, bed, corners, why):
    flat = Region("flat", RegionKind.REFERENCE, ((10, 10), (40, 10), (40, 40), (10, 40)))
    redrawing = Redrawing((flat,), VIEWS, SITE)
    number = send(folder, NewRegions.of((flat, replace(bed, points_px=corners))))
    (event,) = RequestReader(folder, clock, redrawing)()
    assert (event.kind, event.severity) == (EventKind.REGION, Severity.WARNING)
    assert event.text.startswith("regions not changed: ")
    assert why in event.text
    assert event.data["request"] == number
    assert event.text.endswith("; ".join(text_of(event.data["refusals"])))
    assert redrawing.regions == (flat,)


def test_regions_that_could_not_be_stored_come_again_and_those_stored_stay(folder, clock, bed):
    beds = tuple(
        replace(bed, name=f"b{n}", points_px=((n, 0), (n + 20, 0), (n + 20, 20), (n, 20))) for n in (0, 30)
    )
    send(folder, NewRegions.of(beds))
    reader = RequestReader(folder, clock, Redrawing((), VIEWS, SITE))
    items = reader()
    assert [next(items).region.name, next(items).region.name] == ["b0", "b30"]
    items.close()  # the second was not stored
    assert [item.region.name for item in reader() if isinstance(item, RegionRecord)] == ["b30"]


def test_requests_that_a_killed_recording_did_not_carry_out_are_named(folder, bed):
    for request in (NewRegions.of((bed,)), Shutter(), Acknowledgement("disk")):
        send(folder, request)
    requests = {event.text.rpartition(": ")[2] for event in left_requests(folder)}
    assert requests == {"regions", "shutter", "disk"}
