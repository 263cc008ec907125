"""Correcting the clock of a finished session: what its comparisons propose, and writing the time map."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from fieldkit.model.clock import ClockCheck
from fieldkit.model.units import SECOND_NS
from fieldkit.sessions.finished_file import add_to_finished
from fieldkit.sessions.layout import TIME_MAP_COLUMNS, encode_text
from fieldkit.sessions.reader import SessionReader
from fieldkit.sessions.stored import columns_of
from fieldkit.sessions.time_map import TimeStep, row_crc32s

STEP_NS = SECOND_NS
TOLERANCE_NS = 2_000_000_000

_REASON = h5py.string_dtype("utf-8", 256)

_TRUSTED = ("gps", "ptp", "ntp", "phone")


def awake_offsets_ns(checks: Sequence[ClockCheck]) -> NDArray[np.int64]:
    """UTC minus monotonic time of each comparison, without what sleep since the first has added to it."""
    offsets = np.array([check.utc_minus_mono_ns for check in checks], np.int64)
    suspended = np.array([check.suspended_ns for check in checks], np.int64)
    slept: NDArray[np.int64] = suspended - suspended[:1]
    return offsets - slept


def stepped_ns(checks: Sequence[ClockCheck], anchor_ns: int) -> NDArray[np.int64]:
    """Steps of the system clock from the anchor of the recorded times to the last comparison."""
    moved = np.diff(awake_offsets_ns(checks), prepend=np.int64(anchor_ns))
    return moved[np.abs(moved) > STEP_NS]


def propose_time_map(session: SessionReader) -> list[TimeStep]:
    """Seconds to add to the recorded times, by the clock comparisons; empty where nothing must be.

    A comparison with a trusted source (GPS, NTP ...) counts for the whole session; otherwise
    the last one does if the system clock was stepped, because clocks are stepped to be right.
    Times after a sleep need the time slept as well.
    """
    checks = session.clock_checks()
    best = _best(checks, session.anchor_ns)
    steps = _asleep(checks)
    if best is None or abs(add := int(awake_offsets_ns(checks)[best]) - session.anchor_ns) < TOLERANCE_NS:
        return steps
    whole = TimeStep(0, add, f"clock comparison, source {checks[best].source}")
    return [whole, *(replace(step, add_ns=step.add_ns + add) for step in steps)]


def _best(checks: Sequence[ClockCheck], anchor_ns: int) -> int | None:
    """Index of the comparison that gives how far the recorded times are off."""
    trusted = [place for place, check in enumerate(checks) if check.source in _TRUSTED]
    if trusted:
        return min(trusted, key=lambda place: checks[place].error_ns)
    return len(checks) - 1 if stepped_ns(checks, anchor_ns).size else None


def _asleep(checks: Sequence[ClockCheck]) -> list[TimeStep]:
    """Sleep stops the monotonic clock: what came after it needs the time slept."""
    steps, slept = [], 0
    for before, after in pairwise(checks):
        more = after.suspended_ns - before.suspended_ns
        if more > STEP_NS:
            slept += more
            steps.append(TimeStep(before.mono_ns, slept, f"the computer slept {more / 1e9:.0f} s"))
    return steps


def apply_time_map(path: Path, steps: Sequence[TimeStep]) -> None:
    """Write a time map into a finished session, as a new version beside those before.

    Raises `SessionError` where the session is not finished, `StorageError` where it cannot be written.
    """
    add_to_finished(path, partial(_add_steps, steps))


def _add_steps(steps: Sequence[TimeStep], file: h5py.File) -> None:
    group = file["time_map"]
    old = group["time"].shape[0]
    version = int(group["version"][:].max(initial=0)) + 1
    rows = _rows(steps, version)
    for name in columns_of(group, TIME_MAP_COLUMNS):  # an older file has no room for the checksum
        group[name].resize((old + len(steps),))
        group[name][old:] = rows[name]


def _rows(steps: Sequence[TimeStep], version: int) -> dict[str, NDArray[Any]]:
    """The columns of a new version of the time map."""
    columns: dict[str, NDArray[Any]] = {
        "time": np.full(len(steps), time.time_ns() // 1000, np.int64),
        "mono_ns": np.array([step.mono_ns for step in steps], np.int64),
        "add_ns": np.array([step.add_ns for step in steps], np.int64),
        "version": np.full(len(steps), version, np.uint16),
        "reason": np.array([encode_text(step.reason, 256) for step in steps], _REASON),
    }
    return {**columns, "crc32": np.array(row_crc32s(columns), np.uint32)}
