"""Discovery of connected instruments, and of what keeps them from being used.

`find_devices` lists them, `check_instruments` reports permissions and what may interfere, each problem with
its fix. Nothing is opened: a check must not disturb a meter.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from fieldkit.drivers import registry
from fieldkit.drivers.cameras import thermal_master
from fieldkit.drivers.cameras.source import WITHOUT_TEMPERATURES, cameras
from fieldkit.drivers.identity import SYSFS, UDEV_FIX, Found, Kind, UsbIdentity, permission_fix, usb_parent
from fieldkit.drivers.meters import ut325
from fieldkit.drivers.ports import serial_ports
from fieldkit.model.device import DeviceSettings, DiscoveredDevice, Driver
from fieldkit.model.errors import message_of
from fieldkit.model.finding import Finding

PROC = Path("/proc")
UDEV_DATA = Path("/run/udev/data")
VENDOR_COMMANDS = ((0x0BDA, 0x5830), (0x0BDA, 0x5840))
"""Cameras that take commands through the raw USB node, beside the video node."""

RAW_ONLY = (*thermal_master.KINDS, *ut325.KINDS)
"""Instruments that have only the raw USB node."""

SLOW_LATENCY_MS = 2
NO_DRIVER = "no fieldkit driver"

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, repr=False)
class ConnectedDevice:
    """An instrument, adapter or camera on a cable.

    `identity` is what to write into the configuration. `drivers` are those that recognise it; `note` says why
    they cannot be sure, or is empty.
    """

    identity: str
    port: str
    title: str
    drivers: tuple[str, ...]
    note: str = ""

    def __repr__(self) -> str:
        drivers = " or ".join(self.drivers) or NO_DRIVER
        note = f" ({self.note})" if self.note and self.drivers else ""
        return f"<{self.title or 'device'} [{self.identity}] at {self.port}: {drivers}{note}>"


def find_devices() -> list[ConnectedDevice]:
    """All connected instruments, serial adapters and cameras; drivers that cannot be loaded are logged.

    Examples
    --------
    >>> for device in fieldkit.find_devices():
    ...     print(device.identity, device.port, device.title)
    10c4:ea60:A7 /dev/ttyUSB0 CP2102
    """
    devices, problems = discover()
    for problem in problems:
        _log.warning("%s", problem)
    return devices


def discover() -> tuple[list[ConnectedDevice], list[str]]:
    """(connected devices, problems with drivers that cannot be loaded)."""
    drivers, problems = registry.load_all()
    devices: dict[tuple[str, str], ConnectedDevice] = {}
    for driver in drivers:
        for found in _devices_of(driver, problems):
            key = (found.identity, found.port)
            before = devices.get(key)
            names = (*(before.drivers if before else ()), found.driver)
            note = "only the instrument's reply shows which" if before else found.caveat
            devices[key] = ConnectedDevice(found.identity, found.port, found.title, names, note)
    recognised = {device.port for device in devices.values()}
    others = [
        *_other_devices(cameras(), recognised, "y16 reads it if it has Y16"),
        *_other_devices(serial_ports(), recognised, NO_DRIVER),
    ]
    return [*devices.values(), *others], problems


def _devices_of(driver: Driver, problems: list[str]) -> list[DiscoveredDevice]:
    """The instruments of a driver; what keeps it from looking is a problem of its own, not of the others."""
    try:
        return driver.find()
    except Exception as error:  # another package's code may fail in any way
        problems.append(
            f"the driver {driver.name!r} finds nothing: {type(error).__name__}: {message_of(error)}"
        )
        return []


def _other_devices(present: list[Found], recognised: set[str], note: str) -> list[ConnectedDevice]:
    units = [usb for _, usb in present]
    return [
        ConnectedDevice(
            usb.as_text(units), path, usb.title, (), WITHOUT_TEMPERATURES.get((usb.vendor, usb.product), note)
        )
        for path, usb in present
        if path not in recognised
    ]


def is_device(device: ConnectedDevice, settings: DeviceSettings) -> bool:
    """True if a configured instrument is this one: by identity, by port, or else by a driver alone."""
    if settings.identity:
        usb = (usb for path, usb in (*cameras(), *serial_ports()) if path == device.port)
        return settings.identity == device.identity or any(own.matches(settings.identity) for own in usb)
    if settings.port:
        return os.path.realpath(settings.port) == os.path.realpath(device.port)
    return settings.driver in device.drivers


def is_connected(identity: str, sysfs: Path = SYSFS) -> bool:
    """True if an instrument or serial adapter with this identity is connected."""
    with_nodes = (usb for _, usb in (*cameras(), *serial_ports()))
    raw_only = (usb for usb, _ in _raw_nodes(sysfs, RAW_ONLY))
    return any(usb.matches(identity) for usb in (*with_nodes, *raw_only))


# --- can they be used?


def check_instruments(sysfs: Path = SYSFS) -> Iterator[Finding]:
    """Check the cameras and serial ports of this computer."""
    found_cameras, found_ports = cameras(), serial_ports()
    raw_only = list(_raw_nodes(sysfs, RAW_ONLY))
    yield from _libraries()
    if not found_cameras and not any(_is_camera(usb) for usb, _ in raw_only):
        yield Finding(
            "warn", "camera", "no USB camera is connected", "connect it; lsusb shows whether it is detected"
        )
    for path, usb in found_cameras:
        yield _permission(path, usb, "video")
        yield from _raw_node(usb, sysfs)
        yield from _autosuspend(path, usb, sysfs)
    for usb, node in raw_only:
        yield _permission(node, usb, "plugdev")
    if not found_ports:
        yield Finding("warn", "serial port", "no USB serial port is connected", "connect the meter's adapter")
    for path, usb in found_ports:
        yield _permission(path, usb, "dialout", [usb for _, usb in found_ports])
        yield from _latency(path, sysfs)
        yield from _autosuspend(path, usb, sysfs)
    yield _modem_manager([path for path, _ in found_ports])


def _is_camera(usb: UsbIdentity) -> bool:
    return (usb.vendor, usb.product) in thermal_master.KINDS


def _libraries() -> Iterator[Finding]:
    try:
        import usb.backend.libusb1

        present = usb.backend.libusb1.get_backend() is not None
    except ImportError:
        present = False
    if present:
        yield Finding("ok", "libusb", "installed, for cameras and meters that need it")
    else:
        yield Finding(
            "warn",
            "libusb",
            "missing: needed by P2 Pro commands, P1/P3 cameras, UT325",
            "sudo apt install libusb-1.0-0",
        )


def _permission(path: str, usb: UsbIdentity, group: str, present: Sequence[UsbIdentity] = ()) -> Finding:
    name = f"{path} ({usb.title or usb.as_text()})"
    if not os.path.exists(path):
        return Finding(
            "fail", name, "detected by the kernel, but its device node is missing", "sudo udevadm trigger"
        )
    if os.access(path, os.R_OK | os.W_OK):
        return Finding("ok", name, f"ready; identity {usb.as_text(present)}")
    return Finding("fail", name, "permission denied", permission_fix(group))


def _raw_node(usb: UsbIdentity, sysfs: Path) -> Iterator[Finding]:
    """Cameras with vendor commands need a second permission, for the raw USB node."""
    for other, node in _raw_nodes(sysfs, VENDOR_COMMANDS):
        if other.path != usb.path:
            continue
        if os.access(node, os.W_OK):
            yield Finding("ok", node, "camera commands available")
        else:
            yield Finding("warn", node, "no permission for camera commands; frames still work", UDEV_FIX)


def _raw_nodes(sysfs: Path, kinds: Collection[Kind]) -> Iterator[tuple[UsbIdentity, str]]:
    """(identity, node path) of each USB device that is one of `kinds`."""
    for folder in sorted((sysfs / "bus/usb/devices").glob("*-*")):
        usb = usb_parent(folder)
        if usb is None or usb.path != folder.name or (usb.vendor, usb.product) not in kinds:
            continue  # interfaces and other instruments
        try:
            bus, number = (int((folder / name).read_text()) for name in ("busnum", "devnum"))
        except (OSError, ValueError):
            continue
        yield usb, f"/dev/bus/usb/{bus:03d}/{number:03d}"


def _autosuspend(path: str, usb: UsbIdentity, sysfs: Path) -> Iterator[Finding]:
    try:
        control = (sysfs / "bus/usb/devices" / usb.path / "power/control").read_text().strip()
    except OSError:
        return
    if control != "on":
        yield Finding("warn", path, "the kernel may suspend it (autosuspend)", UDEV_FIX)


def _latency(path: str, sysfs: Path) -> Iterator[Finding]:
    try:
        timer_ms = int((sysfs / "class/tty" / Path(path).name / "device/latency_timer").read_text())
    except (OSError, ValueError):
        return
    if timer_ms > SLOW_LATENCY_MS:
        yield Finding("warn", path, f"the adapter holds bytes for {timer_ms} ms", UDEV_FIX)


def _modem_manager(paths: list[str]) -> Finding:
    if not any(_comm(folder) == "ModemManager" for folder in PROC.glob("[0-9]*")):
        return Finding("ok", "ModemManager", "not running")
    exposed = [path for path in paths if not _is_ignored(path)]
    if exposed:
        return Finding("warn", "ModemManager", f"running; it may probe {', '.join(exposed)}", UDEV_FIX)
    return Finding("ok", "ModemManager", "running; the udev rules keep it off the ports")


def _comm(folder: Path) -> str:
    try:
        return (folder / "comm").read_text().strip()
    except OSError:
        return ""


def _is_ignored(path: str) -> bool:
    """True if the udev rules make ModemManager ignore the port."""
    try:
        number = os.stat(path).st_rdev
        record = (UDEV_DATA / f"c{os.major(number)}:{os.minor(number)}").read_text()
    except OSError:
        return False
    return "ID_MM_PORT_IGNORE=1" in record or "ID_MM_DEVICE_IGNORE=1" in record
