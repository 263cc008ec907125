"""Check that this computer is ready for a day in the field: one line per check, problems with a fix."""

from __future__ import annotations

import platform
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from pathlib import Path

from fieldkit.calibration.calibration_record import expiry_warnings, validity
from fieldkit.config import Config, NoCampaignError, find_campaign, load_config
from fieldkit.drivers import registry
from fieldkit.drivers.discovery import check_instruments, is_connected
from fieldkit.drivers.identity import text_in
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import ConfigError, DeviceError, DeviceNotFoundError, FieldkitError
from fieldkit.model.finding import Finding
from fieldkit.model.installation import DISTRIBUTION
from fieldkit.model.next_step import Action
from fieldkit.model.version import __version__
from fieldkit.phrases import counted
from fieldkit.recording.opening import open_in_time
from fieldkit.recording.preflight import STATE_UNIT, UNKNOWN_UNIT

POWER = Path("/sys/class/power_supply")
LOW_BATTERY_PERCENT = 50
LITTLE_DISK_GB = 2.0
RELEASED_S = 1_760_000_000
"""October 2025: a clock that shows an earlier time was never set."""
FULL_SUN_LX = 130_000


def doctor(folder: str | Path = ".") -> list[Finding]:
    """Check programs, instruments, clock, disk, power, and the configuration of the campaign around `folder`.

    An instrument is opened only where its configuration leaves open what it measures.

    Examples
    --------
    >>> [check.text for check in fieldkit.doctor("sandslope") if check.what == "configuration"]
    ['3 instruments, 4 regions']
    """
    return [result for check in CHECKS for result in check(Path(folder))]


def udev_rules(folder: Path) -> str:
    """The udev rules, with a name for each instrument of the campaign that has a serial number."""
    text = files("fieldkit").joinpath("data/70-fieldkit.rules").read_text(encoding="utf-8")
    return text + "".join(_name_rule(device) for device in _devices(folder))


def _name_rule(device: DeviceSettings) -> str:
    """``/dev/fieldkit/NAME`` for an instrument with a serial number."""
    parts = device.identity.split(":")
    if len(parts) != 3:
        return ""
    subsystem = (
        'SUBSYSTEM=="video4linux", ATTR{index}=="0"' if device.name == "camera" else 'SUBSYSTEM=="tty"'
    )
    ids = f'ATTRS{{idVendor}}=="{parts[0].lower()}", ATTRS{{idProduct}}=="{parts[1].lower()}"'
    return f'{subsystem}, {ids}, ATTRS{{serial}}=="{parts[2]}", SYMLINK+="fieldkit/{device.name}"\n'


def _devices(folder: Path) -> tuple[DeviceSettings, ...]:
    try:
        return load_config(find_campaign(folder)).devices
    except FieldkitError:
        return ()


def _programs(folder: Path) -> Iterator[Finding]:
    names = ("h5py", "pyserial", "pyusb")
    versions = ", ".join(f"{name} {version(name)}" for name in names)
    text = f"python {platform.python_version()}, fieldkit {__version__}, {versions}"
    yield Finding("ok", "program", text)
    with suppress(PackageNotFoundError):
        text = f"another project's package, fieldkit {version('fieldkit')}, is imported by the same name"
        yield Finding("fail", "program", text, f"pip uninstall fieldkit, then install {DISTRIBUTION} again")


def _instruments(folder: Path) -> Iterator[Finding]:
    yield from check_instruments(configured=_devices(folder))


def _clock(folder: Path) -> Iterator[Finding]:
    if time.time() < RELEASED_S:
        now = time.strftime("%Y-%m-%d %H:%M", time.gmtime())
        yield Finding(
            "fail", "clock", f"shows {now} UTC and was never set", "sudo date -u -s '2026-01-31 12:00'"
        )
    level, text, fix = SYNCHRONISATION[_is_clock_synchronised()]
    yield Finding(level, "clock", text, fix)


SYNCHRONISATION = {
    None: ("warn", "synchronisation is unknown", "sudo apt install chrony"),
    True: ("ok", "synchronised", ""),
    False: ("warn", "not synchronised", "go online once, or give the computer a GPS receiver"),
}
"""Level, text and next step by whether the clock is synchronised."""


def _is_clock_synchronised() -> bool | None:
    """True if the system clock is synchronised, by timedatectl; None without that program."""
    try:
        status = subprocess.run(
            ["timedatectl", "show", "--property=NTPSynchronized", "--value"],
            capture_output=True, text=True, timeout=5, check=True,
        )  # fmt: skip
    except (OSError, subprocess.SubprocessError):
        return None
    return status.stdout.strip() == "yes"


def _disk(folder: Path) -> Iterator[Finding]:
    free_gb = shutil.disk_usage(folder).free / 1e9
    if free_gb < LITTLE_DISK_GB:
        yield Finding(
            "warn", "disk", f"{free_gb:.1f} GB free in {folder}", "make room, or use another disk with -C DIR"
        )
    else:
        yield Finding("ok", "disk", f"{free_gb:.0f} GB free in {folder}")


def _power(folder: Path) -> Iterator[Finding]:
    for battery in sorted(POWER.glob("BAT*")):
        percent, state = (text_in(battery / name) or "unknown" for name in ("capacity", "status"))
        text = f"{percent} %, {state.lower()}"
        low = percent.isdigit() and int(percent) < LOW_BATTERY_PERCENT and state == "Discharging"
        fix = "charge it, or take a power bank; three hours of sun drain a laptop" if low else ""
        yield Finding("warn" if low else "ok", f"battery {battery.name}", text, fix)


def _configuration(folder: Path) -> Iterator[Finding]:
    try:
        config = load_config(find_campaign(folder))
    except FieldkitError as error:
        level = "warn" if isinstance(error, NoCampaignError) else "fail"
        yield Finding(level, "configuration", error.message, error.fix or "")
        return
    contents = f"{counted(len(config.devices), 'instrument')}, {counted(len(config.regions), 'region')}"
    if config.devices:
        yield Finding("ok", "configuration", contents)
    else:
        fix = Action.ADD_DEVICES() + " writes what is plugged in into fieldkit.toml"
        yield Finding("warn", "configuration", f"{contents}: there is nothing to record", fix)
    for device in config.devices:
        yield from _instrument_findings(device)
    yield from _calibrations(config)


def _calibrations(config: Config) -> Iterator[Finding]:
    """Checks of the active calibration records and their age; no instrument is opened here."""
    for key, record in config.calibrations().items():
        if issues := expiry_warnings(record, datetime.now(UTC)):
            yield Finding("warn", key, "; ".join(issues), Action.CALIBRATE(record.kind))
        else:
            yield Finding("ok", key, f"of {record.date:%Y-%m-%d}, for {validity(record)}")


def _instrument_findings(device: DeviceSettings) -> Iterator[Finding]:
    """Presence of a configured instrument, and what its configuration lacks."""
    driver = registry.get(device.driver)
    if device.port != "simulated" and device.identity:
        identities = {plugged.identity for plugged in driver.find()}
        present = device.identity in identities or is_connected(device.identity)
        level, text = ("ok", "plugged in") if present else ("fail", f"{device.identity} is not plugged in")
        yield Finding(level, device.name, text, "" if present else Action.FIND_DEVICES())
    elif device.port.startswith("/") and not Path(device.port).exists():
        yield Finding("fail", device.name, f"there is no {device.port}", Action.FIND_DEVICES())
    if registry.needs(device.driver).keys() - device.options.keys():
        yield from _declaration_findings(device)
    if driver.quantity == "illuminance" and device.name == "lux" and "range_max_lx" not in device.options:
        text = "the meter's range is not configured, so an overflow cannot be detected"
        yield Finding(
            "warn", device.name, text, f"range_max_lx = ... in [lux]; full sun is about {FULL_SUN_LX} lx"
        )


def _declaration_findings(device: DeviceSettings) -> Iterator[Finding]:
    """Refuse what `record` refuses: an instrument that does not state what it measures, nor its options."""
    try:
        with closing(open_in_time(device, HostClock())) as opened:
            unit = opened.info.unit
    except ConfigError as error:
        yield Finding("fail", device.name, error.message, error.fix or "")
    except DeviceNotFoundError:
        return
    except DeviceError as error:
        yield Finding("warn", device.name, f"its unit is not known: {error.message}", error.fix or "")
    else:
        if not unit:
            yield Finding("fail", device.name, UNKNOWN_UNIT, STATE_UNIT)


CHECKS: tuple[Callable[[Path], Iterator[Finding]], ...] = (
    _programs,
    _instruments,
    _clock,
    _disk,
    _power,
    _configuration,
)
