"""Correcting the times of a session, as data: recorded times are never rewritten.

A time map gives what is to be added to the recorded UTC from a monotonic time on;
of several versions in a file the newest holds.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldkit.model.errors import SessionError
from fieldkit.model.samples import Event, Health, Sample

_FOREVER_NS = 2**63 - 1


@dataclass(frozen=True, slots=True)
class TimeStep:
    """From monotonic time `mono_ns` on, add `add_ns` to the recorded UTC, for a `reason`."""

    mono_ns: int
    add_ns: int
    reason: str


def row_crc32s(columns: Mapping[str, NDArray[Any]]) -> list[int]:
    """CRC-32 of every row of a time map as stored, over its columns in order but for the checksum itself."""
    others = [values for name, values in columns.items() if name != "crc32"]
    return [zlib.crc32(b"".join(cell.tobytes() for cell in row)) for row in zip(*others, strict=False)]


def check_rows(columns: Mapping[str, NDArray[Any]]) -> None:
    """Raise `SessionError` where a row of a time map is not as written; older maps have no checksum."""
    if "crc32" in columns and row_crc32s(columns) != columns["crc32"].tolist():
        raise SessionError("the corrections of the clock are damaged", fix="take another copy of the session")


def added_ns(steps: Sequence[TimeStep], mono_ns: int) -> int:
    """What a map adds at a monotonic time."""
    return next((step.add_ns for step in reversed(steps) if step.mono_ns <= mono_ns), 0)


def mapped(steps: Sequence[TimeStep], sample: Sample) -> Sample:
    """The sample with its time corrected by a map."""
    return sample._replace(time_ns=sample.time_ns + added_ns(steps, sample.mono_ns))


def mapped_event(steps: Sequence[TimeStep], event: Event) -> Event:
    """The event with its time corrected by a map, and the other times of a mark or a shade test."""
    data = dict(event.data)
    for name in ("begin_ns", "end_ns", "from_ns", "noted_ns"):
        if isinstance(time_ns := data.get(name), int):
            data[name] = time_ns + added_ns(steps, event.mono_ns + time_ns - event.time_ns)
    return replace(event, time_ns=event.time_ns + added_ns(steps, event.mono_ns), data=data)


def mapped_health(steps: Sequence[TimeStep], health: Health) -> Health:
    """The health with its time corrected by a map."""
    return replace(health, time_ns=health.time_ns + added_ns(steps, health.mono_ns))


def recorded_mono_ns(steps: Sequence[TimeStep], time_ns: int, anchor_ns: int) -> int:
    """The monotonic time of a corrected one, by the anchor; while the computer slept it stood."""
    before_ns = _FOREVER_NS
    for step in reversed(steps):
        if (mono_ns := time_ns - anchor_ns - step.add_ns) >= step.mono_ns:
            return min(mono_ns, before_ns)
        before_ns = step.mono_ns
    return min(time_ns - anchor_ns, before_ns)


def mapped_ns(
    steps: Sequence[TimeStep], mono_ns: NDArray[np.int64], time_ns: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Times corrected by a map, steps in order of `mono_ns`."""
    begins = np.array([step.mono_ns for step in steps], np.int64)
    add = np.array([0, *(step.add_ns for step in steps)], np.int64)
    corrected: NDArray[np.int64] = time_ns + add[np.searchsorted(begins, mono_ns, side="right")]
    return corrected
