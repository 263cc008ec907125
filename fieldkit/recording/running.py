"""The running recording of a campaign, one at a time: which session, whether it responds; stop.

Another process is writing the session: nothing here opens it, so that small commands load neither numpy nor
h5py.
"""

from __future__ import annotations

import contextlib
import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from fieldkit.model.errors import RefusedError, SessionError, StorageError, os_errors_as
from fieldkit.model.next_step import Action
from fieldkit.phrases import Words
from fieldkit.recording.recordings import JOURNAL, is_interrupted
from fieldkit.sessions.lock import SessionLock, await_unlocked, is_locked, journal_path, owner

if TYPE_CHECKING:
    from fieldkit.model.site import Site

LOCK_NAME = ".recording"
"""File in ``recordings/`` that the recorder of a campaign holds locked, so that there is only one."""
PREVIEW_LOCK_NAME = ".preview"
"""File in ``recordings/`` that a preview holds locked while it has the instruments open."""
WAITING_NAME = ".waiting"
"""File in ``recordings/`` that a recorder holds locked until the time at which it is to begin."""
PREVIEW_ENDS_WITHIN_S = 10.0
LOOK_EVERY_S = 0.1
STOPPING_NAME = "stopping"
"""File in the journal of a session whose recorder was asked to stop."""
SILENT_AFTER_S = 5.0
"""A recorder writes its state every second; a slow disk may hold up some of them."""
SEALED_WITHIN_S = 90.0
"""A minute for verifying, and what the recorder waits for estimates (`estimator_thread.LONGEST_WAIT_S`)."""
REMOVED_WITHIN_S = 1.0
"""A recorder that has sealed its session lets go of it, then removes the journal."""


def running_session(recordings: Path) -> Path:
    """The session that is being recorded into a folder; raises `RefusedError` if there is none."""
    path = session_in_progress(recordings)
    if path is None and (pid := waiting_recorder(recordings)) is not None:
        raise RefusedError(
            Words("error.waits", process=pid),
            fix=Action.STOP() + " calls it off",
        )
    if path is None:
        raise RefusedError(Words("error.not_recording"), fix=Action.RECORD())
    return path


def waiting_recorder(recordings: Path) -> int | None:
    """The process that waits for the time at which its recording is to begin (``record --at``), or None."""
    return owner(recordings, WAITING_NAME)


def _call_off(recordings: Path) -> bool:
    """End a recorder that waits for its time, so that it never begins; False if none does."""
    if (pid := waiting_recorder(recordings)) is None:
        return False
    os.kill(pid, signal.SIGTERM)
    await_unlocked(recordings, LOCK_NAME, PREVIEW_ENDS_WITHIN_S)
    return True


def session_in_progress(recordings: Path) -> Path | None:
    """The session that a living process is writing, or None; an interrupted one is not in progress.

    The latest of a recording that is split by the time of day, of which the one before is being sealed.
    """
    for journal in sorted(recordings.glob(f"*.h5{JOURNAL}"), reverse=True):
        if is_locked(journal):
            return journal.with_name(journal.name.removesuffix(JOURNAL))
    return None


@contextmanager
def only_recorder(recordings: Path) -> Iterator[None]:
    """Be the one process that records in this campaign, from before its instruments are opened.

    Raises `RefusedError` while another one is, `StorageError` if the folder cannot be written.
    """
    try:
        lock = _lock_in(recordings, LOCK_NAME)
    except RefusedError as error:
        _refuse_second(recordings, otherwise=error.message)
        raise
    with lock:
        yield


def _lock_in(recordings: Path, name: str) -> SessionLock:
    fix = "choose a folder that can be written"
    with os_errors_as(StorageError, "no session can be written here", place=recordings, fix=fix):
        recordings.mkdir(parents=True, exist_ok=True)
        return SessionLock(recordings, name)


def is_recorder_present(recordings: Path) -> bool:
    """Whether a process records in this campaign, or opens its instruments in order to."""
    return is_locked(recordings, LOCK_NAME) or session_in_progress(recordings) is not None


@contextmanager
def previewing(recordings: Path) -> Iterator[Callable[[], bool]]:
    """Hold the instruments for a preview, which is to end once what is yielded is true: a recorder waits.

    Raises `RefusedError` while a recorder or another preview holds them, `StorageError` if the folder cannot
    be written.
    """
    _refuse_second(recordings)
    with _lock_in(recordings, PREVIEW_LOCK_NAME):
        yield partial(is_recorder_present, recordings)


def _refuse_second(recordings: Path, otherwise: str = "") -> None:
    """Raise `RefusedError` for a recording in progress: by its session, or otherwise in these words."""
    running = session_in_progress(recordings)
    if what := running.name if running else otherwise:
        raise RefusedError(
            Words("error.recorded_already", session=what),
            fix=Action.STATUS() + " shows it, " + Action.STOP() + " ends it",
        )


@dataclass(frozen=True, slots=True)
class UnresponsiveRecorder:
    """A recorder that holds its session and writes nothing: since when (UTC), and whether it was stopped."""

    pid: int | None
    since_ns: int
    is_stopped: bool

    def at(self, site: Site) -> str:
        """In words, with the time at the site and what to do."""
        from fieldkit.views import formatting

        zone = formatting.zone_name(self.since_ns, site)
        since = f"since {formatting.clock_time(self.since_ns, site, seconds=True)} {zone}"
        if self.is_stopped:
            remedy = f"it was stopped (Ctrl-Z); kill -CONT {self.pid} continues it"
            return f"process {self.pid} does not respond {since}: {remedy}"
        return f"process {self.pid} has written nothing {since}: it is sealing, its disk is slow, or it hangs"


def unresponsive_recorder(session: Path) -> UnresponsiveRecorder | None:
    """Whether the recorder of a session in progress does not respond; None where it does, or has ended."""
    pid = owner(journal_path(session))
    if pid is None:
        return None
    since_ns, is_stopped = _last_write_ns(session), _is_stopped(pid)
    if not is_stopped and time.time() - since_ns / 1e9 < SILENT_AFTER_S:
        return None
    return UnresponsiveRecorder(pid, since_ns, is_stopped)


def _last_write_ns(session: Path) -> int:
    written = [0]
    for file in (session, *journal_path(session).glob("*")):
        with contextlib.suppress(OSError):  # a part of the journal that has just been retired
            written.append(file.stat().st_mtime_ns)
    return max(written)


def _is_stopped(pid: int) -> bool:
    """Whether the kernel has stopped a process, as by Ctrl-Z; false without ``/proc``."""
    try:
        about = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False
    return about.rpartition(")")[2].split()[0] in ("T", "t")


def stop_recording(recordings: Path, notify: Callable[[UnresponsiveRecorder], None]) -> Path | None:
    """Ask the running recording to stop and seal, and wait for it; the sealed session.

    One that waits for its time is called off: nothing was recorded, and there is no session.
    `notify` receives the recorder if it does not respond; one suspended by Ctrl-Z is then continued, so that
    it can seal. Raises `RefusedError` if none is running or it takes more than `SEALED_WITHIN_S`,
    `SessionError` if it ended without sealing.
    """
    if _call_off(recordings):
        return None
    path = running_session(recordings)
    pid = owner(journal_path(path))
    if pid is None:  # it has ended since
        raise RefusedError(Words("error.not_recording"), fix=Action.RECORD())
    if _is_first_to_stop(path):
        os.kill(pid, signal.SIGTERM)
    deadline, is_reported = time.monotonic() + SEALED_WITHIN_S, False
    while is_locked(journal_path(path)):
        if not is_reported and (silent := unresponsive_recorder(path)) is not None:
            is_reported = True
            notify(silent)
            if silent.is_stopped:
                os.kill(pid, signal.SIGCONT)
        if time.monotonic() > deadline:
            raise RefusedError(
                Words("error.not_sealed", process=pid, seconds=f"{SEALED_WITHIN_S:.0f}"),
                place=path.name,
                fix=Words("fix.kill", process=pid),
            )
        time.sleep(0.1)
    deadline = time.monotonic() + REMOVED_WITHIN_S
    while journal_path(path).exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    if is_interrupted(path):
        raise SessionError(
            Words("error.unsealed"),
            place=path.name,
            fix=Action.RECOVER(path),
        )
    return path


def _is_first_to_stop(session: Path) -> bool:
    """Whether a recorder has not been asked to stop before: a second signal would end it unsealed."""
    try:
        (journal_path(session) / STOPPING_NAME).touch(exist_ok=False)
    except FileExistsError:
        return False
    except OSError:
        return True
    return True
