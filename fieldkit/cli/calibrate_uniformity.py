"""``fieldkit calibrate uniformity``: offsets between regions from a uniform target, before and after."""

from __future__ import annotations

from pathlib import Path

import click

from fieldkit.cli import common
from fieldkit.cli.session_paths import find_session
from fieldkit.cli.types import PATH, RECORD_NAME, argument_range


@click.command(cls=common.Command)
@click.argument("before", type=PATH)
@click.argument("after", required=False, type=PATH)
@click.option("--name", type=RECORD_NAME, default="uniformity", show_default=True, help="Name of the record.")
@click.option(
    "--target-sd",
    type=argument_range("target_sd_k"),
    default=0.05,
    show_default=True,
    metavar="K",
    help="Standard uncertainty of the target's uniformity.",
)
def command(before: Path, after: Path | None, name: str, target_sd: float) -> None:
    r"""Find the offsets of all regions against the reference.

    BEFORE and AFTER are recordings of a minute or more with one board over all regions.

    \b
    fieldkit record --for 2m --name board && fieldkit calibrate uniformity recordings/*board.h5
    """
    from fieldkit import calibrate
    from fieldkit.cli.calibration_output import save_and_print

    paths = [find_session(path) for path in (before, after) if path is not None]
    save_and_print(calibrate.uniformity(*paths, name=name, target_sd_k=target_sd, notify=common.say_warning))
