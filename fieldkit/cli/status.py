"""``fieldkit status``: show how the running recording is doing."""

from __future__ import annotations

import os
import shutil
import sys

import click

from fieldkit.cli import common


@click.command(cls=common.Command)
def command() -> None:
    """Show how the running recording is doing: slopes, temperatures, streams, disk, last events."""
    from fieldkit.recording.running import running_session
    from fieldkit.recording.status_request import present_status

    session = running_session(common.recordings())
    cols = shutil.get_terminal_size().columns if sys.stdout.isatty() else common.PIPE_COLS
    status = present_status(session, cols)
    if common.options().json:
        common.print_json(status["document"])
    else:
        plain = common.options().no_color or bool(os.environ.get("NO_COLOR"))
        click.echo(status["text"], nl=False, color=False if plain else None)  # None: as the terminal can
