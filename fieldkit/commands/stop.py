"""``fieldkit stop``: ask the recording that runs to stop and seal."""

from __future__ import annotations

import os
import signal
import time

import click

from fieldkit.commands import common
from fieldkit.commands.running import session_in_progress
from fieldkit.errors import RefusedError
from fieldkit.sessions.layout import journal_path
from fieldkit.sessions.lock import is_locked, owner

PATIENCE_S = 60.0


@click.command(cls=common.Verb)
@click.pass_context
def command(ctx: click.Context) -> None:
    """Ask the recording that runs to stop and seal, and wait until it has."""
    config = common.campaign(ctx)
    path = session_in_progress(config.recordings)
    pid = owner(journal_path(path)) if path is not None else None
    if path is None or pid is None:
        raise RefusedError("no recording is running in this campaign", fix="fieldkit record")
    os.kill(pid, signal.SIGTERM)
    deadline = time.monotonic() + PATIENCE_S
    while is_locked(journal_path(path)):
        if time.monotonic() > deadline:
            raise RefusedError(
                f"process {pid} has not sealed {path.name} within a minute", fix="look at its terminal"
            )
        time.sleep(0.1)
    if common.options().json:
        common.print_json({"session": str(path)})
    common.say(f"sealed {path}")
