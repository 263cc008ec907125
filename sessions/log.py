"""A log of records: appended, never changed, each framed and checked by itself.

::

    magic | session, kind, stream, counts, length, payload's CRC-32 | CRC-32 of all that | payload

Damage costs the records whose bytes it hits and no others: a reader goes on at the next magic. `counts` has
how many records of each stream were written until then, this one included, so that any record that survives
says how many there were before it.
"""

from __future__ import annotations

import contextlib
import os
import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import partial
from pathlib import Path

from isal.isal_zlib import crc32

from fieldkit.disk import Patience

MAGIC = b"\xf5fkL"  # no byte of UTF-8 text begins with F5
_FIXED = struct.Struct("<4sIHHHII")
_CRC = struct.Struct("<I")
_WINDOW = 65_536
_SECTOR = 4096
_MOST_COUNTS, _MOST_RECORDS = 1024, 2**48


class Kind(IntEnum):
    """Kind of a record's payload."""

    IDENTITY = 0
    """Whose log it is; the first record of each file."""
    SAMPLE = 1
    STAMPS = 2
    """A frame without its counts, which the session file has."""
    ENTRY = 3
    CHUNKS = 4
    """Places of chunks of frames in the session file."""
    CONFIRMED = 5
    """Confirmation by the disk of as many records as in `counts`."""
    WRITTEN = 6
    """In the lock: as many records as in `counts` are in the kernel's hands."""
    CLOSED = 7
    """The last record of a journal whose writer ended in order."""


@dataclass(frozen=True, slots=True)
class Head:
    """Head of a payload, and its place."""

    at: int
    session: int
    kind: int
    stream: int
    counts: tuple[int, ...]
    length: int
    crc32: int

    @property
    def seq(self) -> int:
        """The number of the record in its stream, from 0."""
        return self.counts[self.stream] - 1

    @property
    def number(self) -> int:
        """The number of the record among all, from 0."""
        return sum(self.counts) - 1

    @property
    def payload_at(self) -> int:
        """Offset at which the payload begins."""
        return self.at + _FIXED.size + 8 * len(self.counts) + _CRC.size

    @property
    def end(self) -> int:
        """Offset at which the record ends."""
        return self.payload_at + self.length


_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


def boot_id() -> str:
    """Mark of the time since the computer was started: another one after each start."""
    return _BOOT_ID.read_text().strip()


@dataclass(frozen=True, slots=True)
class Origin:
    """The file that a log was made as: part (0: it is none), device, inode, and boot of the computer."""

    part: int
    device: int
    inode: int
    boot: str


def session_number(session_id: str) -> int:
    """Mark of the records of a session: a disk may show bytes of an earlier log that was deleted."""
    return zlib.crc32(session_id.encode())


def encode_record(
    session: int, kind: Kind, stream: int, counts: Sequence[int], *payload: bytes | memoryview
) -> list[bytes | memoryview]:
    """The bytes of one record, its payload given in parts."""
    crc = 0
    for part in payload:
        crc = crc32(part, crc)
    head = _FIXED.pack(MAGIC, session, kind, stream, len(counts), sum(map(len, payload)), crc)
    head += struct.pack(f"<{len(counts)}Q", *counts)
    return [head + _CRC.pack(crc32(head)), *payload]


class LogWriter:
    """Writes a log from its beginning; raises `OSError`, and then it ends with the record before."""

    def __init__(self, path: Path, session: int) -> None:
        self.path = path
        self.size: int = 0
        self._session, self._patience = session, Patience()
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)

    def append(self, kind: Kind, stream: int, counts: Sequence[int], *payload: bytes | memoryview) -> None:
        """Write one record, its payload given in parts."""
        self._patience(partial(self._write, encode_record(self._session, kind, stream, counts, *payload)))

    def _write(self, parts: list[bytes | memoryview]) -> None:
        whole = sum(map(len, parts))
        try:
            written = os.writev(self._descriptor, parts)
            while written < whole:  # a full disk takes a part, and then says why it takes no more
                written += os.write(self._descriptor, b"".join(parts)[written:])
        except OSError:
            with contextlib.suppress(OSError):  # else the next record is written over what is there
                os.ftruncate(self._descriptor, self.size)
            os.lseek(self._descriptor, self.size, os.SEEK_SET)
            raise
        self.size += whole

    def close(self) -> None:
        """Close; a second call does nothing."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


class LogReader:
    """Reads a log from byte `start` on, also one that is being written, was cut off or is damaged.

    `damage` names the bytes that are not records, as far as the file was read; what stands behind the last
    record is its tail, not damage: `is_whole` tells whether there is none.

    Attributes
    ----------
    origin : Origin or None
        The file that the log was made as, once its head was read.
    """

    def __init__(self, path: Path, start: int = 0) -> None:
        self.name: str = path.name
        self._start = start
        self.damage: list[str] = []
        self.is_whole: bool = True
        self.origin: Origin | None = None
        # a disk that is away for a moment must not pass for damage: what is damaged, recovery leaves out
        self._patience = Patience()
        self._file = path.open("rb", buffering=0)
        self._window, self._window_at = b"", 0
        stat = os.fstat(self._file.fileno())
        self._size, self._inode = stat.st_size, (stat.st_dev, stat.st_ino)

    def close(self) -> None:
        """Let go of the file, and of what was read of it."""
        self._file.close()
        self._window = b""

    @property
    def part(self) -> int:
        """Number of the part, from 1; 0 for other logs, and where the head is gone."""
        return self.origin.part if self.origin else 0

    @property
    def is_copy(self) -> bool:
        """True if this is another file than the one that was written."""
        return self.origin is not None and (self.origin.device, self.origin.inode) != self._inode

    def heads(self) -> Iterator[Head]:
        """The head of each record that has one, in the order of the file; payloads are not looked at."""
        at = behind = self._start
        self.damage.clear()
        while at < self._size:
            if (head := self.head_at(at)) is None:
                at = self._next_magic(at + 1)
                continue
            if at > behind:
                self.damage.append(f"{self.name}: {at - behind} bytes from {behind} on are damaged")
            yield head
            # a payload that was torn may hide whole records within its length
            is_next = head.end == self._size or self._read(head.end, len(MAGIC)) == MAGIC
            at = behind = head.end if is_next or self.payload(head) is not None else head.payload_at
        self.is_whole = behind == self._size

    def payload(self, head: Head) -> bytes | None:
        """The payload of a record, None where it is damaged."""
        data = self._read(head.payload_at, head.length)
        return data if len(data) == head.length and crc32(data) == head.crc32 else None

    def head_at(self, at: int) -> Head | None:
        """The record that begins at a place, if one does and the file has all of it."""
        fixed = self._read(at, _FIXED.size)
        if len(fixed) < _FIXED.size or not fixed.startswith(MAGIC):
            return None
        _, session, kind, stream, streams, length, crc = _FIXED.unpack(fixed)
        rest = self._read(at + _FIXED.size, 8 * streams + _CRC.size) if streams <= _MOST_COUNTS else b""
        head, stored = fixed + rest[: -_CRC.size], rest[-_CRC.size :]
        if len(rest) != 8 * streams + _CRC.size or _CRC.pack(crc32(head)) != stored:
            return None
        record = Head(at, session, kind, stream, struct.unpack_from(f"<{streams}Q", rest), length, crc)
        is_possible = stream < streams and max(record.counts) < _MOST_RECORDS
        return record if record.end <= self._size and is_possible else None

    def _next_magic(self, at: int) -> int:
        """Offset of the next magic, or the end of the file."""
        while at < self._size:
            window = self._read(at, _WINDOW)
            if (place := window.find(MAGIC)) >= 0:
                return at + place
            # windows overlap by a magic less a byte; what the disk does not give is skipped by sectors
            at += max(len(window) - len(MAGIC) + 1, 1) if window else _SECTOR
        return self._size

    def _read(self, at: int, size: int) -> bytes:
        """Bytes of the file; none where the disk does not give them, nor a moment later."""
        if not 0 <= at - self._window_at <= len(self._window) - size:
            try:
                self._patience(partial(self._read_window, at, size))
            except OSError:
                return b""
        first = at - self._window_at
        return self._window[first : first + size]

    def _read_window(self, at: int, size: int) -> None:
        """Read what begins at a place: from record to record, most stands in the window already."""
        self._file.seek(at)
        window = self._file.read(max(size, _WINDOW))
        while len(window) < size and (more := self._file.read(size - len(window))):
            window += more  # a disk stops short of a damaged sector, and reports it the next time
        self._window, self._window_at = window, at
