"""``fieldkit calibrate clock``: how far the clock is off, against a phone, GPS or the sun."""

from __future__ import annotations

import shlex
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from fieldkit.cli import common
from fieldkit.cli.session_paths import find_session
from fieldkit.cli.types import MOMENT, PATH, RECORD_NAME

if TYPE_CHECKING:
    from fieldkit.calibrate.clock import ClockCalibration

DEFAULT_NAME = "clock"


@click.command(cls=common.Command)
@click.argument("session", required=False, type=PATH)
@click.option(
    "--at",
    "shown",
    type=MOMENT,
    help="A time a minute ahead, with its zone: press a key the moment a phone shows it.",
)
@click.option("--gps", metavar="STREAM", help="A GPS stream of the SESSION.")
@click.option("--sun", is_flag=True, help="Illuminance of the SESSION against the sun's elevation.")
@click.option(
    "--apply", "is_applied", is_flag=True, help="Correct the SESSION's times from now on when reading."
)
@click.option("--name", type=RECORD_NAME, default=DEFAULT_NAME, show_default=True, help="Name of the record.")
def command(
    session: Path | None, shown: datetime | None, gps: str | None, sun: bool, is_applied: bool, name: str
) -> None:
    r"""Find the seconds to add to this computer's times, or to those of a SESSION.

    Recorded times are never rewritten: --apply keeps the offset beside them.

    \b
    fieldkit calibrate clock --at 2026-12-11T11:52:30+09:00
    fieldkit calibrate clock recordings/X.h5 --sun
    """
    from fieldkit import calibrate
    from fieldkit.cli.calibration_output import save_and_print

    if (shown is not None) + (gps is not None) + sun != 1:
        raise click.UsageError("give one of --at, --gps, --sun")
    if session is None:
        if shown is None or is_applied:
            raise click.UsageError("--gps, --sun and --apply need a SESSION")
        config = common.campaign()
        pressed_ns = _key_pressed_ns(shown)
        save_and_print(
            calibrate.host_clock(
                config, host_ns=pressed_ns, shown=shown, name=name, notify=common.say_warning
            )
        )
        return
    if shown is not None:
        raise click.UsageError("--at is about this computer's clock now; omit the SESSION")
    session = find_session(session)
    calibration = calibrate.clock(session, gps=gps, name=name, notify=common.say_warning)
    save_and_print(calibration, _next_step(session, gps, name, calibration))
    if is_applied:
        calibration.apply()
        common.say(f"{session.name}: {calibration.applied_s:+.1f} s from now on when reading")


def _next_step(session: Path, gps: str | None, name: str, calibration: ClockCalibration) -> str:
    """Next step with the offset: a command as one would type it."""
    if not calibration.is_significant:
        return calibration.used_by
    source = ["--sun"] if gps is None else ["--gps", gps]
    name_option = [] if name == DEFAULT_NAME else ["--name", name]
    return shlex.join(["fieldkit", "calibrate", "clock", str(session), *source, *name_option, "--apply"])


def _key_pressed_ns(shown: datetime) -> int:
    """UTC of this computer at the key press; the start of the program does not delay it."""
    from fieldkit.model.clock import HostClock

    if not common.is_interactive():
        raise click.UsageError("--at asks for a key press: run it in a terminal, without --no-input")
    clock = HostClock()
    click.echo(f"press a key the moment the other clock shows {shown.isoformat()}", err=True)
    click.getchar()
    return clock.to_utc_ns(clock.mono_ns())
