"""Marks taken back and edited afterwards: what is stored stays, everything that is read is as corrected."""

import shutil
from dataclasses import replace
from pathlib import Path

import h5py
import pytest

import fieldkit
from fieldkit.estimation.shade_evidence import DoubtfulShade
from fieldkit.model.errors import ConfigError, SessionError
from fieldkit.model.finding import Finding
from fieldkit.model.samples import Event, EventKind, Quality
from fieldkit.model.units import MINUTE_NS, SECOND_NS
from fieldkit.phrases import Words
from fieldkit.results.check import CORRECT_MARK, check
from fieldkit.sessions.finished_file import add_later_events, apply_time_map
from fieldkit.sessions.layout import LATER_EVENTS
from fieldkit.sessions.recovery import recover
from fieldkit.sessions.time_map import TimeStep
from fieldkit.sessions.writer import SessionWriter
from tests.harness import command_line
from tests.harness.recording import CountedClock, fill, header


def mark(clock: CountedClock, text: str, **data: object) -> Event:
    now = clock.mono_ns()
    return Event(EventKind.MARK, now, clock.to_utc_ns(now), text, data=data)


@pytest.fixture(scope="module")
def marked(tmp_path_factory):
    """A session with the marks 1 "wolke über b05", 2 "wind", 3 "wind" and an acknowledgement before these."""
    path, clock = tmp_path_factory.mktemp("marked") / "a.h5", CountedClock()
    writer = SessionWriter(path, header((24, 32)), clock)
    fill(writer, 10, clock)
    writer.put(mark(clock, "acknowledged: lost lux", acknowledge="lost lux"))
    writer.put(mark(clock, "wind", label="air"))
    writer.put(mark(clock, "wind"))
    writer.close()
    return path


@pytest.fixture
def path(marked, tmp_path):
    """A copy of it."""
    return Path(shutil.copy(marked, tmp_path))


def texts(session: fieldkit.Session) -> list[str]:
    return [event.text for event in session.events() if "acknowledge" not in event.data]


def test_a_mark_taken_back_is_stored_and_read_no_more(path):
    with fieldkit.open_session(path) as session:
        recorded = session.events(recorded=True)
        session.take_back("wolke über b05")
        assert texts(session) == ["wind", "wind"]
        assert list(session.marks()) == [2, 3]
        assert session.events(recorded=True)[:-1] == recorded
        assert session.has_corrected_marks
    assert "fail" not in {one.level for one in check(path, estimates=False).findings}


def test_an_edited_mark_keeps_what_is_not_given_and_counts_again(path):
    with fieldkit.open_session(path) as session:
        before = session.marks()[2]
        session.take_back(2)
        session.edit_mark(2, "gusts")
        after = session.marks()[2]
        assert (after.text, after.data) == ("gusts", before.data)
        assert after.time_ns == before.time_ns // 1000 * 1000
        session.edit_mark(2, label="storm", at="2016-11-24T15:06:40Z", to="2016-11-24T15:07:40Z")
        span = session.marks()[2]
        assert (span.text, span.data["label"]) == ("gusts", "storm")
        assert (span.data["end_ns"] - span.time_ns, span.time_ns % MINUTE_NS) == (MINUTE_NS, 40 * SECOND_NS)
        session.edit_mark(2, at="-1s")
        assert session.marks()[2].time_ns == session.end_ns - SECOND_NS
        assert "end_ns" not in session.marks()[2].data


@pytest.mark.parametrize(
    ("change", "place"),
    [
        (lambda session: session.take_back("rain"), "'rain'"),
        (lambda session: session.take_back(4), "4"),
        (lambda session: session.take_back("wind"), "wind"),
        (lambda session: session.edit_mark(2, "shade-test b51"), "b51"),
        (lambda session: session.edit_mark(2, at="at noon"), "'at noon'"),
        (lambda session: session.edit_mark(2, at="-1s", to="-2s"), "to"),
    ],
)
def test_what_cannot_be_meant_changes_nothing(path, change, place):
    before = path.read_bytes()
    with fieldkit.open_session(path) as session, pytest.raises(ConfigError) as refused:
        change(session)  # type: ignore[operator]
    assert path.read_bytes() == before
    assert place in str(refused.value)
    if place in ("4", "'rain'"):
        assert str(refused.value).count(" wind") == 2


def test_corrected_marks_have_the_times_of_a_corrected_clock(path):
    apply_time_map(path, [TimeStep(0, 3600 * SECOND_NS, "gps")])
    with fieldkit.open_session(path) as session:
        before = session.marks()[3]
        session.edit_mark(3, "gusts")
        assert session.marks()[3].time_ns // 1000 == before.time_ns // 1000
        session.edit_mark(3, at="-3s", to="-1s")
        assert session.end_ns - session.marks()[3].data["end_ns"] == pytest.approx(SECOND_NS, abs=1000)


def test_exports_have_the_marks_as_corrected(path, tmp_path):
    with fieldkit.open_session(path) as session:
        session.take_back(1)
        session.edit_mark(3, "gusts")
        session.export("netcdf", tmp_path / "out")
        table = next(iter(session.export("csv", tmp_path / "out").files))
        assert {*texts(session)} == {"wind", "gusts"}
    with h5py.File(tmp_path / "out" / "a.nc") as file:
        assert [text.decode() for text in file["events/text"][:]][1:] == ["wind", "gusts"]
    assert "wolke" not in (table.parent / "a-events.csv").read_text("utf-8")


def test_corrections_outlive_recovery_and_damage_to_them_is_named(path):
    with fieldkit.open_session(path) as session:
        session.take_back(1)
        session.edit_mark(3, "gusts")
    data = bytearray(path.read_bytes())
    data[11] = 1  # as if its writer had been killed
    path.write_bytes(data)
    with fieldkit.open_session(path) as session, pytest.raises(SessionError, match=r"(?s)a\.h5.*recover\("):
        session.take_back(2)
    recover(path)
    with fieldkit.open_session(path) as session:
        assert [mark.text for mark in session.marks().values()] == ["wind", "gusts"]
        session.take_back(2)
    with h5py.File(path) as file:
        place = file[LATER_EVENTS]["mono_ns"].id.get_chunk_info(0).byte_offset
    data = bytearray(path.read_bytes())
    data[place] ^= 1
    path.write_bytes(data)
    assert any(one.level == "fail" and LATER_EVENTS in one.text for one in check(path).findings)


@pytest.fixture
def shaded(sessions, tmp_path):
    """A session in which b15 was marked as shaded for three minutes."""
    path = tmp_path / shutil.copy(sessions[0], tmp_path)
    with fieldkit.open_session(path) as session:
        start_ns = session.start_ns // MINUTE_NS * MINUTE_NS + 4 * MINUTE_NS
        data = {"shade_test": "b15", "end_ns": start_ns + 3 * MINUTE_NS, "noted_ns": start_ns}
        event = Event(EventKind.MARK, start_ns - session.anchor_ns, start_ns, "shade-test b15", data=data)
    add_later_events(path, [event])
    return path


def test_a_mark_that_the_temperatures_contradict_is_named(shaded):
    """The bed of a session in the sun was marked as shaded: it did not cool."""
    with fieldkit.open_session(shaded) as session:
        minute = session.start_ns // MINUTE_NS + 4
    (finding,) = [one for one in check(shaded).findings if one.fix == CORRECT_MARK]
    start = DoubtfulShade("b15", minute).start
    assert finding == Finding("warn", "b15", Words("issue.doubtful_shade", time=start), CORRECT_MARK)


def slopes(path: Path, **options: object) -> tuple[list[float], int]:
    """Tilts of all minutes, and in how many b15 is shaded."""
    rows = fieldkit.estimate(path, model="paper", **options).rows  # type: ignore[arg-type]
    return rows["tilt_deg"].tolist(), int(sum(bool(one & int(Quality.SHADED)) for one in rows["flags"]))


def test_a_shade_test_taken_back_has_no_effect_on_the_slopes(sessions, shaded):
    plain, marked = slopes(sessions[0]), slopes(shaded)
    assert (plain[1], marked[1]) == (0, 3)
    assert repr(slopes(shaded, without_marks=["shade-test b15"])) == repr(plain)
    found = command_line.fieldkit("estimate", shaded, "--without-mark", "2")
    assert "'2'" in found.output
    assert "its marks: 1 shade-test b15" in found.output
    assert repr(slopes(shaded)) == repr(marked)
    with fieldkit.open_session(shaded) as session:
        session.take_back("shade-test b15")
    assert repr(slopes(shaded)) == repr(plain)


def test_a_mark_outside_the_recording_is_refused_where_it_is_made_and_found_where_it_is_there(tmp_path):
    path, clock = tmp_path / "a.h5", CountedClock()
    writer = SessionWriter(path, header((24, 32)), clock)
    fill(writer, 10, clock)
    before = mark(clock, "shade-test b05", shade_test="b05", phase="begin")
    writer.put(replace(before, time_ns=before.time_ns - 60 * MINUTE_NS))
    writer.close()
    outside = [
        finding for finding in check(path, estimates=False).findings if finding.what.startswith("mark ")
    ]
    assert [(finding.what, finding.level) for finding in outside] == [("mark 2", "warn")]
    with fieldkit.open_session(path) as session:
        for moment in ("-1h", "2016-11-25T15:06:40Z"):
            with pytest.raises(ConfigError):
                session.edit_mark(1, at=moment)
