"""The journal keeps every record, in order, over many parts and after damage."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from fieldkit.model.clock import ClockCheck
from fieldkit.model.errors import SessionError, StorageError
from fieldkit.model.samples import Event, EventKind, Health, Quality, Severity, StreamHealth
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import SlopeEstimate, SlopeState
from fieldkit.sessions import journal as journal_module
from fieldkit.sessions import journal_reader, session_file
from fieldkit.sessions.journal import Chunk, Journal, SessionIdentity, SyncThread
from fieldkit.sessions.journal_reader import JournalReader
from fieldkit.sessions.lock import OWNER_BYTES, RECORDING
from fieldkit.sessions.log import Kind, LogReader, LogWriter, encode_record, session_number
from fieldkit.sessions.records import (
    MinuteRecord,
    RegionRecord,
    SampleRow,
    decode_entry,
    encode_entry,
    encode_sample,
)
from fieldkit.sessions.session_file import FileThread
from tests.harness.disk import full_disk
from tests.harness.learnt import learnt
from tests.harness.recording import START_NS, header, same, sample
from tests.harness.rights import ordinary_rights
from tests.harness.waiting import wait_until

HEADER = header((24, 32))
IDENTITY = SessionIdentity("a-session", START_NS, 77, HEADER)
ENTRIES = (
    Event(EventKind.CLOUD, 5, 6, "Wolke ☁", "lux", Severity.WARNING, {"depth": 0.25}),
    Health(7, 8, (StreamHealth("camera", 1, 2, 3, 4, 5),), 9, 10, 1.5, 2.5, 3.5),
    ClockCheck(11, -12, 13, "gps", 14),
    MinuteRecord(60, (SlopeEstimate(60, "b05", SlopeState.OK, 0.1 + 0.2),), 1 / 3, "eq10", Quality.LOW_SUN),
    MinuteRecord(120, (), learnt=learnt()),
    RegionRecord(Region("b05", RegionKind.TARGET, ((0.5, 1.0), (2.0, 1.0), (2.0, 3.25)), 5.0, 180.0), 15),
)


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: type(entry).__name__)
def test_entry_is_the_same_after_json(entry):
    assert repr(decode_entry(*encode_entry(entry))) == repr(entry)  # type: ignore[arg-type]  # by repr: NaN


def test_entry_that_makes_no_sense_is_named():
    with pytest.raises(SessionError, match="'cloud'"):
        decode_entry("cloud", "{}")
    with pytest.raises(SessionError, match="'event'"):
        decode_entry("event", '{"kind": 3}')


def filled(folder: Path, frames: int, part_bytes: int, session_id: str = "a-session") -> Journal:
    folder.mkdir()
    journal = Journal(folder, replace(IDENTITY, session_id=session_id))
    journal.part_bytes = part_bytes
    for seq in range(frames):
        journal.append(sample(HEADER.streams[0], seq))
        if seq % 5 == 0:
            journal.append(sample(HEADER.streams[1], seq // 5))
            journal.append(ENTRIES[0])
    return journal


def test_records_come_back_in_order_over_many_parts(tmp_path):
    journal = filled(tmp_path / "journal", 40, part_bytes=15_000)
    assert journal.number > 3
    with JournalReader(journal.folder) as reader:  # while the writer is still there
        assert reader.identity.header.to_json() == HEADER.to_json()  # by text: NaN
        assert (reader.identity.session_id, reader.identity.anchor_ns) == ("a-session", 77)
        frames = list(reader.rows(0))
        for seq, row in enumerate(frames):
            found = row.sample(HEADER.streams[0])
            assert found is not None
            assert same(found, sample(HEADER.streams[0], seq))
        assert list(reader.entries()) == [ENTRIES[0]] * 8
        assert [row.seq for row in reader.rows(0, 11, 20)] == list(range(11, 21))
        assert reader.numbers(0).tolist() == list(range(40))
        assert reader.numbers(2).tolist() == []
        assert list(reader.crc32s(0)) == [encode_sample(sample(HEADER.streams[0], n))[1] for n in range(40)]
        assert reader.written == journal.written == (40, 8, 0, 8)
        assert not reader.doubt
        assert not reader.damage
    journal.close()


def test_what_was_written_since_some_record_is_read_in_its_order(tmp_path):
    journal = filled(tmp_path / "journal", 40, part_bytes=15_000)
    order = [n for seq in range(40) for n in (("camera", "lux", "event") if seq % 5 == 0 else ("camera",))]
    for first, last in ((0, 56), (11, 20), (50, 56), (30, 30)):
        with JournalReader(journal.folder) as reader:
            found = list(reader.since(first, last))
        names = [("camera", "lux")[row.stream] if isinstance(row, SampleRow) else "event" for row in found]
        assert names == order[first:last]
    journal.close()


def test_reading_changes_nothing(tmp_path):
    journal = filled(tmp_path / "journal", 30, part_bytes=10**9)
    journal.close()
    journal.close()
    before = {path.name: path.read_bytes() for path in journal.folder.iterdir()}
    with JournalReader(journal.folder) as reader:
        assert len(list(reader.rows(0))) == 30
    assert {path.name: path.read_bytes() for path in journal.folder.iterdir()} == before


def test_retired_part_leaves_all_but_the_frames(tmp_path):
    journal = filled(tmp_path / "journal", 40, part_bytes=15_000)
    part, _ = journal.full_parts.popleft()
    with JournalReader(journal.folder) as reader:
        crc32s = list(reader.crc32s(0))
    journal.retire(part)
    assert not part.exists()
    with JournalReader(journal.folder) as reader:
        frames = list(reader.rows(0))
        gone = [row for row in frames if row.data is None]
        assert 0 < len(gone) < len(frames) == 40
        assert [row.seq for row in gone] == list(range(len(gone)))
        assert all(row.sample(HEADER.streams[0]) is None for row in gone)
        assert list(reader.crc32s(0)) == crc32s
        assert all(row.sample(HEADER.streams[1]) is not None for row in reader.rows(1))
        assert len(list(reader.entries())) == 8
        assert reader.written == journal.written
        assert not reader.doubt
    journal.close()


def test_part_that_was_kept_but_not_yet_deleted_is_read_once_with_its_frames(tmp_path):
    journal = filled(tmp_path / "journal", 40, part_bytes=15_000)
    part, _ = journal.full_parts.popleft()
    shutil.copy(part, tmp_path / "part")
    journal.retire(part)
    shutil.copy(tmp_path / "part", part)
    with JournalReader(journal.folder) as reader:
        rows = list(reader.rows(0))
        assert [row.seq for row in rows] == list(range(40))
        assert all(row.data is not None for row in rows)
        assert len(list(reader.entries())) == 8
    journal.close()


def test_chunks_are_found_by_their_first_row(tmp_path):
    journal = filled(tmp_path / "journal", 3, part_bytes=10**9)
    block = [Chunk("/camera/counts", 9, 0, x, 2**40 + x, 100 + x, 7 + x) for x in (0, 16)]
    rows = [Chunk("/camera/metadata_rows", 9, 0, 0, 5, 6, 7)]
    again = [Chunk("/camera/counts", 9, 0, 0, 1, 2, 3)]
    journal.note_chunks([*block, *rows])
    journal.note_chunks(again)
    with JournalReader(journal.folder) as reader:
        assert reader.chunks("/camera/counts", 9) == [*block, *again]
        assert reader.chunks("/camera/metadata_rows", 9) == rows
        assert reader.chunks("/camera/counts", 0) == []
    journal.close()


def test_row_with_a_changed_byte_is_not_handed_out(tmp_path):
    journal = filled(tmp_path / "journal", 3, part_bytes=10**9)
    with JournalReader(journal.folder) as reader:
        row = next(reader.rows(0))
        assert row.data is not None
        assert replace(row, data=b"\xff" + row.data[1:]).sample(HEADER.streams[0]) is None
        assert replace(row, data=row.data[:-2]).sample(HEADER.streams[0]) is None
        assert row.sample(HEADER.streams[0]) is not None
    journal.close()


def test_journal_without_its_first_part_still_reads(tmp_path):
    journal = filled(tmp_path / "journal", 40, part_bytes=15_000)
    journal.close()
    journal.part_path(1).write_bytes(b"garbage" * 1000)
    with JournalReader(journal.folder) as reader:
        numbers = reader.numbers(0).tolist()
        assert numbers == list(range(numbers[0], 40))
        assert numbers[0] > 0
        assert reader.written == (40, 8, 0, 8)
        assert not reader.doubt


def test_records_of_an_earlier_journal_that_the_disk_shows_again_are_not_taken(tmp_path):
    """After a power cut a file may end in bytes of one that was deleted before."""
    journal = filled(tmp_path / "journal", 3, part_bytes=10**9)
    journal.close()
    earlier = LogWriter(tmp_path / "earlier", session_number("an earlier one"))
    for seq in range(3, 9):
        frame, _ = encode_sample(sample(HEADER.streams[0], seq))
        earlier.append(Kind.SAMPLE, 0, (seq + 1, 1, 0, 1), *frame)
    earlier.close()
    part = journal.part_path(1)
    part.write_bytes(part.read_bytes() + (tmp_path / "earlier").read_bytes())
    with JournalReader(journal.folder) as reader:
        assert reader.numbers(0).tolist() == [0, 1, 2]
        assert reader.written == (3, 1, 0, 1)
        assert [line.split()[0] for line in reader.left_out] == ["6"]


def doubt(folder: Path) -> str:
    with JournalReader(folder) as reader:
        return reader.doubt


def lose_the_last_record(folder: Path) -> None:
    part = folder / "000002.log"
    log = LogReader(part)
    *_, last = log.heads()
    log.close()
    with part.open("r+b") as file:
        file.truncate(last.at)  # as if it had never been there


def copy_the_last_part(folder: Path) -> None:
    shutil.copy(folder / "000002.log", folder / "copy")
    (folder / "copy").replace(folder / "000002.log")


def count_in_lock(folder: Path, *counts: int, session_id: str = "a-session") -> None:
    with (folder / RECORDING).open("r+b") as file:
        file.seek(OWNER_BYTES)
        file.writelines(encode_record(session_number(session_id), Kind.WRITTEN, 0, counts))


@pytest.mark.parametrize(
    ("change", "is_known"),
    [
        (lambda folder: None, True),
        (lambda folder: (folder / "000001.log").unlink(), True),
        (lambda folder: (folder / "confirmed.log").unlink(), True),
        (lambda folder: count_in_lock(folder, 9, 2, 0, 2), True),  # killed between record and lock
        (lambda folder: count_in_lock(folder, 9, 2, 0, 1), False),
        (lambda folder: count_in_lock(folder, 11, 2, 0, 2), False),
        (lambda folder: count_in_lock(folder, 10, 2, 0, 2, session_id="another"), False),
        (lambda folder: (folder / RECORDING).unlink(), False),
        (lambda folder: (folder / "000002.log").unlink(), False),
        (lose_the_last_record, False),
        (copy_the_last_part, False),
    ],
)
def test_end_of_a_killed_recording_is_known_where_lock_and_last_part_agree(
    tmp_path, monkeypatch, change, is_known
):
    folder = filled(tmp_path / "journal", 10, part_bytes=15_000).folder
    shutil.copytree(folder, tmp_path / "copy")
    change(folder)
    assert bool(doubt(folder)) != is_known
    assert doubt(tmp_path / "copy")  # its lock may be as old as its parts
    monkeypatch.setattr(journal_reader, "boot_id", lambda: "after a power cut")
    assert doubt(folder)


def test_end_of_a_closed_journal_is_known_wherever_it_is(tmp_path, monkeypatch):
    journal = filled(tmp_path / "journal", 10, part_bytes=15_000)
    journal.close()
    shutil.copytree(journal.folder, tmp_path / "copy")
    monkeypatch.setattr(journal_reader, "boot_id", lambda: "after a power cut")
    assert not doubt(tmp_path / "copy")
    lose_the_last_record(journal.folder)
    assert doubt(journal.folder)


def test_what_was_confirmed_and_is_gone_is_counted(tmp_path):
    journal = filled(tmp_path / "journal", 10, part_bytes=10**9)
    journal.confirm(journal.written)
    (journal.folder / RECORDING).unlink()
    part = journal.part_path(1)
    part.write_bytes(part.read_bytes()[: part.stat().st_size // 2])
    with JournalReader(journal.folder) as reader:
        assert reader.written == (10, 2, 0, 2)
        assert len(reader.numbers(0)) < 10


@pytest.mark.parametrize("session_id", [None, "a-session", "another"])
def test_session_is_that_of_most_files_or_the_one_asked_for(tmp_path, session_id):
    journal = filled(tmp_path / "journal", 10, part_bytes=15_000)
    other = filled(tmp_path / "other", 30, part_bytes=15_000, session_id="another")
    shutil.copy(other.part_path(2), journal.part_path(0))  # the first by its name
    identity = session_id and replace(IDENTITY, session_id=session_id)
    with JournalReader(journal.folder, identity or None) as reader:
        assert reader.identity.session_id == (session_id or "a-session")
        ours = reader.numbers(0).tolist()
        (foreign,) = [line for line in reader.left_out if "000000.log" in line] or [""]
    assert (ours == list(range(10))) == (session_id != "another")
    assert bool(foreign) == (session_id != "another")


def test_parts_are_taken_by_their_numbers_once_and_the_rest_is_counted(tmp_path):
    journal = filled(tmp_path / "journal", 10, part_bytes=15_000)
    first, second = journal.part_path(1), journal.part_path(2)
    shutil.copy(first, journal.part_path(7))
    for place, name in ((first, "aside"), (second, first), (journal.folder / "aside", second)):
        place.rename(journal.folder / name)
    with JournalReader(journal.folder) as reader:
        rows = list(reader.since(0, 14))
        assert len(rows) == 14
        assert [row.seq for row in rows if isinstance(row, SampleRow) and row.stream == 0] == list(range(10))
        again = [int(line.split()[0]) for line in reader.left_out if "000007.log" in line]
        assert again == [journal.full_parts[0][1]]
        assert not reader.doubt


def test_folder_without_a_journal_is_refused(tmp_path):
    with pytest.raises(SessionError, match="no readable journal"):
        JournalReader(tmp_path)


def _append_many(journal: Journal) -> None:
    for seq in range(10, 40):
        journal.append(sample(HEADER.streams[0], seq))


def test_full_disk_is_a_storage_error_and_earlier_rows_stay(tmp_path):
    journal = filled(tmp_path / "journal", 10, part_bytes=10**9)
    count = journal.next_id
    with (
        full_disk(journal.part_path(1).stat().st_size + 10_000),
        pytest.raises(StorageError, match="too large"),
    ):
        _append_many(journal)
    stored = journal.next_id
    assert count < stored < count + 30
    journal.append(ENTRIES[0])  # room again: it goes on
    journal.close()
    with JournalReader(journal.folder) as reader:
        assert sum(len(reader.numbers(stream)) for stream in range(3)) == stored - 2
        assert len(list(reader.entries())) == 3
        assert not reader.doubt
        assert not reader.damage


def test_parts_stay_until_the_file_has_their_records(tmp_path, monkeypatch):
    monkeypatch.setattr(session_file, "JOURNAL_BYTES", 1)  # after 750 MB parts go
    monkeypatch.setattr(session_file, "FLUSH_EVERY_S", 0.0)
    journal = filled(tmp_path / "journal", 40, part_bytes=15_000)
    parts = [part for part, _ in journal.full_parts]
    assert len(parts) > 2
    thread = FileThread(tmp_path / "a.h5", journal, IDENTITY, lambda error: None)
    there_at_sync: list[list[bool]] = []
    # what is on the disk when is not seen from outside without cutting the power
    monkeypatch.setattr(thread.file, "sync", lambda: there_at_sync.append([part.exists() for part in parts]))
    thread.start()
    after_first = journal.full_parts[0][1]
    with JournalReader(journal.folder) as reader:
        (row,) = reader.since(after_first, after_first + 1)
    assert all(part.exists() for part in parts)  # the file has nothing yet
    # those before it come from the journal
    thread.offer(after_first, row.sample(HEADER.streams[0]), row.crc32)
    wait_until(lambda: not parts[0].exists(), "the first part stays")
    thread.stop(at_once=True)
    thread.join()
    assert thread.error is None
    assert there_at_sync[:1] == [[True] * len(parts)]  # the file is on the disk before the part is gone
    assert [part.exists() for part in parts] == [False] + [True] * (len(parts) - 1)
    thread.close()
    journal.close()


def test_a_disk_that_does_not_confirm_is_told_and_the_part_is_asked_for_again(tmp_path, monkeypatch):
    journal = filled(tmp_path / "journal", 6, part_bytes=10**9)
    told: list[str] = []
    monkeypatch.setattr(journal_module, "SYNC_EVERY_S", 0.01)  # a shorter wait
    part, confirmed = journal.part_path(1), journal.folder / "confirmed.log"
    part.chmod(0)
    before = confirmed.stat().st_size
    with ordinary_rights():
        thread = SyncThread(journal, told.append)
        thread.start()
    wait_until(lambda: told, "the refusal is not reported")
    assert confirmed.stat().st_size == before  # what was not confirmed was not counted
    part.chmod(0o600)
    wait_until(lambda: confirmed.stat().st_size > before, "the part is not asked for again")
    thread.stop()
    assert all("did not confirm the last second" in text for text in told)
    assert str(part) in told[0]
    journal.close()
