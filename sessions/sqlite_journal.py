"""Journals of fieldkit 0.2, which were SQLite databases, as far as SQLite itself reads them.

Only for recovering what that version left interrupted; read like a `JournalReader`.
"""

from __future__ import annotations

import heapq
import itertools
import sqlite3
import struct
import zlib
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import numpy as np

from fieldkit.model.arrays import IntArray
from fieldkit.model.errors import RefusedError, SessionError, message_of
from fieldkit.model.samples import Quality
from fieldkit.sessions.journal import Chunk, SessionIdentity
from fieldkit.sessions.layout import SessionHeader
from fieldkit.sessions.records import Entry, SampleRow, decode_entry

_SAMPLE = (
    "SELECT id, stream, seq, mono_ns, time_ns, device_time, seq, device_seq, flags, fpa_temperature, crc32,"
    " data, more FROM sample WHERE stream = ? AND seq BETWEEN ? AND ? ORDER BY id"
)


class SqliteJournal:
    """The records of such a journal; a context manager.

    Raises `RefusedError` where it is torn: SQLite does not reach what stands behind a tear.
    """

    def __init__(self, folder: Path) -> None:
        self.damage: list[str] = []
        with ExitStack() as stack:
            try:
                parts = [_opened(path) for path in sorted(folder.glob("*.sqlite"))]
                self._parts = [stack.enter_context(closing(part)) for part in parts]
                self.identity: SessionIdentity = self._identity()
                self.written: tuple[int, ...] = self._counted()
            except (sqlite3.Error, SessionError, ValueError, TypeError) as error:
                raise _torn(folder, message_of(error)) from error
            confirmed = _confirmed(folder, len(self.written))
            if any(map(int.__lt__, self.written, confirmed)):
                raise _torn(folder, "records are missing")
            self.has_end: bool = any(confirmed)
            self._stack = stack.pop_all()

    def __enter__(self) -> SqliteJournal:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def numbers(self, stream: int) -> IntArray:
        """The numbers of the samples of a stream that the journal has, in order."""
        found = self._select("SELECT id, seq FROM sample WHERE stream = ? ORDER BY id", stream)
        return np.array([seq for _, seq in found], np.int64)

    def rows(self, stream: int, first: int = 0, last: int = 2**62) -> Iterator[SampleRow]:
        """The samples of a stream with numbers `first` to `last`, in order."""
        for _, *row in self._select(_SAMPLE, stream, first, last):
            place, seq, *numbers, flags, fpa, crc, data, more = row
            stamps = (*numbers, Quality(flags), float("nan") if fpa is None else fpa)
            yield SampleRow(place, seq, stamps, crc, data, more)

    def entries(self) -> Iterator[Entry]:
        """Everything but samples, in order."""
        for _, kind, body in self._select("SELECT id, kind, body FROM entry ORDER BY id"):
            yield decode_entry(kind, body)

    def chunks(self, dataset: str, n: int) -> list[Chunk]:
        """Places of the chunks of a dataset from row `n` on in the session file."""
        statement = "SELECT * FROM chunk WHERE dataset = ? AND n = ?"
        return [Chunk(*row) for part in self._parts for row in part.execute(statement, (dataset, n))]

    def _identity(self) -> SessionIdentity:
        for part in self._parts:
            row = part.execute("SELECT session_id, start_ns, anchor_ns, header FROM session").fetchone()
            if row is not None:
                return SessionIdentity(row[0], row[1], row[2], SessionHeader.from_json(row[3]))
        raise SessionError("it does not name its session")

    def _counted(self) -> tuple[int, ...]:
        samples = (len(self.numbers(stream)) for stream in range(len(self.identity.header.streams)))
        return (*samples, sum(1 for _ in self.entries()))

    def _select(self, statement: str, *arguments: int) -> Iterator[tuple[Any, ...]]:
        """Rows of all parts by number; of a row that stands in two parts, the one with its bytes."""
        parts = [part.execute(statement, arguments) for part in self._parts]
        ordered = heapq.merge(*parts, key=lambda row: int(row[0]))
        for _, same in itertools.groupby(ordered, key=lambda row: int(row[0])):
            yield min(same, key=lambda row: row[-1] is None)


def _opened(path: Path) -> sqlite3.Connection:
    if not path.stat().st_size:
        raise ValueError(f"{path.name} is empty")  # SQLite would delete its write-ahead log
    return sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True, isolation_level=None)


def _confirmed(folder: Path, streams: int) -> tuple[int, ...]:
    """Samples of each stream and, last, other records that the disk has confirmed; zeros if not known."""
    size = 8 * streams
    try:
        data = (folder / "written").read_bytes()
    except OSError:
        return (0,) * streams
    if len(data) != size + 4 or zlib.crc32(data[:size]) != int.from_bytes(data[size:], "little"):
        return (0,) * streams
    records, *samples = struct.unpack(f"<{streams}q", data[:size])
    return (*samples, records - sum(samples))


def _torn(folder: Path, why: str) -> RefusedError:
    return RefusedError(
        f"{folder} is a torn journal of fieldkit 0.2: {why}; it was left as it is",
        fix='version 0.2 recovers it: pip install "fieldkit-slope==0.2.*", then fieldkit recover',
    )
