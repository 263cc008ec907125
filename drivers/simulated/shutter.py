"""The Lepton's shutter: when it corrects its level, asked or by itself, and what it says meanwhile.

Times are monotonic nanoseconds. A correction (FFC) takes 0.8 s, comes by itself three
minutes after the last one and is announced two seconds ahead, as the camera's own default is.
"""

from __future__ import annotations

import enum
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

CORRECTION_NS = 800_000_000
AUTOMATIC_NS = 180_000_000_000
_ANNOUNCED_NS = 2_000_000_000


class State(enum.IntEnum):
    """The camera's word for it, as in the telemetry."""

    NEVER = 0
    IMMINENT = 1
    RUNNING = 2
    DONE = 3


@dataclass(frozen=True, slots=True)
class Moment:
    """State at one time, when the newest correction began, number and end of the last finished one."""

    state: State
    began_ns: int
    number: int
    ended_ns: int


class Shutter:
    """Remembers every correction since the camera was switched on.

    `unasked_ns` are times at which it corrects itself out of turn; `is_automatic` whether it
    does so in turn.
    """

    def __init__(self, on_ns: int, unasked_ns: Sequence[int]) -> None:
        self._began = [on_ns]
        self._unasked = sorted(unasked_ns)
        self.is_automatic = True

    def run(self, now_ns: int) -> None:
        """Correct now, unless a correction runs already."""
        if self.at(now_ns).state is not State.RUNNING:
            self._began.append(now_ns)

    def at(self, mono_ns: int) -> Moment:
        """The shutter at a time; what the camera does by itself until then is done."""
        self._run_unasked(mono_ns)
        newest = bisect_right(self._began, mono_ns) - 1
        began_ns = self._began[newest]
        running = newest > 0 and mono_ns < began_ns + CORRECTION_NS
        last = newest - running
        due_ns = began_ns + AUTOMATIC_NS - _ANNOUNCED_NS
        state = State.RUNNING if running else State.DONE
        if self.is_automatic and mono_ns >= due_ns:
            state = State.IMMINENT
        return Moment(state, began_ns, last, self._began[last] + CORRECTION_NS)

    def _run_unasked(self, mono_ns: int) -> None:
        while True:
            due = [time_ns for time_ns in self._unasked if time_ns > self._began[-1]]
            if self.is_automatic:
                due.append(self._began[-1] + AUTOMATIC_NS)
            if not due or min(due) > mono_ns:
                return
            self._began.append(min(due))
