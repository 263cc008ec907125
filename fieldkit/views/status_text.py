"""The status of a recording as text with the colours of a terminal, of any width."""

from __future__ import annotations

import io

from rich.console import Console

from fieldkit.model.durations import rounded_duration
from fieldkit.views import formatting
from fieldkit.views.latest import Latest
from fieldkit.views.screen import THEMES, snapshot


def status_text(name: str, latest: Latest, start_ns: int, end_ns: int, warning: str, cols: int) -> str:
    """Which recording, since when, how long, the warning if there is one, then what is known now."""
    began = formatting.clock_time(start_ns, latest.site, since_ns=end_ns)
    last = formatting.clock_time(end_ns, latest.site, seconds=True)
    lines = [
        f"recording {name} since {began} {formatting.zone_name(start_ns, latest.site)}",
        f"  last sample {last}, {rounded_duration((end_ns - start_ns) / 1e9)} so far",
        *([f"warning: {warning}"] if warning else []),
    ]
    return "\n".join(lines) + "\n" + _draw(latest, cols)


def _draw(latest: Latest, cols: int) -> str:
    drawn = io.StringIO()
    # the theme's colours are among the first sixteen, which every terminal has
    console = Console(
        file=drawn, width=cols, force_terminal=True, color_system="standard", no_color=False,
        highlight=False, emoji=False, markup=False,
    )  # fmt: skip
    with console.use_theme(THEMES["dark"]):
        console.print(snapshot(latest, cols))
    return drawn.getvalue()
