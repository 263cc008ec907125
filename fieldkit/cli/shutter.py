"""``fieldkit shutter``: run the camera's shutter correction in the running recording."""

from __future__ import annotations

import click

from fieldkit.cli import common


@click.command(cls=common.Command)
def command() -> None:
    """Run the camera's shutter correction now, in the running recording.

    An event of the session reports whether it was started: not every camera can.
    """
    from fieldkit.recording.requests import Shutter, sent

    request = sent(common.recordings(), Shutter())
    if common.options().json:
        common.print_json({"session": str(request.session), "request": request.id})
    common.say(f"sent to {request.session.name}; an event of the session reports whether the shutter ran")
