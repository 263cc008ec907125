"""A time map corrects everything that is read, and nothing that was written."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from fieldkit.model.errors import SessionError, StorageError
from fieldkit.model.samples import Event, EventKind, Frame, Health
from fieldkit.sessions.check import check
from fieldkit.sessions.clock_correction import apply_time_map, changing_path
from fieldkit.sessions.formats.imported import ImportedRecording
from fieldkit.sessions.formats.merged import merge
from fieldkit.sessions.layout import RECOVERED
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.recovery import rebuild
from fieldkit.sessions.time_map import TimeStep
from fieldkit.sessions.writer import SessionWriter
from tests.harness.recording import CountedClock, header, sample

S = 1_000_000_000
HEADER = header((24, 32))
CAMERA, LUX, _ = HEADER.streams
STEPS = [TimeStep(0, 3600 * S, "stepped"), TimeStep(3 * S, 4260 * S, "slept 660 s")]
"""The clock was an hour late, and after the third second the computer slept for eleven minutes."""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Five pictures a second apart, with a mark from second 2 to second 4 and the health of second 4."""
    clock = CountedClock()
    writer = SessionWriter(tmp_path / "a.h5", HEADER, clock)
    for n in range(5):
        writer.append(sample(CAMERA, n, n * S, clock.to_utc_ns(n * S)))
    until = {"end_ns": clock.to_utc_ns(4 * S)}
    writer.event(Event(EventKind.MARK, 2 * S, clock.to_utc_ns(2 * S), "cloud", data=until))
    writer.health(Health(4 * S, clock.to_utc_ns(4 * S), (), 0, 0, 0.0, 0.0, 0.0))
    writer.close()
    apply_time_map(tmp_path / "a.h5", STEPS)
    return tmp_path / "a.h5"


def test_same_instant_has_the_same_time_wherever_it_is_read(path: Path) -> None:
    with open_session(path) as session:
        times_ns = [frame.time_ns for frame in session.samples("camera")]
        (mark,), (health,) = session.events(), session.health()
        assert (mark.time_ns, mark.data["end_ns"]) == (times_ns[2], times_ns[4])
        assert health.time_ns == times_ns[4]
        assert (session.start_ns, session.end_ns) == (times_ns[0], times_ns[4])
        assert session.end_ns - session.start_ns == 664 * S  # four seconds awake, eleven minutes asleep


def test_times_are_corrected_at_once_or_not_at_all(path: Path) -> None:
    """Also where the copy cannot be made, as on a disk that is full or read-only."""
    before = path.read_bytes()
    changing_path(path).mkdir()
    with pytest.raises(StorageError, match="could not be corrected") as refused:
        apply_time_map(path, [TimeStep(0, S, "gps")])
    assert "nothing was changed" in (refused.value.fix or "")
    assert path.read_bytes() == before
    changing_path(path).rmdir()
    apply_time_map(path, [TimeStep(0, S, "gps")])
    with open_session(path) as session:
        assert session.time_map() == [TimeStep(0, S, "gps")]
    assert [item.name for item in path.parent.iterdir()] == ["a.h5"]


def test_recovery_and_checks_see_what_was_recorded(path: Path) -> None:
    utc_ns = CountedClock().to_utc_ns
    with open_session(path) as session:
        (mark,), (health,) = session.events(recorded=True), session.health(recorded=True)
        assert (mark.time_ns, mark.data["end_ns"], health.time_ns) == tuple(utc_ns(n * S) for n in (2, 4, 4))
        assert [frame.time_ns for frame in session.samples(recorded=True)] == [
            utc_ns(n * S) for n in range(5)
        ]
    assert not [one for one in check(path) if one.level == "fail"]


def test_recovered_file_keeps_recorded_times(path: Path) -> None:
    rebuild(path, RECOVERED)
    with open_session(path) as session:
        (mark,) = (one for one in session.events(recorded=True) if one.kind is EventKind.MARK)
        assert mark.time_ns == CountedClock().to_utc_ns(2 * S)


def test_log_beside_a_corrected_session_keeps_its_own_times(path: Path, tmp_path: Path) -> None:
    with open_session(path) as session:
        pictures_ns = [frame.time_ns for frame in session.samples("camera")]
        logged_ns = [*pictures_ns, pictures_ns[2] + 300 * S]  # the last while the computer slept
        log = replace(LUX, name="logger")
        readings = [sample(log, n, time_ns, time_ns) for n, time_ns in enumerate(sorted(logged_ns))]
        merge(session, ImportedRecording((log,), readings), tmp_path / "b.h5", "log.csv")
    with open_session(tmp_path / "b.h5") as session:
        read_us = [one.time_ns // 1000 for one in session.samples("logger")]  # as they are stored
        assert read_us == [time_ns // 1000 for time_ns in sorted(logged_ns)]
        assert [one.time_ns for one in session.samples("camera")] == pictures_ns
        assert session.events()[0].time_ns == pictures_ns[2]
        assert session.time_map() == STEPS
        beside = [one.stream for one in session.samples() if isinstance(one, Frame) or one.seq < 3]
        assert beside == ["camera", "logger"] * 3 + ["camera"] * 2


def test_log_is_not_put_beside_a_session_whose_journal_holds_more(tmp_path: Path) -> None:
    """The new session would be sealed without what the journal alone has."""
    writer = SessionWriter(tmp_path / "a.h5", HEADER, CountedClock())
    for n in range(5):
        writer.append(sample(CAMERA, n))
    writer.abandon()
    log = replace(LUX, name="logger")
    with open_session(tmp_path / "a.h5") as session:
        with pytest.raises(SessionError, match="is interrupted") as refused:
            merge(session, ImportedRecording((log,), [sample(log, 0)]), tmp_path / "b.h5", "log.csv")
        assert "fieldkit recover" in (refused.value.fix or "")
    assert not (tmp_path / "b.h5").exists()
