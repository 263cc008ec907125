"""``fieldkit calibrate``: emissivity, uniformity, irradiance, surface, clock as records; pose, horizon."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fieldkit.cli import common
from fieldkit.cli.calibrate_clock import command as clock
from fieldkit.cli.calibrate_emissivity import command as emissivity
from fieldkit.cli.calibrate_horizon import command as horizon
from fieldkit.cli.calibrate_pose import command as pose
from fieldkit.cli.calibration_output import save_and_print
from fieldkit.cli.common import CommandGroup
from fieldkit.cli.session_paths import find_session
from fieldkit.cli.types import PATH, RECORD_NAME, number_option

if TYPE_CHECKING:
    from fieldkit.calibrate.irradiance import Against


@click.group(cls=CommandGroup)
def command() -> None:
    """Calibrate instruments and surfaces; records in calibration/ are used in fieldkit.toml as "@name"."""


for name, subcommand in {"emissivity": emissivity, "clock": clock, "pose": pose, "horizon": horizon}.items():
    command.add_command(subcommand, name)


@command.command()
@click.argument("before", type=PATH)
@click.argument("after", required=False, type=PATH)
@click.option("--name", type=RECORD_NAME, default="uniformity", show_default=True, help="Name of the record.")
@number_option(
    "--target-sd", "target_sd_k", 0.05, "Standard uncertainty of the target's uniformity.", metavar="K"
)
def uniformity(before: Path, after: Path | None, name: str, target_sd_k: float) -> None:
    r"""Find the offsets of all regions against the reference.

    BEFORE and AFTER are recordings of a minute or more with one board over all regions.

    \b
    fieldkit record --for 2m --name board && fieldkit calibrate uniformity recordings/*board.h5
    """
    from fieldkit import calibrate

    paths = [find_session(path) for path in (before, after) if path is not None]
    save_and_print(
        calibrate.uniformity(*paths, name=name, target_sd_k=target_sd_k, notify=common.say_warning)
    )


# options but the references are named as the arguments of `calibrate.irradiance`
@command.command()
@click.argument("session", type=PATH)
@click.option("--name", type=RECORD_NAME, default="light", show_default=True, help="Name of the record.")
@click.option("--pyranometer", metavar="STREAM", help="A stream: global irradiance on the meter's plane.")
@click.option("--pyrheliometer", metavar="STREAM", help="A stream: direct normal irradiance.")
@click.option(
    "--station", metavar="FILE", help="A SURFRAD or BSRN file of the site's station, or the packaged day."
)
@number_option("--reference-sd", "reference_sd", 0.02, "Relative standard uncertainty of the reference.")
@common.set_option
def irradiance(
    session: Path, pyranometer: str | None, pyrheliometer: str | None, station: str | None, **arguments: Any
) -> None:
    r"""Find the W/m2 per unit of the light meter, by a line through the origin.

    Mounting and diffuse model are those of [irradiance]; a station's own diffuse light is used as measured.

    \b
    fieldkit calibrate irradiance SESSION --pyranometer cmp11
    fieldkit calibrate irradiance SESSION --station slv16001.dat
    """
    from fieldkit import calibrate

    references: list[tuple[Against, str | None]]
    references = [("pyranometer", pyranometer), ("pyrheliometer", pyrheliometer), ("station", station)]
    stated = [(against, reference) for against, reference in references if reference is not None]
    if len(stated) != 1:
        raise click.UsageError("give one of --pyranometer, --pyrheliometer, --station")
    ((against, reference),) = stated
    calibration = calibrate.irradiance(
        find_session(session), against=against, reference=reference, **arguments, notify=common.say_warning
    )
    save_and_print(calibration)


# options are named as the arguments of `calibrate.surface`
@command.command()
@click.argument("session", type=PATH)
@click.option("--name", type=RECORD_NAME, default="beds", show_default=True, help="Name of the record.")
@click.option("--region", "beds", multiple=True, metavar="REGION", help="Only this region; may be repeated.")
@number_option("--tilt-sd", "tilt_sd_deg", 0.5, "Standard uncertainty of the inclinometer.", metavar="DEG")
@common.set_option
def surface(session: Path, **arguments: Any) -> None:
    r"""Find the scale kappa of a SESSION from its beds of known tilt and azimuth.

    kappa is for this model of the surface and this irradiance: change neither after calibrating.
    With the learned model, what was learnt of gain, thermal inertia and depth is the next
    session's prior; beds of known slope sharpen it and are not needed.

    \b
    fieldkit calibrate surface recordings/X.h5 --region b15
    fieldkit calibrate surface recordings/X.h5 --set estimator.model=learned --name this-sand
    """
    from fieldkit import calibrate

    save_and_print(calibrate.surface(find_session(session), **arguments, notify=common.say_warning))
