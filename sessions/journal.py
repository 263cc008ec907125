"""The journal: what was recorded, one record per sample, in logs that are only appended to.

While a session is recorded its journal is the truth: a record is written in the thread that delivers the
sample, before anything else happens to it, so a killed process loses nothing; the log is synced each second,
so a power cut loses what came after. Each file is written by one thread::

    000001.log, 000002.log ...   everything recorded; the oldest goes once the session file has its frames
    kept.log                     of those that went, all but the frames; where each frame's chunks lie
    confirmed.log                after each sync, how many records the disk has
    lock                         after each record, how many were written

Each log begins with the session, the number of the part, and the file and boot that it was made on: recovery
goes by these, never by names.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import logging
import os
import struct
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import NamedTuple

from fieldkit.disk import sync, sync_data
from fieldkit.model.errors import StorageError
from fieldkit.model.samples import Frame, Reading
from fieldkit.sessions.layout import FORMAT_VERSION, SessionHeader, check_version
from fieldkit.sessions.lock import OWNER_BYTES, RECORDING
from fieldkit.sessions.log import Kind, LogReader, LogWriter, Origin, boot_id, encode_record, session_number
from fieldkit.sessions.records import Record, encode_entry, encode_sample
from fieldkit.sessions.sample_fields import STAMPS_BYTES

PART_BYTES = 256_000_000


class Chunk(NamedTuple):
    """Place of one compressed chunk of a dataset in the session file."""

    dataset: str
    n: int
    y: int
    x: int
    offset: int
    size: int
    crc32: int


@dataclass(frozen=True, slots=True)
class SessionIdentity:
    """The session that every log of a journal states in its head."""

    session_id: str
    start_ns: int
    anchor_ns: int
    header: SessionHeader

    def to_json(self, origin: Origin) -> bytes:
        """The head of a log of that origin, as text."""
        session = (self.session_id, self.start_ns, self.anchor_ns, self.header.to_json())
        return json.dumps([FORMAT_VERSION, *astuple(origin), *session]).encode()

    @classmethod
    def from_json(cls, text: bytes, folder: Path) -> tuple[SessionIdentity, Origin]:
        """Session and origin from `to_json` of a log in `folder`.

        Raises `FormatError` for one of another version, `SessionError`, `ValueError` or `TypeError` if the
        text is none.
        """
        version, *fields = json.loads(text)
        check_version(folder, str(version))
        part, device, inode, boot, session_id, start_ns, anchor_ns, header = fields
        if max(abs(int(start_ns)), abs(int(anchor_ns))) >= 2**63:
            raise ValueError("times that no clock shows")
        identity = cls(str(session_id), int(start_ns), int(anchor_ns), SessionHeader.from_json(header))
        return identity, Origin(int(part), int(device), int(inode), str(boot))


class Journal:
    """The writing side; one thread appends.

    Raises `StorageError` where the disk does not take a record; that record is then not in the
    journal, everything before is.
    """

    def __init__(self, folder: Path, identity: SessionIdentity) -> None:
        self.folder = folder
        self._full_bytes = 0
        self.part_bytes: int = PART_BYTES
        self.number: int = 1
        """The number of the part that takes the records now."""
        self.written: tuple[int, ...] = (0,) * (len(identity.header.streams) + 1)
        """Samples of each stream and, last, other records so far; for any thread."""
        self.full_parts: deque[tuple[Path, int]] = deque()
        """Parts that are full, oldest first, each with the number of the record after its last."""
        self._identity = identity
        self._session = session_number(identity.session_id)
        self._streams = {info.name: number for number, info in enumerate(identity.header.streams)}
        with contextlib.ExitStack() as undo:
            self._lock = os.open(folder / RECORDING, os.O_WRONLY | os.O_CREAT, 0o644)
            undo.callback(os.close, self._lock)
            self._count_in_lock()
            logs = []
            for part, name in ((1, "000001.log"), (0, "kept.log"), (0, "confirmed.log")):
                logs.append(self._create(folder / name, part))
                undo.callback(logs[-1].close)
                sync(folder / name)
            sync(folder)
            undo.pop_all()
        self._part, self._kept, self._confirmed = logs

    def part_path(self, number: int) -> Path:
        """Path of part `number`."""
        return self.folder / f"{number:06}.log"

    @property
    def next_id(self) -> int:
        """Number of records: the number of the next."""
        return sum(self.written)

    @property
    def bytes_written(self) -> int:
        """Bytes of all files so far, those that went included."""
        return self._full_bytes + sum(log.size for log in (self._part, self._kept, self._confirmed))

    def is_there(self) -> bool:
        """True if the part that takes the records now was not deleted, or no disk can say so."""
        try:
            return self.part_path(self.number).exists()
        except OSError:
            return True

    def append(self, record: Record) -> tuple[int, int | None]:
        """Write one record; its number, from 0 without gaps, and a sample's checksum."""
        if self._part.size >= self.part_bytes:
            with contextlib.suppress(OSError):  # better a part too long than a record lost
                self._rotate()
        try:
            crc32 = self._write(record)
        except OSError as error:
            problem = f"the journal {self.folder} could not store a record: {error.strerror or error}"
            fix = "see that its disk can be written and has room; everything recorded until now is safe"
            raise StorageError(problem, fix=fix) from error
        return self.next_id - 1, crc32

    def _write(self, record: Record) -> int | None:
        if isinstance(record, Frame | Reading):
            payload, crc32 = encode_sample(record)
            self._count(Kind.SAMPLE, self._streams[record.stream], *payload)
            return crc32
        self._count(Kind.ENTRY, len(self._streams), "\n".join(encode_entry(record)).encode(errors="replace"))
        return None

    def _count(self, kind: Kind, stream: int, *payload: bytes | memoryview) -> None:
        counts = list(self.written)
        counts[stream] += 1
        self._part.append(kind, stream, counts, *payload)
        self.written = tuple(counts)
        self._count_in_lock()

    def _count_in_lock(self) -> None:
        """Have the lock say how much was written: the kernel keeps that after a kill.

        Where the disk does not take it the record is safe all the same; only the end will not be known.
        """
        with contextlib.suppress(OSError):
            record = encode_record(self._session, Kind.WRITTEN, 0, self.written)
            os.pwritev(self._lock, record, OWNER_BYTES)

    def _create(self, path: Path, part: int) -> LogWriter:
        log_writer = LogWriter(path, self._session)
        try:
            stat = path.stat()
            origin = Origin(part, stat.st_dev, stat.st_ino, boot_id())
            log_writer.append(Kind.IDENTITY, 0, self.written, self._identity.to_json(origin))
        except OSError:
            log_writer.close()
            path.unlink(missing_ok=True)
            raise
        return log_writer

    def _rotate(self) -> None:
        # the new part first: where the disk takes none, the old one goes on
        following = self._create(self.part_path(self.number + 1), self.number + 1)
        self._part.close()
        self._full_bytes += self._part.size
        self.full_parts.append((self._part.path, self.next_id))
        self._part, self.number = following, self.number + 1

    # --- for the thread that syncs

    def confirm(self, written: tuple[int, ...]) -> None:
        """Note how many records the disk has; raises `OSError`.

        A log that has lost its end looks like a shorter log; only a count kept elsewhere shows that something
        is missing. Not synced itself: after a power cut it may be behind, and then the log is all there is.
        """
        self._confirmed.append(Kind.CONFIRMED, 0, written)

    # --- for the thread that writes the session file

    def note_chunks(self, chunks: Iterable[Chunk]) -> None:
        """Remember where chunks lie; of one written again, its places before as well."""
        for _, block in itertools.groupby(chunks, key=lambda chunk: chunk[:2]):
            self._kept.append(Kind.CHUNKS, 0, self.written, encode_chunks(list(block)))

    def retire(self, part: Path) -> None:
        """Keep all but the frames of a full part, then delete it.

        Only for parts whose frames are in the session file, on the disk.
        """
        cameras = {n for n, info in enumerate(self._identity.header.streams) if info.is_camera}
        with contextlib.closing(LogReader(part)) as reader:
            for head in reader.heads():
                if (payload := reader.payload(head)) is None:
                    raise OSError(f"{part} cannot be read back")
                if head.kind == Kind.SAMPLE and head.stream in cameras:
                    self._kept.append(Kind.STAMPS, head.stream, head.counts, payload[:STAMPS_BYTES])
                elif head.kind in (Kind.SAMPLE, Kind.ENTRY):
                    self._kept.append(Kind(head.kind), head.stream, head.counts, payload)
            if reader.damage or not reader.is_whole:
                raise OSError(f"{part} cannot be read back")
        # on the disk before the only other copy goes
        sync(self._kept.path)
        part.unlink()

    def close(self) -> None:
        """State that nothing comes after, and close the files; a second call does nothing."""
        if self._lock < 0:
            return
        with contextlib.suppress(OSError):  # on a full disk the end is not known, and nothing else is missing
            self._part.append(Kind.CLOSED, 0, self.written)
        for log in (self._part, self._kept, self._confirmed):
            log.close()
        os.close(self._lock)
        self._lock = -1


_BLOCK, _CHUNK = struct.Struct("<qH"), struct.Struct("<IIQII")


def encode_chunks(chunks: Sequence[Chunk]) -> bytes:
    """The chunks of one block as the journal keeps them."""
    dataset = chunks[0].dataset.encode()
    places = b"".join(_CHUNK.pack(*chunk[2:]) for chunk in chunks)
    return _BLOCK.pack(chunks[0].n, len(dataset)) + dataset + places


def decode_chunks(payload: bytes) -> list[Chunk]:
    """Places from `encode_chunks`."""
    n, length = _BLOCK.unpack_from(payload.ljust(_BLOCK.size, b"\0"))
    name, places = payload[_BLOCK.size :][:length], payload[_BLOCK.size + length :]
    whole = places[: len(places) // _CHUNK.size * _CHUNK.size]
    return [Chunk(name.decode(errors="replace"), n, *place) for place in _CHUNK.iter_unpack(whole)]


# --- on the disk, second by second

log: logging.Logger = logging.getLogger(__name__)

SYNC_EVERY_S = 1.0


class SyncThread(threading.Thread):
    """Syncs the journal once a second.

    `failed` is called when the disk did not confirm, or the journal was deleted; `took_ms` is how long the
    last sync took.
    """

    def __init__(self, journal: Journal, failed: Callable[[str], None]) -> None:
        super().__init__(name="session-sync", daemon=True)
        self.took_ms: float = 0.0
        self._journal = journal
        self._failed = failed
        self._stopping = threading.Event()
        self._first = 1
        self._is_there = True

    def run(self) -> None:
        """Until `stop`."""
        while not self._stopping.wait(SYNC_EVERY_S):
            self._sync()

    def stop(self) -> None:
        """End, after a last sync."""
        self._stopping.set()
        self.join()
        self._sync()

    def _sync(self) -> None:
        began = time.monotonic()
        self._look()
        try:
            # counted before the sync: what arrives meanwhile is not confirmed
            last, written = self._journal.number, self._journal.written
            for number in range(self._first, last + 1):
                sync_data(self._journal.part_path(number))
            if last > self._first:
                sync(self._journal.folder)  # the names of the new parts
            self._first = last
        except OSError as error:
            # A sync reports a failure once only: what came since the last one may be gone.
            self._fail(f"the disk did not confirm the last second: {error}")
        else:
            with contextlib.suppress(OSError):  # the records are safe, only their count is behind
                self._journal.confirm(written)
        self.took_ms = (time.monotonic() - began) * 1000.0

    def _look(self) -> None:
        """Report once that the journal was deleted: no power cut and no kill may come now."""
        if self._is_there and not self._journal.is_there():
            self._is_there = False
            self._fail(f"the journal {self._journal.folder} was deleted while recording: {DELETED}")

    def _fail(self, text: str) -> None:
        log.error(text)
        self._failed(text)


DELETED = "a crash would now lose what the session file does not have; stop and begin a new recording"
