"""``fieldkit calibrate irradiance``: the light meter's factor against a better instrument."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fieldkit.cli import common
from fieldkit.cli.session_paths import find_session
from fieldkit.cli.types import PATH, RECORD_NAME, argument_range

if TYPE_CHECKING:
    from fieldkit.calibrate.irradiance import Against


# options but the references are named as the arguments of `calibrate.irradiance`
@click.command(cls=common.Command)
@click.argument("session", type=PATH)
@click.option("--name", type=RECORD_NAME, default="light", show_default=True, help="Name of the record.")
@click.option("--pyranometer", metavar="STREAM", help="A stream: global irradiance on the meter's plane.")
@click.option("--pyrheliometer", metavar="STREAM", help="A stream: direct normal irradiance.")
@click.option(
    "--station", metavar="FILE", help="A SURFRAD or BSRN file of the site's station, or the packaged day."
)
@click.option(
    "--reference-sd",
    type=argument_range("reference_sd"),
    default=0.02,
    show_default=True,
    help="Relative standard uncertainty of the reference.",
)
@common.set_option
def command(
    session: Path, pyranometer: str | None, pyrheliometer: str | None, station: str | None, **given: Any
) -> None:
    r"""Find the W/m2 per unit of the light meter, by a line through the origin.

    Mounting and diffuse model are those of [irradiance]; a station's own diffuse light is used as measured.

    \b
    fieldkit calibrate irradiance SESSION --pyranometer cmp11
    fieldkit calibrate irradiance SESSION --station slv16001.dat
    """
    from fieldkit import calibrate
    from fieldkit.cli.calibration_output import save_and_print

    references: dict[Against, str | None] = {
        "pyranometer": pyranometer,
        "pyrheliometer": pyrheliometer,
        "station": station,
    }
    chosen = [(kind, reference) for kind, reference in references.items() if reference is not None]
    if len(chosen) != 1:
        raise click.UsageError("give one of --pyranometer, --pyrheliometer, --station")
    ((against, reference),) = chosen
    calibration = calibrate.irradiance(
        find_session(session), against=against, reference=reference, **given, notify=common.say_warning
    )
    save_and_print(calibration)
