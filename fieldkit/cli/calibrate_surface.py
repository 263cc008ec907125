"""``fieldkit calibrate surface``: kappa from beds of known slope, or what was learnt of the sand."""

from __future__ import annotations

from pathlib import Path

import click

from fieldkit.cli import common
from fieldkit.cli.session_paths import find_session
from fieldkit.cli.types import RECORD_NAME, NumberRange


@click.command(cls=common.Command)
@click.argument("session", type=click.Path(path_type=Path))
@click.option("--name", type=RECORD_NAME, default="beds", show_default=True, help="Name of the record.")
@click.option("--region", "beds", multiple=True, metavar="REGION", help="Only this region; may be repeated.")
@click.option(
    "--tilt-sd",
    type=NumberRange(0, min_open=True),
    default=0.5,
    show_default=True,
    metavar="DEG",
    help="Standard uncertainty of the inclinometer.",
)
@common.set_option
@click.pass_context
def command(
    ctx: click.Context, /, session: Path, name: str, beds: tuple[str, ...], tilt_sd: float,
    settings: tuple[str, ...],
) -> None:  # fmt: skip
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
    from fieldkit.sessions.reader import open_session

    with open_session(find_session(ctx, session)) as opened:
        found = calibrate.surface(
            opened, beds=beds, tilt_sd_deg=tilt_sd, name=name, settings=settings, notify=common.say_warning
        )
    save_and_print(found)
