"""A log gives back every record whose bytes are whole, whatever became of those around it."""

import errno
import io
import os
import random
from pathlib import Path

import pytest

from fieldkit.sessions.log import MAGIC, Kind, LogReader, LogWriter, session_number
from tests.harness.disk import full_disk

SESSION = session_number("a-session")
OTHER = session_number("another")


def payload(number: int) -> bytes:
    """Of any size, and not without bytes that look like the beginning of a record."""
    return random.Random(number).randbytes(number * 37 % 900) + MAGIC * (number % 3)


def written(path: Path, count: int = 40) -> list[int]:
    """Records of two streams; where each begins, and where the last ends."""
    log, counts = LogWriter(path, SESSION), [0, 0]
    places = []
    for number in range(count):
        counts[number % 2] += 1
        places.append(log.size)
        log.append(Kind.SAMPLE, number % 2, counts, payload(number)[:50], payload(number)[50:])
    log.close()
    log.close()
    return [*places, log.size]


def read(path: Path) -> tuple[list[tuple[int, bytes | None]], LogReader]:
    log = LogReader(path)
    found = [(head.number, log.payload(head)) for head in log.heads()]
    log.close()
    return found, log


def test_records_come_back_as_they_were_written(tmp_path):
    places = written(tmp_path / "log")
    log = LogReader(tmp_path / "log")
    heads = list(log.heads())
    assert [log.payload(head) for head in heads] == [payload(number) for number in range(40)]
    assert [(head.stream, head.seq, head.number) for head in heads] == [(n % 2, n // 2, n) for n in range(40)]
    assert [head.at for head in heads] == places[:-1]
    assert {head.session for head in heads} == {SESSION}
    assert log.is_whole
    assert log.damage == []
    log.close()


@pytest.mark.parametrize("trial", range(60))
def test_damage_costs_only_the_records_that_it_hits(tmp_path, trial):
    chance, path = random.Random(trial), tmp_path / "log"
    places = written(path)
    first = chance.randrange(places[-1])
    last = min(first + chance.choice((1, 40, 3_000)), places[-1]) - 1
    data = bytearray(path.read_bytes())
    data[first : last + 1] = bytes(byte ^ 0x5A for byte in data[first : last + 1])
    path.write_bytes(data)
    hit = {n for n in range(40) if places[n] <= last and places[n + 1] > first}
    found, log = read(path)
    whole = {number: content for number, content in found if content is not None}
    assert whole == {n: payload(n) for n in range(40) if n not in hit}
    assert log.damage or not log.is_whole or any(content is None for _, content in found)


def test_bytes_taken_out_or_in_cost_no_other_record(tmp_path):
    path = tmp_path / "log"
    places = written(path)
    data = path.read_bytes()
    path.write_bytes(
        data[: places[10] + 7] + data[places[12] + 5 : places[20]] + b"?" * 77 + data[places[20] :]
    )
    found, log = read(path)
    assert [number for number, content in found if content is not None] == [*range(10), *range(13, 40)]
    assert len(log.damage) == 2


def test_record_that_lacks_bytes_does_not_cost_those_behind_it(tmp_path):
    path = tmp_path / "log"
    log = LogWriter(path, SESSION)
    for number, size in enumerate((10, 5_000, 10, 10, 10)):
        log.append(Kind.ENTRY, 0, (number + 1,), bytes(size))
    log.close()
    data = path.read_bytes()
    path.write_bytes(data[:1_000] + data[1_100:])
    found, log_read = read(path)
    assert [number for number, content in found if content is not None] == [0, 2, 3, 4]
    assert len(log_read.damage) == 1


@pytest.mark.parametrize("lost", [1, 30, 200])
def test_log_without_its_end_says_so(tmp_path, lost):
    path = tmp_path / "log"
    written(path)
    path.write_bytes(path.read_bytes()[:-lost])
    found, log = read(path)
    assert [number for number, _ in found] == list(range(39))
    assert not log.is_whole
    assert log.damage == []  # what stands behind the last record is its tail


def test_record_within_a_record_is_not_taken_for_one(tmp_path):
    inner, outer = tmp_path / "inner", tmp_path / "outer"
    written(inner)
    log = LogWriter(outer, OTHER)
    for number in range(3):
        log.append(Kind.ENTRY, 0, (number + 1,), inner.read_bytes())
    log.close()
    found, _ = read(outer)
    assert found == [(number, inner.read_bytes()) for number in range(3)]


def test_record_that_does_not_fit_leaves_nothing_behind(tmp_path):
    log = LogWriter(tmp_path / "log", SESSION)
    log.append(Kind.ENTRY, 0, (1,), b"first")
    size = log.size
    with full_disk(size + 100), pytest.raises(OSError, match="too large"):
        log.append(Kind.ENTRY, 0, (2,), bytes(500))
    assert (tmp_path / "log").stat().st_size == log.size == size
    log.append(Kind.ENTRY, 0, (2,), b"second")
    log.close()
    found, reader = read(tmp_path / "log")
    assert found == [(0, b"first"), (1, b"second")]
    assert reader.is_whole


class StumblingFile(io.FileIO):
    """A file that the disk does not give twice, and then does."""

    refusals = 2

    def read(self, size: int = -1) -> bytes:
        if self.refusals:
            self.refusals -= 1
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return super().read(size)


def test_a_disk_that_is_away_for_a_moment_is_no_damage(tmp_path):
    written(tmp_path / "log")
    log = LogReader(tmp_path / "log")
    log.close()
    log._file = StumblingFile(tmp_path / "log")
    assert [log.payload(head) for head in log.heads()] == [payload(number) for number in range(40)]
    assert (log.damage, log.is_whole, log._file.refusals) == ([], True, 0)
    log.close()
