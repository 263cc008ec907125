"""Open a campaign's instruments together, real or simulated, and close them at the end.

Each is opened and closed in a thread of its own: a driver that hangs is named, given up and left behind.
"""

from __future__ import annotations

import logging
import shutil
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, wait
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from threading import enumerate as enumerate_threads

from fieldkit.config import Config
from fieldkit.drivers import registry
from fieldkit.model.clock import Clock, HostClock
from fieldkit.model.device import Device, DeviceSettings, StreamInfo
from fieldkit.model.errors import (
    ConfigError,
    DeviceError,
    DeviceNotFoundError,
    DeviceTimeoutError,
    FieldkitError,
)
from fieldkit.model.next_step import Action, Sentence
from fieldkit.phrases import Words
from fieldkit.recorder import daemon

SIMULATED = "simulated"
NAMED_AFTER_S = 10.0
CLOSED_WITHIN_S = 2.0
MOST_HANGING = 3
"""Threads left behind in a driver that hangs; the instrument is opened again once one has come back."""
OPEN_END_S = 8 * 3600.0
"""Length of a simulated scene where no duration is given."""
log: logging.Logger = logging.getLogger(__name__)


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
            Words("error.no_instruments"),
            place=config.path,
            fix=Action.ADD_DEVICES() + " writes what is plugged in into fieldkit.toml",
        )
    clock: Clock = HostClock()
    by_name = {settings.name: settings for settings in config.devices}
    space_left: Callable[[int], int] = int  # all of it, unless a simulated fault takes it away
    with ExitStack() as opened:
        if any(settings.port == SIMULATED for settings in config.devices):
            from fieldkit.recording.simulated_scene import simulated_field

            simulation = simulated_field(config, duration_s or OPEN_END_S, simulated_from_ns)
            clock, field = opened.enter_context(simulation)
            by_name = {name: field.plug(settings) for name, settings in by_name.items()}
            space_left = field.disk_free_bytes
        devices = open_all(tuple(by_name.values()), clock, allow_missing=allow_missing)
        opened.callback(_close_all, devices)
        # a simulated clock would stand still while another thread opens the instrument; no cable is simulated
        reopen = open_in_time if clock.is_real else registry.open_device
        recordings = config.recordings  # asked every second
        yield Instruments(
            devices,
            clock,
            reopen=lambda name: reopen(by_name[name], clock),
            free_bytes=lambda: space_left(free_bytes(recordings)),
        )


def open_all(
    settings: Sequence[DeviceSettings], clock: Clock, *, allow_missing: bool = False
) -> tuple[Device, ...]:
    """Open every instrument before raising, so that one error lists all cables that are out.

    With `allow_missing` what is not plugged in or does not come back is skipped. Raises `DeviceError`, or
    `ConfigError` for a single instrument whose options are wrong.
    """
    devices: list[Device] = []
    failed: list[ConfigError | DeviceError] = []
    try:
        for setting in settings:
            try:
                devices.append(open_in_time(setting, clock))
            except (ConfigError, DeviceError) as error:
                if not (allow_missing and isinstance(error, DeviceNotFoundError | HangingDriverError)):
                    failed.append(error)
                    continue
                log.warning("going on without it: %s", error.message)
        if failed:
            raise together(failed)
    except BaseException:
        _close_all(devices)
        raise
    return tuple(devices)


class HangingDriverError(DeviceTimeoutError):
    """A driver has not come back from opening its instrument."""


def open_in_time(settings: DeviceSettings, clock: Clock) -> Device:
    """Open an instrument; named after 10 s, given up after its `connect_timeout_s`, in real time.

    Raises as `registry.open_device`, `HangingDriverError`, and `DeviceError` for whatever else its driver
    raises. What is opened later all the same is closed at once. While `MOST_HANGING` earlier attempts have
    not come back there is no other.
    """
    limit_s, name = settings.connect_timeout_s, f"open-{settings.name}"
    hanging = HangingDriverError(
        Words("error.hanging", driver=settings.driver, seconds=f"{limit_s:g}"),
        place=settings.name,
        fix=Words("fix.replug"),
    )
    if sum(thread.name == name for thread in enumerate_threads()) >= MOST_HANGING:
        raise hanging
    opening = daemon.start(partial(_open, settings, clock), name)
    try:
        if not wait([opening], min(NAMED_AFTER_S, limit_s)).done and limit_s > NAMED_AFTER_S:
            log.warning("%s: still opening it after %g s", settings.name, NAMED_AFTER_S)
            wait([opening], limit_s - NAMED_AFTER_S)
        if not opening.done():
            raise hanging
    except BaseException:  # given up, or interrupted
        opening.add_done_callback(_close_late)
        raise
    return opening.result()


def _open(settings: DeviceSettings, clock: Clock) -> Device:
    with clock.taking_part():
        try:
            return registry.open_device(settings, clock)
        except FieldkitError:
            raise
        except BaseException as error:  # another package's code may fail in any way, also by SystemExit
            log.info("the driver %s failed", settings.driver, exc_info=True)
            raise DeviceError(
                Words("error.driver_failed", driver=settings.driver, error=repr(error)),
                place=settings.name,
                fix=Words("fix.replug"),
            ) from error


def _close_late(opening: Future[Device]) -> None:
    if opening.exception() is None:
        _close(opening.result())


def _close_all(devices: Sequence[Device]) -> None:
    """Close each device in a thread of its own, which is left behind if its driver hangs."""
    closing = [daemon.start(partial(_close, device), f"close-{device.info.name}") for device in devices]
    wait(closing, CLOSED_WITHIN_S)


def _close(device: Device) -> None:
    try:
        device.close()
    except BaseException as error:
        log.warning("%s: closing it failed: %r", device.info.name, error)


def together(failed: Sequence[ConfigError | DeviceError]) -> ConfigError | DeviceError:
    """One error that shows what is wrong with each of several instruments."""
    if len(failed) == 1:
        return failed[0]
    each = ["\n  " + error.explanation + ("\n    fix: " + error.fix if error.fix else "") for error in failed]
    problem = Sentence((f"{len(failed)} instruments cannot be used:", *each))
    error = DeviceError(problem, fix=Action.DOCTOR() + " shows the causes")
    error.causes = failed
    return error


def free_bytes(folder: Path) -> int:
    """Free space on the disk that a folder is, or will be, on."""
    while not folder.exists():
        folder = folder.parent
    return shutil.disk_usage(folder).free
