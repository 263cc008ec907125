"""Finishing a session whose writer did not: a new file from everything that can be read.

The new file is made and verified beside the old one and takes its place at the very end,
in one step; so recovery may be killed at any time and run again, and running it on a
finished session changes nothing.
"""

from __future__ import annotations

import contextlib
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from fieldkit.errors import RefusedError, SessionError, StorageError
from fieldkit.samples import Event, EventKind, Sample, Severity
from fieldkit.sessions.brick_thread import COMPRESSORS
from fieldkit.sessions.layout import RECOVERED, journal_path
from fieldkit.sessions.lock import RECOVERY, SessionLock, is_locked
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.records import sample_bytes, sample_crc32
from fieldkit.sessions.salvage import Salvage, Tally
from fieldkit.sessions.seal import SealReport, remove_journal, seal
from fieldkit.sessions.session_file import SessionFile


@dataclass(frozen=True, slots=True)
class RecoveryReport:
    """What recovery found: samples per stream, how many only the journal had, and what is lost.

    `lost` has the first and last number of every run of lost samples, per stream;
    `damage` names in words what could not be read. `crashed` is the file as it was.
    """

    path: Path
    counts: dict[str, int]
    from_journal: dict[str, int]
    lost: dict[str, list[tuple[int, int]]]
    damage: tuple[str, ...] = ()
    crashed: Path | None = None
    was_complete: bool = False
    bytes: int = 0

    @property
    def lost_samples(self) -> int:
        """How many samples are known to be lost."""
        return sum(last - first + 1 for runs in self.lost.values() for first, last in runs)


def crashed_path(path: Path) -> Path:
    """Where the file of an interrupted session is kept after recovery."""
    return path.with_name(path.name + ".crashed")


def recover(path: str | Path) -> RecoveryReport:
    """Finish an interrupted session; on a finished one nothing is done.

    Raises `RefusedError` while it is still being recorded, `SessionError` where nothing can
    be read of it, `StorageError` where the disk has no room for the new file.
    """
    path = Path(path)
    folder = journal_path(path)
    if not path.exists() and crashed_path(path).exists():
        crashed_path(path).rename(path)
    if not path.exists() and not folder.exists():
        raise SessionError(f"there is no session {path}", fix="fieldkit ls shows the sessions of a campaign")
    if is_locked(folder):
        fix = "wait until the recording has ended, or stop it: fieldkit stop"
        raise RefusedError(f"{path} is in use: it is being recorded", fix=fix)
    folder.mkdir(exist_ok=True)
    lock = SessionLock(folder, RECOVERY)
    try:
        complete = _complete(path)
        report = complete or _recover(path)
    finally:
        lock.release()
    remove_journal(folder)
    return report


def rebuild(path: Path, state: int) -> SealReport:
    """Make a session's file again from its journal and itself, when it could not be completed."""
    report, _ = _rebuild(path, state, None)
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
        path, counts, dict.fromkeys(counts, 0), {}, was_complete=True, bytes=path.stat().st_size
    )


def _recover(path: Path) -> RecoveryReport:
    kept = crashed_path(path) if path.exists() else None
    report, salvage = _rebuild(path, RECOVERED, kept)
    return RecoveryReport(
        path, report.counts, {name: tally.from_journal for name, tally in salvage.tallies.items()},
        {name: runs for name, tally in salvage.tallies.items() if (runs := _runs(tally.lost))},
        tuple(dict.fromkeys(salvage.damage)), kept, bytes=report.bytes,
    )  # fmt: skip


def _rebuild(path: Path, state: int, keep_as: Path | None) -> tuple[SealReport, Salvage]:
    fresh = path.with_name(path.name + ".recovering")
    try:
        fresh.unlink(missing_ok=True)
        with Salvage(path) as salvage:
            _write(fresh, salvage, tell=state == RECOVERED)
        report = seal(fresh, {name: tally.crc32s for name, tally in salvage.tallies.items()}, state)
        if keep_as is not None:
            with contextlib.suppress(FileExistsError):  # left by a recovery that was killed
                os.link(path, keep_as)
        os.replace(fresh, path)
    except OSError as error:
        raise StorageError(
            f"the session {path} could not be finished: {error.strerror or error}",
            fix="make room beside it, then run recovery again; nothing is lost",
        ) from error
    return SealReport(path, report.counts, report.bytes, report.verified), salvage


def _write(fresh: Path, salvage: Salvage, *, tell: bool) -> None:
    last: Sample | None = None
    with ThreadPoolExecutor(COMPRESSORS) as pool:
        file = SessionFile(fresh, salvage.identity, pool, swmr=False)
        try:
            for name, tally in salvage.tallies.items():
                for sample in salvage.samples(name):
                    file.put(sample)
                    tally.crc32s.append(sample_crc32(sample, *sample_bytes(sample)))
                    last = sample if last is None or sample.mono_ns > last.mono_ns else last
            for entry in salvage.entries():
                file.put(entry)
            end_ns = last.time_ns if last else salvage.identity.start_ns
            if tell:
                mono_ns = last.mono_ns if last else end_ns - salvage.identity.anchor_ns
                file.put(_event(salvage.tallies, mono_ns, end_ns))
            file.finish(end_ns)
        finally:
            file.close()


def _event(tallies: dict[str, Tally], mono_ns: int, time_ns: int) -> Event:
    lost = sum(len(tally.lost) for tally in tallies.values())
    kept = sum(tally.kept for tally in tallies.values())
    data = {
        name: {"kept": tally.kept, "from_journal": tally.from_journal, "lost": _runs(tally.lost)[:20]}
        for name, tally in tallies.items()
    }
    text = f"session recovered: {kept} samples, {lost} lost"
    severity = Severity.ERROR if lost else Severity.WARNING
    return Event(EventKind.RECOVERED, mono_ns, time_ns, text, "", severity, data)


def _runs(numbers: list[int]) -> list[tuple[int, int]]:
    """Runs of consecutive numbers, each as first and last."""
    runs: list[tuple[int, int]] = []
    for number in numbers:
        if runs and number == runs[-1][1] + 1:
            runs[-1] = runs[-1][0], number
        else:
            runs.append((number, number))
    return runs
