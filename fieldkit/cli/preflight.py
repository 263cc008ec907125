"""What would spoil a session, told before it is begun: regions, disk, calibrations."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime

from fieldkit.calibration.doubts import doubts
from fieldkit.cli import common
from fieldkit.cli.recording import SECOND_NS, Instruments, disk_reserve_bytes, sampling_of
from fieldkit.config import Config
from fieldkit.estimation.instruments import Instruments as Light
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError, StorageError
from fieldkit.model.radiation import how_to_state
from fieldkit.physics.sun import sun_vectors
from fieldkit.recorder import Sampling
from fieldkit.views import formatting

NO_REGIONS = (
    "no regions are drawn: frames and readings are recorded, no slope is estimated. Find the beds on the "
    "report's picture, add them with fieldkit roi add, then: fieldkit report SESSION --campaign"
)


def preflight(config: Config, tools: Instruments, duration_s: float | None) -> None:
    """Raise `ConfigError` or `StorageError` for what would spoil the session, before it is begun.

    Calibrations that are old or of another instrument are warned of, and radiation that cannot be used.
    """
    _check_regions(config, tools.streams)
    for name in config.tables.irradiance.measures.keys() - {info.name for info in tools.streams}:
        common.say(f"warning: irradiance.measures.{name}: no instrument is called {name}")
    for name in Light(tools.streams, config.estimator_settings()).unknown:
        common.say(f"warning: {name}: what it measures is not known, so it is not used; {how_to_state(name)}")
    needed = _bytes_per_second(tools.streams, sampling_of(config))
    _check_space(needed, duration_s, tools.free_bytes(), disk_reserve_bytes(config))
    now_ns = tools.clock.to_utc_ns(tools.clock.mono_ns())
    sun_vectors(now_ns, config.site)  # the first sun of a process reads tables: not while recording
    now = datetime.fromtimestamp(now_ns / SECOND_NS, UTC)
    for key, record in config.calibrations().items():
        for doubt in doubts(record, tools.streams, now):
            common.say(f"warning: {key}: {doubt}")


def _check_regions(config: Config, streams: Sequence[StreamInfo]) -> None:
    """Raise `ConfigError` if a region is not inside the picture; warn if there are none."""
    camera = next((info for info in streams if info.is_camera), None)
    if camera is None:
        return
    if not config.regions:
        common.say(f"warning: {NO_REGIONS}")
    rows, cols = camera.shape
    for region in config.regions:
        if not region.is_within(camera.shape):
            raise ConfigError(
                f"region {region.name!r} reaches outside the picture of {cols} x {rows} pixels",
                fix="fieldkit roi check, then correct its points_px in fieldkit.toml",
            )


def _bytes_per_second(streams: Sequence[StreamInfo], sampling: Sampling) -> float:
    """How fast a session grows, journal and pictures together, uncompressed."""
    total = 0.0
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
    """Raise `StorageError` if the planned time, or any at all, does not fit the disk beside its reserve."""
    needed = needed_per_s * (planned_s or 0.0)
    if needed + reserve <= free:
        return
    lasts_min = max(0.0, free - reserve) / needed_per_s / 60
    raise StorageError(
        f"the disk has {formatting.size(free)} free and keeps {formatting.size(reserve)} in reserve; "
        f"this session needs "
        f"{formatting.size(needed_per_s * 60)} a minute: there is room for {lasts_min:.0f} min",
        fix='free some space, record for a shorter time, or use bursts: [record] sampling = "bursts"',
    )
