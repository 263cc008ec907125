"""A time map corrects everything that is read, and nothing that was written."""

import json
import shutil
from collections.abc import Callable
from dataclasses import asdict, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import h5py
import pandas as pd
import pytest
from mcap.reader import make_reader

from fieldkit.model.clock import ClockCheck
from fieldkit.model.errors import SessionError, StorageError
from fieldkit.model.next_step import Action
from fieldkit.model.samples import Event, EventKind, Frame, Health
from fieldkit.model.slope import SlopeEstimate, SlopeState
from fieldkit.results.export import export
from fieldkit.results.session import Session, Stream
from fieldkit.results.session import open_session as open_whole
from fieldkit.sessions.check import check
from fieldkit.sessions.digests import object_paths
from fieldkit.sessions.file_tree import LIBVER
from fieldkit.sessions.finished_file import add_later_events, apply_time_map, changing_path
from fieldkit.sessions.formats.exports import EXPORTS
from fieldkit.sessions.formats.imported import ImportedRecording
from fieldkit.sessions.formats.merged import merge
from fieldkit.sessions.layout import RECOVERED
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.records import MinuteRecord, RegionRecord
from fieldkit.sessions.recovery import rebuild
from fieldkit.sessions.time_map import TimeStep
from fieldkit.sessions.writer import SessionWriter
from tests.harness.learnt import learnt
from tests.harness.next_steps import at, steps
from tests.harness.recording import CountedClock, header, recorded, sample, session_of

S = 1_000_000_000
HEADER = replace(
    header((24, 32)),
    license="CC-BY-4.0",
    config_toml="[campaign]\nexact_place = false\n",  # an RO-Crate without the session, which keeps its times
)
CAMERA, LUX, _ = HEADER.streams
STEPS = [TimeStep(0, 3600 * S, "stepped"), TimeStep(3 * S, 4260 * S, "slept 660 s")]
"""The clock was an hour late, and after the third second the computer slept for eleven minutes."""


@pytest.fixture(scope="module")
def corrected(tmp_path_factory):
    """Five pictures a second apart, with a mark from second 2 to second 4 and the health of second 4."""
    utc_ns = CountedClock().to_utc_ns
    cloud = Event(EventKind.MARK, 2 * S, utc_ns(2 * S), "cloud", data={"end_ns": utc_ns(4 * S)})
    health = Health(4 * S, utc_ns(4 * S), (), 0, 0, 0.0, 0.0, 0.0)
    frames = (sample(CAMERA, n, n * S) for n in range(5))
    path = session_of(tmp_path_factory.mktemp("corrected") / "a.h5", HEADER, *frames, cloud, health)
    apply_time_map(path, STEPS)
    return path


@pytest.fixture
def path(corrected, tmp_path):
    return Path(shutil.copy(corrected, tmp_path))


def test_same_instant_has_the_same_time_wherever_it_is_read(path):
    with open_session(path) as session:
        times_ns = [frame.time_ns for frame in session.samples("camera")]
        (mark,), (health,) = session.events(), session.health()
        assert (mark.time_ns, mark.data["end_ns"]) == (times_ns[2], times_ns[4])
        assert health.time_ns == times_ns[4]
        assert (session.start_ns, session.end_ns) == (times_ns[0], times_ns[4])
        assert session.end_ns - session.start_ns == 664 * S  # four seconds awake, eleven minutes asleep


def test_times_are_corrected_at_once_or_not_at_all(path):
    """Also where the copy cannot be made, as on a disk that is full or read-only."""
    before = path.read_bytes()
    changing_path(path).mkdir()
    with pytest.raises(StorageError, check=at(path)) as refused:
        apply_time_map(path, [TimeStep(0, S, "gps")])
    assert refused.value.fix
    assert path.read_bytes() == before
    changing_path(path).rmdir()
    apply_time_map(path, [TimeStep(0, S, "gps")])
    with open_session(path) as session:
        assert session.time_map() == [TimeStep(0, S, "gps")]
    assert [item.name for item in path.parent.iterdir()] == ["a.h5"]


def test_recovery_and_checks_see_what_was_recorded(path):
    utc_ns = CountedClock().to_utc_ns
    with open_session(path) as session:
        (mark,), (health,) = session.events(recorded=True), session.health(recorded=True)
        assert (mark.time_ns, mark.data["end_ns"], health.time_ns) == tuple(utc_ns(n * S) for n in (2, 4, 4))
        assert [frame.time_ns for frame in session.samples(recorded=True)] == [
            utc_ns(n * S) for n in range(5)
        ]
    assert not [one for one in check(path) if one.level == "fail"]


def test_recovered_file_keeps_recorded_times(path):
    rebuild(path, RECOVERED)
    with open_session(path) as session:
        (mark,) = (one for one in session.events(recorded=True) if one.kind is EventKind.MARK)
        assert mark.time_ns == CountedClock().to_utc_ns(2 * S)


def test_log_beside_a_corrected_session_keeps_its_own_times(path, tmp_path):
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


def test_log_is_not_put_beside_a_session_whose_journal_holds_more(tmp_path):
    """The new session would be sealed without what the journal alone has."""
    writer = SessionWriter(tmp_path / "a.h5", HEADER, CountedClock())
    for n in range(5):
        writer.append(sample(CAMERA, n))
    writer.abandon()
    log = replace(LUX, name="logger")
    with open_session(tmp_path / "a.h5") as session:
        with pytest.raises(SessionError, match="interrupted") as refused:
            merge(session, ImportedRecording((log,), [sample(log, 0)]), tmp_path / "b.h5", "log.csv")
        assert [step.action for step in steps(refused.value)] == [Action.RECOVER]
    assert not (tmp_path / "b.h5").exists()


# --- every output: a session recorded an hour late and corrected, beside one recorded at the right time

LATE_NS = 3_601_234_567_000
"""An hour and a bit, in whole microseconds, in which tables are stored."""
MOMENTS = ("begin_ns", "end_ns", "from_ns", "since_ns", "noted_ns", "after_ns", "before_ns")


class ClockAhead(CountedClock):
    """The same clock, ahead by a constant."""

    def __init__(self, ahead_ns: int) -> None:
        super().__init__()
        self._ahead_ns = ahead_ns

    def to_utc_ns(self, mono_ns: int) -> int:
        return super().to_utc_ns(mono_ns) + self._ahead_ns


def full_session(path: Path, ahead_ns: int) -> Path:
    """Five seconds of everything that a session can hold."""
    clock = ClockAhead(ahead_ns)
    writer = SessionWriter(path, HEADER, clock)
    utc_ns = [clock.to_utc_ns(n * S) for n in range(130)]
    for n in range(5):
        for info in HEADER.streams:
            writer.append(sample(info, n, n * S, utc_ns[n]))
    writer.put(Event(EventKind.MARK, 2 * S, utc_ns[2], "cloud", data=dict.fromkeys(MOMENTS, utc_ns[4])))
    writer.put(Event(EventKind.SLEPT, 2 * S, utc_ns[2], "slept", data={"slept_ns": 5}))
    writer.put(Health(4 * S, utc_ns[4], (), 0, 0, 0.0, 0.0, 0.0))
    writer.put(ClockCheck(3 * S, utc_ns[0] - ahead_ns + LATE_NS, 50, "gps"))
    _, target = HEADER.regions
    moved = replace(target, points_px=tuple((x + 1.0, y) for x, y in target.points_px))
    writer.put(RegionRecord(moved, utc_ns[60]))
    writer.put(RegionRecord(replace(target, name="later"), utc_ns[60]))
    slopes = [
        SlopeEstimate(utc_ns[4], name, SlopeState.OK, 5.0, 180.0, window_start_ns=utc_ns[1])
        for name in (target.name, "later")
    ]
    writer.put(MinuteRecord(utc_ns[4], tuple(slopes), 800.0, "eq10", learnt=learnt()))
    writer.close()
    return path


BY_STREAM: dict[str, Callable[[Any], list[int]]] = {
    "times_ns": lambda found: found.tolist(),
    "samples": lambda found: [one.time_ns for one in found],
    "readings": lambda found: found.time_ns.tolist(),
    "region_series": lambda found: found.time_ns.tolist(),
    "to_pandas": lambda found: found.index.asi8.tolist(),
    "to_xarray": lambda found: found["time"].values.tolist(),
}
OF_SESSION = {
    "start_ns", "end_ns", "region_schedule", "events", "health", "region_history", "region_changes",
    "estimates", "learnt", "irradiance", "minutes", "timed_table", "marks",
}  # fmt: skip
OTHERWISE = {"stream", "export", "plot", "estimate", "slope_map", "report", "take_back", "edit_mark"}
"""Tested below, and in `tests/unit/results/test_from_python.py` and `test_corrected_marks.py`."""
WITHOUT_TIMES = {
    "check", "clock_checks", "close", "columns_are_sealed", "config_toml", "count", "damaged", "flags",
    "group", "has_corrected_marks", "identity", "is_closed", "kelvin", "missing_corrections", "name",
    "object_digest", "provenance", "raw", "refresh", "regions", "require_finished", "require_open",
    "sealed_objects", "tables", "time_map", "was_finished",
}  # fmt: skip
AS_STORED = {"table", "datasets", "entries"}


def outputs(session: Session) -> dict[str, object]:
    """Everything with a time in it that a session's methods return."""
    found: dict[str, object] = {}
    for name in OF_SESSION - {"timed_table", "irradiance"}:
        value = getattr(session, name)
        found[name] = json.dumps(value() if callable(value) else value, default=asdict)  # there NaN is NaN
    found["irradiance"] = session.irradiance()["time_ns"].tolist()
    for name in session.tables:
        table = session.timed_table(name)
        found[f"table {name}"] = {key: table[key].tolist() for key in table if key.endswith("_ns")}
    found["all samples"] = [one.time_ns for one in session.samples()]
    for name, info in session.streams.items():
        reader = session.stream(name)
        found[f"{name}: stored"] = reader.time_ns().tolist(), [one.time_ns for one in reader.samples()]
        for method in BY_STREAM.keys() - {"readings" if info.is_camera else "region_series"}:
            found[f"{name}: {method}"] = BY_STREAM[method](getattr(session[name], method)())
    return found


def contents(path: Path) -> object:
    """What an exported file holds, but for what identifies the session."""
    match path.suffix:
        case ".parquet":
            return pd.read_parquet(path).to_csv()
        case ".nc":
            with h5py.File(path, "r") as file:
                paths = object_paths(file)
                datasets = {path: file[path] for path in paths if isinstance(file[path], h5py.Dataset)}
                return {path: data[()].tobytes() for path, data in datasets.items() if "crc32" not in path}
        case ".mcap":
            messages = make_reader(BytesIO(path.read_bytes())).iter_messages()
            return [(channel.topic, message.log_time, message.data) for _, channel, message in messages]
        case ".json":
            graph = json.loads(path.read_text(encoding="utf-8")).get("@graph", [])
            return [{key: value for key, value in one.items() if key != "identifier"} for one in graph]
    return path.read_bytes()


@pytest.fixture(scope="module")
def corrected_and_right(tmp_path_factory):
    """Both are only read."""
    late, right = (tmp_path_factory.mktemp(name) / "a.h5" for name in ("late", "right"))
    apply_time_map(full_session(late, 0), [TimeStep(0, LATE_NS, "gps")])
    full_session(right, LATE_NS)
    with open_whole(late) as one, open_whole(right) as other:
        yield one, other


def test_every_method_returns_corrected_times(corrected_and_right):
    corrected, right = map(outputs, corrected_and_right)
    assert {name: (corrected[name], right[name]) for name in right if corrected[name] != right[name]} == {}


def test_no_method_of_a_session_was_forgotten():
    public = {name for kind in (Session, Stream) for name in dir(kind) if not name.startswith("_")}
    known = OF_SESSION | BY_STREAM.keys() | OTHERWISE | WITHOUT_TIMES | AS_STORED | {"counts"}
    assert public == known


@pytest.mark.parametrize("kind", list(EXPORTS))
def test_every_export_has_corrected_times(corrected_and_right, kind, tmp_path):
    corrected, right = (
        export(session, kind, tmp_path / session.path.parent.name / "out").files
        for session in corrected_and_right
    )
    assert [path.name for path in corrected] == [path.name for path in right]
    assert corrected
    for one, other in zip(corrected, right, strict=True):
        assert contents(one) == contents(other), one.name


@pytest.mark.parametrize("removed", ["later_events", "time_map"])
def test_corrections_that_were_removed_again_are_found(tmp_path, removed):
    path = tmp_path / "a.h5"
    recorded(path, header((24, 32)), 10)
    add_later_events(path, [Event(EventKind.MARK, 0, 0, "seen later")])
    apply_time_map(path, [TimeStep(0, 10**9, "a test")])
    assert not [finding for finding in check(path) if finding.level == "fail"]
    with h5py.File(path, "r+", libver=LIBVER) as file:
        if removed == "later_events":
            del file["later_events"]
        else:
            for column in file["time_map"].values():
                column.resize((0,))
    assert [finding.what for finding in check(path) if finding.level == "fail"] == [removed]
