"""The thread that has the disk keep what the journal was given; never the one that appends."""

from __future__ import annotations

import logging
import os
import sqlite3
import threading
import time
from collections.abc import Callable
from contextlib import suppress

from fieldkit.disk import BEGIN_BYTES, begin_sync, sync_data
from fieldkit.sessions.journal import Journal, wal_of
from fieldkit.sessions.written import note_written

log = logging.getLogger(__name__)

SYNC_EVERY_S = 1.0


class SyncThread(threading.Thread):
    """Syncs the journal once a second, and has the disk begin in between when much is written.

    `failed` is told when the disk did not confirm; `took_ms` is how long the last sync took.
    """

    def __init__(self, journal: Journal, failed: Callable[[str], None]) -> None:
        super().__init__(name="session-sync", daemon=True)
        self.took_ms = 0.0
        self._journal = journal
        self._failed = failed
        self._wake = threading.Event()
        self._stopping = False
        self._first = 1
        self._noticed_bytes = 0
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

    def notice(self) -> None:
        """To be called when the journal has grown; returns at once."""
        if self._journal.bytes_written - self._noticed_bytes >= BEGIN_BYTES:
            self._noticed_bytes = self._journal.bytes_written
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
            return  # nothing was promised; the sync will tell
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
            # A sync tells of a failure once only: what came since the last one may be gone.
            text = f"the disk did not confirm the last second: {error}"
            log.error(text)
            self._failed(text)
        else:
            with suppress(OSError):  # the records are safe, only their count is behind
                note_written(self._journal.folder, written)
        self.took_ms = (time.monotonic() - began) * 1000.0
