"""Correcting the times of a session, as data: recorded times are never rewritten.

A time map says from which monotonic time on how much is to be added to the recorded UTC;
of several versions in a file the newest holds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fieldkit.samples import Sample


@dataclass(frozen=True, slots=True)
class TimeStep:
    """From monotonic time `mono_ns` on, add `add_ns` to the recorded UTC; `reason` says why."""

    mono_ns: int
    add_ns: int
    reason: str


def mapped(steps: Sequence[TimeStep], sample: Sample) -> Sample:
    """The sample with its time corrected by a map."""
    add = [step.add_ns for step in steps if step.mono_ns <= sample.mono_ns]
    return sample._replace(time_ns=sample.time_ns + add[-1]) if add else sample


def mapped_ns(
    steps: Sequence[TimeStep], mono_ns: NDArray[np.int64], time_ns: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Times corrected by a map, steps in order of `mono_ns`."""
    begins = np.array([step.mono_ns for step in steps], np.int64)
    add = np.array([0, *(step.add_ns for step in steps)], np.int64)
    corrected: NDArray[np.int64] = time_ns + add[np.searchsorted(begins, mono_ns, side="right")]
    return corrected
