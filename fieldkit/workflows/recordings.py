"""The recordings of a folder: where a new one belongs, which are interrupted, and how to finish those."""

from __future__ import annotations

import shlex
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from fieldkit.model.errors import ConfigError, SessionError
from fieldkit.model.units import SECOND_NS

if TYPE_CHECKING:
    from fieldkit.config import Config
    from fieldkit.sessions.recovery import RecoveryReport

JOURNAL = ".journal"


def sessions_in(folder: Path) -> list[Path]:
    """The sessions of a folder by name, including those of which only the journal is left."""
    names = {path.name for path in folder.glob("*.h5")}
    names |= {path.name.removesuffix(JOURNAL) for path in folder.glob(f"*.h5{JOURNAL}")}
    return [folder / name for name in sorted(names)]


def is_interrupted(path: Path) -> bool:
    """Whether a session was never sealed and no process is writing it."""
    from fieldkit.sessions.lock import is_locked
    from fieldkit.sessions.reader import open_session
    from fieldkit.sessions.superblock import is_clean

    journal = path.with_name(path.name + JOURNAL)
    if is_locked(journal):
        return False
    try:
        if is_clean(path) and not journal.exists():
            return False  # as nearly all are: not opened
        with open_session(path) as session:
            return session.state == "interrupted"
    except SessionError:
        return journal.exists()


def exists(path: Path) -> bool:
    """Whether there is a file or folder, or the journal of a session of that name."""
    return path.exists() or path.with_name(f"{path.name}{JOURNAL}").exists()


def began(path: Path) -> tuple[int, int, str]:
    """A key that sorts sessions by their first sample, then by when they were written.

    Sessions of one simulated day begin together.
    """
    from fieldkit.sessions.reader import open_session

    written_ns = path.stat().st_mtime_ns if path.exists() else 0
    try:
        with open_session(path) as session:
            return session.start_ns, written_ns, path.name
    except SessionError:  # reported where it is opened for its content
        return 0, written_ns, path.name


def recover_session(path: Path) -> RecoveryReport:
    """Finish an interrupted session from its journal, with the requests that were left for it.

    May be interrupted and run again; a finished session is not changed. Raises `SessionError`,
    `StorageError`, or `RefusedError` while the session is being written.
    """
    from fieldkit.sessions.recovery import recover
    from fieldkit.workflows.requests import inbox, left_requests

    return recover(path, left_requests(inbox(path)))


def delete_crash_files(sessions: Iterable[Path]) -> list[Path]:
    """Delete the files that recovery kept as crashes left them; their paths."""
    from fieldkit.sessions.clock_correction import changing_path
    from fieldkit.sessions.recovery import crashed_path

    beside = [name(path) for path in sessions for name in (crashed_path, changing_path)]
    left = [path for path in beside if path.exists()]
    for path in left:
        path.unlink()
    return left


def session_path(config: Config, name: str, time_ns: int) -> Path:
    """Where a session that begins at `time_ns` (UTC) belongs: ``recordings/20261211T025512Z-name.h5``.

    With ``-2``, ``-3`` ... if that is taken, as by another run of the same simulated day. Raises
    `ConfigError` for a name with a slash: the file would lie where no command looks for sessions.
    """
    if "/" in name or "\\" in name:
        plain = name.replace("/", "-").replace("\\", "-")
        raise ConfigError(f"the name {name!r} has a slash", fix=f"--name {shlex.quote(plain)}")
    stamp = datetime.fromtimestamp(time_ns / SECOND_NS, UTC).strftime("%Y%m%dT%H%M%SZ")
    return _unused(config.recordings / (f"{stamp}-{name}.h5" if name else f"{stamp}.h5"))


def _unused(path: Path) -> Path:
    """The path, or the first ``-2``, ``-3`` ... beside it that does not exist: nothing is overwritten."""
    number, free = 1, path
    while exists(free):
        number += 1
        free = path.with_name(f"{path.stem}-{number}.h5")
    return free
