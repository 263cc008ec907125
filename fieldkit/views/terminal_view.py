"""Views in a terminal, a screen or plain lines where there is none, and a line below a notebook's cell.

All receive the items of a recording through `show`, which never blocks on a terminal and never raises: a
recording must not depend on its display.
"""

from __future__ import annotations

import logging
import math
import queue
import sys
import threading
import time
from collections.abc import Sequence
from typing import IO, TYPE_CHECKING, Any, Literal

from rich.console import Console
from rich.live import Live
from rich.screen import Screen

from fieldkit.model.samples import Event, Frame, Health, Reading, Severity
from fieldkit.model.site import Region, RegionKind, RegionRecord, Site
from fieldkit.model.slope import SlopeEstimate
from fieldkit.views import formatting
from fieldkit.views.latest import Item, Latest
from fieldkit.views.screen import THEMES, screen

if TYPE_CHECKING:
    from fieldkit.estimation.estimator import Minute

log: logging.Logger = logging.getLogger(__name__)

ThemeName = Literal["dark", "paper"]
CLOSE_WITHIN_S = 2.0


def terminal_view(
    latest: Latest,
    console: Console,
    *,
    theme: ThemeName = "dark",
    bell_from: Severity | None = Severity.WARNING,
) -> TerminalView | PlainView:
    """The screen where `console` can show it, plain lines elsewhere (a pipe, a log, a dumb terminal).

    The screen's bell rings for new alarms of at least the severity `bell_from`; None for never.
    """
    if not console.is_terminal or console.is_dumb_terminal or console.options.ascii_only:
        return PlainView(latest.site, latest.regions, file=console.file)
    return TerminalView(latest, console=console, theme=theme, bell_from=bell_from)


class TerminalView:
    """The live screen; it appears with the first item and restores the terminal when closed.

    A separate thread draws the latest state `refresh_hz` times a second and skips what came in between, so
    that a slow or stopped terminal does not delay the recording. If drawing fails, the view reports it in
    one line and ends.
    """

    def __init__(
        self,
        latest: Latest,
        *,
        console: Console,
        theme: ThemeName = "dark",
        refresh_hz: float = 4.0,
        bell_from: Severity | None = Severity.WARNING,
    ) -> None:
        self._latest, self._console, self._theme = latest, console, THEMES[theme]
        self._period_s, self._bell_from = 1.0 / refresh_hz, bell_from
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="live view", daemon=True)

    def show(self, item: Item) -> None:
        """Keep an item for the next redraw."""
        self._latest.update(item)
        if self._thread.ident is None:
            self._thread.start()

    def close(self) -> None:
        """Restore the terminal; waits at most two seconds for a terminal that does not respond."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join(CLOSE_WITHIN_S)

    def _run(self) -> None:
        try:
            # rich keeps themes per thread: this one draws, so this one sets it.
            with self._console.use_theme(self._theme), self._live() as live:
                self._draw_until_stopped(live)
        except Exception as error:
            log.exception("the live view failed")
            self._console.print(f"the live view stopped ({error!r}); the recording goes on", soft_wrap=True)

    def _live(self) -> Live:
        return Live(
            console=self._console,
            screen=True,
            auto_refresh=False,
            redirect_stdout=False,
            redirect_stderr=False,
        )

    def _draw_until_stopped(self, live: Live) -> None:
        rung = items = 0
        while not self._stop.wait(self._period_s):
            if items == self._latest.items:
                continue
            items = self._latest.items
            cols, rows = self._console.size
            live.update(Screen(screen(self._latest, cols, rows), style="base"), refresh=True)
            if (due := self._alarms_to_ring()) > rung:
                rung = due
                self._console.bell()

    def _alarms_to_ring(self) -> int:
        if self._bell_from is None:
            return 0
        return sum(count for severity, count in self._latest.raised.items() if severity >= self._bell_from)


class PlainView:
    """One line a minute, and each event at once: for pipes, logs and terminals without a cursor.

    A separate thread prints, so that a pipe that is no longer read (a pager, Ctrl-S) stops only the printing.
    """

    def __init__(self, site: Site, regions: Sequence[Region], *, file: IO[str]) -> None:
        self._site, self._file = site, file
        self._references = [region.name for region in regions if region.kind is RegionKind.REFERENCE]
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._print, name="plain view", daemon=True)
        self._thread.start()

    def show(self, item: Item) -> None:
        """Print the item if it is an event or a minute; the first failure ends the printing."""
        if isinstance(item, Frame | Reading | RegionRecord | Health):
            return
        kelvin = [] if isinstance(item, Event) else list(item.temperature_k.values())
        if kelvin and not any(map(math.isfinite, kelvin)):
            return  # a minute without a frame, such as the last one
        self._lines.put(self._event(item) if isinstance(item, Event) else self._minute(item))

    def close(self) -> None:
        """Print the remaining lines; waits at most two seconds for a reader."""
        self._lines.put(None)
        self._thread.join(CLOSE_WITHIN_S)

    def _print(self) -> None:
        try:
            while (line := self._lines.get()) is not None:
                print(line, file=self._file, flush=True)
        except OSError:
            pass  # the pipe's other end has gone
        except ValueError:  # closed, or without the characters
            log.exception("the plain lines ended")

    def _event(self, event: Event) -> str:
        return f" {self._when(event.time_ns, seconds=True)}  {formatting.event_line(event)}"

    def _minute(self, minute: Minute) -> str:
        irradiance = f"S {formatting.number(minute.dni_w_m2)} W/m² ({minute.irradiance_model})"
        references = [self._bed(minute, name) for name in self._references]
        targets = [
            f"{self._bed(minute, estimate.region)} {_slope(estimate)}{formatting.state(estimate)}"
            for estimate in minute.estimates
        ]
        return f" {self._when(minute.time_ns)}  " + " | ".join([irradiance, *references, *targets])

    def _bed(self, minute: Minute, name: str) -> str:
        return f"{name} {formatting.celsius(minute.temperature_k.get(name, math.nan))} °C"

    def _when(self, time_ns: int, *, seconds: bool = False) -> str:
        zone = formatting.zone_name(time_ns, self._site).split(",")[0]
        return f"{formatting.clock_time(time_ns, self._site, seconds=seconds)} {zone}"


def _slope(estimate: SlopeEstimate) -> str:
    if not math.isfinite(estimate.tilt_deg):
        return ""
    return f"{formatting.tilt(estimate)}° ({formatting.slope_number(estimate, 'kelvin_per_degree')} K per °) "


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
        f"{estimate.region} {formatting.tilt_degrees(estimate)} {formatting.state(estimate)}"
        for estimate in estimates
    ]
    alarms = [f"{alarm.condition} {alarm.subject}".strip() for alarm in latest.alarms]
    return "   ".join([f"{latest.title}  {minutes:.0f}{planned} min", *slopes, *alarms])


def _plain(text: str) -> dict[str, Any]:
    return {"text/plain": text}
