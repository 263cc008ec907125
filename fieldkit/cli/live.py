"""``fieldkit live``: show the current frame and readings without recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from fieldkit.cli import common
from fieldkit.cli.recording import terminal_views
from fieldkit.cli.types import DURATION, PATH

if TYPE_CHECKING:
    from fieldkit.recording.opening import Instruments
    from fieldkit.views.terminal_view import ThemeName


@click.command(cls=common.Command)
@click.option("--png", type=PATH, metavar="FILE", help="Write one image with regions, then exit.")
@click.option("--for", "duration_s", type=DURATION, metavar="TIME", help="Duration: 3h, 90m, 45s.")
@common.theme_option
@common.set_option
def command(png: Path | None, duration_s: float | None, theme: ThemeName, settings: tuple[str, ...]) -> None:
    """Show the current frame and readings without recording; Ctrl-C or a recording that begins ends it."""
    from fieldkit.recording.last_samples import LastSamples
    from fieldkit.recording.opening import open_instruments
    from fieldkit.recording.preview import LivePreview, missing_instruments, write_png
    from fieldkit.recording.running import previewing

    config = common.campaign(settings)
    with (
        previewing(config.recordings) as recorder_waits,
        open_instruments(config, duration_s=duration_s, allow_missing=True) as instruments,
    ):
        if missing := missing_instruments(config, instruments.streams):
            common.say(f"not plugged in: {', '.join(missing)}")
        if png is not None:
            write_png(png, config, instruments)
            click.echo(png)
            _report_enlargement(instruments)
            return
        views = terminal_views(config, instruments, "live, not recorded", duration_s, theme)
        views.append(LastSamples(config, instruments))
        try:
            LivePreview(config, instruments, views).run(duration_s, recorder_waits)
        except KeyboardInterrupt:
            common.say("nothing was recorded; to record: fieldkit record")
            return
    if recorder_waits():
        common.say("a recording begins: fieldkit status  |  fieldkit page")


def _report_enlargement(instruments: Instruments) -> None:
    """Print that the image is enlarged: its axes count the camera's pixels, not the file's."""
    from fieldkit.model.device import cameras_by_name
    from fieldkit.views import frame_image

    rows, cols = cameras_by_name(instruments.streams)[""].shape
    factor = frame_image.enlargement((rows, cols))
    common.say(f"{cols} x {rows} pixels, enlarged {factor} times; the axes count camera pixels, as roi does")
