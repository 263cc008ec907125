"""Open a campaign's instruments together, real or simulated, and close them at the end."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from fieldkit.config import Config
from fieldkit.drivers import registry
from fieldkit.model.clock import Clock, HostClock
from fieldkit.model.device import Device, DeviceSettings, StreamInfo
from fieldkit.model.errors import ConfigError, DeviceError, DeviceNotFoundError
from fieldkit.model.next_step import Action, Sentence

SIMULATED = "simulated"
OPEN_END_S = 8 * 3600.0
"""Length of a simulated scene where no duration is given."""


@dataclass(frozen=True, slots=True)
class Instruments:
    """Opened devices, the clock that stamps their samples, how to reopen one, and the free disk space."""

    devices: tuple[Device, ...]
    clock: Clock
    reopen: Callable[[str], Device]
    free_bytes: Callable[[], int]

    @property
    def streams(self) -> tuple[StreamInfo, ...]:
        """Declarations of the devices."""
        return tuple(device.info for device in self.devices)

    def utc_ns(self) -> int:
        """Now, by the instruments' clock, nanoseconds since 1970."""
        return self.clock.to_utc_ns(self.clock.mono_ns())


@contextmanager
def open_instruments(
    config: Config,
    *,
    duration_s: float | None = None,
    allow_missing: bool = False,
    simulated_from_ns: int | None = None,
) -> Iterator[Instruments]:
    """The campaign's instruments, real or simulated, opened together and closed at the end.

    `simulated_from_ns` is where the clock of a simulated field goes on that was open before.

    Raises `DeviceError` with everything that would not open, `ConfigError` for none at all.
    """
    if not config.devices:
        raise ConfigError(
            "no instruments are configured",
            fix=Action.ADD_DEVICES() + " writes what is plugged in into fieldkit.toml",
        )
    free_here = partial(free_bytes, config.recordings)
    if not any(settings.port == SIMULATED for settings in config.devices):
        with _open_together(config.devices, HostClock(), free_here, allow_missing) as opened:
            yield opened
        return
    from fieldkit.recording.simulated_scene import simulated_field

    with simulated_field(config, duration_s or OPEN_END_S, simulated_from_ns) as (clock, field):
        plugged = [field.plug(settings) for settings in config.devices]
        with _open_together(
            plugged, clock, lambda: field.disk_free_bytes(free_here()), allow_missing
        ) as opened:
            yield opened


@contextmanager
def _open_together(
    settings: Sequence[DeviceSettings], clock: Clock, free: Callable[[], int], allow_missing: bool
) -> Iterator[Instruments]:
    by_name = {setting.name: setting for setting in settings}
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
        for setting in settings:
            try:
                opened.append(registry.open_device(setting, clock))
            except (ConfigError, DeviceError) as error:
                if not (allow_missing and isinstance(error, DeviceNotFoundError)):
                    failed.append(error)
    if failed:
        for device in opened:
            device.close()
        raise together(failed)
    return tuple(opened)


def together(failed: Sequence[ConfigError | DeviceError]) -> ConfigError | DeviceError:
    """One error that shows what is wrong with each of several instruments."""
    if len(failed) == 1:
        return failed[0]
    each = ["\n  " + error.explanation + ("\n    fix: " + error.fix if error.fix else "") for error in failed]
    problem = Sentence((f"{len(failed)} instruments cannot be used:", *each))
    return DeviceError(problem, fix=Action.DOCTOR() + " shows the causes")


def free_bytes(folder: Path) -> int:
    """Free space on the disk that a folder is, or will be, on."""
    while not folder.exists():
        folder = folder.parent
    return shutil.disk_usage(folder).free
