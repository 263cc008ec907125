"""The journal: what was recorded, one row per sample, in SQLite databases in WAL mode.

While a session is recorded its journal is the truth: a row is committed in the thread
that delivers the sample, before anything else happens to it, so a killed process loses
nothing; the write-ahead log is synced each second, so a power cut loses what came after.
Databases are filled one after the other (``000001.sqlite``, ``000002.sqlite`` ...), so that
the oldest can go once the session file has its samples safely. What must stay of those (all
but the frames) and where each frame's chunks lie in the file moves to
``000000.sqlite`` before.
"""

from __future__ import annotations

import contextlib
import logging
import os
import sqlite3
import struct
import threading
import time
import zlib
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from fieldkit.disk import BEGIN_BYTES, begin_sync, sync, sync_data
from fieldkit.model.errors import StorageError
from fieldkit.model.samples import Frame, Reading
from fieldkit.sessions.layout import SessionHeader
from fieldkit.sessions.records import Record, encode_entry, sample_bytes, sample_crc32

SCHEMA_VERSION = 1

PART_BYTES = 256_000_000

KEPT_NAME = "000000.sqlite"

LARGE_PIXELS = 150_000
"""A frame of so many and more is large: its camera alone can keep a computer busy."""

TABLES = """
CREATE TABLE session(schema_version INTEGER, session_id TEXT, start_ns INTEGER, anchor_ns INTEGER,
    header TEXT);
CREATE TABLE sample(id INTEGER PRIMARY KEY, stream INTEGER, seq INTEGER, mono_ns INTEGER, time_ns INTEGER,
    device_time INTEGER, device_seq INTEGER, flags INTEGER, fpa_temperature REAL, crc32 INTEGER,
    data BLOB, more BLOB);
CREATE TABLE entry(id INTEGER PRIMARY KEY, kind TEXT, body TEXT);
CREATE TABLE chunk(dataset TEXT, n INTEGER, y INTEGER, x INTEGER, offset INTEGER, size INTEGER,
    crc32 INTEGER, PRIMARY KEY (dataset, n, y, x, offset)) WITHOUT ROWID;
"""

_INSERT_SAMPLE = "INSERT INTO sample VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)"


class Chunk(NamedTuple):
    """Where one compressed chunk of a dataset lies in the session file."""

    dataset: str
    n: int
    y: int
    x: int
    offset: int
    size: int
    crc32: int


@dataclass(frozen=True, slots=True)
class SessionIdentity:
    """What every part of a journal repeats: whose it is."""

    session_id: str
    start_ns: int
    anchor_ns: int
    header: SessionHeader


class Journal:
    """The writing side; one thread appends.

    Raises `StorageError` where the disk does not take a row; that row is then not in the
    journal, everything before is.
    """

    def __init__(self, folder: Path, identity: SessionIdentity, part_bytes: int = PART_BYTES) -> None:
        self.folder = folder
        self.bytes_written: int = 0
        self.next_id: int = 0
        self._identity = identity
        self.part_bytes = part_bytes
        self._streams = {info.name: number for number, info in enumerate(identity.header.streams)}
        self._number = 1
        self._part_start = 0
        self._samples = [0] * len(self._streams)
        self._database = create_part(self.part_path(1), identity)
        self._next: sqlite3.Connection | None = None
        self._next_lock = threading.Lock()
        self.is_closed: bool = False
        self.full_parts: deque[tuple[Path, int]] = deque()
        """Parts that are full, oldest first, each with the number of the record after its last."""

    def part_path(self, number: int) -> Path:
        """Where part `number` stands."""
        return self.folder / f"{number:06}.sqlite"

    @property
    def number(self) -> int:
        """The number of the part that takes the rows now."""
        return self._number

    @property
    def written(self) -> WrittenCount:
        """What was appended so far, from any thread: an entry may be missing, never a record too many."""
        records = self.next_id  # read first: it is counted last
        return WrittenCount(records, tuple(self._samples))

    def append(self, record: Record) -> tuple[int, int | None]:
        """Commit one record; its number, from 0 without gaps, and a sample's checksum."""
        if self.bytes_written - self._part_start >= self.part_bytes:
            with contextlib.suppress(sqlite3.Error, OSError):  # better a part too long than a record lost
                self._rotate()
        try:
            size, crc32 = self._insert(record)
        except sqlite3.Error as error:
            raise StorageError(
                f"the journal {self.folder} could not store a record: {error}",
                fix="free some space; everything recorded until now is safe",
            ) from error
        self.bytes_written += size
        self.next_id += 1
        return self.next_id - 1, crc32

    def _insert(self, record: Record) -> tuple[int, int | None]:
        if not isinstance(record, Frame | Reading):
            kind, body = encode_entry(record)
            self._database.execute("INSERT INTO entry VALUES (?, ?, ?)", (self.next_id, kind, body))
            return len(body), None
        data, more = sample_bytes(record)
        crc32 = sample_crc32(record, data, more)
        row = (
            self.next_id, self._streams[record.stream], record.seq, record.mono_ns, record.time_ns,
            record.device_time, record.device_seq, int(record.quality),
            record.fpa_temperature_k if isinstance(record, Frame) else None,
            crc32, data, more,
        )  # fmt: skip
        self._database.execute(_INSERT_SAMPLE, row)
        self._samples[row[1]] += 1
        return len(data) + len(more) + 128, crc32

    def prepare(self) -> None:
        """Make the next database ready before it is needed: its syncs must not hold up a sample.

        For another thread than the one that appends.
        """
        with self._next_lock:
            half_full = self.bytes_written - self._part_start >= self.part_bytes // 2
            if self._next is None and half_full and not self.is_closed:
                self._next = create_part(self.part_path(self._number + 1), self._identity)

    def _rotate(self) -> None:
        with self._next_lock:
            part = self.part_path(self._number)
            following = self._next or create_part(self.part_path(self._number + 1), self._identity)
            self._next = None
            close_uncopied(self._database, part)
            self.full_parts.append((part, self.next_id))
            self._database, self._number, self._part_start = following, self._number + 1, self.bytes_written

    def close(self) -> None:
        """Close the database; a second call does nothing."""
        with self._next_lock:
            if not self.is_closed:
                self.is_closed = True
                close_uncopied(self._database, self.part_path(self._number))
                if self._next is not None:
                    self._next.close()


def create_part(path: Path, identity: SessionIdentity) -> sqlite3.Connection:
    """Make and open a database of the journal; its name and first page are on disk when this returns."""
    delete_part(path)  # what an attempt that failed may have left
    uri = path.absolute().as_uri()
    database = sqlite3.connect(uri, uri=True, isolation_level=None, check_same_thread=False)
    database.executescript(
        f"PRAGMA page_size={_page_size(identity.header)}; PRAGMA journal_mode=WAL;"
        "PRAGMA synchronous=NORMAL; PRAGMA wal_autocheckpoint=0; BEGIN;" + TABLES
    )
    header = identity.header.to_json()
    row = (SCHEMA_VERSION, identity.session_id, identity.start_ns, identity.anchor_ns, header)
    database.execute("INSERT INTO session VALUES (?, ?, ?, ?, ?)", row)
    database.execute("COMMIT")
    for name in (path, wal_of(path), path.parent):
        sync(name)
    return database


def _page_size(header: SessionHeader) -> int:
    """Large pages halve the cost of a large frame, but each reading of a meter costs one of them."""
    largest = max((info.shape[0] * info.shape[1] for info in header.streams if info.is_camera), default=0)
    return 65_536 if largest >= LARGE_PIXELS else 4096


def open_part(path: Path) -> sqlite3.Connection:
    """Open a database of the journal for reading; nothing in it is changed."""
    return sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True, isolation_level=None)


def close_uncopied(database: sqlite3.Connection, path: Path) -> None:
    """Close without the copy of the whole log into the database that the last one to close makes."""
    with contextlib.suppress(sqlite3.Error):  # what was committed is there, however the closing goes
        reader = open_part(path)
        reader.execute("SELECT schema_version FROM session").fetchone()  # its lock holds once it has read
        database.close()
        reader.close()


def wal_of(path: Path) -> Path:
    """The write-ahead log of a database."""
    return path.with_name(path.name + "-wal")


def delete_part(part: Path) -> None:
    """Delete a database of the journal with its log."""
    for path in (part, wal_of(part), part.with_name(part.name + "-shm")):
        path.unlink(missing_ok=True)


# --- keeping it small


class RetainedPart:
    """Keeps the journal small: where the chunks of the file lie, and what must outlive a full part.

    Used by the one thread that writes the session file.
    """

    def __init__(self, folder: Path, identity: SessionIdentity) -> None:
        self._path = folder / KEPT_NAME
        cameras = [str(n) for n, info in enumerate(identity.header.streams) if info.is_camera]
        self._cameras = ", ".join(cameras)
        self._database = create_part(self._path, identity)
        self._database.execute("PRAGMA wal_autocheckpoint=1000")  # this one lives as long as the session

    def note_chunks(self, chunks: Iterable[Chunk]) -> None:
        """Remember where chunks lie; of one written again, its places before as well."""
        self._database.execute("BEGIN")
        self._database.executemany("INSERT OR REPLACE INTO chunk VALUES (?, ?, ?, ?, ?, ?, ?)", chunks)
        self._database.execute("COMMIT")

    def retire(self, part: Path) -> None:
        """Keep all but the frames of a full part, then delete it.

        Only for parts whose frames are in the session file, on the disk.
        """
        self._database.execute("ATTACH ? AS part", (f"{part.absolute().as_uri()}?mode=ro",))
        self._database.execute("BEGIN")
        self._database.execute(
            "INSERT OR IGNORE INTO sample SELECT id, stream, seq, mono_ns, time_ns, device_time, device_seq,"
            f" flags, fpa_temperature, crc32, {self._keep('data')}, {self._keep('more')} FROM part.sample"
        )
        self._database.execute("INSERT OR IGNORE INTO entry SELECT * FROM part.entry")
        self._database.execute("COMMIT")
        self._database.execute("DETACH part")
        sync(self._path)
        sync(wal_of(self._path))
        delete_part(part)

    def _keep(self, column: str) -> str:
        return f"CASE WHEN stream IN ({self._cameras}) THEN NULL ELSE {column} END"

    def close(self) -> None:
        """Close the database."""
        close_uncopied(self._database, self._path)


# --- on the disk, second by second

log: logging.Logger = logging.getLogger(__name__)

SYNC_EVERY_S = 1.0


class SyncThread(threading.Thread):
    """Syncs the journal once a second, and has the disk begin in between when much is written.

    `failed` is called when the disk did not confirm; `took_ms` is how long the last sync took.
    """

    def __init__(self, journal: Journal, failed: Callable[[str], None]) -> None:
        super().__init__(name="session-sync", daemon=True)
        self.took_ms: float = 0.0
        self._journal = journal
        self._failed = failed
        self._wake = threading.Event()
        self._stopping = False
        self._first = 1
        self._seen_bytes = 0
        self._begun = (1, 0)  # part, bytes of its log

    def run(self) -> None:
        """Until `stop`."""
        due = time.monotonic() + SYNC_EVERY_S
        while not self._stopping:
            if self._wake.wait(max(due - time.monotonic(), 0.0)):
                self._wake.clear()
                self._begin()
            else:
                self._sync()
                due = time.monotonic() + SYNC_EVERY_S

    def grown(self) -> None:
        """To be called when the journal has grown; returns at once."""
        if self._journal.bytes_written - self._seen_bytes >= BEGIN_BYTES:
            self._seen_bytes = self._journal.bytes_written
            self._wake.set()

    def stop(self) -> None:
        """End, after a last sync."""
        self._stopping = True
        self._wake.set()
        self.join()
        self._sync()

    def _begin(self) -> None:
        number = self._journal.number
        start = self._begun[1] if self._begun[0] == number else 0
        try:
            descriptor = os.open(wal_of(self._journal.part_path(number)), os.O_RDONLY)
        except OSError:
            return  # nothing was promised; the sync will report it
        try:
            end = os.fstat(descriptor).st_size
            begin_sync(descriptor, start, end - start)
        finally:
            os.close(descriptor)
        self._begun = number, end

    def _sync(self) -> None:
        began = time.monotonic()
        try:
            self._journal.prepare()
            last, written = self._journal.number, self._journal.written
            for number in range(self._first, last + 1):
                sync_data(wal_of(self._journal.part_path(number)))
            self._first = last
        except (OSError, sqlite3.Error) as error:
            # A sync reports a failure once only: what came since the last one may be gone.
            text = f"the disk did not confirm the last second: {error}"
            log.error(text)
            self._failed(text)
        else:
            with suppress(OSError):  # the records are safe, only their count is behind
                note_written(self._journal.folder, written)
        self.took_ms = (time.monotonic() - began) * 1000.0


# --- how many records the disk has confirmed


#


# A log that has lost its end looks like a shorter log; only a count kept elsewhere shows that something is


# missing. It is written in place after each sync of the log, so it is never ahead of what was stored. It is
# not


# synced itself: after a power cut it may be behind, and then the log is all there is to go by.

NAME = "written"


@dataclass(frozen=True, slots=True)
class WrittenCount:
    """How many records a journal was given, and how many of them were samples of each stream."""

    records: int
    samples: tuple[int, ...]

    @property
    def entries(self) -> int:
        """How many were not samples."""
        return self.records - sum(self.samples)


def note_written(folder: Path, written: WrittenCount) -> None:
    """Replace the count; raises `OSError`."""
    numbers = struct.pack(f"<{1 + len(written.samples)}q", written.records, *written.samples)
    descriptor = os.open(folder / NAME, os.O_WRONLY | os.O_CREAT, 0o644)
    try:
        os.pwrite(descriptor, numbers + zlib.crc32(numbers).to_bytes(4, "little"), 0)
    finally:
        os.close(descriptor)


def read_written(folder: Path, streams: int) -> WrittenCount:
    """What was counted; zeros where that is not known: an older journal, or a damaged count."""
    size = 8 * (1 + streams)
    with suppress(OSError):
        data = (folder / NAME).read_bytes()
        if len(data) == size + 4 and zlib.crc32(data[:size]).to_bytes(4, "little") == data[size:]:
            records, *samples = struct.unpack(f"<{1 + streams}q", data[:size])
            return WrittenCount(records, tuple(samples))
    return WrittenCount(0, (0,) * streams)
