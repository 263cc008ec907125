"""Checks of what would spoil a session, before it begins: regions, disk space, meters, old calibrations."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from datetime import UTC, datetime

from fieldkit.calibration.calibration_record import CalibrationRecord, model_warnings, record_warnings
from fieldkit.config import Config
from fieldkit.config.pose import outside
from fieldkit.estimation.instruments import Instruments as EstimatorInstruments
from fieldkit.estimation.region_check import check_regions
from fieldkit.model.channels import how_to_state
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError, StorageError
from fieldkit.model.next_step import Action, Text
from fieldkit.model.site import Site
from fieldkit.model.units import SECOND_NS
from fieldkit.phrases import Words
from fieldkit.physics.sun import sun_vectors
from fieldkit.recorder import Sampling
from fieldkit.recording.opening import Instruments
from fieldkit.recording.regions import camera_views
from fieldkit.views import formatting

NO_REGIONS = (
    "no regions are drawn: frames and readings are recorded, no slope is estimated. Find them on the "
    "report's image, then " + Action.ADD_REGION() + " and " + Action.ESTIMATE(present=True)
)
NOT_RECORDED = "not recorded, as a port gives one quantity"
UNKNOWN_UNIT = Words("error.unknown_unit")
STATE_UNIT = 'print the unit (T=21.5 C), name the column by it (temp_c), or set options.unit = "C"'
Notify = Callable[[Text], None]
"""Receives a warning."""
log: logging.Logger = logging.getLogger(__name__)


def preflight(
    config: Config, instruments: Instruments, duration_s: float | None, notify: Notify = log.warning
) -> None:
    """Raise `ConfigError` or `StorageError` for what would spoil the session, before it begins.

    `notify` receives warnings: no regions, radiation that cannot be used, probes and limits of what is not
    there, a trajectory of another time, calibrations that are old or of another instrument.
    """
    streams = instruments.streams
    _check_regions(config, streams, notify)
    for name in config.tables.irradiance.measures.keys() - {info.name for info in streams}:
        notify(f"irradiance.measures.{name}: no instrument is called {name}")
    for name in config.tables.alarms.region.keys() - {region.name for region in config.regions}:
        notify(f"alarms.region.{name}: no region is called {name}, so its limits watch nothing")
    meters = EstimatorInstruments(streams, config.estimator_settings())
    for name in meters.unknown:
        notify(f"{name}: what it measures is not known, so it is not used; {how_to_state(name)}")
    for info in streams:
        if others := info.settings.get("not_recorded"):
            notify(f"{info.name}: {NOT_RECORDED}: {others}")
    if unknown := [info.name for info in streams if not info.unit]:
        raise ConfigError(UNKNOWN_UNIT, place=", ".join(unknown), fix=STATE_UNIT)
    for name in meters.absent:
        notify(f"probes of regions: no instrument is called {name}")
    needed = bytes_per_second(streams, sampling_of(config))
    _check_space(needed, duration_s, instruments.free_bytes(), disk_reserve_bytes(config))
    now_ns = instruments.utc_ns()
    sun_vectors(now_ns, Site(0.0, 0.0))  # loads astropy's tables now: later it would hold up the recording
    _check_trajectory(config, now_ns, duration_s or 0.0, notify)
    now = datetime.fromtimestamp(now_ns / SECOND_NS, UTC)
    for key, calibration in config.calibrations().items():
        use = _use_warnings(key, calibration, config, meters.label)
        for warning in (*record_warnings(calibration, streams, now), *use):
            notify(f"{key}: {warning}")


def _use_warnings(key: str, record: CalibrationRecord, config: Config, light: str) -> list[str]:
    """Warnings of a record in a configuration that it was not made for; `light` labels the irradiance."""
    if key == "estimator.scale":
        return model_warnings(record, config.tables.estimator.model, light)
    if key == "irradiance.factor" and (model := config.tables.irradiance.model) != "calibrated":
        return [f'{record.name} is not used: irradiance.model is "{model}"; write model = "calibrated"']
    return []


def _check_regions(config: Config, streams: Sequence[StreamInfo], notify: Notify) -> None:
    """Raise `ConfigError` if a region reaches outside its camera's frame; warn of what else is wrong."""
    views = camera_views(config, streams)
    if views and not config.regions:
        notify(NO_REGIONS)
    for inspection in check_regions(config.regions, views) if views else ():
        region, failures = inspection.region, inspection.failures
        if region.camera not in views:
            notify(f"region {region.name}: there is no camera {region.camera}, so it has no temperature")
        elif not region.is_within(views[region.camera].shape):
            fix = Words("fix.draw_again")
            raise ConfigError(Words("text.all", texts=failures), place=region.name, fix=fix)
        elif failures:
            notify(f"region {region.name}: {'; '.join(failures)}")


def _check_trajectory(config: Config, now_ns: int, duration_s: float, notify: Notify) -> None:
    """Warn if the camera's trajectory does not cover the session."""
    path = config.estimator_settings().camera_path
    for time_ns in (now_ns, now_ns + round(duration_s * SECOND_NS)):
        if path is not None and path.trajectory.at(time_ns) is None:
            wrong = outside(path.trajectory, time_ns, "the trajectory of camera.pose").message
            notify(f"{wrong}: regions on the ground are lost then")
            return


def bytes_per_second(streams: Sequence[StreamInfo], sampling: Sampling) -> float:
    """Largest growth of a session in time, journal and file together, frames uncompressed."""
    total = 1000.0  # health and events
    for info in streams:
        rate_hz = info.rate_hz or 1.0
        if info.is_camera:
            per_frame = 2 * (info.shape[0] * info.shape[1] + info.metadata_shape[0] * info.metadata_shape[1])
            kept_hz = sampling.burst_frames / sampling.every_s if sampling.every_s else rate_hz
            total += 2 * per_frame * kept_hz
        else:
            total += 400 * rate_hz
    return total


def _check_space(needed_per_s: float, planned_s: float | None, free: int, reserve: int) -> None:
    """Raise `StorageError` if the planned duration, or any, does not fit the disk beside its reserve."""
    needed = needed_per_s * (planned_s or 0.0)
    if needed + reserve <= free:
        return
    lasts_min = max(0.0, free - reserve) / needed_per_s / 60
    sizes = {"free": free, "reserve": reserve, "per_min": needed_per_s * 60}
    shown = {name: formatting.size(size) for name, size in sizes.items()}
    raise StorageError(Words("error.no_room", minutes=f"{lasts_min:.0f}", **shown), fix=Words("fix.room"))


def disk_reserve_bytes(config: Config) -> int:
    """Free space below which storing frames stops."""
    return round(config.tables.alarms.disk_reserve_mb * 1e6)


def sampling_of(config: Config) -> Sampling:
    """Choice of frames that the configuration keeps."""
    table = config.tables.record
    every_s = table.every_s if table.sampling == "bursts" else None
    return Sampling(every_s, table.burst_frames, table.shutter_before_burst)
