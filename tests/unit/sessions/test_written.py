"""The count beside a journal says what the disk has confirmed, and nothing where that is not known."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from fieldkit.sessions import journal as journal_module
from fieldkit.sessions.journal import NAME, WrittenCount, note_written, read_written
from fieldkit.sessions.layout import journal_path
from fieldkit.sessions.recovery import recover
from fieldkit.sessions.writer import SessionWriter
from tests.harness.recording import CountedClock, header, sample

HEADER = header((24, 32))
REGIONS = 2


def interrupted(path: Path) -> Path:
    """Seven frames and three readings of the illuminometer; the folder of the journal."""
    writer = SessionWriter(path, HEADER, CountedClock())
    for seq in range(7):
        writer.append(sample(HEADER.streams[0], seq))
    for seq in range(3):
        writer.append(sample(HEADER.streams[1], seq))
    writer.abandon()
    return journal_path(path)


def test_count_is_of_every_record_and_of_the_samples_of_each_stream(tmp_path: Path) -> None:
    written = read_written(interrupted(tmp_path / "a.h5"), 3)
    assert written == WrittenCount(10 + REGIONS, (7, 3, 0))
    assert written.entries == REGIONS


def test_a_count_is_replaced_as_a_whole(tmp_path: Path) -> None:
    for number in (2**40, 3):
        note_written(tmp_path, WrittenCount(number, (number, 0)))
        assert read_written(tmp_path, 2) == WrittenCount(number, (number, 0))


@pytest.mark.parametrize("place", [0, 9, 30, 35])
def test_a_damaged_count_says_nothing(tmp_path: Path, place: int) -> None:
    folder = interrupted(tmp_path / "a.h5")
    data = bytearray((folder / NAME).read_bytes())
    assert len(data) == 36
    data[place] ^= 1
    (folder / NAME).write_bytes(data)
    assert read_written(folder, 3) == WrittenCount(0, (0, 0, 0))
    (folder / NAME).write_bytes(data[:-1])
    assert read_written(folder, 3) == WrittenCount(0, (0, 0, 0))
    (folder / NAME).unlink()  # as in a journal of an earlier version
    assert read_written(folder, 3) == WrittenCount(0, (0, 0, 0))
    assert recover(tmp_path / "a.h5").lost_samples == 0


def test_what_the_disk_did_not_confirm_is_not_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(_: Path) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(journal_module, "sync_data", fails)
    assert not (interrupted(tmp_path / "a.h5") / NAME).exists()
