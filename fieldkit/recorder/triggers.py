"""Triggers: a recording starts, stops or is marked when a meter's channel passes a threshold.

`Triggers` is a view, so that one that fails costs neither samples nor the recording. While a recording waits
(``record --on-trigger``) it looks for its start, while it records for its end and for what is to be marked. A
condition acts once, when it has lasted, and again only after it was over; one that is the case from the
beginning acts only as a start.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from fieldkit.model.samples import Event, EventKind, Reading
from fieldkit.model.units import SECOND_NS
from fieldkit.recorder.recorder import Shown

Act = Literal["start", "stop", "mark"]
ACTED = math.inf
"""Begin of a condition that has acted already."""


@dataclass(frozen=True, slots=True)
class Trigger:
    """A threshold of a channel (its number in the stream): values below `low` or above `high`, in its unit.

    The condition must last `hold_s`; a start also includes the `before_s` before it.
    """

    name: str
    act: Act
    stream: str
    channel: int
    low: float = -math.inf
    high: float = math.inf
    hold_s: float = 0.0
    before_s: float = 0.0
    text: str = ""


class Triggers:
    """Watches the readings of a recording, or of one that waits for `started`.

    `since_ns` is the time (monotonic) from which on such a recording includes what was before. `end` ends the
    recording; each act leaves a mark, as an event that `events` yields once.
    """

    def __init__(self, triggers: Sequence[Trigger] = ()) -> None:
        self.triggers: tuple[Trigger, ...] = tuple(triggers)
        self.started: Trigger | None = None
        self.since_ns: int = 0
        self.end: Callable[[], None] | None = None
        acting = [trigger.name for trigger in self.triggers if trigger.act != "start"]
        self._since_ns: dict[str, float] = dict.fromkeys(acting, ACTED)
        self._events: deque[Event] = deque()

    @property
    def starts(self) -> list[Trigger]:
        """Those that start a recording."""
        return [trigger for trigger in self.triggers if trigger.act == "start"]

    def rearm(self) -> None:
        """Let a start act only after its condition was over, as the others do."""
        self._since_ns = dict.fromkeys((trigger.name for trigger in self.triggers), ACTED)

    def show(self, item: Shown) -> None:
        """Act on a reading; anything else is ignored."""
        if isinstance(item, Reading):
            for trigger in self.triggers:
                if trigger.stream == item.stream and math.isfinite(value := item.values[trigger.channel]):
                    self._update(trigger, item, is_on=not trigger.low <= value <= trigger.high)

    def _update(self, trigger: Trigger, reading: Reading, *, is_on: bool) -> None:
        if not is_on:
            self._since_ns.pop(trigger.name, None)
            return
        since_ns = self._since_ns.setdefault(trigger.name, reading.mono_ns)
        if reading.mono_ns - since_ns >= trigger.hold_s * SECOND_NS:
            self._since_ns[trigger.name] = ACTED
            if (trigger.act == "start") == (self.end is None):
                self._act(trigger, reading)

    def _act(self, trigger: Trigger, reading: Reading) -> None:
        text = f"{trigger.act} by {trigger.name}: {trigger.text}"
        data = {"label": "trigger", "trigger": trigger.name, "act": trigger.act}
        self._events.append(Event(EventKind.MARK, reading.mono_ns, reading.time_ns, text, data=data))
        if self.end is None and self.started is None:
            self.started, self.since_ns = trigger, reading.mono_ns - round(trigger.before_s * SECOND_NS)
        elif self.end is not None and trigger.act == "stop":
            self.end()

    def add(self, event: Event) -> None:
        """An event of another view; any thread."""
        self._events.append(event)

    def events(self) -> Iterator[Event]:
        """The marks of what acted since the last call, and events that were added."""
        while self._events:
            yield self._events.popleft()

    def close(self) -> None:
        """Nothing to close."""
