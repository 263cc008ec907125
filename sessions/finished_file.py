"""Adding to a finished session what came to be known later: as data beside what was recorded."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import h5py
import numpy as np

from fieldkit.disk import one_at_a_time, put_in_place
from fieldkit.model.errors import StorageError
from fieldkit.model.samples import Event
from fieldkit.sessions.entry_rows import event_columns
from fieldkit.sessions.file_tree import put_columns, put_group
from fieldkit.sessions.guarded_file import GuardedFile
from fieldkit.sessions.layout import LATER_EVENT_COLUMNS, LATER_EVENTS
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.time_map import row_crc32s


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


# --- corrections of marks


def add_later_events(path: Path, events: Sequence[Event]) -> None:
    """Add events, with times as recorded, to a finished session beside those recorded.

    Raises `SessionError` where the session is not finished, `StorageError` where it cannot be written.
    """
    add_to_finished(path, partial(_add, events))


def _add(events: Sequence[Event], file: h5py.File) -> None:
    if LATER_EVENTS not in file:
        put_columns(put_group(file, LATER_EVENTS, "NXlog"), LATER_EVENT_COLUMNS)
    group, written = file[LATER_EVENTS], np.full(len(events), time.time_ns() // 1000, np.int64)
    rows = {**event_columns(events), "written": written}
    old = group["time"].shape[0]
    for name, values in {**rows, "crc32": np.array(row_crc32s(rows), np.uint32)}.items():
        group[name].resize((old + len(events),))
        group[name][old:] = values
