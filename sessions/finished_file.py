"""Adding to a finished session what came to be known later: as data beside what was recorded."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import h5py

from fieldkit.disk import one_at_a_time, put_in_place
from fieldkit.model.errors import StorageError
from fieldkit.sessions.guarded_file import GuardedFile
from fieldkit.sessions.reader import open_session


def add_to_finished(path: Path, add: Callable[[h5py.File], None]) -> None:
    """Add to a finished session by a function that writes into its file.

    That is done in a copy, which then takes the session's place: a process killed meanwhile leaves the
    session as it was. Raises `SessionError` where the session is not finished, `StorageError` where it
    cannot be written or there is no room for the copy.
    """
    path = path.resolve()  # a link stays a link
    draft = changing_path(path)
    try:
        with one_at_a_time(path.parent):
            with open_session(path) as session:
                session.require_finished()
            try:
                shutil.copyfile(path, draft)
                shutil.copystat(path, draft)
                with GuardedFile(draft) as file:
                    add(file)
                put_in_place(draft, path)
            finally:
                draft.unlink(missing_ok=True)
    except OSError as error:
        raise StorageError(
            f"{path} could not be corrected: {error.strerror or error}",
            fix="see that its folder can be written and has room for a copy of it; nothing was changed",
        ) from error


def changing_path(path: Path) -> Path:
    """Path at which a session is changed before it takes its own place; a killed process leaves it."""
    return path.with_name(path.name + ".changing")
