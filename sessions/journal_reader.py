"""Reading a journal, also one whose writer was killed or whose disk lost the last second.

SQLite recovers its own log; with `salvage` what lies behind a tear of it is read as well. What cannot be
read is named in `damage` and skipped, and a sample whose checksum does not match is never returned.
"""

from __future__ import annotations

import heapq
import itertools
import sqlite3
import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import SessionError, message_of
from fieldkit.model.samples import Quality, Sample
from fieldkit.sessions.journal import Chunk, SessionIdentity, open_part
from fieldkit.sessions.layout import SessionHeader
from fieldkit.sessions.records import (
    Entry,
    build_frame,
    build_reading,
    decode_entry,
    sample_bytes,
    sample_crc32,
)
from fieldkit.sessions.torn_log import salvaged_part

_SESSION = "SELECT session_id, start_ns, anchor_ns, header FROM session"
_SAMPLE = (
    "SELECT id, stream, seq, mono_ns, time_ns, device_time, device_seq, flags, fpa_temperature, crc32,"
    " data, more FROM sample"
)


@dataclass(frozen=True, slots=True)
class SampleRow:
    """One sample as the journal keeps it; `data` is None once only the session file has the frame."""

    number: int
    stream: int
    seq: int
    mono_ns: int
    time_ns: int
    device_time: int
    device_seq: int
    flags: int
    fpa_temperature: float | None
    crc32: int
    data: bytes | None
    more: bytes | None

    def sample(self, info: StreamInfo) -> Sample | None:
        """The sample, or None where its bytes are gone or do not match their checksum."""
        if self.data is None or self.more is None:
            return None
        try:
            sample = self._build(info, self.data, self.more)
            matches = sample_crc32(sample, *sample_bytes(sample)) == self.crc32
        except (ValueError, TypeError, OverflowError, struct.error):
            return None
        return sample if matches else None

    def columns(self) -> dict[str, Any]:
        """What the session file's columns have of the sample."""
        return {
            "time": self.time_ns // 1000, "mono_ns": self.mono_ns, "device_time": self.device_time,
            "seq": self.seq, "device_seq": self.device_seq, "flags": self.flags, "crc32": self.crc32,
            "fpa_temperature": float("nan") if self.fpa_temperature is None else self.fpa_temperature,
        }  # fmt: skip

    def with_bytes(self, data: bytes, more: bytes) -> SampleRow:
        """The same row with its frame found elsewhere."""
        return replace(self, data=data, more=more)

    def _build(self, info: StreamInfo, data: bytes, more: bytes) -> Sample:
        stamps: dict[str, Any] = {
            "mono_ns": self.mono_ns, "time_ns": self.time_ns, "device_time": self.device_time,
            "device_seq": self.device_seq, "quality": Quality(self.flags), "seq": self.seq,
        }  # fmt: skip
        if not info.is_camera:
            return build_reading(info, stamps, data, more)
        fpa = float("nan") if self.fpa_temperature is None else self.fpa_temperature
        return build_frame(info, stamps, data, more, fpa)


class JournalReader:
    """The records of a journal, in the order they were written.

    With `salvage`, for a journal that is no longer written, also what SQLite does not reach. Raises
    `SessionError` where the folder holds no readable journal.
    """

    def __init__(self, folder: Path, *, salvage: bool = False) -> None:
        self.folder = folder
        self.damage: list[str] = []
        self._salvage = salvage
        self._parts: dict[str, sqlite3.Connection] = {}
        self.identity: SessionIdentity = self._open()

    def __enter__(self) -> JournalReader:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the databases."""
        for part in self._parts.values():
            part.close()
        self._parts.clear()

    def rows(self, after: int = -1, before: int | None = None) -> Iterator[SampleRow | Entry]:
        """Records with numbers between two, both excluded; those of damaged places are missing."""
        limit = 2**62 if before is None else before
        between = " WHERE id > ? AND id < ? ORDER BY id"
        samples = self._merged(_SAMPLE + between, after, limit)
        entries = self._merged("SELECT id, kind, body FROM entry" + between, after, limit)
        for row in heapq.merge(samples, entries, key=lambda row: int(row[0])):
            yield decode_entry(row[1], row[2]) if len(row) == 3 else SampleRow(*row)

    def stream_rows(
        self, stream: int, first: int = 0, last: int = 2**62, *, frames: bool = True
    ) -> Iterator[SampleRow]:
        """The samples of a stream in records `first` to `last`, in order; without `frames` no bytes."""
        columns = _SAMPLE if frames else _SAMPLE.replace("data, more", "NULL, NULL")
        statement = columns + " WHERE stream = ? AND id BETWEEN ? AND ? ORDER BY id"
        for row in self._merged(statement, stream, first, last):
            yield SampleRow(*row)

    def numbers(self, stream: int) -> Iterator[tuple[int, int]]:
        """The numbers of the records that are samples of a stream, and of the samples, in order."""
        sound = "SELECT id, seq FROM sample WHERE stream = ? AND typeof(seq) = 'integer' ORDER BY id"
        yield from self._merged(sound, stream)

    def crc32s(self, stream: int) -> Iterator[int]:
        """The checksums of that stream's samples, in order."""
        statement = "SELECT id, crc32 FROM sample WHERE stream = ? ORDER BY id"
        return (crc32 for _, crc32 in self._merged(statement, stream))

    def entries(self) -> Iterator[Entry]:
        """Everything but samples, in order."""
        for _, kind, body in self._merged("SELECT id, kind, body FROM entry ORDER BY id"):
            try:
                yield decode_entry(kind, body)
            except SessionError as error:
                self.damage.append(error.message)

    def total(self, stream: int) -> int:
        """How many samples of a stream were ever numbered; no number is higher than its record's."""
        rows = self._merged("SELECT max(id), seq FROM sample WHERE stream = ? HAVING seq IS NOT NULL", stream)
        return max((min(int(number), int(seq)) + 1 for number, seq in rows), default=0)

    def chunks(self, dataset: str, n: int) -> Iterator[Chunk]:
        """Where the chunks of a dataset from row `n` on lie in the session file."""
        for part in self._parts:
            for row in self._select(part, "SELECT * FROM chunk WHERE dataset = ? AND n = ?", dataset, n):
                yield Chunk(*row)

    def _open(self) -> SessionIdentity:
        identity: SessionIdentity | None = None
        for path in sorted(self.folder.glob("[0-9]*.sqlite")):
            try:
                database = self._open_part(path)
                self._parts[path.name] = database
                found = database.execute(_SESSION).fetchone()
                if found is not None:
                    identity = identity or SessionIdentity(
                        found[0], found[1], found[2], SessionHeader.from_json(found[3])
                    )
            except (sqlite3.Error, SessionError, UnicodeDecodeError) as error:
                self.damage.append(f"{path.name}: {message_of(error)}")
        if identity is None:
            self.close()
            raise SessionError(
                f"{self.folder} holds no readable journal: {'; '.join(self.damage) or 'empty'}"
            )
        return identity

    def _open_part(self, path: Path) -> sqlite3.Connection:
        if not self._salvage:
            return open_part(path)
        database, found = salvaged_part(path)
        if found is not None:
            text = f"{path.name}: torn; {found} records behind the tear were read from its pages"
            self.damage.append(text)
        return database

    def _merged(self, statement: str, *arguments: int | str) -> Iterator[tuple[Any, ...]]:
        """Rows of all parts by number; of a row that stands in two parts, the one with its bytes."""
        parts = [self._select(part, statement, *arguments) for part in self._parts]
        ordered = heapq.merge(*parts, key=lambda row: int(row[0]))
        for _, same in itertools.groupby(ordered, key=lambda row: int(row[0])):
            yield min(same, key=lambda row: row[-1] is None)

    def _select(self, part: str, statement: str, *arguments: int | str) -> Iterator[tuple[Any, ...]]:
        """Rows of one part as far as they can be read."""
        try:
            yield from self._parts[part].execute(statement, arguments)
        except (sqlite3.Error, UnicodeDecodeError, OverflowError, MemoryError) as error:
            self.damage.append(f"{part}: {message_of(error)}")
