"""Reading a journal's pages without SQLite gives what SQLite gives, and what it does not reach."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from fieldkit.sessions.journal import Chunk, Journal, RetainedPart, SessionIdentity, open_part, wal_of
from fieldkit.sessions.journal_reader import JournalReader
from fieldkit.sessions.torn_log import salvaged_part
from tests.harness.recording import START_NS, header, sample

SMALL, LARGE = header((24, 32)), header((300, 512))
"""Pages of 4096 bytes, and of 65 536."""


def journalled(folder: Path, head: object = SMALL, frames: int = 12) -> Journal:
    folder.mkdir()
    journal = Journal(folder, SessionIdentity("a-session", START_NS, 77, head))  # type: ignore[arg-type]
    for seq in range(frames):
        for info in journal._identity.header.streams:
            journal.append(sample(info, seq))
    journal.close()
    return journal


def rows(path: Path) -> list[tuple[object, ...]]:
    database = open_part(path)
    found = database.execute("SELECT * FROM sample ORDER BY id").fetchall()
    database.close()
    return found


def tear(log: Path, place: int) -> None:
    data = bytearray(log.read_bytes())
    data[place] ^= 0x10
    log.write_bytes(data)


def is_whole(part: Path) -> bool:
    database, found = salvaged_part(part)
    database.close()
    return found is None


@pytest.mark.parametrize("head", [SMALL, LARGE], ids=["small pages", "large pages"])
def test_torn_first_page_costs_no_row(tmp_path: Path, head: object) -> None:
    journal = journalled(tmp_path / "journal", head)
    part = journal.part_path(1)
    whole = rows(part)
    assert len(whole) == journal.next_id
    assert is_whole(part)
    tear(wal_of(part), 60)  # SQLite takes nothing of a log whose first frame is not whole
    copy, found = salvaged_part(part)
    assert found == journal.next_id
    assert copy.execute("SELECT * FROM sample ORDER BY id").fetchall() == whole


def test_row_of_a_torn_page_is_the_only_one_lost(tmp_path: Path) -> None:
    journal = journalled(tmp_path / "journal")
    part = journal.part_path(1)
    whole = rows(part)
    log = wal_of(part)
    tear(log, log.read_bytes().index(bytes(sample(SMALL.streams[0], 5).counts[5].tobytes())))  # type: ignore[union-attr]
    with JournalReader(journal.folder, salvage=True) as reader:
        found = list(reader.stream_rows(0))
    assert [row.seq for row in found if row.sample(SMALL.streams[0]) is None] == []
    assert {row[2] for row in whole if row[1] == 0} - {row.seq for row in found} <= {5}


def big_endian(log: bytes, page_size: int) -> bytes:
    """The same log as a big-endian computer writes it; checksums as section 4.2 of the format says."""

    def checksum(data: bytes, s0: int, s1: int) -> tuple[int, int]:
        for x0, x1 in struct.iter_unpack(">II", data):
            s0 = (s0 + x0 + s1) % 2**32
            s1 = (s1 + x1 + s0) % 2**32
        return s0, s1

    head = struct.pack(">I", 0x377F0683) + log[4:24]
    sums = checksum(head, 0, 0)
    parts = [head, struct.pack(">II", *sums)]
    for at in range(32, len(log), 24 + page_size):
        content = log[at + 24 : at + 24 + page_size]
        sums = checksum(log[at : at + 8] + content, *sums)
        parts += [log[at : at + 16], struct.pack(">II", *sums), content]
    return b"".join(parts)


def test_log_of_a_big_endian_computer_is_read(tmp_path: Path) -> None:
    journal = journalled(tmp_path / "journal")
    part = journal.part_path(1)
    whole = rows(part)
    wal_of(part).write_bytes(big_endian(wal_of(part).read_bytes(), 4096))
    assert rows(part) == whole  # SQLite agrees that it is one
    assert is_whole(part)
    tear(wal_of(part), 60)
    copy, _ = salvaged_part(part)
    assert copy.execute("SELECT * FROM sample ORDER BY id").fetchall() == whole


def test_database_that_lost_all_its_bytes_does_not_cost_its_log(tmp_path: Path) -> None:
    journal = journalled(tmp_path / "journal")
    journal.part_path(1).write_bytes(b"")
    with JournalReader(journal.folder, salvage=True) as reader:
        assert len(list(reader.rows())) == journal.next_id
    assert wal_of(journal.part_path(1)).stat().st_size


def test_log_whose_header_is_torn_costs_no_row(tmp_path: Path) -> None:
    journal = journalled(tmp_path / "journal")
    part = journal.part_path(1)
    whole = rows(part)
    tear(wal_of(part), 8)  # the page size: as if the log were too short for a single frame
    copy, _ = salvaged_part(part)
    assert copy.execute("SELECT * FROM sample ORDER BY id").fetchall() == whole


def test_log_that_began_again_after_a_checkpoint_is_whole(tmp_path: Path) -> None:
    retained = RetainedPart(tmp_path, SessionIdentity("a-session", START_NS, 77, SMALL))
    for n in range(0, 40_000, 100):
        retained.note_chunks(Chunk("/camera/counts", m, 0, 0, 4096 * m, 4000, m) for m in range(n, n + 100))
    retained.close()
    part = tmp_path / "000000.sqlite"
    assert wal_of(part).read_bytes()[12:16] != bytes(4)
    assert is_whole(part)
