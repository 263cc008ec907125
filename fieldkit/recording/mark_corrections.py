"""Taking back and editing marks of any session: by its recorder while it records, else in its file."""

from __future__ import annotations

from pathlib import Path

from fieldkit.model.marks import Mark
from fieldkit.recording.requests import sent
from fieldkit.results.marks import correct, edited, taken_back
from fieldkit.sessions.reader import SessionReader, open_session


def take_back(path: Path, name: str) -> Mark:
    """Take back the mark of a session with that number or text.

    Raises `ConfigError` where no mark or more than one is meant, `SessionError` where the session is
    interrupted, `RefusedError` where its recording has just ended, `StorageError`.
    """
    with open_session(path) as session:
        return _kept(session, taken_back(session, name))


def edit(
    path: Path, name: str, text: str | None, *, label: str | None, at: str | None, to: str | None
) -> Mark:
    """Give a mark another text, label or time; see `edited`. Raises as `take_back`."""
    with open_session(path) as session:
        return _kept(session, edited(session, name, text, label=label, at=at, to=to))


def keep(path: Path, correction: Mark) -> None:
    """Keep the correction of a mark of a session; raises as `take_back`."""
    with open_session(path) as session:
        _kept(session, correction)


def _kept(session: SessionReader, correction: Mark) -> Mark:
    if session.state == "recording":
        sent(session.path.parent, correction)
    else:
        correct(session, correction)
    return correction
