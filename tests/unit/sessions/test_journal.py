"""The journal keeps every record, in order, over many parts and after damage."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from fieldkit.model.clock import ClockCheck
from fieldkit.model.errors import SessionError, StorageError
from fieldkit.model.samples import Event, EventKind, Health, Quality, Severity, StreamHealth
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import SlopeEstimate, SlopeState
from fieldkit.sessions import journal as journal_module
from fieldkit.sessions import session_file
from fieldkit.sessions.journal import Journal, RetainedPart, SessionIdentity, SyncThread, wal_of
from fieldkit.sessions.journal_reader import JournalReader, SampleRow
from fieldkit.sessions.records import MinuteRecord, RegionRecord, decode_entry, encode_entry
from fieldkit.sessions.session_file import FileThread
from tests.harness.learnt import learnt
from tests.harness.recording import START_NS, header, same, sample

HEADER = header((24, 32))
IDENTITY = SessionIdentity("a-session", START_NS, 77, HEADER)
ENTRIES = (
    Event(EventKind.CLOUD, 5, 6, "Wolke ☁", "lux", Severity.WARNING, {"depth": 0.25}),
    Health(7, 8, (StreamHealth("camera", 1, 2, 3, 4, 5),), 9, 10, 1.5, 2.5, 3.5),
    ClockCheck(11, -12, 13, "gps", 14),
    MinuteRecord(60, (SlopeEstimate(60, "b05", SlopeState.OK, 0.1 + 0.2),), 1 / 3, "eq10", Quality.LOW_SUN),
    MinuteRecord(120, (), learnt=learnt()),
    RegionRecord(Region("b05", RegionKind.TARGET, ((0.5, 1.0), (2.0, 1.0), (2.0, 3.25)), 5.0, 180.0), 15),
)  # fmt: skip


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: type(entry).__name__)
def test_entry_is_the_same_after_json(entry: object) -> None:
    assert repr(decode_entry(*encode_entry(entry))) == repr(entry)  # type: ignore[arg-type]  # by repr: NaN


def test_entry_that_makes_no_sense_is_named() -> None:
    with pytest.raises(SessionError, match="cloud"):
        decode_entry("cloud", "{}")
    with pytest.raises(SessionError, match="event"):
        decode_entry("event", '{"kind": 3}')


def filled(folder: Path, frames: int, part_bytes: int) -> Journal:
    folder.mkdir()
    journal = Journal(folder, IDENTITY, part_bytes)
    for seq in range(frames):
        journal.append(sample(HEADER.streams[0], seq))
        if seq % 5 == 0:
            journal.append(sample(HEADER.streams[1], seq // 5))
            journal.append(ENTRIES[0])
    return journal


def test_records_come_back_in_order_over_many_parts(tmp_path: Path) -> None:
    journal = filled(tmp_path / "journal", 40, part_bytes=15_000)
    assert journal.number > 3
    with JournalReader(journal.folder) as reader:  # while the writer is still there
        assert reader.identity.header.to_json() == HEADER.to_json()  # by text: NaN
        assert (reader.identity.session_id, reader.identity.anchor_ns) == ("a-session", 77)
        rows = list(reader.rows())
        assert len(rows) == journal.next_id == 40 + 8 + 8
        frames = [row for row in rows if isinstance(row, SampleRow) and row.stream == 0]
        for seq, row in enumerate(frames):
            found = row.sample(HEADER.streams[0])
            assert found is not None
            assert same(found, sample(HEADER.streams[0], seq))
        assert [row for row in rows if not isinstance(row, SampleRow)] == [ENTRIES[0]] * 8
        some = [row.number for row in reader.rows(after=10, before=20) if isinstance(row, SampleRow)]
        assert some == [n for n in range(11, 20) if n % 7 != 2]
        assert reader.total(0) == 40
        assert reader.total(2) == 0
        assert not reader.damage
    journal.close()


def test_closing_copies_nothing_and_reading_changes_nothing(tmp_path: Path) -> None:
    journal = filled(tmp_path / "journal", 30, part_bytes=10**9)
    part = journal.part_path(1)
    size = wal_of(part).stat().st_size
    journal.close()
    journal.close()
    assert wal_of(part).stat().st_size == size
    before = part.read_bytes(), wal_of(part).read_bytes()
    with JournalReader(journal.folder) as reader:
        assert len(list(reader.rows())) == journal.next_id
    assert (part.read_bytes(), wal_of(part).read_bytes()) == before


def test_retired_part_leaves_all_but_the_pictures(tmp_path: Path) -> None:
    journal = filled(tmp_path / "journal", 40, part_bytes=15_000)
    retained = RetainedPart(journal.folder, IDENTITY)
    part, end = journal.full_parts.popleft()
    retained.retire(part)
    assert not part.exists()
    with JournalReader(journal.folder) as reader:
        rows = list(reader.rows())
        assert len(rows) == journal.next_id
        gone = [row for row in rows if isinstance(row, SampleRow) and row.data is None]
        assert gone
        assert all(row.stream == 0 and row.number < end for row in gone)
        assert all(row.sample(HEADER.streams[0]) is None for row in gone)
        assert list(reader.crc32s(0)) == [row.crc32 for row in reader.stream_rows(0)]
    retained.close()
    journal.close()


def test_next_part_is_made_ready_before_it_is_needed(tmp_path: Path) -> None:
    journal = filled(tmp_path / "journal", 6, part_bytes=15_000)
    journal.prepare()
    assert journal.part_path(2).exists()
    assert journal.number == 1
    for seq in range(6, 30):
        journal.append(sample(HEADER.streams[0], seq))
    assert journal.number >= 2
    journal.close()


def test_row_with_a_changed_byte_is_not_handed_out(tmp_path: Path) -> None:
    journal = filled(tmp_path / "journal", 3, part_bytes=10**9)
    with JournalReader(journal.folder) as reader:
        row = next(reader.stream_rows(0))
        assert row.data is not None
        assert row.more is not None
        assert row.with_bytes(b"\xff" + row.data[1:], row.more).sample(HEADER.streams[0]) is None
        assert row.with_bytes(row.data[:-2], row.more).sample(HEADER.streams[0]) is None
        assert row.with_bytes(row.data, row.more).sample(HEADER.streams[0]) is not None
    journal.close()


def test_journal_without_its_first_part_still_reads(tmp_path: Path) -> None:
    journal = filled(tmp_path / "journal", 40, part_bytes=15_000)
    journal.close()
    for path in (journal.part_path(1), wal_of(journal.part_path(1))):
        path.write_bytes(b"garbage" * 1000)
    with JournalReader(journal.folder) as reader:
        numbers = [row.number for row in reader.rows() if isinstance(row, SampleRow)]
        assert numbers
        assert min(numbers) > 0
        assert any("000001" in line for line in reader.damage)


def test_folder_without_a_journal_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SessionError, match="no readable journal"):
        JournalReader(tmp_path)


def _append_many(journal: Journal) -> None:
    for seq in range(10, 40):
        journal.append(sample(HEADER.streams[0], seq))


def test_full_disk_is_a_storage_error_and_earlier_rows_stay(tmp_path: Path) -> None:
    journal = filled(tmp_path / "journal", 10, part_bytes=10**9)
    count = journal.next_id
    # SQLite's own limit on pages gives the very error of a full disk (SQLITE_FULL).
    pages = journal._database.execute("PRAGMA page_count").fetchone()[0]
    journal._database.execute(f"PRAGMA max_page_count={pages}")
    with pytest.raises(StorageError, match="full"):
        _append_many(journal)
    stored = journal.next_id
    assert count <= stored < count + 30
    journal._database.execute("PRAGMA max_page_count=100000")
    journal.append(ENTRIES[0])  # room again: it goes on
    journal.close()
    shutil.copytree(journal.folder, tmp_path / "copy")
    with JournalReader(tmp_path / "copy") as reader:
        assert len(list(reader.rows())) == stored + 1


def test_parts_stay_until_the_file_has_their_records(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session_file, "JOURNAL_BYTES", 1)
    journal = filled(tmp_path / "journal", 40, part_bytes=15_000)
    parts = [part for part, _ in journal.full_parts]
    assert len(parts) > 2
    thread = FileThread(tmp_path / "a.h5", journal, IDENTITY, lambda error: None)
    thread._shorten_journal()
    assert all(part.exists() for part in parts)  # the file has nothing yet
    thread._catch_up(journal.full_parts[0][1])
    there_at_sync: list[bool] = []
    monkeypatch.setattr(thread.file, "sync", lambda: there_at_sync.append(parts[0].exists()))
    thread._shorten_journal()
    assert there_at_sync == [True]  # the file is on the disk before the part is gone
    assert [part.exists() for part in parts] == [False] + [True] * (len(parts) - 1)
    thread.close()
    journal.close()


def test_a_disk_that_does_not_confirm_is_told_and_the_part_is_asked_for_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal = filled(tmp_path / "journal", 6, part_bytes=10**9)
    told: list[str] = []
    asked: list[Path] = []

    def refuse(path: Path) -> None:
        asked.append(path)
        raise OSError(5, "Input/output error")

    thread = SyncThread(journal, told.append)
    monkeypatch.setattr(journal_module, "sync_data", refuse)
    thread._sync()
    assert len(told) == 1
    assert "did not confirm the last second" in told[0]
    assert "Input/output error" in told[0]
    monkeypatch.setattr(journal_module, "sync_data", asked.append)
    thread._sync()
    assert asked == [wal_of(journal.part_path(1))] * 2
    journal.close()
