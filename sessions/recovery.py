"""Finishing a session whose writer did not: a new file from everything that can be read.

The new file is made and verified beside the old one and takes its place at the very end,
in one step; so recovery may be killed at any time and run again, and running it on a
finished session changes nothing. Only when the disk has confirmed that step does the journal go.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from functools import partial
from itertools import takewhile
from operator import attrgetter
from pathlib import Path
from tempfile import mkdtemp

from fieldkit.disk import Patience, put_in_place
from fieldkit.model.errors import IntegrityError, RefusedError, SessionError, StorageError
from fieldkit.model.next_step import Action
from fieldkit.model.samples import Event, EventKind, Severity
from fieldkit.phrases import counted
from fieldkit.sessions.file_tree import put_rows
from fieldkit.sessions.guarded_file import GuardedFile
from fieldkit.sessions.journal_reader import session_numbers
from fieldkit.sessions.layout import RECOVERED, SEALED
from fieldkit.sessions.lock import RECOVERY, SessionLock, is_locked, journal_path
from fieldkit.sessions.log import session_number
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.salvage import LostRange, Salvage
from fieldkit.sessions.seal import SealReport, remove_journal, seal
from fieldkit.sessions.session_file import COMPRESSORS, SessionFile
from fieldkit.sessions.superblock import CHECK_PATH

FRESH = ".recovering"
"""Ending of the new file until it takes the session's place."""


class Outcome(StrEnum):
    """Whether a recovery has everything that was recorded."""

    COMPLETE = "complete"
    END_NOT_KNOWN = "end not known"
    """Nothing is known to be lost, but something may have been behind the last sample."""
    LOST = "lost"


@dataclass(frozen=True, slots=True)
class RecoveryReport:
    """Result of a recovery: samples per stream, those only in the journal, and every run of lost ones.

    `damage` names in words what could not be read or was left out; `doubt` says why the end is not known, and
    is empty where it is. `lost_entries` counts events, slopes, records of health and corrections. `crashed`
    is the file as it was. Without `counts` nothing was ever recorded.
    """

    path: Path
    counts: dict[str, int]
    lost: tuple[LostRange, ...] = ()
    from_journal: Mapping[str, int] = field(default_factory=dict)
    damage: tuple[str, ...] = ()
    crashed: Path | None = None
    was_complete: bool = False
    bytes: int = 0
    doubt: str = ""
    lost_entries: int = 0

    @property
    def lost_samples(self) -> int:
        """Number of samples known to be lost."""
        return sum(run.count for run in self.lost)

    @property
    def outcome(self) -> Outcome:
        """Which of the three it was."""
        if self.lost_samples or self.lost_entries:
            return Outcome.LOST
        return Outcome.END_NOT_KNOWN if self.doubt else Outcome.COMPLETE


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
        problem = f"the session {path} could not be recovered: {error.strerror or error}"
        fix = "make room beside it, or copy it with its .journal folder to where there is; nothing is lost"
        raise StorageError(problem, fix=fix) from error


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
    is_ours = not folder.exists()  # only for the lock: a file of which nothing is left is not interrupted
    folder.mkdir(exist_ok=True)
    with SessionLock(folder, RECOVERY):
        try:
            report = _complete(path) or _never_begun(path, folder) or _recover(path, notes)
        except SessionError:
            if is_ours:
                remove_journal(folder)
            raise
    return _put_away(folder, report)


def _put_away(folder: Path, report: RecoveryReport) -> RecoveryReport:
    """Delete the journal, which is not needed any more; one with files of another session is kept beside."""
    if report.path.exists():
        with open_session(report.path) as session:
            ours = session_number(session.session_id)
        if {ours} != {ours, *session_numbers(folder)}:
            aside = mkdtemp(prefix=f"{crashed_path(folder).name}-", dir=folder.parent)
            os.replace(folder, aside)
            kept = f"what is of another session is kept in {aside}"
            return replace(report, damage=(*report.damage, kept))
    remove_journal(folder)
    return report


def _complete(path: Path) -> RecoveryReport | None:
    """The report on a session that needs no recovery, with what an earlier one found; None for another."""
    try:
        with open_session(path) as session:
            if session.state not in ("sealed", "recovered"):
                return None
            counts = {name: session.count(name) for name in session.streams}
            events = [event for event in session.events(recorded=True) if event.kind is EventKind.RECOVERED]
        runs = takewhile(attrgetter("stream"), events[-2::-1])
        lost = tuple(LostRange(**event.data) for event in runs)[::-1]
        summary = events[-1].data if events else {}
        return RecoveryReport(path, counts, lost, was_complete=True, bytes=path.stat().st_size, **summary)
    except (SessionError, TypeError):
        return None


def _never_begun(path: Path, folder: Path) -> RecoveryReport | None:
    """The report on a session whose recorder ended before it could take a sample; None for any other."""
    logs = {log.name for log in folder.glob("*.log")}
    if path.exists() or logs - {"000001.log"} or session_numbers(folder):
        return None  # even if it has no sample
    return RecoveryReport(path, {})


def _recover(path: Path, notes: Sequence[Event]) -> RecoveryReport:
    crashed = crashed_path(path) if path.exists() else None
    _, salvage = rebuild(path, RECOVERED, notes, crashed)
    report = _complete(path)
    assert report is not None
    from_journal = {name: stats.from_journal for name, stats in salvage.statistics.items()}
    damage = tuple(salvage.damage)
    return replace(report, was_complete=False, from_journal=from_journal, damage=damage, crashed=crashed)


def rebuild(
    path: Path, state: int, notes: Sequence[Event] = (), keep_as: Path | None = None
) -> tuple[SealReport, Salvage]:
    """Make a session's file again from its journal and itself, when it could not be completed.

    With `state` SEALED it raises `IntegrityError` where something is lost, the file and the journal being as
    they were: only recovery may finish such a session, because it reports what is missing.
    """
    fresh = path.with_name(path.name + FRESH)
    report, salvage = _make(path, fresh, state, notes)
    if keep_as is not None and not keep_as.exists():  # one that exists is left by a recovery that was killed
        try:
            os.link(path, keep_as)
        except OSError as error:
            if error.errno in (errno.ENOSPC, errno.EDQUOT):
                raise
            # where a file can have one name only; `recover` takes it back if the new one gets no place
            os.rename(path, keep_as)
    put_in_place(fresh, path)
    return replace(report, path=path), salvage


def _make(path: Path, fresh: Path, state: int, notes: Sequence[Event]) -> tuple[SealReport, Salvage]:
    """The new file, sealed."""
    fresh.unlink(missing_ok=True)
    try:
        with Salvage(path) as salvage:
            _write(fresh, salvage, notes, report=state == RECOVERED)
        if state == SEALED and (salvage.lost or salvage.lost_entries):
            lost = [f"{run.stream}: {counted(run.count, 'sample')} lost" for run in salvage.lost]
            raise IntegrityError(f"not whole: {'; '.join([*lost, *salvage.damage])}", place=path)
        return seal(fresh, {name: stats.crc32s for name, stats in salvage.statistics.items()}, state), salvage
    except (OSError, IntegrityError):
        with suppress(OSError):
            fresh.unlink(missing_ok=True)  # on a full disk it would only be in the way
        raise


def _write(fresh: Path, salvage: Salvage, notes: Sequence[Event], *, report: bool) -> None:
    time_map = salvage.time_map()
    with ThreadPoolExecutor(COMPRESSORS) as pool:
        file = SessionFile(fresh, salvage.identity, pool, swmr=False)
        try:
            for name in salvage.statistics:
                for sample, crc32 in salvage.samples(name):
                    file.put(sample, crc32)
            for entry in salvage.entries():
                file.put(entry)
            end_ns = max((stats.last_ns for stats in salvage.statistics.values()), default=0)
            end_ns = end_ns or salvage.identity.start_ns
            for event in _recovery_events(salvage, notes, end_ns, report=report):
                file.put(event)
            file.finish(end_ns)
        finally:
            file.close()
    if time_map:
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
    for run in salvage.lost:
        time_ns = run.after_ns or start_ns
        text = f"{run.stream}: {counted(run.count, 'sample')} lost, numbers {run.first} to {run.last}"
        data, error = asdict(run), Severity.ERROR
        yield Event(EventKind.RECOVERED, time_ns - anchor_ns, time_ns, text, run.stream, error, data)
    count = sum(len(stats.crc32s) for stats in salvage.statistics.values())
    doubt = f"; the end is not known: {salvage.doubt}" if salvage.doubt else ""
    lost = sum(run.count for run in salvage.lost)
    text = f"session recovered: {counted(count, 'sample')}, {lost} lost{doubt}"
    severity = Severity.ERROR if salvage.lost or doubt else Severity.WARNING
    findings = {"doubt": salvage.doubt, "lost_entries": salvage.lost_entries}
    yield Event(EventKind.RECOVERED, end_ns - anchor_ns, end_ns, text, "", severity, findings)
