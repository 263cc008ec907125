"""``fieldkit replay``: play a session as if live, through the same estimator."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import click

from fieldkit.cli import common
from fieldkit.cli.session_paths import find_session, report_interrupted
from fieldkit.cli.slope_table import explain_slopes, print_slopes
from fieldkit.cli.types import PATH, SPEED

if TYPE_CHECKING:
    from fieldkit.estimation.estimator import Estimator
    from fieldkit.recorder import View
    from fieldkit.sessions.reader import SessionReader


@click.command(cls=common.Command)
@click.argument("session", type=PATH)
@click.option("--speed", type=SPEED, default="60", show_default=True, help="Session seconds per real second.")
@common.set_option
def command(session: Path, speed: float, settings: tuple[str, ...]) -> None:
    """Play a SESSION as if live; --speed max gives its slopes at once."""
    from fieldkit.recording.replay import replay
    from fieldkit.results.estimate import as_document
    from fieldkit.results.json_document import learnt_document

    session = find_session(session)
    report_interrupted([session])
    is_shown = not (math.isinf(speed) or common.options().json)
    summary = replay(session, speed=speed, settings=settings, view_of=_view if is_shown else None)
    slopes = summary.estimates
    documents, learnt = list(map(as_document, slopes.values())), learnt_document(summary.learnt)
    if common.print_if_json({"session": str(session), "slopes": documents, "learnt": learnt}):
        return
    if not slopes:
        common.say("no region is a target: nothing was estimated. next: fieldkit roi add in its campaign")
        return
    print_slopes(slopes, summary.regions, summary.learnt)
    explain_slopes(slopes.values())
    common.say(f"next: fieldkit report {session}")


def _view(session: SessionReader, estimator: Estimator) -> View:
    from fieldkit.views.latest import Latest
    from fieldkit.views.terminal_view import terminal_view

    streams, title = tuple(session.streams.values()), f"{session.path.stem} (replay)"
    latest = Latest(estimator.site, estimator.regions, streams, title, session.end_ns)
    return terminal_view(latest, common.console(err=True))
