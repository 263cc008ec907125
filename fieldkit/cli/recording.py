"""From a configuration to a recording: what `record` and `demo` share.

Puts rooms together that do not know each other: devices, session, estimator, recorder.
"""

from __future__ import annotations

import shlex
import shutil
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from fieldkit.cli import common
from fieldkit.config import Config
from fieldkit.drivers import registry
from fieldkit.estimation.estimator import Estimator
from fieldkit.model.clock import Clock, HostClock
from fieldkit.model.device import Device, DeviceSettings, StreamInfo
from fieldkit.model.errors import ConfigError, DeviceError, DeviceNotFoundError
from fieldkit.model.radiation import with_components
from fieldkit.recorder import Recorder, Sampling, Summary, View
from fieldkit.recorder.marks import MarkInbox, marks_folder
from fieldkit.sessions.header import SessionHeader
from fieldkit.sessions.layout import journal_path
from fieldkit.sessions.writer import SessionWriter

SECOND_NS = 1_000_000_000
SIMULATED = "simulated"
OPEN_END_S = 8 * 3600.0
"""How long a simulated field lasts when nobody says."""


@dataclass(frozen=True, slots=True)
class Instruments:
    """Opened devices, the clock they are stamped by, how to find one again, and the disk as seen here."""

    devices: tuple[Device, ...]
    clock: Clock
    reopen: Callable[[str], Device]
    free_bytes: Callable[[], int]

    @property
    def streams(self) -> tuple[StreamInfo, ...]:
        """What the devices declared."""
        return tuple(device.info for device in self.devices)


@contextmanager
def instruments(
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
    real_free = partial(free_bytes, config.recordings)
    if not any(settings.port == SIMULATED for settings in config.devices):
        with _opened(config.devices, HostClock(), real_free, allow_missing) as opened:
            yield opened
        return
    from fieldkit.cli.simulation import simulated_field

    with simulated_field(config, duration_s or OPEN_END_S) as (clock, field):
        plugged = [field.plug(settings) for settings in config.devices]
        with _opened(plugged, clock, lambda: field.disk_free_bytes(real_free()), allow_missing) as opened:
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


def free_bytes(folder: Path) -> int:
    """Free space on the disk that a folder is, or will be, on."""
    while not folder.exists():
        folder = folder.parent
    return shutil.disk_usage(folder).free


def session_path(config: Config, name: str, time_ns: int) -> Path:
    """Where a session that begins at `time_ns` (UTC) belongs: ``recordings/20261211T025512Z-name.h5``.

    With ``-2``, ``-3`` ... where that is taken, as by another run of the same simulated day. Raises
    `ConfigError` for a name that would put it into another folder, where no other verb looks.
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


def open_all(
    settings: Sequence[DeviceSettings], clock: Clock, *, allow_missing: bool = False
) -> tuple[Device, ...]:
    """Open every instrument before complaining, so that one look tells which cables are out.

    With `allow_missing` what is not plugged in is left out. Raises `DeviceError`, or `ConfigError` for a
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
    lines = "".join(f"\n  {error}" + (f"\n    fix: {error.fix}" if error.fix else "") for error in failed)
    return DeviceError(
        f"{len(failed)} instruments cannot be used:{lines}", fix="fieldkit doctor looks for causes"
    )


def record_session(
    config: Config,
    tools: Instruments,
    path: Path,
    *,
    title: str = "",
    duration_s: float | None = None,
    views: Sequence[View] = (),
) -> Summary:
    """Record into `path` until the planned end or a signal; call `preflight` before.

    Raises `StorageError` when nothing can be stored.
    """
    with _stop_on_signals() as stopping:  # from before there is anything that must be sealed
        start_ns = tools.clock.mono_ns()
        writer = SessionWriter(path, header_of(config, title, tools.streams), tools.clock)
        marks = MarkInbox(marks_folder(path), tools.clock)
        try:
            return Recorder(
                devices=tools.devices,
                reopen=tools.reopen,
                writer=writer,
                estimator=Estimator(config.site, config.regions, tools.streams, config.estimator_settings()),
                clock=tools.clock,
                free_bytes=tools.free_bytes,
                sampling=sampling_of(config),
                views=views,
                end_ns=None if duration_s is None else start_ns + round(duration_s * SECOND_NS),
                marks=marks,
                last_marks=marks.close,
                disk_reserve_bytes=disk_reserve_bytes(config),
                stopping=stopping,
            ).run()
        except KeyboardInterrupt:
            common.say(f"\nstopped at once; the journal is kept. next: fieldkit recover {path}")
            raise
        finally:
            writer.abandon()  # whatever ended the recording without sealing it


def disk_reserve_bytes(config: Config) -> int:
    """Free space below which pictures stop."""
    return round(config.alarms.disk_reserve_mb * 1e6)


def sampling_of(config: Config) -> Sampling:
    """Which pictures the configuration keeps."""
    record = config.record
    every_s = record.every_s if record.sampling == "bursts" else None
    return Sampling(every_s, record.burst_frames, record.shutter_before_burst)


def header_of(config: Config, title: str, streams: Sequence[StreamInfo]) -> SessionHeader:
    """What is known about the session before its first sample."""
    campaign = config.campaign
    return SessionHeader(
        title=title or campaign.title,
        site=config.site,
        streams=tuple(with_components(info, config.tables.irradiance.measures) for info in streams),
        regions=config.regions,
        config_toml=config.to_toml(),
        command_line=shlex.join(["fieldkit", *sys.argv[1:]]),
        operator=campaign.operator,
        description=campaign.description,
        license=campaign.license,
        references=campaign.references,
    )


@contextmanager
def _stop_on_signals() -> Iterator[threading.Event]:
    """Ctrl-C, SIGTERM and SIGHUP ask to seal the session; a second Ctrl-C stops at once."""
    stopping = threading.Event()

    def stop(number: int, frame: object) -> None:
        if number == signal.SIGINT:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        stopping.set()

    before = {
        number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    }
    try:
        yield stopping
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
