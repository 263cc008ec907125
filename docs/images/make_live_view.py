"""Draw the README's picture of the live view from a recorded session.

    fieldkit demo --fast && python docs/images/make_live_view.py demo/recordings/*.h5

The session goes through the estimator and the screen as in ``fieldkit replay``; what would
stand on a terminal two hours after its start is written to ``live-view.svg`` beside this file.
"""

from __future__ import annotations

import heapq
import io
import re
import sys
from pathlib import Path

from rich.console import Console
from rich.screen import Screen
from rich.terminal_theme import SVG_EXPORT_THEME

from fieldkit.model.samples import Frame, Reading
from fieldkit.sessions.reader import open_session
from fieldkit.views.latest import Latest
from fieldkit.views.screen import THEMES, screen
from fieldkit.workflows.estimate import estimator_for
from fieldkit.workflows.sources import config_for

AFTER_NS = 2 * 3600 * 10**9
COLS, ROWS = 100, 30


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
            latest.take(item)
            for minute in estimator.add(item) if isinstance(item, Frame | Reading) else ():
                latest.take(minute)
    return latest


def svg_of(latest: Latest) -> str:
    """The screen as SVG, with the reader's own monospaced font."""
    console = Console(
        record=True,
        width=COLS,
        height=ROWS,
        file=io.StringIO(),
        force_terminal=True,
        color_system="truecolor",
    )
    with console.use_theme(THEMES["dark"]):
        console.print(Screen(screen(latest, COLS, ROWS), style="base"))
    svg = console.export_svg(title="fieldkit record", theme=SVG_EXPORT_THEME, unique_id="live")
    svg = re.sub(r"@font-face \{.*?\}\s*", "", svg, flags=re.DOTALL)  # nothing is fetched from outside
    return re.sub(r"[ \t]+$", "", svg.replace("Fira Code, monospace", "monospace"), flags=re.MULTILINE)


if __name__ == "__main__":
    target = Path(__file__).with_name("live-view.svg")
    target.write_text(svg_of(latest_of(Path(sys.argv[1]))), encoding="utf-8")
    print(target)
