"""``fieldkit stop``: stop and seal the running recording."""

from __future__ import annotations

import click

from fieldkit.cli import common


@click.command(cls=common.Command)
def command() -> None:
    """Stop and seal the running recording, and wait until it has ended; call off one that waits."""
    from fieldkit.recording.running import UnresponsiveRecorder, stop_recording

    def warn(silent: UnresponsiveRecorder) -> None:
        common.say_warning(silent.at(common.campaign().site))
        if silent.is_stopped:
            common.say_warning("the recorder was suspended; continuing it, so that it can seal")

    path = stop_recording(common.recordings(), notify=warn)
    if common.options().json:
        common.print_json({"session": path and str(path)})
    common.say(f"sealed {path}" if path else "called off: nothing was recorded")
