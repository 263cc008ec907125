"""The live view on a terminal, two hours after the start of the demo's session.

The session goes through the estimator and the screen as in ``fieldkit replay``.
"""

from __future__ import annotations

import heapq
from pathlib import Path

from demo_day import COLUMNS, DemoDay, terminal_svg
from rich.screen import Screen

from fieldkit.model.samples import Frame, Reading
from fieldkit.results.estimate import estimator_for
from fieldkit.results.sources import config_for
from fieldkit.sessions.reader import open_session
from fieldkit.views.latest import Latest
from fieldkit.views.screen import screen

AFTER_NS = 2 * 3600 * 10**9
ROWS = 30
IMAGES = ("live-view.svg",)


def latest_of(path: Path) -> Latest:
    """What is known two hours after the start of a session."""
    with open_session(path) as session:
        estimator = estimator_for(session, config_for(session))
        latest = Latest(
            estimator.site, estimator.regions, tuple(session.streams.values()), path.stem, session.end_ns
        )
        told = sorted([*session.events(), *session.health()], key=lambda item: item.mono_ns)
        for item in heapq.merge(session.samples(), told, key=lambda item: item.mono_ns):
            if item.time_ns > session.start_ns + AFTER_NS:
                break
            latest.update(item)
            for minute in estimator.add(item) if isinstance(item, Frame | Reading) else ():
                latest.update(minute)
    return latest


def main(day: DemoDay) -> None:
    """Draw the screen."""
    shown = Screen(screen(latest_of(day.session), COLUMNS, ROWS), style="base")
    (day.images / IMAGES[0]).write_text(terminal_svg(shown, "fieldkit record", ROWS), encoding="utf-8")
