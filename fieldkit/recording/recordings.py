"""The recordings of a folder: where a new one belongs, which are interrupted, and how to finish those."""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Callable, Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from fieldkit.disk import is_regular
from fieldkit.model.errors import ConfigError, SessionError
from fieldkit.model.next_step import Argument
from fieldkit.model.units import SECOND_NS
from fieldkit.phrases import Words
from fieldkit.sessions.lock import is_locked, journal_path

if TYPE_CHECKING:
    from fieldkit.config import Config

JOURNAL = ".journal"
NAME_BYTES = 120
"""Of the 255 of a file's name: time, stream and ending of all that is made of a session need the others."""
_UNFIT = re.compile("[/\\\\\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff]")
"""Slashes, control characters, separators of lines, and bytes that are not UTF-8."""
log: logging.Logger = logging.getLogger(__name__)


def sessions_in(folder: Path, notify: Callable[[str], None] = log.info) -> list[Path]:
    """The sessions of a folder by name, including those of which only the journal is left.

    Nothing but the folder's own files: a link may lead anywhere, or count a session twice; a pipe would block
    its reader. `notify` receives the names of what is skipped.
    """
    names = {path.name for path in folder.glob("*.h5")}
    names |= {path.name.removesuffix(JOURNAL) for path in folder.glob(f"*.h5{JOURNAL}")}
    paths: list[Path] = []
    for path in [folder / name for name in sorted(names, key=in_natural_order)]:
        if is_regular(path) or not os.path.lexists(path):
            paths.append(path)
        else:
            notify(f"{path} is skipped: it is a link, a folder or a device; name the session file itself")
    return paths


def recordings_in(folder: Path) -> Path:
    """The recordings of a campaign by its folder; any other folder as it is."""
    return inside if (inside := folder / "recordings").is_dir() else folder


def in_natural_order(name: str) -> list[str | int]:
    """Key that sorts names by the numbers in them: d2 before d10."""
    return [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", name)]


def is_interrupted(path: Path) -> bool:
    """True if a session was never sealed and no process is writing it."""
    from fieldkit.sessions.superblock import is_clean

    journal = journal_path(path)
    if is_locked(journal):
        return False
    try:
        if is_clean(path) and not journal.exists():
            return False  # as nearly all are: not opened
        from fieldkit.sessions.reader import open_session

        with open_session(path) as session:
            return session.state == "interrupted"
    except SessionError:
        return journal.exists()


def exists(path: Path) -> bool:
    """True if there is a file or folder, or the journal of a session of that name."""
    return path.exists() or journal_path(path).exists()


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


def delete_crash_files(sessions: Iterable[Path]) -> list[Path]:
    """Delete the files that recovery kept as crashes left them; their paths."""
    from fieldkit.sessions.finished_file import changing_path
    from fieldkit.sessions.recovery import crashed_path

    beside = [name(path) for path in sessions for name in (crashed_path, changing_path)]
    crash_files = [path for path in beside if path.exists()]
    for path in crash_files:
        path.unlink()
    return crash_files


def session_path(config: Config, name: str, time_ns: int) -> Path:
    """Path of a session that begins at `time_ns` (UTC): ``recordings/20261211T025512Z-name.h5``.

    With ``-2``, ``-3`` ... if that is taken, as by another run of the same simulated day. Raises
    `ConfigError` for a name that no file can have, or none that every program can show.
    """
    _check_name(name)
    stamp = datetime.fromtimestamp(time_ns / SECOND_NS, UTC).strftime("%Y%m%dT%H%M%SZ")
    return _free_path(config.recordings / (f"{stamp}-{name}.h5" if name else f"{stamp}.h5"))


def _check_name(name: str) -> None:
    size = len(name.encode(errors="replace"))
    plain = _UNFIT.sub("-", name.encode(errors="replace")[:NAME_BYTES].decode(errors="ignore"))
    if size > NAME_BYTES:
        what = Words("error.name_bytes", size=size, most=NAME_BYTES)
    elif "/" in name or "\\" in name:
        what = Words("error.name_slash", name=repr(name))
    elif _UNFIT.search(name):
        what = Words("error.name_not_text", name=repr(name))
    else:
        return
    raise ConfigError(what, place=Argument("name"), fix=Argument("name", plain))


def _free_path(path: Path) -> Path:
    """The path, or the first ``-2``, ``-3`` ... beside it that does not exist: nothing is overwritten."""
    number, free = 1, path
    while exists(free):
        number += 1
        free = path.with_name(f"{path.stem}-{number}.h5")
    return free
