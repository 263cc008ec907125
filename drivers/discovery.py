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
from fieldkit.drivers.cameras.source import NO_FORMAT, WITHOUT_TEMPERATURES, cameras
from fieldkit.drivers.identity import (
    SYSFS,
    UDEV_FIX,
    Found,
    Kind,
    UsbIdentity,
    permission_fix,
    text_in,
    usb_parent,
)
from fieldkit.drivers.meters import ut325
from fieldkit.drivers.ports import SerialDriver, serial_ports
from fieldkit.model.device import DeviceSettings, DiscoveredDevice, Driver
from fieldkit.model.errors import message_of
from fieldkit.model.finding import Finding

PROC = Path("/proc")
UDEV_DATA = Path("/run/udev/data")
VENDOR_COMMANDS = ((0x0BDA, 0x5830), (0x0BDA, 0x5840))
"""Cameras that take commands through the raw USB node, beside the video node."""

RAW_ONLY = (*thermal_master.KINDS, *ut325.KINDS)
"""Instruments that have only the raw USB node."""

ADAPTERS = (
    ("ch341", 0x1A86, (0x5523, 0x7522, 0x7523)),
    ("ch341", 0x4348, (0x5523,)),
    ("cp210x", 0x10C4, (0xEA60, 0xEA61, 0xEA63, 0xEA70, 0xEA71)),
    ("ftdi_sio", 0x0403, (0x6001, 0x6010, 0x6011, 0x6014, 0x6015)),
    ("pl2303", 0x067B, (0x2303, 0x2304, 0x23A3, 0x23B3, 0x23C3, 0x23D3, 0x23E3, 0x23F3)),
)
"""Kernel modules of serial adapters, with vendor and products; others are of a USB class, cdc_acm's."""
MODULES = {(vendor, product): module for module, vendor, products in ADAPTERS for product in products}
BRLTTY_RULES = Path("/usr/lib/udev/rules.d")
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
    for taken in _adapters_without_port(SYSFS, serial_ports()):
        problems.append(f"{taken.what}: {taken.text}; {taken.fix}")
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


def check_instruments(sysfs: Path = SYSFS, configured: Sequence[DeviceSettings] = ()) -> Iterator[Finding]:
    """Check the cameras and serial ports of this computer; `configured` ones elsewhere are not missed."""
    found_cameras, found_ports = cameras(), serial_ports()
    raw_only = list(_raw_nodes(sysfs, RAW_ONLY))
    yield _libraries()
    without_port = list(_adapters_without_port(sysfs, found_ports))
    kinds = [_connection(settings) for settings in configured]
    elsewhere = any(is_camera for _, is_camera in kinds) and ("USB video", True) not in kinds
    if not (found_cameras or elsewhere or any(_raw_nodes(sysfs, thermal_master.KINDS))):
        yield Finding(
            "warn", "camera", "no USB camera is connected", "connect it; lsusb shows whether it is detected"
        )
    for path, usb in found_cameras:
        yield _permission(path, usb, "video")
        yield from _raw_node(usb, sysfs)
        yield from _autosuspend(path, usb, sysfs)
    for usb, node in raw_only:
        yield _permission(node, usb, "plugdev")
    yield from without_port
    if not (found_ports or without_port) and (not kinds or "USB serial" in dict(kinds)):
        yield Finding("warn", "serial port", "no USB serial port is connected", "connect the meter's adapter")
    for path, usb in found_ports:
        yield _permission(path, usb, "dialout", [usb for _, usb in found_ports])
        yield from _latency(path, sysfs)
        yield from _autosuspend(path, usb, sysfs)
    yield _modem_manager([path for path, _ in found_ports])


def _connection(settings: DeviceSettings) -> tuple[str, bool]:
    """How an instrument is connected, "" in the network or simulated; and whether it is a camera."""
    driver = registry.get(settings.driver)
    is_camera = driver.quantity in ("brightness_temperature", "counts")
    if settings.port and not settings.port.startswith("/"):
        return "", is_camera
    if getattr(driver, "video", NO_FORMAT).fourcc:
        return "USB video", is_camera
    return "USB serial" if isinstance(driver, SerialDriver) else "", is_camera


def _libraries() -> Finding:
    try:
        import usb.backend.libusb1

        present = usb.backend.libusb1.get_backend() is not None
    except ImportError:
        present = False
    if present:
        return Finding("ok", "libusb", "installed, for cameras and meters that need it")
    text = "missing: needed by P2 Pro commands, P1/P3 cameras, UT325"
    return Finding("warn", "libusb", text, "sudo apt install libusb-1.0-0")


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
    for usb, folder in _usb_devices(sysfs):
        if (usb.vendor, usb.product) in kinds and (node := _raw_path(folder)):
            yield usb, node


def _usb_devices(sysfs: Path) -> Iterator[tuple[UsbIdentity, Path]]:
    """Every USB device with its folder, without those of its interfaces."""
    for folder in sorted((sysfs / "bus/usb/devices").glob("*-*")):
        usb = usb_parent(folder)
        if usb is not None and usb.path == folder.name:
            yield usb, folder


def _raw_path(folder: Path) -> str:
    """The raw node of a USB device; empty if it is unplugged."""
    bus, number = text_in(folder / "busnum"), text_in(folder / "devnum")
    return f"/dev/bus/usb/{bus.zfill(3)}/{number.zfill(3)}" if bus and number else ""


def _adapters_without_port(sysfs: Path, found_ports: Sequence[Found]) -> Iterator[Finding]:
    """Serial adapters that the kernel sees and that have no port, with what has taken them."""
    for usb, folder in _usb_devices(sysfs):
        interfaces = [*folder.parent.glob(f"{folder.name}:*")]
        is_cdc = any("ic02isc02" in text_in(interface / "modalias") for interface in interfaces)
        module = MODULES.get((usb.vendor, usb.product), "cdc_acm" if is_cdc else "")
        if module and usb.path not in {other.path for _, other in found_ports}:
            text, fix = _why_no_port(module, folder, interfaces)
            yield Finding("fail", usb.title or usb.as_text(), f"{usb.as_text()} has no port: {text}", fix)


def _why_no_port(module: str, folder: Path, interfaces: Sequence[Path]) -> tuple[str, str]:
    """What keeps an adapter from having a port, and the command that frees it."""
    is_brltty = _is_running("brltty") or any(BRLTTY_RULES.glob("*brltty*"))
    if is_brltty and module != "cdc_acm":
        text, fix = "brltty takes it for a Braille display", "if you have none: sudo apt remove brltty"
    elif "usbfs" in {(interface / "driver").resolve().name for interface in interfaces}:
        text, fix = "another program has it", f"close what sudo fuser -v {_raw_path(folder)} names"
    else:
        text, fix = f"the kernel's driver {module} is not in use", f"sudo modprobe {module}"
    return text, f"{fix}, then unplug and plug it"


def _autosuspend(path: str, usb: UsbIdentity, sysfs: Path) -> Iterator[Finding]:
    if text_in(sysfs / "bus/usb/devices" / usb.path / "power/control") not in ("", "on"):
        yield Finding("warn", path, "the kernel may suspend it (autosuspend)", UDEV_FIX)


def _latency(path: str, sysfs: Path) -> Iterator[Finding]:
    timer_ms = text_in(sysfs / "class/tty" / Path(path).name / "device/latency_timer")
    if timer_ms.isdigit() and int(timer_ms) > SLOW_LATENCY_MS:
        yield Finding("warn", path, f"the adapter holds bytes for {timer_ms} ms", UDEV_FIX)


def _modem_manager(paths: list[str]) -> Finding:
    if not _is_running("ModemManager"):
        return Finding("ok", "ModemManager", "not running")
    exposed = [path for path in paths if not _is_ignored(path)]
    if exposed:
        return Finding("warn", "ModemManager", f"running; it may probe {', '.join(exposed)}", UDEV_FIX)
    return Finding("ok", "ModemManager", "running; the udev rules keep it off the ports")


def _is_running(program: str) -> bool:
    return any(text_in(folder / "comm") == program for folder in PROC.glob("[0-9]*"))


def _is_ignored(path: str) -> bool:
    """True if the udev rules make ModemManager ignore the port."""
    try:
        number = os.stat(path).st_rdev
        record = (UDEV_DATA / f"c{os.major(number)}:{os.minor(number)}").read_text()
    except OSError:
        return False
    return "ID_MM_PORT_IGNORE=1" in record or "ID_MM_DEVICE_IGNORE=1" in record
