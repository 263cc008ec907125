"""``fieldkit calibrate surface``: kappa from beds of known slope, or what was learnt of the sand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from fieldkit.cli import common
from fieldkit.cli.session_paths import find_session
from fieldkit.cli.types import PATH, RECORD_NAME, argument_range


# options are named as the arguments of `calibrate.surface`
@click.command(cls=common.Command)
@click.argument("session", type=PATH)
@click.option("--name", type=RECORD_NAME, default="beds", show_default=True, help="Name of the record.")
@click.option("--region", "beds", multiple=True, metavar="REGION", help="Only this region; may be repeated.")
@click.option(
    "--tilt-sd",
    "tilt_sd_deg",
    type=argument_range("tilt_sd_deg"),
    default=0.5,
    show_default=True,
    metavar="DEG",
    help="Standard uncertainty of the inclinometer.",
)
@common.set_option
def command(session: Path, **given: Any) -> None:
    r"""Find the scale kappa of a SESSION from its beds of known tilt and azimuth.

    kappa is for this model of the surface and this irradiance: change neither after calibrating.
    With the learned model, what was learnt of gain, thermal inertia and depth is the next
    session's prior; beds of known slope sharpen it and are not needed.

    \b
    fieldkit calibrate surface recordings/X.h5 --region b15
    fieldkit calibrate surface recordings/X.h5 --set estimator.model=learned --name this-sand
    """
    from fieldkit import calibrate
    from fieldkit.cli.calibration_output import save_and_print

    save_and_print(calibrate.surface(find_session(session), **given, notify=common.say_warning))
