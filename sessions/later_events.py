"""Events added to a finished session: corrections of its marks."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import h5py
import numpy as np

from fieldkit.model.samples import Event
from fieldkit.sessions.entry_rows import event_columns
from fieldkit.sessions.file_tree import put_columns, put_group
from fieldkit.sessions.finished_file import add_to_finished
from fieldkit.sessions.layout import LATER_EVENT_COLUMNS, LATER_EVENTS
from fieldkit.sessions.time_map import row_crc32s


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
