"""What goes into a session comes out again, the same, whatever went wrong on the side of the file."""

import dataclasses
import gc
import os
import shutil
from multiprocessing.queues import Queue
from multiprocessing.synchronize import Barrier
from pathlib import Path

import h5py
import pytest

from fieldkit.model.errors import ConfigError, IntegrityError, RefusedError, StorageError
from fieldkit.model.learnt import Learnt
from fieldkit.model.next_step import Action
from fieldkit.model.samples import Event, EventKind, Health, Quality, Sample, Severity, StreamHealth
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import SlopeEstimate, SlopeState
from fieldkit.recording.recordings import is_interrupted
from fieldkit.sessions import journal, session_file
from fieldkit.sessions import seal as seal_module
from fieldkit.sessions.layout import FRAME_DATASETS
from fieldkit.sessions.lock import journal_path
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.records import MinuteRecord, RegionRecord
from fieldkit.sessions.recovery import Outcome, recover
from fieldkit.sessions.writer import SessionWriter
from tests.harness.disk import full_disk
from tests.harness.next_steps import at, steps
from tests.harness.recording import SPAWN, CountedClock, fill, header, recorded, same, sample
from tests.harness.waiting import wait_until

HEADER = header((24, 32))


def appended_and_read(
    path: Path, appended: list, streams: tuple[str, ...] = ("camera", "lux", "thermometer")
) -> None:
    """Every appended sample is in the session, the same, in the order of its stamps."""
    with open_session(path) as session:
        found = list(session.samples())
        assert len(found) == len(appended)
        assert all(same(one, other) for one, other in zip(found, appended, strict=True))
        assert not any(item.quality & Quality.BAD_CRC for item in found)


def test_samples_are_the_same_to_the_nanosecond(tmp_path):
    clock = CountedClock()
    writer = SessionWriter(tmp_path / "a.h5", HEADER, clock)
    appended = fill(writer, 50, clock)
    report = writer.close()
    assert report.counts == {"camera": 50, "lux": 13, "thermometer": 13}
    assert sum(report.counts.values()) == len(appended) == 76
    assert writer.close() is report
    assert writer.is_closed
    appended_and_read(tmp_path / "a.h5", appended)
    assert [item.name for item in tmp_path.iterdir()] == ["a.h5"]


def test_entries_are_the_same(tmp_path):
    clock = CountedClock()
    writer = SessionWriter(tmp_path / "a.h5", HEADER, clock)
    now = clock.mono_ns()
    utc = clock.to_utc_ns(now)
    event = Event(EventKind.CLOUD, now, utc, "cloud ☁", "lux", Severity.WARNING, {"depth": 0.1, "n": [1, 2]})
    health = Health(
        now, utc, tuple(StreamHealth(name, 1, 2, 3, 4, 5) for name in ("camera", "lux", "thermometer")), 6
    )
    check = dataclasses.replace(clock.check(), source="gps")
    estimate = SlopeEstimate(
        60_000_000_000, "b05", SlopeState.NOT_RESOLVED, 0.1 + 0.2, 181.0, second_tilt_deg=1 / 3,
        chi_square=2.0, flags=Quality.CLOUD, n_bins=4, model="paper", reason="two slopes fit ☼",
    )  # fmt: skip
    moved = dataclasses.replace(HEADER.regions[1], points_px=((2.0, 2.0), (9.0, 2.0), (9.0, 9.5)))
    writer.put(event)
    writer.put(health)
    writer.put(check)
    writer.put(MinuteRecord(60_000_000_000, (estimate,), 812.25, "eq10 /0.44", Quality.LOW_SUN))
    writer.put(RegionRecord(moved, utc))
    writer.close()
    with open_session(tmp_path / "a.h5") as session:
        assert session.state == "sealed"
        assert session.events() == [event]
        assert session.health() == [health]
        assert session.clock_checks() == [check]
        assert repr(session.estimates()) == repr([estimate])  # by repr: NaN
        minute = session.irradiance()
        assert (minute["time_ns"][0], minute["irradiance_w_m2"][0], minute["model"][0]) == (
            60_000_000_000, 812.25, "eq10 /0.44",
        )  # fmt: skip
        assert minute["flags"][0] == Quality.LOW_SUN
        assert repr(session.regions) == repr((HEADER.regions[0], moved))
        assert [record.region.name for record in session.region_history()] == ["flat", "b05", "b05"]
        assert session.header.to_json() == HEADER.to_json()
        assert session.config_toml == HEADER.config_toml


def test_long_text_is_cut_between_characters(tmp_path):
    clock = CountedClock()
    writer = SessionWriter(tmp_path / "a.h5", HEADER, clock)
    writer.put(Event(EventKind.MARK, 1, clock.to_utc_ns(1), "é" * 300, data={"long": "x" * 2000}))
    writer.close()
    with open_session(tmp_path / "a.h5") as session:
        (event,) = session.events()
        assert event.text == "é" * 126 + "…"
        assert "left_out" in event.data


@pytest.mark.parametrize("is_killed", [False, True])
def test_entries_that_no_column_holds_keep_nothing_from_being_stored(tmp_path, is_killed):
    """Times of other ages, bytes of a file name that are no UTF-8, a region that was not declared."""
    path, clock, late = tmp_path / "caf\udce9.h5", CountedClock(), 9_223_372_036_854_775_807
    strange = dataclasses.replace(HEADER, command_line=f"fieldkit -C {path}", title=str(path))
    writer = SessionWriter(path, strange, clock)
    appended = fill(writer, 20, clock)
    utc = clock.to_utc_ns(1)
    writer.put(Event(EventKind.MARK, 28 * 10**18, 30 * 10**18, f"file {path.name}"))
    writer.put(Event(EventKind.MARK, -(10**30), -(10**30), 3))  # type: ignore[arg-type]
    streams = tuple(StreamHealth(name, 10**20, 0, 0) for name in ("camera", "lux", "thermometer"))
    writer.put(Health(1, utc, streams, -(10**20)))
    writer.put(RegionRecord(dataclasses.replace(HEADER.regions[1], name="new"), utc))
    writer.put(MinuteRecord(utc, (SlopeEstimate(utc, "b05", SlopeState.OK, n_bins=2**31),)))
    if is_killed:
        writer.abandon()
        assert recover(path).lost_samples == 0
    else:
        assert sum(writer.close().counts.values()) == len(appended)
    appended_and_read(path, appended)
    with open_session(path) as session:
        far, ancient = (event for event in session.events()[:3] if "wolke" not in event.text)
        assert (far.mono_ns, far.time_ns // 1000, far.text) == (late, late // 1000, "file caf?.h5")
        assert (ancient.mono_ns, ancient.time_ns // 1000, ancient.text) == (-late - 1, -(late // 1000), "3")
        (health,) = session.health()
        assert (health.streams[0].received, health.disk_free_bytes) == (late, -late - 1)
        assert [estimate.n_bins for estimate in session.estimates()] == [2**31 - 1]


@pytest.mark.parametrize("count", [256, 257])
def test_session_has_room_for_as_many_regions_as_a_byte_counts(tmp_path, count):
    regions = tuple(dataclasses.replace(HEADER.regions[0], name=f"r{n}") for n in range(count))
    many = dataclasses.replace(HEADER, regions=regions)
    if count > 256:
        with pytest.raises(ConfigError, match="257 regions"):
            SessionWriter(tmp_path / "a.h5", many, CountedClock())
        assert not list(tmp_path.iterdir())
        return
    SessionWriter(tmp_path / "a.h5", many, CountedClock()).close()
    with open_session(tmp_path / "a.h5") as session:
        assert [record.region.name for record in session.region_history()] == [f"r{n}" for n in range(256)]


def test_sample_that_is_not_as_declared_is_refused(tmp_path):
    writer = SessionWriter(tmp_path / "a.h5", HEADER, CountedClock())
    with pytest.raises(ValueError, match=r"\(24, 32\).*\(12, 32\)"):
        writer.append(sample(header((12, 32)).streams[0], 0))
    with pytest.raises(ValueError, match="raw bytes"):
        writer.append(sample(HEADER.streams[1], 0)._replace(raw=bytes(17)))
    frame = sample(HEADER.streams[0], 0)
    with pytest.raises(ValueError, match=r"\(2, 32\).*\(0, 32\)"):
        writer.append(frame._replace(metadata_rows=frame.metadata_rows[:0]))
    for name in ("counts", "metadata_rows"):
        with pytest.raises(ValueError, match="int32, not uint16"):
            writer.append(frame._replace(**{name: getattr(frame, name).astype("i4")}))
    many = tuple((float(n), float(n % 7)) for n in range(65))
    with pytest.raises(ValueError, match="65 corners"):
        writer.put(RegionRecord(Region("big", RegionKind.TARGET, many), 0))
    assert not any(writer.close().counts.values())


def test_what_was_not_handed_over_is_read_back_from_the_journal(tmp_path, monkeypatch):
    monkeypatch.setattr(session_file, "HANDOVER_BYTES", 4_000)  # room for one or two frames
    clock = CountedClock()
    writer = SessionWriter(tmp_path / "a.h5", HEADER, clock)
    appended = fill(writer, 200, clock)
    assert writer.close().counts["camera"] == 200
    appended_and_read(tmp_path / "a.h5", appended)


def test_long_journal_is_shortened_and_nothing_is_lost(tmp_path, monkeypatch):
    monkeypatch.setattr(journal, "PART_BYTES", 20_000)  # a full part takes 256 MB
    monkeypatch.setattr(session_file, "JOURNAL_BYTES", 60_000)  # after 750 MB parts go
    monkeypatch.setattr(session_file, "FLUSH_EVERY_S", 0.0)
    clock = CountedClock()
    path = tmp_path / "a.h5"
    writer = SessionWriter(path, HEADER, clock)
    appended = fill(writer, 300, clock)
    assert writer.close().counts["camera"] == 300
    appended_and_read(path, appended)

    path = tmp_path / "killed.h5"
    writer = SessionWriter(path, HEADER, clock)
    appended = fill(writer, 300, clock)
    first = journal_path(path) / "000001.log"
    wait_until(lambda: not first.exists(), "the first part stays")
    writer.abandon()
    report = recover(path)
    assert report.lost_samples == 0
    appended_and_read(path, appended)


def test_recording_goes_on_when_the_file_fails(tmp_path, monkeypatch):
    """The session is finished from the journal."""
    clock, path = CountedClock(), tmp_path / "a.h5"
    writer, appended = filled_without_its_file(path, 60, clock, monkeypatch)
    appended += [sample(HEADER.streams[0], 60, clock.mono_ns())]
    appended[-1] = appended[-1]._replace(time_ns=clock.to_utc_ns(appended[-1].mono_ns))
    writer.append(appended[-1])
    report = writer.close()
    assert report.counts["camera"] == 61
    appended_and_read(path, appended)
    with open_session(path) as session:
        assert session.state == "sealed"
        assert any("recording goes on in the journal" in event.text for event in session.events())
    assert [item.name for item in tmp_path.iterdir()] == ["a.h5"]


def test_session_of_which_something_is_lost_is_not_sealed(tmp_path, monkeypatch):
    """The file side fails, and five rows of the journal are damaged: only recovery says what is missing."""
    path, clock = tmp_path / "a.h5", CountedClock()
    writer, _ = filled_without_its_file(path, 80, clock, monkeypatch)
    for part in journal_path(path).glob("0*.log"):
        data = part.read_bytes()
        for seq in range(75, 80):
            row = sample(HEADER.streams[0], seq).counts[5].tobytes()
            data = data.replace(row, bytes(len(row)))
        part.write_bytes(data)
    with pytest.raises(StorageError, match="camera: 5 ") as caught:
        writer.close()
    assert [step.action for step in steps(caught.value)] == [Action.RECOVER]
    assert sorted(item.name for item in tmp_path.iterdir()) == ["a.h5", "a.h5.journal"]
    (run,) = recover(path).lost
    assert (run.stream, run.first, run.last) == ("camera", 75, 79)


def filled_without_its_file(
    path: Path, frames: int, clock: CountedClock, patch: pytest.MonkeyPatch
) -> tuple[SessionWriter, list[Sample]]:
    """Record while the file may not grow; the journal, in parts that are smaller than the file, does."""
    patch.setattr(journal, "PART_BYTES", 20_000)  # a full part takes 256 MB
    writer, folder = SessionWriter(path, HEADER, clock), journal_path(path)

    def goes_on() -> bool:
        return any(b"recording goes on in the journal" in part.read_bytes() for part in folder.glob("0*.log"))

    with full_disk(writer.path.stat().st_size):
        appended = fill(writer, frames, clock)
        wait_until(goes_on, "the file does not fail")
    return writer, appended


def test_living_recording_can_be_read_but_not_recovered(tmp_path):
    clock = CountedClock()
    path = tmp_path / "a.h5"
    writer = SessionWriter(path, HEADER, clock)
    fill(writer, 9, clock)
    with pytest.raises(RefusedError, match="in use"):
        recover(path)
    writer.close()


def test_a_file_that_lacks_the_journals_last_sample_is_not_sealed(tmp_path):
    recorded(tmp_path / "a.h5", header((24, 32)), 8)
    with open_session(tmp_path / "a.h5") as session:
        crcs = {name: session.stream(name).column("crc32").tolist() for name in session.streams}
    seal_module.seal(tmp_path / "a.h5", crcs, 1)
    for name in crcs:
        with pytest.raises(IntegrityError, match=f"of {name} "):
            seal_module.seal(tmp_path / "a.h5", {**crcs, name: [*crcs[name], 1]}, 1)


def test_journal_deleted_while_recording_is_reported_and_the_session_interrupted(tmp_path, caplog):
    clock, path = CountedClock(), tmp_path / "a.h5"
    writer = SessionWriter(path, HEADER, clock)
    appended = fill(writer, 30, clock)
    shutil.rmtree(journal_path(path))
    wait_until(lambda: "was deleted while recording" in caplog.text, "no sync has noticed")
    with pytest.raises(StorageError, match=r"(?s)journal.*recover\(") as caught:
        writer.close()
    assert [step.action for step in steps(caught.value)] == [Action.RECOVER]
    assert is_interrupted(path)
    report = recover(path)
    assert (report.outcome, report.lost_samples) == (Outcome.END_NOT_KNOWN, 0)
    assert not is_interrupted(path)
    appended_and_read(path, appended)
    with open_session(path) as session:
        assert any("was deleted while recording" in event.text for event in session.events())


def test_ten_minutes_are_hardly_larger_than_their_numbers(tmp_path):
    path, clock, head = tmp_path / "a.h5", CountedClock(), header((24, 32), 1.0)
    writer = SessionWriter(path, head, clock)
    for second in range(600):
        mono_ns = second * 10**9
        time_ns = clock.to_utc_ns(mono_ns)
        for info in head.streams:
            writer.append(sample(info, second, mono_ns, time_ns))
        writer.put(Health(mono_ns, time_ns, (), 10**9))
        if second % 60 == 0:
            slopes = [SlopeEstimate(time_ns, name, SlopeState.OK) for name in head.region_names]
            writer.put(MinuteRecord(time_ns, tuple(slopes), 800.0, "eq10", learnt=Learnt(())))
    report, numbers = writer.close(), list[int]()

    def count(name: str, node: h5py.Group | h5py.Dataset) -> None:
        if isinstance(node, h5py.Dataset):
            is_packed = name.rsplit("/", 1)[-1] in FRAME_DATASETS
            numbers.append(node.id.get_storage_size() if is_packed else node.size * node.dtype.itemsize)

    with h5py.File(path) as file:
        file.visititems(count)
    assert report.bytes - sum(numbers) < 150_000


def test_bytes_written_are_those_on_the_disk(tmp_path):
    """Of a meter alone: each reading once cost the journal pages of 4096 bytes."""
    head = dataclasses.replace(HEADER, streams=HEADER.streams[1:2])
    writer = SessionWriter(tmp_path / "a.h5", head, CountedClock())
    empty = writer.bytes_written
    for seq in range(2000):
        writer.append(sample(head.streams[0], seq))
    writer.abandon(at_once=False)
    files = [tmp_path / "a.h5", *journal_path(tmp_path / "a.h5").glob("*.log")]
    assert writer.bytes_written == sum(file.stat().st_size for file in files)
    assert writer.bytes_written - empty < 2000 * 400  # what is planned for before a recording


# --- how a session begins: under a name of its own, alone, leaving nothing behind where it cannot


def test_session_is_never_written_over(tmp_path):
    SessionWriter(tmp_path / "a.h5", HEADER, CountedClock()).close()
    with pytest.raises(RefusedError, match="exists already"):
        SessionWriter(tmp_path / "a.h5", HEADER, CountedClock())


def begin_at_once(path: Path, barrier: Barrier, begun: Queue) -> None:
    """Begin a session when the other process does, and record a little."""
    clock = CountedClock()
    barrier.wait()
    try:
        writer = SessionWriter(path, HEADER, clock)
    except RefusedError:
        begun.put(False)
        barrier.wait()
        return
    begun.put(True)
    barrier.wait()  # the other one has given up
    fill(writer, 5, clock)
    writer.close()


def test_of_two_that_begin_the_same_session_at_once_one_has_it(tmp_path):
    barrier, begun = SPAWN.Barrier(2), SPAWN.Queue()
    for number in range(3):
        path = tmp_path / f"{number}.h5"
        pair = [SPAWN.Process(target=begin_at_once, args=(path, barrier, begun)) for _ in range(2)]
        for process in pair:
            process.start()
        for process in pair:
            process.join(500)
        assert sorted(begun.get(timeout=60) for _ in pair) == [False, True]
        with open_session(path) as session:
            assert (session.state, session.count("camera")) == ("sealed", 5)


def test_session_sealed_since_one_looked_is_left_alone(tmp_path, monkeypatch):
    path, exists = tmp_path / "a.h5", Path.exists

    def look(place: Path) -> bool:
        there = exists(place)
        monkeypatch.setattr(Path, "exists", exists)
        SessionWriter(path, HEADER, CountedClock()).close()
        return there

    # the other one comes and goes between two looks, which two processes hardly ever do
    monkeypatch.setattr(Path, "exists", look)
    with pytest.raises(RefusedError, match="exists already"):
        SessionWriter(path, HEADER, CountedClock())
    assert [item.name for item in tmp_path.iterdir()] == ["a.h5"]
    with open_session(path) as session:
        assert session.state == "sealed"


@pytest.mark.parametrize("room", [0, 10_000, 1_000_000])  # for nothing, the journal, all but its reserve
def test_start_that_fails_leaves_nothing_open_and_nothing_behind(tmp_path, room):
    with full_disk(room), pytest.raises(StorageError, check=at(tmp_path / "a.h5")):
        SessionWriter(tmp_path / "a.h5", HEADER, CountedClock())
    assert not list(tmp_path.iterdir())
    gc.collect()
    opened = [os.readlink(item) for item in Path("/proc/self/fd").iterdir() if item.is_symlink()]
    assert not [name for name in opened if str(tmp_path) in name]


def test_folder_that_cannot_be_written_is_a_storage_error(tmp_path):
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(StorageError, check=at(tmp_path / "file" / "a.h5")):
        SessionWriter(tmp_path / "file" / "a.h5", HEADER, CountedClock())
