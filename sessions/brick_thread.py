"""The thread that keeps the session file up with the journal, and the journal small.

It is handed each record after the journal has it. If it cannot keep up, what it missed is
read back from the journal; if it fails, recording goes on and the session is finished from
the journal when it is closed.
"""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from fieldkit.model.samples import Frame
from fieldkit.sessions.journal import Chunk, Identity, Journal, Keeper
from fieldkit.sessions.journal_reader import JournalReader, SampleRow
from fieldkit.sessions.records import Entry, Record
from fieldkit.sessions.session_file import SessionFile

log = logging.getLogger(__name__)

HANDOVER_BYTES = 64_000_000
JOURNAL_BYTES = 750_000_000
FLUSH_EVERY_S = 1.0
SYNC_EVERY_S = 10.0
COMPRESSORS = 2
_LOOK_AGAIN_S = 0.01  # what is behind is so by seconds


class BrickThread(threading.Thread):
    """Writes the session file from what `offer` hands over.

    `failed` is called once, with the error, when the file cannot be written any more.
    """

    def __init__(
        self, path: Path, journal: Journal, identity: Identity, failed: Callable[[Exception], None]
    ) -> None:
        super().__init__(name="session-bricks", daemon=True)
        self._pool = ThreadPoolExecutor(COMPRESSORS, thread_name_prefix="session-compress")
        self._journal = journal
        self._identity = identity
        self._failed = failed
        self._keeper = Keeper(journal.folder, identity)
        self.file = SessionFile(path, identity, self._pool)
        self.error: Exception | None = None
        self._offers: queue.SimpleQueue[tuple[int, Record, int | None] | None] = queue.SimpleQueue()
        self._handed_bytes = 0
        self._taken_bytes = 0
        self._next_id = 0
        self._at_once = False
        self._flushed_at = self._synced_at = time.monotonic()

    def offer(self, number: int, record: Record, crc32: int | None) -> None:
        """Hand over a record (a sample with its checksum), unless too much is waiting.

        Then the journal will give it later.
        """
        if self.error is None and not self.is_behind():
            self._handed_bytes += _size(record)
            self._offers.put((number, record, crc32))

    def is_behind(self) -> bool:
        """Whether as much is waiting as may wait; after a failure nothing is."""
        return self.error is None and self._handed_bytes - self._taken_bytes > HANDOVER_BYTES

    def caught_up(self, timeout_s: float) -> bool:
        """Whether no more is waiting than may wait, or will be after a while; see `Clock.hold_until`."""
        if self.is_behind():
            time.sleep(min(timeout_s, _LOOK_AGAIN_S))
        return not self.is_behind()

    def stop(self, *, at_once: bool = False) -> None:
        """Let the thread take everything up to now from hand-over and journal (or leave that), and end."""
        self._at_once = at_once
        self._offers.put(None)

    def run(self) -> None:
        """Until `stop`: take, write, flush each second, sync each ten seconds."""
        try:
            while self._step():
                pass
            if not self._at_once:
                self._catch_up(self._journal.next_id)
        except Exception as error:  # whatever it is, the journal has everything and recording must go on
            log.exception("the session file cannot be written")
            self.error = error
            self._failed(error)

    def finish(self, end_ns: int) -> None:
        """Complete the file, after the thread has ended."""
        self.file.finish(end_ns)

    def close(self) -> None:
        """Let go of everything, whatever state it is in."""
        if self.error is None:
            try:
                self.file.close()
            except OSError as error:
                log.warning("the session file did not close: %s", error)
        else:
            self.file.discard()
        self._pool.shutdown()
        self._keeper.close()

    def _step(self) -> bool:
        due = self._flushed_at + FLUSH_EVERY_S - time.monotonic()
        try:
            offer = self._offers.get(timeout=max(0.0, due))
        except queue.Empty:
            self._flush()
            return True
        if offer is None or self._at_once:
            return False
        number, record, crc32 = offer
        self._catch_up(number)
        self._put(record, crc32)
        self._taken_bytes += _size(record)
        if time.monotonic() - self._flushed_at >= FLUSH_EVERY_S:
            self._flush()
        return True

    def _catch_up(self, number: int) -> None:
        """Read from the journal what was not handed over."""
        if self._next_id >= number:
            return
        with JournalReader(self._journal.folder) as reader:
            for row in reader.rows(after=self._next_id - 1, before=number):
                self._put(self._record(row), row.crc32 if isinstance(row, SampleRow) else None)

    def _record(self, row: SampleRow | Entry) -> Record:
        if not isinstance(row, SampleRow):
            return row
        sample = row.sample(self._identity.header.streams[row.stream])
        if sample is None:
            raise OSError(f"record {row.number} cannot be read back from the journal")
        return sample

    def _put(self, record: Record, crc32: int | None) -> None:
        chunks = self.file.put(record, crc32)
        self._next_id += 1
        if chunks:
            self._note(chunks + self.file.flush())

    def _flush(self) -> None:
        self._flushed_at = time.monotonic()
        self._note(self.file.flush())
        if self._flushed_at - self._synced_at >= SYNC_EVERY_S:
            self.file.sync()
            self._synced_at = self._flushed_at
        self._shorten_journal()

    def _shorten_journal(self) -> None:
        """Delete the oldest parts of a long journal, once the file has their samples on the disk."""
        full = self._journal.full_parts
        while (
            full
            and (len(full) + 1) * self._journal.part_bytes > JOURNAL_BYTES
            and full[0][1] <= self._next_id
        ):
            self._note(self.file.flush(everything=True))
            self.file.sync()
            self._keeper.retire(full.popleft()[0])

    def _note(self, chunks: list[Chunk]) -> None:
        if chunks:
            self._keeper.note_chunks(chunks)


def _size(record: Record) -> int:
    return record.counts.nbytes + record.metadata_rows.nbytes if isinstance(record, Frame) else 512
