"""Which session of a campaign is being recorded, and that only one is."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fieldkit.errors import RefusedError, StorageError
from fieldkit.sessions.lock import SessionLock, is_locked

LOCK_NAME = ".recording"
"""File in ``recordings/`` that the recorder of a campaign holds locked, so that there is only one."""


@contextmanager
def only_recorder(recordings: Path) -> Iterator[None]:
    """Be the one process that records in this campaign, from before its instruments are opened.

    Raises `RefusedError` while another one is, `StorageError` where the folder cannot be written.
    """
    _refuse_second(recordings)  # a recorder of an earlier version holds only its session's lock
    try:
        recordings.mkdir(parents=True, exist_ok=True)
        lock = SessionLock(recordings, LOCK_NAME)
    except RefusedError as error:
        _refuse_second(recordings)  # by the name of its session, once it has one
        raise RefusedError(f"this campaign is being recorded already: {error.message}", fix=_FIX) from error
    except OSError as error:
        raise StorageError(
            f"cannot record into {recordings}: {error.strerror}", fix="choose a folder that can be written"
        ) from error
    try:
        yield
    finally:
        lock.release()


_FIX = "fieldkit status shows it, fieldkit stop ends it"


def _refuse_second(recordings: Path) -> None:
    if (running := session_in_progress(recordings)) is not None:
        raise RefusedError(f"this campaign is being recorded already: {running.name}", fix=_FIX)


def session_in_progress(recordings: Path) -> Path | None:
    """The session that a living process is writing, or None; an interrupted one is not in progress."""
    for journal in sorted(recordings.glob("*.h5.journal")):
        if is_locked(journal):
            return journal.with_name(journal.name.removesuffix(".journal"))
    return None
