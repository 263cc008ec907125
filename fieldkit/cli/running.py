"""The running recording: ``fieldkit status``, ``stop`` and ``shutter``."""

from __future__ import annotations

import os
import shutil
import sys

import click

from fieldkit.cli import common


@click.command(cls=common.Command)
def status() -> None:
    """Show how the running recording is doing: slopes, temperatures, streams, disk, last events."""
    from fieldkit.recording.running import running_session
    from fieldkit.recording.status_request import present_status

    session = running_session(common.recordings())
    cols = shutil.get_terminal_size().columns if sys.stdout.isatty() else common.PIPE_COLS
    status = present_status(session, cols)
    if not common.print_if_json(status["document"]):
        plain = common.options().no_color or bool(os.environ.get("NO_COLOR"))
        click.echo(status["text"], nl=False, color=False if plain else None)  # None: as the terminal can


@click.command(cls=common.Command)
def stop() -> None:
    """Stop and seal the running recording, and wait until it has ended; call off one that waits."""
    from fieldkit.recording.running import UnresponsiveRecorder, stop_recording

    def warn(silent: UnresponsiveRecorder) -> None:
        common.say_warning(silent.at(common.campaign().site))
        if silent.is_stopped:
            common.say_warning("the recorder was suspended; continuing it, so that it can seal")

    path = stop_recording(common.recordings(), notify=warn)
    common.print_if_json({"session": path and str(path)})
    common.say(f"sealed {path}" if path else "called off: nothing was recorded")


@click.command(cls=common.Command)
def shutter() -> None:
    """Run the camera's shutter correction now, in the running recording.

    An event of the session reports whether it was started: not every camera can.
    """
    from fieldkit.recording.requests import Shutter, send_to_recorder

    request = send_to_recorder(common.recordings(), Shutter())
    common.print_if_json({"session": str(request.session), "request": request.id})
    common.say(f"sent to {request.session.name}; an event of the session reports whether the shutter ran")
