"""The HDF5 side of a session, for the one thread that owns it: records in, blocks and rows out.

Everything exists before the first record (see `file_tree`). In SWMR mode another process may
read what `flush` has written.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from fieldkit.disk import sync
from fieldkit.model.errors import message_of
from fieldkit.model.samples import Frame, Reading, Sample
from fieldkit.sessions.chunks import FrameWriter, TableWriter, read_chunk
from fieldkit.sessions.entry_rows import EntryRows, fitting_column
from fieldkit.sessions.file_tree import ISO_WIDTH, file_image, iso_utc
from fieldkit.sessions.guarded_file import GuardedFile, limit_cache, write_in_place
from fieldkit.sessions.journal import Chunk, Journal, SessionIdentity
from fieldkit.sessions.journal_reader import JournalReader
from fieldkit.sessions.layout import FRAME_DATASETS, encode_text, entry_columns, raw_width, stream_columns
from fieldkit.sessions.records import Entry, Record, SampleRow, sample_bytes, sample_crc32
from fieldkit.sessions.sample_fields import stamps_of, to_columns

_CACHE_BYTES = 262_144  # twice what the indexes of five streams need; HDF5's own limit is reached in days

PARTIAL_AFTER_S = 1.3
"""Time that a block may wait for its last frame before it is written as it is."""


class SessionFile:
    """A session file being written.

    `put` may raise `OSError` when the disk does not take what is due; the file is then as
    good as at its last `flush`.
    """

    def __init__(self, path: Path, identity: SessionIdentity, pool: Executor, *, swmr: bool = True) -> None:
        self.path = path
        with path.open("xb") as file:
            file.write(file_image(identity))
        self._guarded = GuardedFile(path)
        self._file = self._guarded.file
        try:
            self._begin(identity, pool, swmr=swmr)
        except BaseException:
            self._guarded.discard()
            raise

    def _begin(self, identity: SessionIdentity, pool: Executor, *, swmr: bool) -> None:
        header, places = identity.header, self._guarded.disk.places
        streams = header.streams
        self._streams = {info.name: _Stream(self._file[info.name], info, pool, places) for info in streams}
        self._tables = {
            name: TableWriter(self._file[name], columns, fitting_column)
            for name, columns in entry_columns(header).items()
        }
        self._entry_rows = EntryRows(header, identity.anchor_ns)
        limit_cache(self._file, _CACHE_BYTES)
        if swmr:
            self._file.swmr_mode = True

    @property
    def bytes_written(self) -> int:
        """Size of the file."""
        return self._guarded.disk.size

    def put(self, record: Record, crc32: int | None = None) -> list[Chunk]:
        """Take a record, with its checksum where that is known; returns the chunks written for it."""
        if isinstance(record, Frame | Reading):
            crc = sample_crc32(record, *sample_bytes(record)) if crc32 is None else crc32
            return self._streams[record.stream].put(record, crc)
        for table, row in self._entry_rows.rows(record):
            self._tables[table].append(row)
        return []

    def flush(self, *, everything: bool = False) -> list[Chunk]:
        """Write what is due: all rows, and blocks that have waited long (or all)."""
        chunks = [chunk for stream in self._streams.values() for chunk in stream.write(force=everything)]
        for table in self._tables.values():
            table.write()
        self._guarded.flush()
        return chunks

    def sync(self) -> None:
        """Have the disk keep what was flushed; HDF5 itself never asks for that."""
        sync(self.path)

    def finish(self, end_ns: int) -> list[Chunk]:
        """Write what is left and the end time, and close; not yet declared complete."""
        chunks = self.flush(everything=True)
        self.sync()
        self.close()
        end_time = np.array(encode_text(iso_utc(end_ns), ISO_WIDTH))
        write_in_place(self.path, {"entry/end_time": end_time})
        return chunks

    def close(self) -> None:
        """Close as it is; a second call does nothing. Raises `OSError` where the disk takes no more."""
        self._guarded.close()

    def discard(self) -> None:
        """Close, and leave the file as the disk has it."""
        self._guarded.discard()


class _Stream:
    """One stream of samples: its columns and, of a camera, its blocks."""

    def __init__(self, group: h5py.Group, info: Any, pool: Executor, places: dict[int, int]) -> None:
        self._table = TableWriter(group, stream_columns(info))
        names = [name for name in FRAME_DATASETS if name in group]
        self._writers = [FrameWriter(group[name], pool, places) for name in names]
        self._raw_width = raw_width(info)
        self._waiting: list[dict[str, Any]] = []
        self._waiting_since = 0.0

    def put(self, sample: Sample, crc32: int) -> list[Chunk]:
        row = {**to_columns(stamps_of(sample)), "crc32": crc32}
        if isinstance(sample, Reading):
            raw = np.frombuffer(sample.raw.ljust(self._raw_width, b"\0"), np.uint8)
            self._table.append({**row, "value": sample.values, "raw": raw, "raw_length": len(sample.raw)})
            return []
        if not self._waiting:
            self._waiting_since = time.monotonic()
        for writer, frame in zip(self._writers, (sample.counts, sample.metadata_rows), strict=False):
            writer.put(frame)
        self._waiting.append(row)
        return self.write(force=True) if self._writers[0].is_full else []

    def write(self, *, force: bool) -> list[Chunk]:
        """Write the blocks if due, then the rows that go with them."""
        chunks: list[Chunk] = []
        if self._waiting and (force or time.monotonic() - self._waiting_since > PARTIAL_AFTER_S):
            for writer in self._writers:
                chunks += writer.write()
            self._table.append(*self._waiting)
            self._waiting.clear()
        self._table.write()
        return chunks


# --- the thread that keeps the file up with the journal, and the journal small

log: logging.Logger = logging.getLogger(__name__)

HANDOVER_BYTES = 64_000_000

JOURNAL_BYTES = 750_000_000

TOGETHER_S = 0.05
"""Time that records wait to be taken together: to be woken for each would cost more than all done with it."""

FLUSH_EVERY_S = 1.0

SYNC_EVERY_S = 10.0

COMPRESSORS = 2

MOST_UNVERIFIED = 1024
"""Chunks that are read back together, if the journal is not shortened before."""

_POLL_S = 0.01  # what is behind is so by seconds


class FileThread(threading.Thread):
    """Writes the session file from the records that `offer` queues.

    `failed` is called once, with words on the error, when the file cannot be written any more.
    """

    def __init__(
        self, path: Path, journal: Journal, identity: SessionIdentity, failed: Callable[[str], None]
    ) -> None:
        super().__init__(name="session-file", daemon=True)
        self._pool = ThreadPoolExecutor(COMPRESSORS, thread_name_prefix="session-compress")
        self._journal = journal
        self._identity = identity
        self._failed = failed
        self.file: SessionFile = SessionFile(path, identity, self._pool)
        self.error: Exception | None = None
        self._unverified: dict[tuple[str, int, int, int], Chunk] = {}
        self._offers: deque[tuple[int, Record, int | None]] = deque()
        self._stopping = threading.Event()
        self._handed_bytes = 0
        self._taken_bytes = 0
        self._next_id = 0
        self._at_once = False
        self._flushed_at = self._synced_at = time.monotonic()

    def offer(self, number: int, record: Record, crc32: int | None) -> None:
        """Queue a record (a sample with its checksum), unless too much is waiting.

        Then the journal will give it later.
        """
        if self.error is None and not self.is_behind():
            self._handed_bytes += _size(record)
            self._offers.append((number, record, crc32))

    def is_behind(self) -> bool:
        """True if as much is waiting as may wait; after a failure nothing is."""
        return self.error is None and self._handed_bytes - self._taken_bytes > HANDOVER_BYTES

    def caught_up(self, timeout_s: float) -> bool:
        """True if no more is waiting than may wait, or will be after a while; see `Clock.hold_until`."""
        if self.is_behind():
            time.sleep(min(timeout_s, _POLL_S))
        return not self.is_behind()

    def stop(self, *, at_once: bool = False) -> None:
        """Let the thread take everything up to now from queue and journal (or leave that), and end."""
        self._at_once = at_once
        self._stopping.set()

    def run(self) -> None:
        """Until `stop`: take, write, flush each second, sync each ten seconds."""
        try:
            while not self._stopping.wait(TOGETHER_S):
                self._take_offers()
            self._take_offers()
            if not self._at_once:
                self._catch_up(self._journal.next_id)
        except Exception as error:  # whatever it is, the journal has everything and recording must go on
            self.error = error
            text = f"the session file cannot be written: {message_of(error)}"
            log.error(text, exc_info=log.isEnabledFor(logging.DEBUG))
            self._failed(f"{text}; recording goes on in the journal")

    def close(self) -> None:
        """Close everything, whatever state it is in."""
        if self.error is None:
            try:
                self.file.close()
            except OSError as error:
                log.warning("the session file did not close: %s", message_of(error))
        else:
            self.file.discard()
        self._pool.shutdown()

    def _take_offers(self) -> None:
        while self._offers and not self._at_once:
            number, record, crc32 = self._offers.popleft()
            self._catch_up(number)
            self._put(record, crc32)
            self._taken_bytes += _size(record)
            self._flush_if_due()
        self._flush_if_due()

    def _catch_up(self, number: int) -> None:
        """Read from the journal what was not queued."""
        if self._next_id >= number:
            return
        with JournalReader(self._journal.folder) as reader:
            for row in reader.since(self._next_id, number):
                self._put(self._record(row), row.crc32 if isinstance(row, SampleRow) else None)
        if self._next_id < number:
            raise OSError(f"record {self._next_id} cannot be read back from the journal")

    def _record(self, row: SampleRow | Entry) -> Record:
        if not isinstance(row, SampleRow):
            return row
        info = self._identity.header.streams[row.stream]
        if (sample := row.sample(info)) is None:
            raise OSError(f"number {row.seq} of {info.name} cannot be read back from the journal")
        return sample

    def _put(self, record: Record, crc32: int | None) -> None:
        chunks = self.file.put(record, crc32)
        self._next_id += 1
        if chunks:
            self._note(chunks + self.file.flush())

    def _flush_if_due(self) -> None:
        if time.monotonic() - self._flushed_at < FLUSH_EVERY_S:
            return
        self._flushed_at = time.monotonic()
        self._note(self.file.flush())
        if self._flushed_at - self._synced_at >= SYNC_EVERY_S:
            self.file.sync()
            self._synced_at = self._flushed_at
            if len(self._unverified) > MOST_UNVERIFIED:  # a slow journal is not shortened for days
                self._verify()
        self._shorten_journal()

    def _shorten_journal(self) -> None:
        """Delete the oldest parts of a long journal, once the file has their samples on the disk."""
        full, part_bytes = self._journal.full_parts, self._journal.part_bytes
        while full and (len(full) + 1) * part_bytes > JOURNAL_BYTES and full[0][1] <= self._next_id:
            self._note(self.file.flush(everything=True))
            self.file.sync()
            self._verify()
            self._journal.retire(full.popleft()[0])

    def _verify(self) -> None:
        """Read back every chunk written since the last time; raises `OSError`."""
        for chunk in self._unverified.values():
            if read_chunk(self.file.path, chunk) is None:
                raise OSError(f"the chunk at byte {chunk.offset} does not read as it was written")
        self._unverified.clear()

    def _note(self, chunks: list[Chunk]) -> None:
        self._journal.note_chunks(chunks)
        self._unverified.update({chunk[:4]: chunk for chunk in chunks})


def _size(record: Record) -> int:
    return record.counts.nbytes + record.metadata_rows.nbytes if isinstance(record, Frame) else 512
