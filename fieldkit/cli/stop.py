"""``fieldkit stop``: stop and seal the running recording."""

from __future__ import annotations

import os
import shlex
import signal
import time
from typing import TYPE_CHECKING

import click

from fieldkit.cli import common
from fieldkit.cli.session_paths import is_interrupted
from fieldkit.model.errors import RefusedError, SessionError
from fieldkit.sessions.layout import journal_path
from fieldkit.sessions.lock import is_locked, owner
from fieldkit.workflows.running import UnresponsiveRecorder, session_in_progress, unresponsive_recorder

if TYPE_CHECKING:
    from pathlib import Path

    from fieldkit.config import Config

PATIENCE_S = 60.0


@click.command(cls=common.Command)
@click.pass_context
def command(ctx: click.Context) -> None:
    """Stop and seal the running recording, and wait until it has ended."""
    path = _stopped(common.campaign(ctx))
    if is_interrupted(path):
        raise SessionError(
            f"the recording ended without sealing {path.name}; its journal is kept",
            fix=f"fieldkit recover {shlex.quote(str(path))}",
        )
    if common.options().json:
        common.print_json({"session": str(path)})
    common.say(f"sealed {path}")


def _stopped(config: Config) -> Path:
    """The session that was being recorded, once its process has let go of it."""
    path = session_in_progress(config.recordings)
    pid = owner(journal_path(path)) if path is not None else None
    if path is None or pid is None:
        raise RefusedError("no recording is running in this campaign", fix="fieldkit record")
    os.kill(pid, signal.SIGTERM)
    deadline, silent = time.monotonic() + PATIENCE_S, None
    while is_locked(journal_path(path)):
        if silent is None and (silent := unresponsive_recorder(path)) is not None:
            _tell(silent, pid, config)
        if time.monotonic() > deadline:
            raise RefusedError(
                f"process {pid} has not sealed {path.name} within a minute", fix="look at its terminal"
            )
        time.sleep(0.1)
    return path


def _tell(silent: UnresponsiveRecorder, pid: int, config: Config) -> None:
    """Say since when the recorder does not respond; continue one that was stopped, so that it can seal."""
    common.say(f"warning: {silent.at(config.site)}")
    if silent.is_stopped:
        common.say("it is continued, so that it can seal")
        os.kill(pid, signal.SIGCONT)
