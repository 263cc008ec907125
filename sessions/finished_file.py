"""Adding to a finished session what came to be known later: as data beside what was recorded."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import h5py
import numpy as np

from fieldkit.disk import Patience, move_into_place, one_at_a_time, sync
from fieldkit.model.arrays import IntArray
from fieldkit.model.clock import ClockCheck
from fieldkit.model.durations import rounded_duration
from fieldkit.model.errors import StorageError, os_errors_as
from fieldkit.model.samples import Event
from fieldkit.model.units import SECOND_NS
from fieldkit.sessions.digests import set_attribute
from fieldkit.sessions.entry_rows import Row, row_of, stored_column, stored_details
from fieldkit.sessions.file_tree import put_columns, put_group
from fieldkit.sessions.guarded_file import GuardedFile
from fieldkit.sessions.layout import LATER_EVENT_COLUMNS, LATER_EVENTS, TIME_MAP_COLUMNS, Column, added_rows
from fieldkit.sessions.reader import SessionReader, open_session
from fieldkit.sessions.stored import columns_of
from fieldkit.sessions.time_map import TimeStep, row_crc32s


def add_to_finished(path: Path, add: Callable[[h5py.File], None]) -> None:
    """Add to a finished session by a function that writes into its file.

    That is done in a copy, which then takes the session's place: a process killed meanwhile leaves the
    session as it was. Raises `SessionError` where the session is not finished, `StorageError` where it
    cannot be written or there is no room for the copy.
    """
    path = path.resolve()  # a link stays a link
    fix = "see that its folder can be written and has room for a copy of it; nothing was changed"
    with (
        os_errors_as(StorageError, "could not be corrected", place=path, fix=fix),
        one_at_a_time(path.parent),
    ):
        Patience()(partial(_change_copy, path, add))
        move_into_place(changing_path(path), path)


def _change_copy(path: Path, add: Callable[[h5py.File], None]) -> None:
    draft = changing_path(path)
    with open_session(path) as session:
        session.require_finished()
    try:
        shutil.copyfile(path, draft)
        shutil.copystat(path, draft)
        with GuardedFile(draft) as file:
            add(file)
        sync(draft)
    except BaseException:
        draft.unlink(missing_ok=True)
        raise


def changing_path(path: Path) -> Path:
    """Path at which a session is changed before it takes its own place; a killed process leaves it."""
    return path.with_name(path.name + ".changing")


def _append(group: h5py.Group, columns: Sequence[Column], rows: Sequence[Row]) -> None:
    """Add rows, with their checksums, to a group."""
    stored = {column.name: stored_column(rows, column) for column in columns}
    stored["crc32"] = np.array(row_crc32s(stored), np.uint32)
    old = group["time"].shape[0]
    for name, dataset in columns_of(group, columns).items():
        dataset.resize((old + len(rows),))
        dataset[old:] = stored[name]
    set_attribute(group.file, added_rows(group.name), old + len(rows))


# --- corrections of marks


def add_later_events(path: Path, events: Sequence[Event]) -> None:
    """Add events, with times as recorded, to a finished session beside those recorded.

    Raises `SessionError` where the session is not finished, `StorageError` where it cannot be written.
    """
    add_to_finished(path, partial(_add, events))


def _add(events: Sequence[Event], file: h5py.File) -> None:
    if LATER_EVENTS not in file:
        put_columns(put_group(file, LATER_EVENTS, "NXlog"), LATER_EVENT_COLUMNS)
    written = {"written": time.time_ns(), "crc32": 0}
    rows = [row_of(LATER_EVENT_COLUMNS, event, data=stored_details(event), **written) for event in events]
    _append(file[LATER_EVENTS], LATER_EVENT_COLUMNS, rows)


# --- corrections of the clock


STEP_NS = SECOND_NS
TOLERANCE_NS = 2_000_000_000

_TRUSTED = ("gps", "ptp", "ntp", "phone")


def awake_offsets_ns(checks: Sequence[ClockCheck]) -> IntArray:
    """UTC minus monotonic time of each comparison, without what sleep since the first has added to it."""
    offsets = np.array([check.utc_minus_mono_ns for check in checks], np.int64)
    suspended = np.array([check.suspended_ns for check in checks], np.int64)
    return np.asarray(offsets - (suspended - suspended[:1]))


def stepped_ns(checks: Sequence[ClockCheck], anchor_ns: int) -> IntArray:
    """Steps of the system clock from the anchor of the recorded times to the last comparison."""
    steps = np.diff(awake_offsets_ns(checks), prepend=np.int64(anchor_ns))
    return steps[np.abs(steps) > STEP_NS]


def propose_time_map(session: SessionReader) -> list[TimeStep]:
    """Seconds to add to the recorded times, by the clock comparisons; empty where nothing must be.

    A comparison with a trusted source (GPS, NTP ...) counts for the whole session; otherwise
    the last one does if the system clock was stepped, because clocks are stepped to be right.
    Times after a sleep need the time slept as well.
    """
    checks = session.clock_checks()
    best = _best(checks, session.anchor_ns)
    steps, slept = [], 0
    for before, after in pairwise(checks):
        more = after.suspended_ns - before.suspended_ns
        if more > STEP_NS:  # sleep stops the monotonic clock: what came after it needs the time slept
            slept += more
            reason = f"the computer slept {rounded_duration(more / 1e9)}"
            steps.append(TimeStep(before.mono_ns, slept, reason))
    if best is None or abs(add := int(awake_offsets_ns(checks)[best]) - session.anchor_ns) < TOLERANCE_NS:
        return steps
    whole = TimeStep(0, add, f"clock comparison, source {checks[best].source}")
    return [whole, *(replace(step, add_ns=step.add_ns + add) for step in steps)]


def _best(checks: Sequence[ClockCheck], anchor_ns: int) -> int | None:
    """Index of the comparison that gives how far the recorded times are off."""
    if trusted := [place for place, check in enumerate(checks) if check.source in _TRUSTED]:
        return min(trusted, key=lambda place: checks[place].error_ns)
    return len(checks) - 1 if stepped_ns(checks, anchor_ns).size else None


def apply_time_map(path: Path, steps: Sequence[TimeStep]) -> None:
    """Write a time map into a finished session, as a new version beside those before.

    Raises `SessionError` where the session is not finished, `StorageError` where it cannot be written.
    """
    add_to_finished(path, partial(_add_steps, steps))


def _add_steps(steps: Sequence[TimeStep], file: h5py.File) -> None:
    group = file["time_map"]
    written = {"time": time.time_ns(), "version": int(group["version"][:].max(initial=0)) + 1, "crc32": 0}
    _append(group, TIME_MAP_COLUMNS, [row_of(TIME_MAP_COLUMNS, step, **written) for step in steps])
