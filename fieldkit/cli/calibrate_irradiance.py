"""``fieldkit calibrate irradiance``: the light meter's factor against a better instrument."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np
from numpy.typing import NDArray

from fieldkit.cli import common
from fieldkit.cli.session_paths import find_session
from fieldkit.cli.types import RECORD_NAME
from fieldkit.model.errors import ConfigError
from fieldkit.model.radiation import UNKNOWN, measured

if TYPE_CHECKING:
    from fieldkit.config import Config
    from fieldkit.physics.facet import FloatArray
    from fieldkit.sessions.reader import Session

Times = NDArray[np.int64]
DIFFUSE_SD = {"none": 0.03, "fraction": 0.05, "erbs": 0.04}
"""Relative uncertainty of the sky's share where it is not measured."""


@click.command(cls=common.Command)
@click.argument("session", type=click.Path(path_type=Path))
@click.option("--name", type=RECORD_NAME, default="light", show_default=True, help="Names the record.")
@click.option("--pyranometer", metavar="STREAM", help="A stream: global irradiance on the meter's plane.")
@click.option("--pyrheliometer", metavar="STREAM", help="A stream: direct normal irradiance.")
@click.option(
    "--station", metavar="FILE", help="A SURFRAD or BSRN file of the site's station, or the packaged day."
)
@click.option(
    "--reference-sd", type=click.FloatRange(0), default=0.02, show_default=True, help="Relative, k=1."
)
@common.set_option
@click.pass_context
def command(
    ctx: click.Context, /, session: Path, name: str, pyranometer: str | None, pyrheliometer: str | None,
    station: str | None, reference_sd: float, settings: tuple[str, ...],
) -> None:  # fmt: skip
    r"""W/m2 per unit of the light meter, through the origin.

    Mounting and diffuse model are those of [irradiance]; a station's own diffuse light is used as measured.

    \b
    fieldkit calibrate irradiance SESSION --pyranometer cmp11
    fieldkit calibrate irradiance SESSION --station slv16001.dat
    """
    from fieldkit.calibration.calibration_record import CalibrationRecord, instrument_of
    from fieldkit.calibration.light_meter import light_factor
    from fieldkit.cli.calibrating import finish, moment, one_stream, source_of
    from fieldkit.sessions.reader import open_session
    from fieldkit.workflows.sources import config_for

    if sum(one is not None for one in (pyranometer, pyrheliometer, station)) != 1:
        raise click.UsageError("give one of --pyranometer, --pyrheliometer, --station")
    # a file is named from the folder one stands in, not from the campaign's
    station_files = [path.resolve() for path in [Path(station or "")] if path.is_file()]
    station = str(station_files[0]) if station_files else station
    session = find_session(ctx, session)
    with open_session(session) as opened:
        config = config_for(opened, settings)
        meter = one_stream(opened, "illuminance")
        minutes, reading = minute_means(opened, meter.name)
        plane, how, diffuse_sd = _reference(opened, config, minutes, pyranometer, pyrheliometer, station)
        date = moment(opened)
        common.say_damage(opened)
    found = light_factor(reading, plane, reference_sd=reference_sd, diffuse_sd=diffuse_sd)
    model = config.irradiance_model()
    record = CalibrationRecord(
        "irradiance", name, date, found.value, found.standard_uncertainty, "W/m2/lx", how,
        found.minutes - 1, found.budget, instrument=instrument_of(meter),
        sources=tuple(source_of(file) for file in (session, *station_files)),
        details={"minutes": found.minutes, "scatter": found.scatter, "mounting": model.mounting,
                 "diffuse": model.diffuse},
        settings={"name": name, "pyranometer": pyranometer or "", "pyrheliometer": pyrheliometer or "",
                  "station": station or ""},
        remarks=found.remarks,
    )  # fmt: skip
    headline = (
        f"{found.value:.6f} ± {found.expanded:.6f} W/m² per lx (k=2)   {1.0 / found.value:.0f} lm/W   "
        f"scatter {found.scatter:.1%}   {found.minutes} minutes"
    )
    finish(record, config, headline, f'irradiance.model = "calibrated", irradiance.factor = "@{name}"')


def _reference(
    session: Session, config: Config, minute_ns: Times,
    pyranometer: str | None, pyrheliometer: str | None, station: str | None,
) -> tuple[FloatArray, str, float]:  # fmt: skip
    """Irradiance on the meter's plane at the minutes, the method, the doubt about the sky's share."""
    from fieldkit.calibration.light_meter import on_plane
    from fieldkit.physics.sun import sun_vectors
    from fieldkit.workflows.simulate import measured_weather

    model = config.irradiance_model()
    sun = sun_vectors(minute_ns, config.site, refraction=True)
    if pyranometer is not None:
        times, value = minute_means(session, _radiation(session, config, pyranometer, ("ghi", "gti")))
        return _at(minute_ns, times, value), f"against the pyranometer {pyranometer} on the same plane", 0.0
    if pyrheliometer is not None:
        times, value = minute_means(session, _radiation(session, config, pyrheliometer, ("dni",)))
        plane = on_plane(model, _at(minute_ns, times, value), None, sun, minute_ns)
        return (
            plane,
            f"against the pyrheliometer {pyrheliometer}, diffuse {model.diffuse}",
            DIFFUSE_SD[model.diffuse],
        )
    weather = measured_weather(config, station or "")
    if minute_ns[0] > weather.time_ns[-1] or minute_ns[-1] < weather.time_ns[0]:
        raise ConfigError(f"{station} is of another day than {session.path.name}", fix="give that day's file")
    direct, diffuse = (
        _at(minute_ns, weather.time_ns, column) for column in (weather.dni_w_m2, weather.dhi_w_m2)
    )
    return on_plane(model, direct, diffuse, sun, minute_ns), f"against the station file {weather.source}", 0.0


def _radiation(session: Session, config: Config, stream: str, components: Sequence[str]) -> str:
    """The stream of that name; raises `ConfigError` if it is known to measure something else."""
    from fieldkit.cli.calibrating import one_stream

    info = one_stream(session, "irradiance", stream)
    known = set(measured(info, config.tables.irradiance.measures)) - {UNKNOWN}
    if known and not known & set(components):
        raise ConfigError(
            f"{stream} measures {', '.join(sorted(known))}, not {' or '.join(components)}",
            fix=f"name another stream, or correct irradiance.measures.{stream}",
        )
    return info.name


def _at(
    minute_ns: Times,
    time_ns: Times,
    value: FloatArray,
) -> FloatArray:
    """Values at the minutes, straight in between; NaN farther than a minute and a half from any."""
    known = np.isfinite(value)
    if not known.any():
        return np.full(minute_ns.size, np.nan)
    since, times = (minute_ns - time_ns[0]) / 1e9, (time_ns[known] - time_ns[0]) / 1e9
    near = np.abs(times[np.clip(np.searchsorted(times, since), 0, times.size - 1)] - since) < 90.0
    near |= np.abs(times[np.clip(np.searchsorted(times, since) - 1, 0, times.size - 1)] - since) < 90.0
    return np.where(near, np.interp(since, times, value[known]), np.nan)


def minute_means(session: Session, stream: str, *, recorded: bool = False) -> tuple[Times, FloatArray]:
    """Middle and mean of every minute of a meter's first channel; raises `ConfigError` without any.

    `recorded` takes the times as they were recorded, without a time map that is in force.
    """
    from fieldkit.sessions import analysis

    minutes, means = analysis.minute_means(session, stream, recorded=recorded)
    if not minutes.size:
        raise ConfigError(f"{session.path}: {stream} has no good readings", fix="fieldkit check says why")
    return minutes, means
