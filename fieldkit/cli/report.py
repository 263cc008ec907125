"""``fieldkit report``: the report of a recorded session, or of several together, as one HTML file or PDF."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING

import click

from fieldkit.cli import common
from fieldkit.cli.batch import raise_failures
from fieldkit.cli.session_paths import find_sessions, latest_session
from fieldkit.cli.types import PATH
from fieldkit.model.installation import install_extra
from fieldkit.palettes import NAMES

if TYPE_CHECKING:
    from fieldkit.results.report import Report


@click.command(cls=common.Command)
@click.argument("sessions", nargs=-1, type=PATH)
@click.option(
    "-o",
    "--out",
    type=PATH,
    metavar="FILE",
    help="FILE.html, FILE.pdf with the HTML beside it, or FILE.png, one image for a slide "
    "[default: HTML in the reports folder].",
)
@click.option(
    "--palette", type=click.Choice(NAMES), help="Colours of the frames in FILE.png. [default: inferno]"
)
@click.option("--open", "show", is_flag=True, help="Open it in the browser.")
@common.present_option
@common.set_option
def command(
    sessions: tuple[Path, ...],
    out: Path | None,
    palette: str | None,
    show: bool,
    present: bool,
    settings: tuple[str, ...],
) -> None:
    """Write the report of recorded SESSIONS: one HTML file that opens offline, or a PDF.

    A single session (default: the campaign's latest) with everything about it; several, or a folder of
    them, with errors and figures over all. The BASE of `estimate -o BASE` stands for its sessions and
    parameters: fieldkit report BASE.
    """
    from fieldkit.results.report import ReportOptions, report
    from fieldkit.results.result_files import recall

    sessions, settings, as_now = recall(sessions, settings)
    paths = find_sessions(sessions) if sessions else [latest_session(None)]
    chosen = ReportOptions(settings=settings, present=present or as_now, palette=palette)
    pages = report(paths, out, chosen, notify=common.say_warning)
    _print(pages)
    if show:
        webbrowser.open(pages.path.resolve().as_uri())
    raise_failures(pages.failures, paths)


def _print(pages: Report) -> None:
    if common.print_if_json({"sessions": [str(path) for path in pages.sessions], "report": str(pages.path)}):
        return
    click.echo(pages.path)
    from fieldkit.views import plotting

    if not plotting.available():
        common.say(f"the report has its tables; for figures: {install_extra('lab')}")
