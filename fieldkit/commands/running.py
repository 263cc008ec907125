"""Which session of a campaign is being recorded."""

from __future__ import annotations

from pathlib import Path

from fieldkit.sessions.lock import is_locked

LOCK_NAME = ".recording"
"""File in ``recordings/`` that the recorder of a campaign holds locked, so that there is only one."""


def session_in_progress(recordings: Path) -> Path | None:
    """The session that a living process is writing, or None; an interrupted one is not in progress."""
    for journal in sorted(recordings.glob("*.h5.journal")):
        if is_locked(journal):
            return journal.with_name(journal.name.removesuffix(".journal"))
    return None
