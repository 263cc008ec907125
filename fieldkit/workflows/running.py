"""The session that is being recorded: which it is, and whether its recorder responds."""

from __future__ import annotations

import contextlib
import time
from dataclasses import dataclass
from pathlib import Path

from fieldkit.model.site import Site
from fieldkit.sessions.layout import journal_path
from fieldkit.sessions.lock import is_locked, owner
from fieldkit.views import formatting


def session_in_progress(recordings: Path) -> Path | None:
    """The session that a living process is writing, or None; an interrupted one is not in progress."""
    for journal in sorted(recordings.glob("*.h5.journal")):
        if is_locked(journal):
            return journal.with_name(journal.name.removesuffix(".journal"))
    return None


SILENT_AFTER_S = 5.0
"""A recorder writes each second how it is doing; a disk may take some of them."""


@dataclass(frozen=True, slots=True)
class UnresponsiveRecorder:
    """A recorder that holds its session and writes nothing: since when (UTC), and whether it was stopped."""

    pid: int | None
    since_ns: int
    is_stopped: bool

    def at(self, site: Site) -> str:
        """In words, with the time at the site and what to do."""
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
    """Whether the kernel has stopped a process, as by Ctrl-Z; false where it does not say (no ``/proc``)."""
    try:
        about = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False
    return about.rpartition(")")[2].split()[0] in ("T", "t")
