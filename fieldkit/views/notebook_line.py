"""One line below the cell of a notebook that records: time, slopes, alarms."""

from __future__ import annotations

import sys
import time
from typing import Any

from fieldkit.views import formatting
from fieldkit.views.latest import Item, Latest

EVERY_S = 0.5


def is_notebook() -> bool:
    """Whether this is the kernel of a notebook, which can show what changes below a cell."""
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    return getattr(shell, "kernel", None) is not None


class NotebookLine:
    """A view that replaces its line twice a second; made by the thread of the cell, in a notebook only."""

    def __init__(self, latest: Latest) -> None:
        from IPython.display import display

        self._latest, self._next_s = latest, 0.0
        show: Any = display  # IPython states no types
        self._shown = show(_plain("the recording begins"), raw=True, display_id=True)

    def show(self, item: Item) -> None:
        """Keep an item; now and then show what is latest."""
        self._latest.update(item)
        if (now_s := time.monotonic()) >= self._next_s:
            self._next_s = now_s + EVERY_S
            self._update()

    def close(self) -> None:
        """Show the last state."""
        self._update()

    def _update(self) -> None:
        self._shown.update(_plain(line(self._latest)), raw=True)


def line(latest: Latest) -> str:
    """The recording in one line: its name, for how long of how long, each target's slope, present alarms."""
    minutes = (latest.time_ns - latest.start_ns) / 60e9
    planned = f" of {(latest.planned_end_ns - latest.start_ns) / 60e9:.0f}" if latest.planned_end_ns else ""
    estimates = latest.minute.estimates if latest.minute else ()
    slopes = [
        f"{estimate.region} {formatting.tilt(estimate)}° {formatting.state(estimate)}"
        for estimate in estimates
    ]
    alarms = [f"{alarm.condition} {alarm.subject}".strip() for alarm in latest.alarms]
    return "   ".join([f"{latest.title}  {minutes:.0f}{planned} min", *slopes, *alarms])


def _plain(text: str) -> dict[str, Any]:
    return {"text/plain": text}
