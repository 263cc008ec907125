"""The sessions a command works on: those named, those of a folder, or the campaign's latest."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Sequence
from pathlib import Path

from fieldkit.cli.common import recordings, say, say_warning, working_folder
from fieldkit.model.errors import ConfigError, SessionError
from fieldkit.model.next_step import Action
from fieldkit.recording.recordings import began, exists, is_interrupted, recordings_in, sessions_in
from fieldkit.sessions.superblock import refuse_address


def recordings_folder() -> Path:
    """``recordings/`` of the campaign that ``-C`` names or around the current folder, else the folder."""
    try:
        return recordings()
    except ConfigError:
        return working_folder()


def report_interrupted(paths: Iterable[Path]) -> None:
    """Print which of these sessions are interrupted, and how to finish them."""
    for path in paths:
        if is_interrupted(path):
            quoted_path = shlex.quote(str(path))
            say(
                f"{path.name} is interrupted, its journal may hold more. next: fieldkit recover {quoted_path}"
            )


def find_sessions(paths: Sequence[Path]) -> list[Path]:
    """The sessions named by files and folders; without any, all of the campaign.

    Prints which are interrupted. Raises `SessionError` if a path does not exist or there is no session.
    """
    sessions = _expand(paths)
    report_interrupted(sessions)
    return sessions


def latest_session(path: Path | None) -> Path:
    """The session named, or the campaign's latest by its first sample; prints if it is interrupted."""
    latest = max(_expand([path] if path else []), key=began)
    report_interrupted([latest])
    return latest


def find_session(name: Path) -> Path:
    """A session or folder by its path, or by its name among the campaign's, as ``fieldkit ls`` prints it.

    Raises `SessionError` if there is neither.
    """
    path = name if exists(name) else recordings_folder() / name
    if not exists(path):
        refuse_address(name)
        fix = Action.LIST_SESSIONS() + " shows the sessions"
        raise SessionError("there is no such session", place=name, fix=fix)
    return path


def _expand(paths: Sequence[Path]) -> list[Path]:
    sessions: list[Path] = []
    for name in paths or [recordings_folder()]:
        path = find_session(name)
        if path.is_dir():
            sessions.extend(sessions_in(recordings_in(path), say_warning))
        else:
            sessions.append(path)
    if not sessions:
        where = ", ".join(map(str, paths or [recordings_folder()]))
        raise SessionError("no sessions", place=where, fix="name one, or record one: " + Action.RECORD())
    return sessions
