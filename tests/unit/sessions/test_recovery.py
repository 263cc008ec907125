"""What comes back of a damaged session: all whose bytes are there, and every run of what is lost is named."""

import errno
import os
import shutil
import struct
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import h5py
import pytest

from fieldkit.model.errors import StorageError
from fieldkit.model.samples import Event, EventKind, Quality, Severity
from fieldkit.sessions import session_file
from fieldkit.sessions.finished_file import apply_time_map
from fieldkit.sessions.journal import Journal
from fieldkit.sessions.journal_reader import JournalReader
from fieldkit.sessions.lock import journal_path
from fieldkit.sessions.log import Kind, LogReader, LogWriter
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.recovery import Outcome, recover
from fieldkit.sessions.sample_fields import STAMPS_BYTES
from fieldkit.sessions.time_map import TimeStep
from fieldkit.sessions.writer import SessionWriter
from tests.harness import disk, recording
from tests.harness.faults import flip_byte, mark_unfinished
from tests.harness.recording import START_NS, CountedClock, fill, header, same, sample
from tests.harness.rights import ordinary_rights

HEADER = header((60, 80))
FRAMES = 400


def recorded(path: Path, frames: int, *, sealed: bool) -> None:
    """A recording of samples of all streams, the meters as often as the camera."""
    writer = SessionWriter(path, HEADER, CountedClock())
    for seq in range(frames):
        for info in HEADER.streams:
            writer.append(sample(info, seq))
        if seq % 100 == 0:
            mono_ns = seq * 5_000_000
            writer.put(Event(EventKind.MARK, mono_ns, START_NS + mono_ns, f"mark {seq}"))
    if sealed:
        writer.close()
    else:
        writer.abandon(at_once=False)


def rewritten(part: Path, change: Callable[[int, bytes], bytes]) -> None:
    """Let a part of a journal have been written with other frames."""
    reader, copy = LogReader(part), part.with_name("copy")
    heads = list(reader.heads())
    writer = LogWriter(copy, heads[0].session)
    for head in heads:
        payload = reader.payload(head)
        assert payload is not None
        is_frame = head.kind == Kind.SAMPLE and head.stream == 0
        writer.append(
            Kind(head.kind), head.stream, head.counts, change(head.seq, payload) if is_frame else payload
        )
    writer.close()
    reader.close()
    copy.replace(part)


def later(row: bytes) -> bytes:
    """A journalled sample with another time than that of its checksum."""
    mono_ns, time_ns = struct.unpack_from("<qq", row)
    return struct.pack("<qq", mono_ns, time_ns + 5000) + row[16:]


@pytest.fixture(scope="module")
def sealed(tmp_path_factory):
    path = tmp_path_factory.mktemp("sealed") / "a.h5"
    recorded(path, FRAMES, sealed=True)
    return path


@pytest.fixture(scope="module")
def originals(tmp_path_factory):
    """Folders of interrupted sessions with their journals, by their number of frames."""
    folders = {frames: tmp_path_factory.mktemp(f"of-{frames}") for frames in (20, 95)}
    for frames, folder in folders.items():
        recorded(folder / "a.h5", frames, sealed=False)
    return folders


@pytest.fixture
def interrupted(originals, tmp_path):
    """A session of twenty frames that was not sealed."""
    return shutil.copytree(originals[20], tmp_path, dirs_exist_ok=True) / "a.h5"


@pytest.fixture
def longer(originals, tmp_path):
    """The same with ten whole chunks and a last one of five frames."""
    return shutil.copytree(originals[95], tmp_path, dirs_exist_ok=True) / "a.h5"


def rows_in_front_of(path: Path, stream: str, end: int) -> list[int]:
    """Samples all of whose bytes stand in front of a place, by the places that the library tells."""
    whole = [True] * FRAMES
    with h5py.File(path) as file:
        for dataset in file[stream].values():
            if dataset.maxshape[0] is not None:
                continue
            for n in range(dataset.id.get_num_chunks()):
                chunk, depth = dataset.id.get_chunk_info(n), dataset.chunks[0]
                first, packed = chunk.chunk_offset[0], dataset.compression is not None
                for row in range(first, min(first + depth, FRAMES)):
                    size = chunk.size if packed else chunk.size // depth * (row - first + 1)
                    whole[row] &= chunk.byte_offset + size <= end
    return [row for row in range(FRAMES) if whole[row]]


@pytest.mark.parametrize(
    "share", [0.9, 0.3, *(pytest.param(one, marks=pytest.mark.slow) for one in (0.999, 0.6))]
)
def test_sealed_file_that_lost_its_end_gives_back_all_whose_bytes_are_there(sealed, tmp_path, share):
    path = tmp_path / "a.h5"
    end = round(sealed.stat().st_size * share)
    path.write_bytes(sealed.read_bytes()[:end])
    report = recover(path)
    with open_session(path) as session:
        told = {event.stream: event for event in session.events() if event.kind is EventKind.RECOVERED}
        for info in HEADER.streams:
            there = rows_in_front_of(sealed, info.name, end)
            found = list(session.stream(info.name).samples())
            assert [item.seq for item in found] == there
            assert all(same(item, sample(info, item.seq)) for item in found)
            (run,) = [run for run in report.lost if run.stream == info.name] or [None]
            assert (run is None) == (len(there) == FRAMES)
            if run is not None:
                assert (run.first, run.last, run.count) == (len(there), FRAMES - 1, FRAMES - len(there))
                assert (run.after_ns, run.before_ns) == (found[-1].time_ns, 0)
                assert told[info.name].data == asdict(run)
                assert told[info.name].severity is Severity.ERROR
        marks = [event.text for event in session.events() if event.kind is EventKind.MARK]
        assert marks == [f"mark {100 * n}" for n in range(len(marks))]
    assert not report.doubt  # a file that was sealed says how much it had


def test_run_lost_in_the_middle_is_told_with_the_times_around_it(sealed, tmp_path):
    path = tmp_path / "a.h5"
    shutil.copy(sealed, path)
    with h5py.File(path) as file:
        place = file["camera/counts"].id.get_chunk_info_by_coord((360, 0, 0))
    flip_byte(path, place.byte_offset + 100)
    mark_unfinished(path)
    (run,) = recover(path).lost
    assert (run.stream, run.first, run.last) == ("camera", 360, 368)
    camera = HEADER.streams[0]
    assert (run.after_ns, run.before_ns) == (sample(camera, 359).time_ns, sample(camera, 369).time_ns)


def test_block_that_is_not_as_it_was_written_is_made_from_the_journal(longer):
    with h5py.File(longer) as file:
        place = file["camera/counts"].id.get_chunk_info_by_coord((18, 0, 0))
    flip_byte(longer, place.byte_offset + 50)
    assert recover(longer).lost_samples == 0


def test_row_that_does_not_verify_is_taken_from_the_file(longer):
    """The journal itself is damaged: one row's stamp is not the one that its checksum is of."""
    rewritten(journal_path(longer) / "000001.log", lambda seq, row: later(row) if seq == 20 else row)
    report = recover(longer)
    assert report.lost_samples == 0  # the file has it as it was
    with open_session(longer) as session:
        assert not any(item.quality & Quality.BAD_CRC for item in session.samples())
        assert same(session.stream("camera").frame(20), sample(HEADER.streams[0], 20))


def test_marks_that_nobody_took_become_events_within_the_session(tmp_path):
    path = tmp_path / "a.h5"
    appended = recording.interrupted(path, HEADER, 20)
    early, late = appended[0].time_ns + 1_000_000, appended[-1].time_ns + 10**12
    recover(path, [Event(EventKind.MARK, 0, early, "cloud"), Event(EventKind.MARK, 0, late, "rain")])
    with open_session(path) as session:
        marks = {event.text: event for event in session.events() if event.kind is EventKind.MARK}
        assert marks["cloud"].time_ns // 1000 == early // 1000
        assert marks["rain"].time_ns == appended[-1].time_ns == marks["rain"].mono_ns + session.anchor_ns


def no_links(*_: object) -> None:
    """What FAT and exFAT say to a second name for a file."""
    raise PermissionError(errno.EPERM, "Operation not permitted")


def test_session_on_a_card_that_knows_no_links_is_recovered(interrupted, tmp_path, monkeypatch):
    """Also where recovery ends between the two steps that take the place of one."""
    crashed = interrupted.read_bytes()
    monkeypatch.setattr(os, "link", no_links)  # as on FAT
    with monkeypatch.context() as killed:
        killed.setattr(os, "replace", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            recover(interrupted)
    assert not interrupted.exists()
    report = recover(interrupted)
    assert (report.counts["camera"], report.lost_samples, report.was_complete) == (20, 0, False)
    assert sorted(item.name for item in tmp_path.iterdir()) == ["a.h5", "a.h5.crashed"]
    assert (tmp_path / "a.h5.crashed").read_bytes() == crashed
    with open_session(interrupted) as session:
        assert session.state == "recovered"


def test_events_that_a_torn_journal_lost_come_from_the_file_once_and_in_order(tmp_path, monkeypatch):
    path = tmp_path / "a.h5"
    monkeypatch.setattr(session_file, "FLUSH_EVERY_S", 0.0)  # all that is taken is in the file
    writer = SessionWriter(path, HEADER, CountedClock())
    for n in range(200):
        writer.put(Event(EventKind.MARK, n, START_NS + n, f"mark {n} {'about the wind ' * 12}"))
        writer.append(sample(HEADER.streams[0], n))
    writer.abandon(at_once=False)
    log = journal_path(path) / "000001.log"
    data = bytearray(log.read_bytes())
    third = len(data) // 3
    data[third : 2 * third] = bytes(third)
    log.write_bytes(data)
    with JournalReader(log.parent) as journal:
        assert len([one for one in journal.entries() if isinstance(one, Event)]) < 200
    report = recover(path)
    assert not any("are lost" in line for line in report.damage)
    with open_session(path) as session:
        marks = [event.mono_ns for event in session.events() if event.kind is EventKind.MARK]
    assert marks == list(range(200))


def test_journal_goes_only_when_the_disk_has_the_new_file_in_its_place(tmp_path):
    path = tmp_path / "disk" / "a.h5"
    path.parent.mkdir()
    recorded(path, 20, sealed=False)
    code = f"from fieldkit.sessions.recovery import recover; recover({str(path)!r})"
    done = disk.run_watched(tmp_path, "-c", code, log=tmp_path / "log")
    assert done.returncode == 0, done.stderr
    changes = disk.read_log(tmp_path / "log", path.parent)
    renamed = next(n for n, one in enumerate(changes) if one.kind == "R" and one.path == "a.h5.recovering")
    synced = next(n for n, one in enumerate(changes) if n > renamed and (one.kind, one.path) == ("E", "."))
    gone = next(n for n, one in enumerate(changes) if one.kind == "U" and one.path.endswith("000001.log"))
    assert renamed < synced < gone


@pytest.mark.parametrize("share", [0.0, 0.5, 0.99])
def test_full_disk_keeps_no_part_of_a_new_file(interrupted, tmp_path, share):
    """It would take the room that is to be made."""
    room = int(share * interrupted.stat().st_size)
    with disk.full_disk(room), pytest.raises(StorageError, match="too large"):
        recover(interrupted)
    assert not (tmp_path / "a.h5.recovering").exists()
    assert recover(interrupted).counts["camera"] == 20  # once there is room


def test_time_map_outlives_recovery(tmp_path):
    """All its versions: the process was killed while it wrote a third."""
    path = tmp_path / "a.h5"
    recorded(path, 20, sealed=True)
    for add_ns in (3600 * 10**9, 1800 * 10**9):
        apply_time_map(path, [TimeStep(0, add_ns, "gps"), TimeStep(50_000_000, add_ns + 1, "slept – 二")])
    with open_session(path) as session, h5py.File(path) as file:
        in_force = session.time_map()
        versions = {name: column[:].tolist() for name, column in file["time_map"].items()}
    assert versions["version"] == [1, 1, 2, 2]
    mark_unfinished(path)
    assert not recover(path).was_complete
    with open_session(path) as session, h5py.File(path) as file:
        assert session.time_map() == in_force == [
            TimeStep(0, 1800 * 10**9, "gps"), TimeStep(50_000_000, 1800 * 10**9 + 1, "slept – 二"),
        ]  # fmt: skip
        assert {name: column[:].tolist() for name, column in file["time_map"].items()} == versions


@pytest.mark.parametrize(
    "share", [0.0, 0.6, *(pytest.param(one, marks=pytest.mark.slow) for one in (0.3, 0.99))]
)
def test_time_map_that_was_lost_with_the_end_of_the_file_is_told(sealed, tmp_path, share):
    path = tmp_path / "a.h5"
    shutil.copy(sealed, path)
    apply_time_map(path, [TimeStep(0, 10**9, "gps")])
    before, after = sealed.stat().st_size, path.stat().st_size
    path.write_bytes(path.read_bytes()[: before + int(share * (after - before))])
    assert any(line.startswith("time_map: ") for line in recover(path).damage)
    with open_session(path) as session:
        assert session.time_map() == []


def test_recovery_of_a_finished_session_writes_nothing(sealed, tmp_path):
    path = tmp_path / "a.h5"
    shutil.copy(sealed, path)
    path.chmod(0o400)
    tmp_path.chmod(0o500)
    with ordinary_rights():
        assert recover(path).was_complete
    assert [item.name for item in tmp_path.iterdir()] == ["a.h5"]


def test_recovery_where_nothing_can_be_written_is_a_storage_error(interrupted):
    (journal_path(interrupted) / "recovery.lock").mkdir()
    with pytest.raises(StorageError, match=r"a\.h5 .* Is a directory"):
        recover(interrupted)


def test_chunks_are_where_the_journal_says(longer):
    data = bytearray(longer.read_bytes())
    data[:4096] = bytes(4096)  # the file's own index is out of reach
    longer.write_bytes(data)
    folder = journal_path(longer)
    rewritten(folder / "000001.log", lambda seq, row: row[:STAMPS_BYTES] if seq < 90 else row)
    report = recover(longer)
    assert report.lost_samples <= 9  # a chunk may have stood in what was overwritten
    assert report.counts["camera"] >= 86


def test_session_killed_before_its_journal_was_made_is_cleared_away(tmp_path):
    path = tmp_path / "a.h5"
    journal_path(path).mkdir()
    (journal_path(path) / "lock").write_text("4711\n")
    (journal_path(path) / "000001.log").write_bytes(b"\xf5fkL as far as it came")
    (journal_path(path) / "reserve").write_bytes(bytes(1000))
    report = recover(path)
    assert (report.counts, report.lost) == ({}, ())
    assert list(tmp_path.iterdir()) == []


def test_session_without_a_sample_is_recovered(tmp_path):
    """Killed when its journal was made, but not yet its file."""
    path = tmp_path / "a.h5"
    SessionWriter(path, HEADER, CountedClock()).abandon()
    path.unlink()
    report = recover(path)
    assert report.counts == {"camera": 0, "lux": 0, "thermometer": 0}
    assert report.outcome is Outcome.COMPLETE
    with open_session(path) as session:
        assert session.state == "recovered"


@pytest.fixture
def killed(tmp_path, monkeypatch):
    """A session whose recorder was killed, with all samples in its file; and a copy made half way."""
    monkeypatch.setattr(session_file, "FLUSH_EVERY_S", 0.0)
    monkeypatch.setattr(Journal, "close", lambda journal: None)  # a kill closes nothing
    path = tmp_path / "a.h5"
    writer = SessionWriter(path, HEADER, CountedClock())
    for seq in range(20):
        for info in HEADER.streams:
            writer.append(sample(info, seq))
        if seq == 9:
            shutil.copytree(journal_path(path), tmp_path / "older", ignore=shutil.ignore_patterns("reserve"))
    writer.abandon(at_once=False)
    return path


def test_end_of_a_killed_recording_is_known_and_of_a_copy_is_not(killed, tmp_path):
    shutil.copytree(journal_path(killed), tmp_path / "copy.h5.journal")
    copy = recover(tmp_path / "copy.h5")
    assert (copy.outcome, copy.counts) == (
        Outcome.END_NOT_KNOWN,
        {"camera": 20, "lux": 20, "thermometer": 20},
    )
    with open_session(copy.path) as session:
        assert session.events()[-1].data["doubt"] == copy.doubt
    assert recover(killed).outcome is Outcome.COMPLETE


def test_session_file_that_goes_on_behind_the_journal_is_seen_to(killed, tmp_path):
    """As a power cut can leave it; here under the same boot, and in the files that were written."""
    for older in (tmp_path / "older").iterdir():
        (journal_path(killed) / older.name).write_bytes(older.read_bytes())
    report = recover(killed)
    assert (report.outcome, report.counts["lux"]) == (Outcome.END_NOT_KNOWN, 20)
    assert any("lux" in line and " 10 " in line for line in report.damage)  # those of the file alone


def test_journal_of_another_session_is_left_out_and_kept(originals, interrupted, tmp_path):
    folder = journal_path(interrupted)
    before = {path.name for path in folder.iterdir()}
    shutil.rmtree(folder)
    shutil.copytree(journal_path(originals[95] / "a.h5"), folder)
    report = recover(interrupted)
    assert report.outcome is Outcome.END_NOT_KNOWN
    assert report.counts["camera"] <= 20
    (aside,) = tmp_path.glob("a.h5.journal.crashed-*")
    assert {path.name for path in aside.iterdir()} == {*before, "recovery.lock"}
    aside.rename(tmp_path / "b.h5.journal")
    assert recover(tmp_path / "b.h5").counts["camera"] == 95


def test_entries_that_are_lost_are_counted(killed):
    killed.unlink()
    part = journal_path(killed) / "000001.log"
    part.write_bytes(part.read_bytes().replace(b"region\n", b"Region\n", 1))
    report = recover(killed)
    assert (report.outcome, report.lost_samples, report.lost_entries) == (Outcome.LOST, 0, 1)


def test_import_that_was_interrupted_is_never_whole(tmp_path):
    path = tmp_path / "a.h5"
    clock = CountedClock()
    writer = SessionWriter(path, header(), clock)
    writer.put(Event(EventKind.IMPORTED, clock.mono_ns(), START_NS, "imported from log.csv"))
    fill(writer, 5, clock)
    writer.abandon(at_once=False)
    report = recover(path)
    assert report.outcome is Outcome.END_NOT_KNOWN
    with open_session(path) as session:
        assert session.events()[-1].data["doubt"] == report.doubt
