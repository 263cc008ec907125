"""``fieldkit stop``: stop and seal the running recording."""

from __future__ import annotations

import click

from fieldkit.cli import common


@click.command(cls=common.Command)
@click.pass_context
def command(ctx: click.Context) -> None:
    """Stop and seal the running recording, and wait until it has ended."""
    from fieldkit.workflows.running import stop_recording

    path = stop_recording(common.campaign(ctx), notify=common.say_warning)
    if common.options().json:
        common.print_json({"session": str(path)})
    common.say(f"sealed {path}")
