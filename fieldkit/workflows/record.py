"""Record a session: open the instruments, check what would spoil it, record until the end.

`record` does all of it; `prepare` stops before the first sample, for those who attach views or need the
streams first.
"""

from __future__ import annotations

import logging
import shlex
import shutil
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime, time, timedelta
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from fieldkit.calibration.calibration_record import record_warnings
from fieldkit.config import Config, find_campaign, load_config
from fieldkit.drivers import registry
from fieldkit.estimation.estimator import Estimator, Minute
from fieldkit.estimation.instruments import Instruments as RadiationInstruments
from fieldkit.model.clock import Clock, HostClock
from fieldkit.model.device import Device, DeviceSettings, StreamInfo
from fieldkit.model.durations import as_seconds
from fieldkit.model.errors import ConfigError, DeviceError, DeviceNotFoundError, RefusedError, StorageError
from fieldkit.model.radiation import how_to_state, with_components
from fieldkit.model.site import Site
from fieldkit.model.units import SECOND_NS
from fieldkit.physics.sun import sun_vectors
from fieldkit.recorder import Recorder, Sampling, Summary, View
from fieldkit.recorder.marks import MarkInbox, marks_folder
from fieldkit.recorder.recorder import Shown
from fieldkit.sessions.layout import SessionHeader, journal_path
from fieldkit.sessions.lock import SessionLock
from fieldkit.sessions.writer import SessionWriter
from fieldkit.views import formatting
from fieldkit.workflows.running import session_in_progress
from fieldkit.workflows.session import Session, open_session

if TYPE_CHECKING:
    from fieldkit.workflows.campaign import Campaign

SIMULATED = "simulated"
OPEN_END_S = 8 * 3600.0
"""Length of a simulated scene where no duration is given."""
LOCK_NAME = ".recording"
"""File in ``recordings/`` that the recorder of a campaign holds locked, so that there is only one."""
NO_REGIONS = (
    "no regions are drawn: frames and readings are recorded, no slope is estimated. Find the beds on the "
    "report's image, add them with fieldkit roi add, then: fieldkit report SESSION --campaign"
)
Notify = Callable[[str], None]
log = logging.getLogger(__name__)


def record(
    campaign: Campaign | Config | str | Path = ".",
    *,
    duration: str | float | None = None,
    name: str = "",
    allow_missing: bool = False,
    on_minute: Callable[[Minute], None] | None = None,
    notify: Notify = log.warning,
) -> Session:
    """Record a session of a campaign and seal it; the session, open for reading.

    No signal handler is installed: an interrupt (Ctrl-C, "stop" of a notebook) ends the recording at once
    and keeps its journal, from which ``fieldkit recover`` finishes the session. ``fieldkit record`` seals
    on Ctrl-C.

    Parameters
    ----------
    campaign
        A campaign, its configuration, or a path in its folder.
    duration
        When to stop: ``"20m"``, ``"2h30"``, or a number of seconds. Without it, until interrupted.
    name
        Part of the file's name.
    allow_missing
        Record without instruments that are not plugged in.
    on_minute
        Called with each minute as it closes, from the recording thread; it must return at once. If it
        raises, it is not called again and the recording goes on.
    notify
        Receives warnings, such as of calibrations that are too old.

    Raises
    ------
    ConfigError
        No instruments are configured, or a region lies outside the frame.
    DeviceError
        An instrument cannot be opened.
    RefusedError
        The campaign is being recorded already.
    StorageError
        The disk is too small, cannot be written, or filled up; in the last case the session is sealed.
    """
    config = config_of(campaign)
    with prepare(
        config,
        name=name,
        duration_s=None if duration is None else as_seconds(duration),
        allow_missing=allow_missing,
        notify=notify,
    ) as prepared:
        recorded = prepared.run(() if on_minute is None else (MinuteView(on_minute),))
    if recorded.summary.failure is not None:
        raise recorded.summary.failure
    return open_session(recorded.path)


@dataclass(frozen=True, slots=True)
class RecordedSession:
    """A session that was recorded and sealed: its file, and how the recording went."""

    path: Path
    summary: Summary


@dataclass(frozen=True, slots=True)
class Instruments:
    """Opened devices, the clock that stamps their samples, how to reopen one, and the free disk space."""

    devices: tuple[Device, ...]
    clock: Clock
    reopen: Callable[[str], Device]
    free_bytes: Callable[[], int]

    @property
    def streams(self) -> tuple[StreamInfo, ...]:
        """What the devices declared."""
        return tuple(device.info for device in self.devices)

    def utc_ns(self) -> int:
        """Now, by the instruments' clock, nanoseconds since 1970."""
        return self.clock.to_utc_ns(self.clock.mono_ns())


@dataclass(frozen=True, slots=True)
class PreparedRecording:
    """A recording that can start: instruments open and checked, the session's path chosen."""

    config: Config
    instruments: Instruments
    path: Path
    name: str = ""
    duration_s: float | None = None

    def starting_now(self) -> PreparedRecording:
        """The same recording, its path named after the present time: call after waiting for the user."""
        return replace(self, path=session_path(self.config, self.name, self.instruments.utc_ns()))

    def run(
        self, views: Sequence[View] = (), *, stopping: threading.Event | None = None, command_line: str = ""
    ) -> RecordedSession:
        """Record until the planned end or until `stopping` is set, and seal; call once.

        `command_line` goes into the session's provenance. Raises `StorageError` if nothing can be stored;
        a disk that fills up later is in ``summary.failure``.
        """
        config, instruments = self.config, self.instruments
        start_ns = instruments.clock.mono_ns()
        header = header_of(config, self.name, instruments.streams, command_line)
        writer = SessionWriter(self.path, header, instruments.clock)
        marks = MarkInbox(marks_folder(self.path), instruments.clock)
        estimator = Estimator(config.site, config.regions, instruments.streams, config.estimator_settings())
        try:
            summary = Recorder(
                devices=instruments.devices,
                reopen=instruments.reopen,
                writer=writer,
                estimator=estimator,
                clock=instruments.clock,
                free_bytes=instruments.free_bytes,
                sampling=sampling_of(config),
                views=views,
                end_ns=None if self.duration_s is None else start_ns + round(self.duration_s * SECOND_NS),
                marks=marks,
                last_marks=marks.close,
                disk_reserve_bytes=disk_reserve_bytes(config),
                stopping=stopping or threading.Event(),
            ).run()
        finally:
            writer.abandon()  # no effect after sealing; otherwise the journal is kept for recovery
        return RecordedSession(self.path, summary)


@contextmanager
def prepare(
    config: Config,
    *,
    name: str = "",
    duration_s: float | None = None,
    until: time | None = None,
    allow_missing: bool = False,
    notify: Notify = log.warning,
) -> Iterator[PreparedRecording]:
    """Open a campaign's instruments, check that recording can start, and choose the session's path.

    `until` is a time of day at the site and replaces `duration_s`. Raises as `record`.
    """
    with (
        only_recorder(config.recordings),
        open_instruments(config, duration_s=duration_s, allow_missing=allow_missing) as instruments,
    ):
        if until is not None:
            duration_s = seconds_until(until, config.site, instruments.clock)
        preflight(config, instruments, duration_s, notify)
        path = session_path(config, name, instruments.utc_ns())
        yield PreparedRecording(config, instruments, path, name, duration_s)


def config_of(campaign: Campaign | Config | str | Path) -> Config:
    """The configuration of a campaign given as an object or as a path in its folder."""
    if isinstance(campaign, str | Path):
        return load_config(find_campaign(Path(campaign)))
    return campaign if isinstance(campaign, Config) else campaign.config


class MinuteView:
    """A view that calls a function with every minute that closes."""

    def __init__(self, on_minute: Callable[[Minute], None]) -> None:
        self._on_minute = on_minute

    def show(self, item: Shown) -> None:
        """Pass a minute on; ignore anything else."""
        if isinstance(item, Minute):
            self._on_minute(item)

    def close(self) -> None:
        """Nothing to close."""


# --- opening instruments


@contextmanager
def open_instruments(
    config: Config, *, duration_s: float | None = None, allow_missing: bool = False
) -> Iterator[Instruments]:
    """The campaign's instruments, real or simulated, opened together and closed at the end.

    Raises `DeviceError` with everything that would not open, `ConfigError` for none at all.
    """
    if not config.devices:
        raise ConfigError(
            "no instruments are configured",
            fix="fieldkit devices shows what is plugged in and what to write into fieldkit.toml",
        )
    free_here = partial(free_bytes, config.recordings)
    if not any(settings.port == SIMULATED for settings in config.devices):
        with _opened(config.devices, HostClock(), free_here, allow_missing) as opened:
            yield opened
        return
    from fieldkit.workflows.simulate import simulated_field

    with simulated_field(config, duration_s or OPEN_END_S) as (clock, field):
        plugged = [field.plug(settings) for settings in config.devices]
        with _opened(plugged, clock, lambda: field.disk_free_bytes(free_here()), allow_missing) as opened:
            yield opened


@contextmanager
def _opened(
    settings: Sequence[DeviceSettings], clock: Clock, free: Callable[[], int], allow_missing: bool
) -> Iterator[Instruments]:
    by_name = {one.name: one for one in settings}
    devices = open_all(settings, clock, allow_missing=allow_missing)
    try:
        yield Instruments(devices, clock, lambda name: registry.open_device(by_name[name], clock), free)
    finally:
        for device in devices:
            device.close()


def open_all(
    settings: Sequence[DeviceSettings], clock: Clock, *, allow_missing: bool = False
) -> tuple[Device, ...]:
    """Open every instrument before raising, so that one error lists all cables that are out.

    With `allow_missing` what is not plugged in is skipped. Raises `DeviceError`, or `ConfigError` for a
    single instrument whose options are wrong.
    """
    opened: list[Device] = []
    failed: list[ConfigError | DeviceError] = []
    with clock.taking_part():
        for one in settings:
            try:
                opened.append(registry.open_device(one, clock))
            except (ConfigError, DeviceError) as error:
                if not (allow_missing and isinstance(error, DeviceNotFoundError)):
                    failed.append(error)
    if failed:
        for device in opened:
            device.close()
        raise _together(failed)
    return tuple(opened)


def _together(failed: Sequence[ConfigError | DeviceError]) -> ConfigError | DeviceError:
    if len(failed) == 1:
        return failed[0]
    lines = "".join(
        f"\n  {error.message}" + (f"\n    fix: {error.fix}" if error.fix else "") for error in failed
    )
    return DeviceError(
        f"{len(failed)} instruments cannot be used:{lines}", fix="fieldkit doctor looks for causes"
    )


def free_bytes(folder: Path) -> int:
    """Free space on the disk that a folder is, or will be, on."""
    while not folder.exists():
        folder = folder.parent
    return shutil.disk_usage(folder).free


# --- one recorder, one path, one end


@contextmanager
def only_recorder(recordings: Path) -> Iterator[None]:
    """Be the one process that records in this campaign, from before its instruments are opened.

    Raises `RefusedError` while another one is, `StorageError` if the folder cannot be written.
    """
    _refuse_second(recordings)  # a recorder of an earlier version holds only its session's lock
    try:
        recordings.mkdir(parents=True, exist_ok=True)
        lock = SessionLock(recordings, LOCK_NAME)
    except RefusedError as error:
        _refuse_second(recordings)  # by the name of its session, once it has one
        raise _already_recorded(error.message) from error
    except OSError as error:
        raise StorageError(
            f"cannot record into {recordings}: {error.strerror}", fix="choose a folder that can be written"
        ) from error
    try:
        yield
    finally:
        lock.release()


def _refuse_second(recordings: Path) -> None:
    if (running := session_in_progress(recordings)) is not None:
        raise _already_recorded(running.name)


def _already_recorded(what: str) -> RefusedError:
    return RefusedError(
        f"this campaign is being recorded already: {what}",
        fix="fieldkit status shows it, fieldkit stop ends it",
    )


def session_path(config: Config, name: str, time_ns: int) -> Path:
    """Where a session that begins at `time_ns` (UTC) belongs: ``recordings/20261211T025512Z-name.h5``.

    With ``-2``, ``-3`` ... if that is taken, as by another run of the same simulated day. Raises
    `ConfigError` for a name with a slash: the file would lie where no command looks for sessions.
    """
    if "/" in name or "\\" in name:
        plain = name.replace("/", "-").replace("\\", "-")
        raise ConfigError(f"the name {name!r} has a slash", fix=f"--name {shlex.quote(plain)}")
    stamp = datetime.fromtimestamp(time_ns / SECOND_NS, UTC).strftime("%Y%m%dT%H%M%SZ")
    return _unused(config.recordings / (f"{stamp}-{name}.h5" if name else f"{stamp}.h5"))


def _unused(path: Path) -> Path:
    """The path, or the first ``-2``, ``-3`` ... beside it that does not exist: nothing is overwritten."""
    number, free = 1, path
    while free.exists() or journal_path(free).exists():
        number += 1
        free = path.with_name(f"{path.stem}-{number}.h5")
    return free


def seconds_until(time_of_day: time, site: Site, clock: Clock) -> float:
    """Seconds from now to the next time the site's clocks show `time_of_day`."""
    now = formatting.local_time(clock.to_utc_ns(clock.mono_ns()), site)
    end = now.replace(hour=time_of_day.hour, minute=time_of_day.minute, second=0, microsecond=0)
    if end <= now:
        end += timedelta(days=1)
    # by timestamps: local times differ by an hour more or less where clocks change in between
    return end.timestamp() - now.timestamp()


# --- preflight: what would spoil the session, found before it begins


def preflight(
    config: Config, instruments: Instruments, duration_s: float | None, notify: Notify = log.warning
) -> None:
    """Raise `ConfigError` or `StorageError` for what would spoil the session, before it begins.

    `notify` receives warnings: no regions, radiation that cannot be used, calibrations that are old or of
    another instrument.
    """
    streams = instruments.streams
    _check_regions(config, streams, notify)
    for name in config.tables.irradiance.measures.keys() - {info.name for info in streams}:
        notify(f"irradiance.measures.{name}: no instrument is called {name}")
    for name in RadiationInstruments(streams, config.estimator_settings()).unknown:
        notify(f"{name}: what it measures is not known, so it is not used; {how_to_state(name)}")
    needed = _bytes_per_second(streams, sampling_of(config))
    _check_space(needed, duration_s, instruments.free_bytes(), disk_reserve_bytes(config))
    now_ns = instruments.utc_ns()
    sun_vectors(now_ns, config.site)  # loads astropy's tables now: later it would hold up the recording
    now = datetime.fromtimestamp(now_ns / SECOND_NS, UTC)
    for key, calibration in config.calibrations().items():
        for warning in record_warnings(calibration, streams, now):
            notify(f"{key}: {warning}")


def _check_regions(config: Config, streams: Sequence[StreamInfo], notify: Notify) -> None:
    """Raise `ConfigError` if a region reaches outside the frame; warn if there are none."""
    camera = next((info for info in streams if info.is_camera), None)
    if camera is None:
        return
    if not config.regions:
        notify(NO_REGIONS)
    rows, cols = camera.shape
    for region in config.regions:
        if not region.is_within(camera.shape):
            raise ConfigError(
                f"region {region.name!r} reaches outside the frame of {cols} x {rows} pixels",
                fix="fieldkit roi check, then correct its points_px in fieldkit.toml",
            )


def _bytes_per_second(streams: Sequence[StreamInfo], sampling: Sampling) -> float:
    """How fast a session grows, journal and frames together, uncompressed."""
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
    """Raise `StorageError` if the planned duration, or any, does not fit the disk beside its reserve."""
    needed = needed_per_s * (planned_s or 0.0)
    if needed + reserve <= free:
        return
    lasts_min = max(0.0, free - reserve) / needed_per_s / 60
    raise StorageError(
        f"the disk has {formatting.size(free)} free and keeps {formatting.size(reserve)} in reserve; "
        f"this session needs {formatting.size(needed_per_s * 60)} a minute: "
        f"there is room for {lasts_min:.0f} min",
        fix='free some space, record for a shorter time, or use bursts: [record] sampling = "bursts"',
    )


# --- from the configuration to the recorder's own terms


def disk_reserve_bytes(config: Config) -> int:
    """Free space below which storing frames stops."""
    return round(config.alarms.disk_reserve_mb * 1e6)


def sampling_of(config: Config) -> Sampling:
    """Which frames the configuration keeps."""
    table = config.record
    every_s = table.every_s if table.sampling == "bursts" else None
    return Sampling(every_s, table.burst_frames, table.shutter_before_burst)


def header_of(config: Config, title: str, streams: Sequence[StreamInfo], command_line: str) -> SessionHeader:
    """What is known about the session before its first sample."""
    campaign = config.campaign
    return SessionHeader(
        title=title or campaign.title,
        site=config.site,
        streams=tuple(with_components(info, config.tables.irradiance.measures) for info in streams),
        regions=config.regions,
        config_toml=config.to_toml(),
        command_line=command_line,
        operator=campaign.operator,
        description=campaign.description,
        license=campaign.license,
        references=campaign.references,
    )
