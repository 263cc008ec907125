"""The factor of a light meter, W/m2 per unit, against a better instrument."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from fieldkit.calibrate.inputs import light_meter, minute_means, one_stream, open_to_calibrate
from fieldkit.calibrate.result import Calibration, make_record
from fieldkit.calibration.calibration_record import instrument_of
from fieldkit.calibration.light_meter import (
    MAX_LAG_S,
    LightFactor,
    clock_lag_s,
    light_factor,
    on_plane,
    refuse_shifted_clocks,
    with_lag,
)
from fieldkit.calibration.ranges import require_ranges
from fieldkit.config import Config
from fieldkit.model.arrays import FloatArray, IntArray
from fieldkit.model.channels import radiation_components
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.irradiance import DIFFUSE_MODELS
from fieldkit.physics.sun import sun_vectors
from fieldkit.recording.simulated_scene import measured_weather
from fieldkit.results.sources import SessionOrFile, Settings, log_warning
from fieldkit.sessions.reader import SessionReader

Against = Literal["pyranometer", "pyrheliometer", "station"]
NEAR_S = 90.0
MARGIN = round(MAX_LAG_S / 60.0)
"""Minutes before and after a session in which the reference is looked at, to compare the clocks."""


def irradiance(
    session: SessionOrFile,
    *,
    against: Against,
    reference: str,
    reference_sd: float = 0.02,
    name: str = "light",
    settings: Settings = (),
    notify: Callable[[str], None] = log_warning,
) -> Calibration:
    """Find the factor of a session's light meter against a reference, by a line through the origin.

    Mounting and diffuse model are those of ``[irradiance]``; diffuse irradiance of a station is used as
    measured.

    Parameters
    ----------
    session : Session or path
        A recording with an illuminance stream; of several the one that ``irradiance.stream`` names.
    against : {"pyranometer", "pyrheliometer", "station"}
        Kind of reference: a stream of global irradiance on the meter's plane, a stream of direct normal
        irradiance, or a station file.
    reference : str
        Name of the stream, SURFRAD or BSRN file of the site's station, or name of the packaged day.
    reference_sd : float
        Relative standard uncertainty of the reference. [unitless]
    name : str
        Names the record.
    settings : mapping, or sequence of ``KEY=VALUE``
        Other values for keys of the configuration, such as ``surface.albedo=0.25``.
    notify : callable
        Receives warnings, such as damaged samples that were excluded.

    Raises
    ------
    ConfigError
        If a stream or station does not measure what is needed, or not at the session's times; for an
        uncertainty below 0.
    CalibrationError
        If the readings do not determine a factor.

    Examples
    --------
    >>> fieldkit.calibrate.irradiance(session, against="station", reference="alamosa-2016-01-01")
    <Calibration: 0.009156 ± 0.000458 W/m² per lx (k=2)   109 lm/W   scatter 0.1%   21 minutes>
    """
    require_ranges({"reference_sd": reference_sd})
    if against not in get_args(Against):
        raise ConfigError(
            "not a kind of reference",
            place=Argument("against", against),
            fix=f"choose one of {', '.join(get_args(Against))}",
        )
    with open_to_calibrate(session, settings, notify) as (opened, config):
        files = [Path(reference).resolve()] if against == "station" and Path(reference).is_file() else []
        if files:  # relative paths are meant from the current folder, not from the campaign's
            reference = str(files[0])
        meter = light_meter(opened, config)
        minutes, illuminance = minute_means(opened, meter.name)
        around = _with_margins(minutes)
        plane, method, diffuse_sd = _reference(opened, config, around, against, reference)
        refuse_shifted_clocks(lag_s := clock_lag_s(minutes, illuminance, around, plane))

        def factor(on_meter: FloatArray) -> LightFactor:
            return light_factor(illuminance, on_meter, reference_sd=reference_sd, diffuse_sd=diffuse_sd)

        calibration_factor = factor(plane[MARGIN:-MARGIN])
        if lag_s:
            at_lag = np.interp(minutes + round(lag_s * 1e9), around, plane)
            calibration_factor = with_lag(calibration_factor, factor(at_lag), lag_s)
        model = config.irradiance_model()
        record = make_record(
            "irradiance",
            name,
            calibration_factor.value,
            "W/m2/lx",
            calibration_factor.budget,
            [opened],
            files=files,
            method=method,
            degrees_of_freedom=calibration_factor.minutes - 1,
            instrument=instrument_of(meter),
            details={
                "minutes": calibration_factor.minutes,
                "scatter": calibration_factor.scatter,
                "mounting": model.mounting,
                "diffuse": model.diffuse,
            },
            settings={
                "name": name,
                "pyranometer": "",
                "pyrheliometer": "",
                "station": "",
                against: reference,
            },
            remarks=calibration_factor.remarks,
        )
        used_by = f'irradiance.model = "calibrated", irradiance.factor = "@{name}"'
        return Calibration(record, _summary(calibration_factor), used_by, config.calibration)


def _summary(found: LightFactor) -> str:
    return (
        f"{found.value:.6f} ± {found.expanded:.6f} W/m² per lx (k=2)   {1.0 / found.value:.0f} lm/W   "
        f"scatter {found.scatter:.1%}   {found.minutes} minutes"
    )


def _reference(
    session: SessionReader, config: Config, minute_ns: IntArray, against: Against, reference: str
) -> tuple[FloatArray, str, float]:
    """Irradiance on the meter's plane at minutes, the method, the uncertainty of the diffuse part.

    The minutes are those of the session `_with_margins`.
    """
    model = config.irradiance_model()
    if against == "pyranometer":
        times, value = minute_means(session, _radiation(session, config, reference, ("ghi", "gti")))
        method = f"against the pyranometer {reference} on the same plane"
        return _at(minute_ns, times, value), method, 0.0
    sun = sun_vectors(minute_ns, config.site, refraction=True)
    if against == "pyrheliometer":
        times, value = minute_means(session, _radiation(session, config, reference, ("dni",)))
        plane = on_plane(model, _at(minute_ns, times, value), None, sun, minute_ns)
        method = f"against the pyrheliometer {reference}, diffuse {model.diffuse}"
        return plane, method, DIFFUSE_MODELS[model.diffuse].relative_sd
    weather = measured_weather(config, reference)
    first_ns, last_ns = minute_ns[MARGIN], minute_ns[-MARGIN - 1]
    if first_ns > weather.time_ns[-1] or last_ns < weather.time_ns[0]:
        raise ConfigError(
            f"of another day than {session.path.name}", place=reference, fix="give that day's file"
        )
    dni = _at(minute_ns, weather.time_ns, weather.dni_w_m2)
    dhi = _at(minute_ns, weather.time_ns, weather.dhi_w_m2)
    return on_plane(model, dni, dhi, sun, minute_ns), f"against the station file {weather.source}", 0.0


def _radiation(session: SessionReader, config: Config, stream: str, components: Sequence[str]) -> str:
    """The stream of that name; raises `ConfigError` if it is known to measure something else."""
    info = one_stream(session, "irradiance", stream)
    components_measured = set(radiation_components(info, config.tables.irradiance.measures)) - {""}
    if components_measured and not components_measured & set(components):
        raise ConfigError(
            f"measures {', '.join(sorted(components_measured))}, not {' or '.join(components)}",
            place=stream,
            fix=f"name another stream, or correct irradiance.measures.{stream}",
        )
    return info.name


def _with_margins(minute_ns: IntArray) -> IntArray:
    """The minutes, and those around them in which the reference may have had the session's light."""
    beside = MINUTE_NS * np.arange(1, MARGIN + 1)
    return np.concatenate([minute_ns[0] - beside[::-1], minute_ns, minute_ns[-1] + beside])


def _at(minute_ns: IntArray, time_ns: IntArray, value: FloatArray) -> FloatArray:
    """Values interpolated at the minutes; NaN farther than a minute and a half from any value."""
    has_value = np.isfinite(value)
    if not has_value.any():
        return np.full(minute_ns.size, np.nan)
    since, times = (minute_ns - time_ns[0]) / 1e9, (time_ns[has_value] - time_ns[0]) / 1e9
    following = np.searchsorted(times, since)
    near = np.abs(times[np.clip(following, 0, times.size - 1)] - since) < NEAR_S
    near |= np.abs(times[np.clip(following - 1, 0, times.size - 1)] - since) < NEAR_S
    return np.where(near, np.interp(since, times, value[has_value]), np.nan)
