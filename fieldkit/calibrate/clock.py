"""Offset of a clock: a session's against GPS or the sun, this computer's against another clock."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from fieldkit.calibrate.inputs import light_meter, minute_means, open_to_calibrate
from fieldkit.calibrate.result import Calibration, make_record
from fieldkit.calibration.clock_offset import ClockOffset, offset_from_sun, offset_from_times
from fieldkit.config import Config
from fieldkit.model.clock import as_moment, utc_ns
from fieldkit.model.errors import CalibrationError, ConfigError
from fieldkit.model.next_step import Action, Argument
from fieldkit.model.samples import NO_COUNTER, Quality, Reading, Sample, is_usable
from fieldkit.model.units import DAY_S
from fieldkit.physics.bodies import EARTH, body_of
from fieldkit.results.sources import SessionOrFile, log_warning
from fieldkit.sessions.finished_file import apply_time_map
from fieldkit.sessions.reader import SessionReader
from fieldkit.sessions.time_map import TimeStep

DEFAULT_NAME = "clock"
BY_HAND_S = 0.5
"""Standard uncertainty of pressing a key at a given moment."""
RECEIVER_S = 0.4
"""Standard uncertainty of a GPS receiver's sentences, which arrive up to 0.7 s late."""
NOTHING_TO_DO = "nothing, the offset is within its uncertainty"
LARGEST_ZONE_S = 14 * 3600.0
"""No two time zones differ by more from UTC; beyond that, one of the dates is wrong."""


@dataclass(frozen=True, repr=False)
class ClockCalibration(Calibration):
    """Seconds to add to recorded times; `session` is the file they were found from, if any."""

    offset: ClockOffset
    session: Path | None = None

    @property
    def is_significant(self) -> bool:
        """True if the offset is larger than its expanded uncertainty."""
        return abs(self.offset.offset_s) > self.offset.expanded

    @property
    def applied_s(self) -> float:
        """The offset to apply: 0 if it is within its uncertainty, as the clock may then be right."""
        return self.offset.offset_s if self.is_significant else 0.0

    def apply(self) -> None:
        """Correct the session's times from now on when reading; the recorded times stay as they are.

        By nothing where the offset is not significant. The session must not be open. Raises `ConfigError` for
        an offset of this computer's clock.
        """
        if self.session is None:
            raise ConfigError(
                "this offset is not of a session", fix="set this computer's clock before recording"
            )
        step = TimeStep(0, round(self.applied_s * 1e9), self.record.method)
        apply_time_map(self.session, [step])


def clock(
    session: SessionOrFile,
    *,
    gps: str | None = None,
    name: str = DEFAULT_NAME,
    notify: Callable[[str], None] = log_warning,
) -> ClockCalibration:
    """Find the offset of a session's times against its GPS receiver, or else against the sun.

    Parameters
    ----------
    session : Session or path
        A recording with a GPS stream, or with an illuminance stream under a clear sky.
    gps : str, optional
        Name of the GPS stream; without it the illuminance is compared with the sun's elevation.
    name : str
        Names the record.
    notify : callable
        Receives warnings, such as damaged samples or an implausible offset.

    Raises
    ------
    ConfigError
        If the stream does not carry what is needed.
    CalibrationError
        If the receiver had no fix, or the illuminance does not determine an offset.

    Examples
    --------
    A clear day of a light logger that was left on daylight saving time:

    >>> import numpy as np, pandas as pd
    >>> options = fieldkit.PlanOptions(turbidity=3.0, step_min=2)
    >>> day = fieldkit.plan(campaign.config.site, "2016-01-01", [(15.0, 180.0)], options).to_frame()
    >>> time = pd.to_datetime(day["time"]) + pd.Timedelta("1h")
    >>> light = 100 * day["direct_normal_w_m2"] * np.cos(np.radians(day["sun_zenith_deg"]))
    >>> pd.DataFrame({"time": time, "light [lx]": light}).to_csv("logger.csv", index=False)
    >>> logged = fieldkit.import_recording("logger.csv", campaign=campaign.directory)
    >>> fieldkit.calibrate.clock(logged.path)
    <ClockCalibration: add -363... ± 22... s (k=2)   the light against the sun's height>
    """
    with open_to_calibrate(session, (), notify) as (opened, config):
        if gps is None:
            offset, method = _against_sun(opened, config), "the light against the sun's height"
        else:
            offset, method = _against_gps(opened, gps), f"GPS receiver {gps}"
        _warn_of_another_day(offset, notify)
        use = "apply() corrects the session's times"
        return _calibration(name, offset, method, use, config, sessions=[opened])


def host_clock(
    config: Config,
    *,
    host_ns: int,
    shown: datetime,
    name: str = DEFAULT_NAME,
    notify: Callable[[str], None] = log_warning,
) -> ClockCalibration:
    """Find the offset of this computer's clock against another one, read by hand.

    `host_ns` is this computer's UTC, nanoseconds since 1970, at the moment the other clock showed `shown`, a
    time with its zone. Raises `ConfigError` without one.

    Examples
    --------
    >>> from datetime import datetime
    >>> shown = datetime.fromisoformat("2026-12-11T11:52:30+09:00")
    >>> host_ns = 1_796_957_545_000_000_000
    >>> fieldkit.calibrate.host_clock(campaign.config, host_ns=host_ns, shown=shown)
    <ClockCalibration: add +5.0 ± 1.0 s (k=2)   another clock, read by hand>
    """
    own, true = np.array([host_ns], np.int64), np.array([utc_ns(as_moment(shown))], np.int64)
    offset = offset_from_times(own, true, BY_HAND_S, "other clock by hand")
    _warn_of_another_day(offset, notify)
    date = datetime.fromtimestamp(host_ns // 10**9, UTC)
    method, use = "another clock, read by hand", "set this computer's clock before recording"
    return _calibration(name, offset, method, use, config, date=date)


def _calibration(
    name: str,
    offset: ClockOffset,
    method: str,
    use: str,
    config: Config,
    *,
    sessions: Sequence[SessionReader] = (),
    date: datetime | None = None,
) -> ClockCalibration:
    record = make_record(
        "clock",
        name,
        offset.offset_s,
        "s",
        offset.budget,
        sessions,
        date=date,
        method=method,
        degrees_of_freedom=max(0, offset.readings - 1),
    )
    summary = f"add {offset.offset_s:+.1f} ± {offset.expanded:.1f} s (k=2)   {method}"
    path = sessions[0].path if sessions else None
    calibration = ClockCalibration(record, summary, use, config.calibration, offset, path)
    return calibration if calibration.is_significant else replace(calibration, used_by=NOTHING_TO_DO)


def _warn_of_another_day(found: ClockOffset, notify: Callable[[str], None]) -> None:
    if abs(found.offset_s) > LARGEST_ZONE_S:
        days = found.offset_s / DAY_S
        notify(f"that is {days:+.1f} days, more than any time zone: check the date of both clocks")


def _against_gps(session: SessionReader, stream: str) -> ClockOffset:
    reader = session.stream(stream)
    if reader.info.device_time_unit != "ns since 1970 UTC":
        raise ConfigError(f"{stream} carries no UTC", place=session.path, fix="use the drivers gpsd or nmea")
    moments = [
        (sample.time_ns, sample.device_time) for sample in reader.samples(recorded=True) if _is_fix(sample)
    ]
    if not moments:
        raise CalibrationError(
            "never had a fix; without one a receiver's time is a guess",
            place=stream,
            fix="give the receiver a view of the sky",
        )
    own, true = np.array(moments, np.int64).T
    return offset_from_times(own, true, RECEIVER_S, "receiver")


def _is_fix(sample: Sample) -> bool:
    """True if a reading has position and time of satellites, stamped when it arrived.

    Without a fix a receiver runs on its own clock, from the day it was made or last had one.
    """
    return (
        isinstance(sample, Reading)
        and sample.device_time != NO_COUNTER
        and is_usable(sample.quality)
        and not sample.quality & Quality.INTERPOLATED
        and math.isfinite(sample.values[0])  # the latitude
    )


def _against_sun(session: SessionReader, config: Config) -> ClockOffset:
    if (body := body_of(session.site)) is not EARTH:
        raise ConfigError(
            f"recorded on {body.name}; the clock is found by the light under the Earth's air",
            place=session.path,
            fix="give a GPS stream as " + Argument("gps") + ", or use " + Action.HOST_CLOCK(),
        )
    meter = light_meter(session, config).name
    minutes, illuminance = minute_means(session, meter, recorded=True)
    return offset_from_sun(minutes, illuminance, session.site)
