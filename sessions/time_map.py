"""Correcting the times of a session, as data: recorded times are never rewritten.

A time map gives what is to be added to the recorded UTC from a monotonic time on;
of several versions in a file the newest holds.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import h5py
import numpy as np

from fieldkit.model.arrays import AnyArray, IntArray
from fieldkit.model.errors import SessionError
from fieldkit.model.samples import Event
from fieldkit.sessions.layout import TIME_MAP_COLUMNS, Column, decode_text, exact_time_ns
from fieldkit.sessions.stored import columns_of, explain, stored_here

_FOREVER_NS = 2**63 - 1
_TIMES = ("begin_ns", "end_ns", "from_ns", "since_ns", "noted_ns", "after_ns", "before_ns")
"""Details of an event that are moments; others in nanoseconds are durations."""


@dataclass(frozen=True, slots=True)
class TimeStep:
    """From monotonic time `mono_ns` on, add `add_ns` to the recorded UTC, for a `reason`."""

    mono_ns: int
    add_ns: int
    reason: str


def row_crc32s(columns: Mapping[str, AnyArray]) -> list[int]:
    """CRC-32 of every row of corrections as stored, over its columns in order but for the checksum itself."""
    others = [values for name, values in columns.items() if name != "crc32"]
    return [zlib.crc32(b"".join(cell.tobytes() for cell in row)) for row in zip(*others, strict=False)]


def corrections(group: h5py.Group, columns: Sequence[Column]) -> dict[str, AnyArray]:
    """The rows of a group of corrections; raises `SessionError` where one is not as written."""
    rows = {name: dataset[:] for name, dataset in columns_of(group, columns).items()}
    if row_crc32s(rows) != rows.get("crc32", np.empty(0)).tolist():
        fix = "take another copy of the session"
        raise SessionError("corrections are damaged", place=group.name, fix=fix)
    return rows


def added_ns(steps: Sequence[TimeStep], mono_ns: int) -> int:
    """Nanoseconds that a map adds at a monotonic time."""
    return next((step.add_ns for step in reversed(steps) if step.mono_ns <= mono_ns), 0)


def mapped_event(steps: Sequence[TimeStep], event: Event) -> Event:
    """The event with its time corrected by a map, and the other times in its details."""
    before_ns = event.mono_ns - event.time_ns
    return _moved_event(event, event.mono_ns, lambda time_ns: time_ns + added_ns(steps, time_ns + before_ns))


def recorded_event(steps: Sequence[TimeStep], event: Event, anchor_ns: int) -> Event:
    """The event as recorded, of one with corrected times: the inverse of `mapped_event`."""
    mono_ns = recorded_mono_ns(steps, event.time_ns, anchor_ns)
    return _moved_event(
        event, mono_ns, lambda time_ns: recorded_mono_ns(steps, time_ns, anchor_ns) + anchor_ns
    )


def _moved_event(event: Event, mono_ns: int, move: Callable[[int], int]) -> Event:
    times = {name: move(time) for name in _TIMES if isinstance(time := event.data.get(name), int)}
    return replace(event, mono_ns=mono_ns, time_ns=move(event.time_ns), data={**event.data, **times})


def recorded_mono_ns(steps: Sequence[TimeStep], time_ns: int, anchor_ns: int) -> int:
    """The monotonic time of a corrected one, by the anchor; while the computer slept it stood."""
    before_ns = _FOREVER_NS
    for step in reversed(steps):
        if (mono_ns := time_ns - anchor_ns - step.add_ns) >= step.mono_ns:
            return min(mono_ns, before_ns)
        before_ns = step.mono_ns
    return min(time_ns - anchor_ns, before_ns)


def mapped_ns(steps: Sequence[TimeStep], mono_ns: IntArray, time_ns: IntArray) -> IntArray:
    """Times corrected by a map, steps in order of `mono_ns`."""
    begins = np.array([step.mono_ns for step in steps], np.int64)
    add = np.array([0, *(step.add_ns for step in steps)], np.int64)
    return np.asarray(time_ns + add[np.searchsorted(begins, mono_ns, side="right")])


class StoredTimes:
    """UTC of what a session file stores: the one place where recorded times become corrected ones.

    `steps` are those of the active time map. Raises `SessionError` where they are needed and damaged.
    """

    def __init__(self, path: Path, file: h5py.File, anchor_ns: int) -> None:
        self.path = path
        self._file = file
        self._anchor_ns = anchor_ns

    @cached_property
    def steps(self) -> list[TimeStep]:
        """The active corrections; an open file never gets others, because a changed one takes its place."""
        try:
            columns = corrections(stored_here(self._file, "time_map"), TIME_MAP_COLUMNS)
        except SessionError as error:
            raise explain(self.path, error) from error
        latest = columns["version"].max(initial=0)
        rows = zip(*(columns[name] for name in ("version", "mono_ns", "add_ns", "reason")), strict=False)
        return [TimeStep(int(m), int(a), decode_text(r)) for v, m, a, r in rows if v == latest]

    def utc_ns(
        self, time_us: IntArray, mono_ns: IntArray | None = None, *, recorded: bool = False
    ) -> IntArray:
        """UTC nanoseconds of stored microseconds, corrected unless `recorded`.

        What was stored without a monotonic time has that which the anchor gives.
        """
        if mono_ns is None:
            mono_ns = time_us * 1000 - self._anchor_ns
        time_ns = exact_time_ns(time_us, mono_ns, self._anchor_ns)
        return time_ns if recorded else mapped_ns(self.steps, mono_ns, time_ns)
