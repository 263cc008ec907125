"""Writing a session: the journal first, in the caller's thread; everything else beside it.

::

    append -> journal     -> (returns)
                 '-> queue -> file thread -> compress pool -> session.h5
    each second, on its own thread: fdatasync of the journal

`close` completes the file, compares every sample with the journal, and only then lets the
journal go. A process that dies before leaves both, and `recover` finishes the session.
"""

from __future__ import annotations

import atexit
import contextlib
import logging
import math
import os
import shutil
import threading
import uuid
from functools import partial
from pathlib import Path

import numpy as np

from fieldkit.disk import Patience, sync
from fieldkit.model import errors
from fieldkit.model.clock import Clock
from fieldkit.model.device import StreamInfo
from fieldkit.model.next_step import Action
from fieldkit.model.samples import Event, EventKind, Frame, Sample, Severity
from fieldkit.sessions.journal import Journal, SessionIdentity, SyncThread
from fieldkit.sessions.journal_reader import JournalReader
from fieldkit.sessions.layout import SEALED, SessionHeader, check_region, check_room, raw_width
from fieldkit.sessions.lock import SessionLock, journal_path
from fieldkit.sessions.records import Entry, Record, RegionRecord
from fieldkit.sessions.seal import SealReport as SealReport
from fieldkit.sessions.seal import remove_journal, seal
from fieldkit.sessions.session_file import FileThread

log: logging.Logger = logging.getLogger(__name__)

RESERVE_BYTES = 64_000_000


class SessionWriter:
    """One session being recorded; `append` and its like may be called from any thread.

    It begins now, or at `start_mono_ns` with samples that were taken before.

    Raises `RefusedError` where the session exists already, `ConfigError` where it has too many
    regions, `StorageError` where the disk does not take what it is given: that record is then not
    stored, all before it are.
    """

    def __init__(
        self, path: Path, header: SessionHeader, clock: Clock, start_mono_ns: int | None = None
    ) -> None:
        check_room(header)
        self.path = path
        self.header = header
        self.is_closed: bool = False
        self._clock = clock
        self._counts = {info.name: 0 for info in header.streams}
        self._streams = {info.name: info for info in header.streams}
        self._lock = threading.Lock()
        self._report: SealReport | None = None
        self._folder = journal_path(path)
        self._open(clock.mono_ns() if start_mono_ns is None else start_mono_ns)
        atexit.register(self.abandon)
        clock.hold_until(self._file_thread.caught_up)
        for region in header.regions:
            self.put(RegionRecord(region, self._identity.start_ns))

    def _open(self, start_mono_ns: int) -> None:
        start, anchor = self._clock.to_utc_ns(start_mono_ns), self._clock.to_utc_ns(0)
        self._identity = SessionIdentity(str(uuid.uuid4()), start, anchor, self.header)
        try:
            Patience()(self._make)
        except FileExistsError as error:
            fix = "choose a name that is free"
            raise errors.RefusedError("exists already", place=self.path, fix=fix) from error
        except (OSError, RuntimeError) as error:
            problem = f"cannot be begun: {getattr(error, 'strerror', None) or error}"
            fix = "choose a folder that can be written and has room"
            raise errors.StorageError(problem, place=self.path, fix=fix) from error
        self._syncer = SyncThread(self._journal, self._add_error)
        self._file_thread.start()
        self._syncer.start()

    def _make(self) -> None:
        """Make all that a session needs, or nothing; `FileExistsError` where something is there."""
        with contextlib.ExitStack() as undo:
            if self.path.exists():
                raise FileExistsError(self.path)
            self._folder.mkdir(parents=True)  # of two that begin at once only one can
            undo.callback(_remove_folder, self._folder)
            self._session_lock = SessionLock(self._folder)
            undo.callback(self._session_lock.release)
            if self.path.exists():  # the other one has finished in the meantime
                raise FileExistsError(self.path)
            undo.callback(_delete, self.path)
            self._journal = Journal(self._folder, self._identity)
            undo.callback(self._journal.close)
            self._file_thread = FileThread(self.path, self._journal, self._identity, self._add_error)
            undo.callback(self._file_thread.close)
            _reserve(self._folder)  # last: what is killed before leaves little, and can be recovered
            sync(self.path.parent)
            undo.pop_all()

    # --- what comes in

    def utc_ns(self, mono_ns: int) -> int:
        """UTC of a monotonic time by the anchor of this session."""
        return mono_ns + self._identity.anchor_ns

    @property
    def bytes_written(self) -> int:
        """Bytes given to the disk so far, in the journal and in the file."""
        return self._journal.bytes_written + self._file_thread.file.bytes_written

    @property
    def sync_ms(self) -> float:
        """Time that the last sync of the journal took."""
        return self._syncer.took_ms

    @property
    def counts(self) -> dict[str, int]:
        """Samples stored so far, per stream."""
        return dict(self._counts)

    def append(self, sample: Sample) -> None:
        """Store a sample: in the journal when this returns. It gets the next number of its stream."""
        check_sample(self._streams.get(sample.stream), sample)
        with self._lock:
            self._store(sample._replace(seq=self._counts[sample.stream]))
            self._counts[sample.stream] += 1

    def put(self, entry: Entry) -> None:
        """Store anything but a sample; clock checks correct nothing.

        Raises `ValueError` for an outline for which the file has no room.
        """
        if isinstance(entry, RegionRecord):
            check_region(entry.region)
        with self._lock:
            self._store(entry)

    def _store(self, record: Record) -> None:
        if self.is_closed:
            raise errors.SessionError("closed", place=self.path)
        number, crc32 = self._journal.append(record)
        self._file_thread.offer(number, record, crc32)

    # --- the end

    def release_reserve(self) -> None:
        """Give back the room that was kept for the end; if it cannot be freed, sealing reports it."""
        _delete(self._folder / "reserve")

    def close(self) -> SealReport:
        """Complete, verify and seal the session, then let its journal go; a second call does nothing.

        Raises `StorageError` where that is not possible; the journal then stays for
        `fieldkit recover`.
        """
        if self._report is None:
            self._stop()
            try:
                complete = self._finish_file(self.utc_ns(self._clock.mono_ns()))
                self._report = Patience()(partial(self._seal, complete))
            except (OSError, RuntimeError, errors.FieldkitError, ValueError, OverflowError) as error:
                raise self._not_sealed(error) from error
            finally:
                self._session_lock.release()
            with contextlib.suppress(OSError):  # sealed it is; what is left of a journal does no harm
                remove_journal(self._folder)
        return self._report

    def abandon(self, *, at_once: bool = True) -> None:
        """Stop and leave the session interrupted, for `fieldkit recover`; a sealed one is left alone.

        At once, or when the file has caught up with the journal. Also what becomes of a session when its
        process ends without closing it: a thread inside the HDF5 library would keep the process from ending.
        """
        if self._report is None:
            self._stop(at_once=at_once)
            self._file_thread.close()
            self._session_lock.release()

    def discard(self) -> None:
        """Stop and delete what was written: for a session that should not have been begun."""
        self.abandon()
        remove_journal(self._folder)
        self.path.unlink(missing_ok=True)

    def _stop(self, *, at_once: bool = False) -> None:
        atexit.unregister(self.abandon)
        with self._lock:
            self.is_closed = True
        self._file_thread.stop(at_once=at_once)
        self._syncer.stop()  # while the file catches up
        self._file_thread.join()
        self._journal.close()

    def _seal(self, complete: bool) -> SealReport:
        if not self._journal.is_there():
            self._folder.mkdir(exist_ok=True)  # so that it is seen to be interrupted
            raise errors.IntegrityError("its journal was deleted while it was recorded", place=self.path)
        with JournalReader(self._folder) as journal:
            if complete:
                crc32s = {name: journal.crc32s(number) for number, name in enumerate(self._streams)}
                return seal(self.path, crc32s, SEALED)
        from fieldkit.sessions.recovery import rebuild  # takes half a second, and is hardly ever needed

        return rebuild(self.path, SEALED)[0]

    def _not_sealed(self, error: Exception) -> errors.StorageError:
        text = f"could not be sealed: {errors.message_of(error)}"
        if not self._journal.is_there():
            fix = Action.RECOVER(self.path) + " finishes it from its file"
            return errors.StorageError(text, place=self.path, fix=fix)
        fix = "see that there is free space, then: " + Action.RECOVER(self.path)
        return errors.StorageError(f"{text}; its journal is kept", place=self.path, fix=fix)

    def _finish_file(self, end_ns: int) -> bool:
        """Complete the file; False if it must be made again from the journal."""
        try:
            self.release_reserve()
            if self._file_thread.error is None:
                self._file_thread.file.finish(end_ns)
                return True
        except (OSError, RuntimeError) as error:
            log.warning("the session file could not be completed: %s", errors.message_of(error))
        finally:
            self._file_thread.close()
        return False

    def _add_error(self, text: str) -> None:
        """An event of the writer's own; dropped where even the journal is full."""
        now = self._clock.mono_ns()
        event = Event(EventKind.DISK, now, self.utc_ns(now), text, "", Severity.ERROR)
        with contextlib.suppress(errors.StorageError, errors.SessionError):
            self.put(event)


def _delete(path: Path) -> None:
    with contextlib.suppress(OSError):
        path.unlink(missing_ok=True)


def _remove_folder(folder: Path) -> None:
    """Delete the folder of a session that could not be begun."""
    with contextlib.suppress(OSError):  # what stays would look like another session to the next attempt
        Patience()(partial(shutil.rmtree, folder))


def _reserve(folder: Path) -> None:
    """Room kept for closing: a file that is deleted first. Less of it on a small disk."""
    path = folder / "reserve"
    size = min(RESERVE_BYTES, shutil.disk_usage(folder).free // 8)
    with path.open("wb") as file:
        if size:
            os.posix_fallocate(file.fileno(), 0, size)


# --- what each stream declared, against what comes

_LOWEST, _HIGHEST = -(2**63), 2**63 - 1


def check_sample(info: StreamInfo | None, sample: Sample) -> None:
    """Raise `ValueError` for a sample of another shape or type, or with numbers that no column holds.

    That it is as its stream was declared is the driver's promise; other samples could not be read back.
    """
    numbers: tuple[object, ...] = (sample.mono_ns, sample.time_ns, sample.device_time, sample.device_seq)
    if not all(isinstance(number, int | np.integer) and _LOWEST <= number <= _HIGHEST for number in numbers):
        raise ValueError(f"stream {sample.stream!r}: a time or counter is no integer of 64 bits: {numbers}")
    shape = sample.counts.shape if isinstance(sample, Frame) else (len(sample.values),)
    if info is None or shape != info.shape:
        declared = None if info is None else info.shape
        raise ValueError(f"stream {sample.stream!r} was declared as {declared}, the sample has {shape}")
    if isinstance(sample, Frame):
        _check_frame(info, sample)
    elif len(sample.raw) > raw_width(info):
        raise ValueError(f"stream {sample.stream!r}: {len(sample.raw)} raw bytes, more than declared")


def _check_frame(info: StreamInfo, frame: Frame) -> None:
    declared, shape = info.metadata_shape, frame.metadata_rows.shape
    if shape != declared and (frame.metadata_rows.size or math.prod(declared)):
        problem = f"was declared with {declared} metadata rows, the sample has {shape}"
        raise ValueError(f"stream {frame.stream!r} {problem}")
    for counts in (frame.counts, frame.metadata_rows):
        if (counts.dtype.kind, counts.dtype.itemsize) != ("u", 2):
            raise ValueError(f"stream {frame.stream!r}: counts are {counts.dtype}, not uint16")
