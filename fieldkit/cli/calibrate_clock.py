"""``fieldkit calibrate clock``: how far the clock is off, against a phone, GPS or the sun."""

from __future__ import annotations

import math
import shlex
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from fieldkit.cli import common
from fieldkit.cli.session_paths import find_session
from fieldkit.cli.types import MOMENT, RECORD_NAME
from fieldkit.model.clock import utc_ns
from fieldkit.model.errors import CalibrationError, ConfigError

if TYPE_CHECKING:
    from fieldkit.calibration.clock_offset import ClockOffset
    from fieldkit.model.samples import Sample
    from fieldkit.sessions.reader import Session

DEFAULT_NAME = "clock"
BY_HAND_S, RECEIVER_S = 0.5, 0.4
"""Half a second by hand; a receiver's sentences come up to 0.7 s late."""


OTHER_DAY_S = 14 * 3600.0
"""No two time zones differ by more from UTC; beyond it a date is wrong, here or there."""


@click.command(cls=common.Command)
@click.argument("session", required=False, type=click.Path(path_type=Path))
@click.option(
    "--told",
    type=MOMENT,
    help="A time a minute ahead, with its zone: press a key the moment a phone shows it.",
)
@click.option("--gps", metavar="STREAM", help="A GPS stream of the SESSION.")
@click.option("--sun", is_flag=True, help="The light of the SESSION against the sun's height.")
@click.option(
    "--apply", "is_applied", is_flag=True, help="Correct the SESSION's times from now on when reading."
)
@click.option("--name", type=RECORD_NAME, default=DEFAULT_NAME, show_default=True, help="Names the record.")
@click.pass_context
def command(
    ctx: click.Context, /, session: Path | None, told: datetime | None, gps: str | None, sun: bool,
    is_applied: bool, name: str,
) -> None:  # fmt: skip
    r"""Seconds to add to this computer's times, or to those of a SESSION.

    Recorded times are never rewritten: --apply keeps the offset beside them.

    \b
    fieldkit calibrate clock --told 2026-12-11T11:52:30+09:00
    fieldkit calibrate clock recordings/X.h5 --sun
    """
    from fieldkit.calibration.calibration_record import CalibrationRecord
    from fieldkit.cli.calibrating import finish, moment, source_of
    from fieldkit.sessions.reader import open_session
    from fieldkit.workflows.sources import config_for

    if (told is not None) + (gps is not None) + sun != 1:
        raise click.UsageError("give one of --told, --gps, --sun")
    if session is None:
        if told is None or is_applied:
            raise click.UsageError("--gps, --sun and --apply need a SESSION")
        config = common.campaign(ctx)
        own_ns = _key_pressed_ns(told)
        date = datetime.fromtimestamp(own_ns // 10**9, UTC)
        found, how = _by_hand(own_ns, told)
    else:
        if told is not None:
            raise click.UsageError("--told is about this computer's clock now; leave the SESSION out")
        session = find_session(ctx, session)
        with open_session(session) as opened:
            config, date = config_for(opened), moment(opened)
            found, how = _by_gps(opened, gps) if gps is not None else _by_sun(opened)
            common.say_damage(opened)
    record = CalibrationRecord(
        "clock", name, date, found.offset_s, found.standard_uncertainty_s, "s", how,
        max(0, found.readings - 1), found.budget,
        sources=() if session is None else (source_of(session),),
    )  # fmt: skip
    if abs(found.offset_s) > OTHER_DAY_S:
        days = found.offset_s / 86_400.0
        common.say(f"warning: that is {days:+.1f} days, more than any zone: check the date of both clocks")
    headline = f"add {found.offset_s:+.1f} ± {found.expanded_s:.1f} s (k=2)   {how}"
    finish(record, config, headline, _next_step(session, gps, name, found))
    if session is not None and is_applied:
        _apply(session, found, how)


def _next_step(session: Path | None, gps: str | None, name: str, found: ClockOffset) -> str:
    """What to do with the offset: a command as one would type it."""
    if abs(found.offset_s) <= found.expanded_s:
        return "nothing, the offset is within its uncertainty"
    if session is None:
        return "set this computer's clock before recording"
    source = ["--sun"] if gps is None else ["--gps", gps]
    named = [] if name == DEFAULT_NAME else ["--name", name]
    return shlex.join(["fieldkit", "calibrate", "clock", str(session), *source, *named, "--apply"])


def _key_pressed_ns(shown: datetime) -> int:
    """Time of this computer at the key press, which the start of the program does not delay."""
    from fieldkit.model.clock import HostClock

    if common.options().no_input or not sys.stdin.isatty():
        raise click.UsageError("--told asks for a key press: run it in a terminal, without --no-input")
    clock = HostClock()
    click.echo(f"press a key the moment the other clock shows {shown.isoformat()}", err=True)
    click.getchar()
    return clock.to_utc_ns(clock.mono_ns())


def _by_hand(own_ns: int, told: datetime) -> tuple[ClockOffset, str]:
    from fieldkit.calibration.clock_offset import offset_from_times

    own, true = np.array([own_ns], np.int64), np.array([utc_ns(told)], np.int64)
    return offset_from_times(own, true, BY_HAND_S, "other clock by hand"), "another clock, read by hand"


def _by_gps(session: Session, stream: str) -> tuple[ClockOffset, str]:
    from fieldkit.calibration.clock_offset import offset_from_times

    reader = session.stream(stream)
    if reader.info.device_time_unit != "ns since 1970 UTC":
        raise ConfigError(f"{session.path}: {stream} tells no time", fix="use the drivers gpsd or nmea")
    moments = [(one.time_ns, one.device_time) for one in reader.samples() if _is_fix(one)]
    if not moments:
        raise CalibrationError(
            f"{stream} never had a fix; without one a receiver's time is a guess",
            fix="give the receiver a view of the sky",
        )
    own, true = np.array(moments, np.int64).T
    return offset_from_times(own, true, RECEIVER_S, "receiver"), f"GPS receiver {stream}"


def _is_fix(sample: Sample) -> bool:
    """Whether a reading has position and time of satellites, stamped when it came.

    Without a fix a receiver goes on by its own clock, from the day it was made or last had one.
    """
    from fieldkit.model.samples import NO_COUNTER, Quality, Reading, is_usable

    return (
        isinstance(sample, Reading)
        and sample.device_time != NO_COUNTER
        and is_usable(sample.quality)
        and not sample.quality & Quality.INTERPOLATED
        and math.isfinite(sample.values[0])  # the latitude
    )


def _by_sun(session: Session) -> tuple[ClockOffset, str]:
    from fieldkit.calibration.clock_offset import offset_from_sun
    from fieldkit.cli.calibrate_irradiance import minute_means
    from fieldkit.cli.calibrating import one_stream

    minutes, light = minute_means(session, one_stream(session, "illuminance").name, recorded=True)
    return offset_from_sun(minutes, light, session.site), "the light against the sun's height"


def _apply(session: Path, found: ClockOffset, how: str) -> None:
    from fieldkit.sessions.clock_correction import apply_time_map
    from fieldkit.sessions.time_map import TimeStep

    apply_time_map(session, [TimeStep(0, round(found.offset_s * 1e9), how)])
    common.say(f"{session.name}: {found.offset_s:+.1f} s from now on when reading")
