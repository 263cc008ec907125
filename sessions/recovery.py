"""Finishing a session whose writer did not: a new file from everything that can be read.

The new file is made and verified beside the old one and takes its place at the very end,
in one step; so recovery may be killed at any time and run again, and running it on a
finished session changes nothing. Only when the disk has confirmed that step does the journal go.
"""

from __future__ import annotations

import errno
import logging
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from fieldkit.disk import Patience, put_in_place
from fieldkit.model.errors import (
    FormatError,
    IntegrityError,
    RefusedError,
    SessionError,
    StorageError,
    message_of,
)
from fieldkit.model.next_step import Action
from fieldkit.model.samples import Event, EventKind, Severity
from fieldkit.sessions.check import integrity_findings
from fieldkit.sessions.chunks import PackedBlock
from fieldkit.sessions.file_tree import put_rows
from fieldkit.sessions.guarded_file import GuardedFile
from fieldkit.sessions.journal_reader import JournalReader
from fieldkit.sessions.layout import RECOVERED, SEALED, check_version
from fieldkit.sessions.lock import RECOVERY, SessionLock, is_locked, journal_path
from fieldkit.sessions.reader import SessionReader, open_interrupted, open_session
from fieldkit.sessions.salvage import LostRange, RecoveryStatistics, Salvage
from fieldkit.sessions.seal import SealReport, remove_journal, seal
from fieldkit.sessions.session_file import COMPRESSORS, SessionFile
from fieldkit.sessions.superblock import CHECK_PATH

log: logging.Logger = logging.getLogger(__name__)

FRESH = ".recovering"
"""Ending of the new file until it takes the session's place."""


@dataclass(frozen=True, slots=True)
class RecoveryReport:
    """Result of a recovery: samples per stream, those only in the journal, and every run of lost ones.

    `damage` names in words what could not be read. `crashed` is the file as it was. Where the end is not
    known, samples may be lost behind the last one that is there. Without `counts` nothing was ever recorded.
    """

    path: Path
    counts: dict[str, int]
    from_journal: dict[str, int]
    lost: tuple[LostRange, ...] = ()
    damage: tuple[str, ...] = ()
    crashed: Path | None = None
    was_complete: bool = False
    bytes: int = 0
    end_is_known: bool = True

    @property
    def lost_samples(self) -> int:
        """Number of samples known to be lost."""
        return sum(run.count for run in self.lost)


def crashed_path(path: Path) -> Path:
    """Path at which the file of an interrupted session is kept after recovery."""
    return path.with_name(path.name + ".crashed")


def recover(path: str | Path, notes: Sequence[Event] = ()) -> RecoveryReport:
    """Finish an interrupted session; on a finished one nothing is done.

    `notes` are marks that the recorder had no time to take: they become events of the session.
    Raises `RefusedError` while it is still being recorded, `SessionError` where nothing can
    be read of it, `StorageError` where the disk has no room for the new file or takes none.
    """
    path = Path(path)
    complete = _complete(path)
    if complete is not None and not journal_path(path).exists():
        return complete  # also where nothing can be written
    try:
        return Patience()(partial(_recover_locked, path, notes))
    except OSError as error:
        raise StorageError(
            f"the session {path} could not be recovered: {error.strerror or error}",
            fix="copy it, with its .journal folder, to where it can be written, then run recovery again",
        ) from error


def _recover_locked(path: Path, notes: Sequence[Event]) -> RecoveryReport:
    """Recover the session, or only remove what is left of its journal, unless it is in use."""
    folder = journal_path(path)
    if not path.exists() and crashed_path(path).exists():
        crashed_path(path).rename(path)
    if not path.exists() and not folder.exists():
        raise SessionError(f"there is no session {path}", fix=CHECK_PATH)
    if is_locked(folder):
        fix = "wait until the recording has ended, or stop it: " + Action.STOP()
        raise RefusedError("in use: it is being recorded", place=path, fix=fix)
    _check_versions(path, folder)
    is_ours = not folder.exists()  # only for the lock: a file of which nothing is left is not interrupted
    folder.mkdir(exist_ok=True)
    lock = SessionLock(folder, RECOVERY)
    try:
        report = _complete(path) or _never_begun(path, folder) or _recover(path, notes)
    except SessionError:
        if is_ours:
            remove_journal(folder)
        raise
    finally:
        lock.release()
    remove_journal(folder)
    return report


def _check_versions(path: Path, folder: Path) -> None:
    """Raise `FormatError` where the file or its journal is of another version; damage is no matter here."""
    if any(folder.glob("*.sqlite")):  # what is not a log would be taken for nothing and removed
        check_version(folder, "1")
    for open_part in (partial(open_interrupted, path), partial(JournalReader, folder)):
        try:
            open_part().close()
        except FormatError:
            raise
        except SessionError:
            continue


def rebuild(path: Path, state: int) -> SealReport:
    """Make a session's file again from its journal and itself, when it could not be completed.

    Raises `IntegrityError` where something is lost, the file and the journal being as they were: only
    recovery may finish such a session, because it reports what is missing.
    """
    report, _ = _rebuild(path, state, None, ())
    return report


def _complete(path: Path) -> RecoveryReport | None:
    """The report on a session that needs no recovery."""
    try:
        with open_session(path) as session:
            if session.state not in ("sealed", "recovered"):
                return None
            counts = {name: session.count(name) for name in session.streams}
    except SessionError:
        return None
    return RecoveryReport(
        path, counts, dict.fromkeys(counts, 0), was_complete=True, bytes=path.stat().st_size
    )


def _never_begun(path: Path, folder: Path) -> RecoveryReport | None:
    """The report on a session whose recorder ended before it could take a sample; None for any other."""
    logs = [*folder.glob("*.log")]
    if path.exists() or any(log.name != "000001.log" for log in logs):
        return None
    with suppress(SessionError), JournalReader(folder):
        return None  # even if it has no sample
    return RecoveryReport(path, {}, {})


def _recover(path: Path, notes: Sequence[Event]) -> RecoveryReport:
    crashed = crashed_path(path) if path.exists() else None
    fresh = path.with_name(path.name + FRESH)
    if (report := _finish_earlier(fresh, path)) is not None:
        _take_place(fresh, path, crashed)
        return replace(report, path=path, crashed=crashed)
    sealed, salvage = _rebuild(path, RECOVERED, crashed, notes)
    return RecoveryReport(
        path, sealed.counts, {name: stats.from_journal for name, stats in salvage.statistics.items()},
        tuple(run for stats in salvage.statistics.values() for run in stats.lost),
        tuple(salvage.damage), crashed, bytes=sealed.bytes, end_is_known=salvage.has_end,
    )  # fmt: skip


def _finish_earlier(fresh: Path, path: Path) -> RecoveryReport | None:
    """The report on the new file where an earlier recovery completed it and only its place was not taken.

    After a power cut that may be all that is left. It is verified once more; one that is not sound, or of
    another session of that name, is made again.
    """
    try:
        with open_session(fresh) as session:
            is_this = session.session_id in (_session_ids(path) or {session.session_id})
            is_sound = all(finding.level != "fail" for finding in integrity_findings(session))
            if not (session.state == "recovered" and is_this and is_sound):
                return None
            crc32s = {name: session.stream(name).column("crc32") for name in session.streams}
            report = _report_of(session)
        return replace(report, bytes=seal(fresh, crc32s, RECOVERED).bytes)
    except (SessionError, RuntimeError, ValueError, KeyError, TypeError):
        return None


def _session_ids(path: Path) -> set[str]:
    """Identity of the session, as far as its file and its journal still show."""
    ids = set()
    with suppress(SessionError), open_interrupted(path) as session:
        ids.add(session.session_id)
    with suppress(SessionError), JournalReader(journal_path(path)) as journal:
        ids.add(journal.identity.session_id)
    return ids


def _report_of(session: SessionReader) -> RecoveryReport:
    """The report of a recovery, from the events that `_recovery_events` wrote."""
    events = [event for event in session.events(recorded=True) if event.kind is EventKind.RECOVERED]
    counts = {name: session.count(name) for name in session.streams}
    summary = events[-1].data if events else {}
    keys = ("first", "last", "after_ns", "before_ns")
    lost = tuple(
        LostRange(event.stream, *(int(event.data[key]) for key in keys)) for event in events if event.stream
    )
    from_journal = {name: int(summary.get(name, {}).get("from_journal", 0)) for name in counts}
    has_end = bool(summary.get("has_end", True))
    return RecoveryReport(session.path, counts, from_journal, lost, end_is_known=has_end)


def _rebuild(
    path: Path, state: int, keep_as: Path | None, notes: Sequence[Event]
) -> tuple[SealReport, Salvage]:
    fresh = path.with_name(path.name + FRESH)
    try:
        report, salvage = _make(path, fresh, state, notes)
        _take_place(fresh, path, keep_as)
    except OSError as error:
        raise StorageError(
            f"the session {path} could not be finished: {error.strerror or error}",
            fix="make room beside it, then run recovery again; nothing is lost",
        ) from error
    return replace(report, path=path), salvage


def _take_place(fresh: Path, path: Path, keep_as: Path | None) -> None:
    """Put the new file in the old one's place; when this returns, the disk has it there."""
    if keep_as is not None and not keep_as.exists():  # one that exists is left by a recovery that was killed
        try:
            os.link(path, keep_as)
        except OSError as error:
            if error.errno in (errno.ENOSPC, errno.EDQUOT):
                raise
            # where a file can have one name only; `recover` takes it back if the new one gets no place
            os.rename(path, keep_as)
    put_in_place(fresh, path)


def _make(path: Path, fresh: Path, state: int, notes: Sequence[Event]) -> tuple[SealReport, Salvage]:
    """The new file, sealed; if a block taken as it was does not verify, made again sample by sample."""
    try:
        return _make_sealed(path, fresh, state, notes, packed=True)
    except (IntegrityError, ValueError, TypeError, OverflowError) as error:
        log.warning("recovering %s sample by sample: %s", path, message_of(error))
        return _make_sealed(path, fresh, state, notes, packed=False)


def _make_sealed(
    path: Path, fresh: Path, state: int, notes: Sequence[Event], *, packed: bool
) -> tuple[SealReport, Salvage]:
    fresh.unlink(missing_ok=True)
    try:
        with Salvage(path, packed=packed) as salvage:
            _write(fresh, salvage, notes, report=state == RECOVERED)
        if state == SEALED and salvage.losses:
            raise IntegrityError(f"not whole: {'; '.join(salvage.losses)}", place=path)
        return seal(fresh, {name: stats.crc32s for name, stats in salvage.statistics.items()}, state), salvage
    except (OSError, IntegrityError):
        with suppress(OSError):
            fresh.unlink(missing_ok=True)  # on a full disk it would only be in the way
        raise


def _write(fresh: Path, salvage: Salvage, notes: Sequence[Event], *, report: bool) -> None:
    with ThreadPoolExecutor(COMPRESSORS) as pool:
        file = SessionFile(fresh, salvage.identity, pool, swmr=False)
        try:
            for name in salvage.statistics:
                for piece in salvage.samples(name):
                    if isinstance(piece, PackedBlock):
                        file.put_packed(piece)
                    else:
                        file.put(piece)
            for entry in salvage.entries():
                file.put(entry)
            end_ns = max((stats.last_ns for stats in salvage.statistics.values()), default=0)
            end_ns = end_ns or salvage.identity.start_ns
            for event in _recovery_events(salvage, notes, end_ns, report=report):
                file.put(event)
            file.finish(end_ns)
        finally:
            file.close()
    if time_map := salvage.time_map():
        with GuardedFile(fresh) as opened:
            put_rows(opened["time_map"], time_map)


def _recovery_events(
    salvage: Salvage, notes: Sequence[Event], end_ns: int, *, report: bool
) -> Iterator[Event]:
    """Events of the recovery itself: marks not yet taken, every range of lost samples, the summary."""
    start_ns, anchor_ns = salvage.identity.start_ns, salvage.identity.anchor_ns
    for note in notes:
        time_ns = min(max(note.time_ns, start_ns), end_ns)
        yield replace(note, time_ns=time_ns, mono_ns=time_ns - anchor_ns)
    if not report:
        return
    for stats in salvage.statistics.values():
        for run in stats.lost:
            time_ns = run.after_ns or start_ns
            text = f"{run.stream}: {run.count} samples lost, numbers {run.first} to {run.last}"
            data = {
                "first": run.first, "last": run.last, "lost": run.count, "after_ns": run.after_ns,
                "before_ns": run.before_ns,
            }  # fmt: skip
            error = Severity.ERROR
            yield Event(EventKind.RECOVERED, time_ns - anchor_ns, time_ns, text, run.stream, error, data)
    yield _summary(salvage.statistics, end_ns - anchor_ns, end_ns, has_end=salvage.has_end)


def _summary(
    statistics: dict[str, RecoveryStatistics], mono_ns: int, time_ns: int, *, has_end: bool
) -> Event:
    lost = {name: sum(run.count for run in stats.lost) for name, stats in statistics.items()}
    count = sum(stats.kept for stats in statistics.values())
    data: dict[str, object] = {
        name: {"kept": stats.kept, "from_journal": stats.from_journal, "lost": lost[name]}
        for name, stats in statistics.items()
    }
    text = f"session recovered: {count} samples, {sum(lost.values())} lost"
    if not has_end:
        text, data = f"{text}; samples behind the last one may be lost", {**data, "has_end": False}
    severity = Severity.ERROR if any(lost.values()) else Severity.WARNING
    return Event(EventKind.RECOVERED, mono_ns, time_ns, text, "", severity, data)
