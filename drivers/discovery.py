"""May the instruments be used, and is anything in their way? Facts for `fieldkit doctor`, each with its fix.

Only looked at, never opened: a meter must not be disturbed by a check.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

from fieldkit.drivers import registry
from fieldkit.drivers.cameras import thermal_master
from fieldkit.drivers.cameras.source import cameras
from fieldkit.drivers.identity import SYSFS, UDEV_FIX, UsbIdentity, permission_fix, usb_parent
from fieldkit.drivers.meters import ut325
from fieldkit.drivers.ports import serial_ports

# --- what is connected

UNKNOWN = "no driver of fieldkit's"


@dataclass(frozen=True, slots=True)
class ConnectedDevice:
    """One thing on a cable; `drivers` take it for their own, `remark` says why they are not sure."""

    identity: str
    port: str
    title: str
    drivers: tuple[str, ...]
    remark: str = ""


def plugged_in() -> tuple[list[ConnectedDevice], list[str]]:
    """(instruments, adapters and cameras that are there; problems with drivers that could not be loaded)."""
    drivers, problems = registry.load_all()
    things: dict[tuple[str, str], ConnectedDevice] = {}
    for driver in drivers:
        for found in driver.find():
            key = (found.identity, found.port)
            before = things.get(key)
            names = (*(before.drivers if before else ()), found.driver)
            remark = "only the instrument's answer tells which" if before else found.doubt
            things[key] = ConnectedDevice(found.identity, found.port, found.title, names, remark)
    known = {thing.port for thing in things.values()}
    others = [
        *_strangers(cameras(), known, "y16 reads it if it has Y16"),
        *_strangers(serial_ports(), known, UNKNOWN),
    ]
    return [*things.values(), *others], problems


def _strangers(present: list[tuple[str, UsbIdentity]], known: set[str], remark: str) -> list[ConnectedDevice]:
    everybody = [usb for _, usb in present]
    return [
        ConnectedDevice(usb.written(everybody), path, usb.title, (), remark)
        for path, usb in present
        if path not in known
    ]


PROC = Path("/proc")
UDEV_DATA = Path("/run/udev/data")
VENDOR_COMMANDS = ((0x0BDA, 0x5830), (0x0BDA, 0x5840))
"""Cameras that take commands through the raw USB node, beside the video node."""

RAW_ONLY = (*thermal_master.KINDS, *ut325.KINDS)
"""Instruments that have nothing but the raw USB node."""

SLOW_LATENCY_MS = 2


@dataclass(frozen=True, slots=True)
class Fact:
    """One thing looked at: `level` ok, warn or fail, what it is about, and the next step."""

    level: str
    what: str
    text: str
    fix: str = ""


def look(sysfs: Path = SYSFS) -> Iterator[Fact]:
    """Everything about cameras and serial ports of this computer."""
    found_cameras, found_ports = cameras(), serial_ports()
    raw_only = list(_raw_nodes(sysfs, RAW_ONLY))
    yield from _libraries()
    if not found_cameras and not any(_is_camera(usb) for usb, _ in raw_only):
        yield Fact(
            "warn", "camera", "no USB camera is plugged in", "plug it in; lsusb shows whether it arrives"
        )
    for path, usb in found_cameras:
        yield _may_use(path, usb, "video")
        yield from _raw_node(usb, sysfs)
        yield from _sleeps(path, usb, sysfs)
    for usb, node in raw_only:
        yield _may_use(node, usb, "plugdev")
    if not found_ports:
        yield Fact("warn", "serial port", "no USB serial port is there", "plug the meter's adapter in")
    for path, usb in found_ports:
        yield _may_use(path, usb, "dialout")
        yield from _latency(path, sysfs)
        yield from _sleeps(path, usb, sysfs)
    yield _modem_manager([path for path, _ in found_ports])


def is_connected(identity: str, sysfs: Path = SYSFS) -> bool:
    """Whether an instrument or serial adapter of that identity is there."""
    with_nodes = (usb for _, usb in (*cameras(), *serial_ports()))
    raw_only = (usb for usb, _ in _raw_nodes(sysfs, RAW_ONLY))
    return any(usb.matches(identity) for usb in (*with_nodes, *raw_only))


def _is_camera(usb: UsbIdentity) -> bool:
    return (usb.vendor, usb.product) in thermal_master.KINDS


def _libraries() -> Iterator[Fact]:
    try:
        import usb.backend.libusb1

        present = usb.backend.libusb1.get_backend() is not None
    except ImportError:
        present = False
    if present:
        yield Fact("ok", "libusb", "there, for the commands of cameras that need it")
    else:
        yield Fact(
            "warn",
            "libusb",
            "missing: P2 Pro commands, P1/P3 cameras, UT325",
            "sudo apt install libusb-1.0-0",
        )


def _may_use(path: str, usb: UsbIdentity, group: str) -> Fact:
    name = f"{path} ({usb.title or usb.written()})"
    if not os.path.exists(path):
        return Fact("fail", name, "the kernel knows it, but there is no node", "sudo udevadm trigger")
    if os.access(path, os.R_OK | os.W_OK):
        return Fact("ok", name, f"may be used; identity {usb.written()}")
    return Fact("fail", name, "you may not use it", permission_fix(group))


def _raw_node(usb: UsbIdentity, sysfs: Path) -> Iterator[Fact]:
    """Cameras with vendor commands need a second right, to the raw USB node."""
    for other, node in _raw_nodes(sysfs, VENDOR_COMMANDS):
        if other.path != usb.path:
            continue
        if os.access(node, os.W_OK):
            yield Fact("ok", node, "camera commands may be sent")
        else:
            yield Fact("warn", node, "camera commands may not be sent; pictures still work", UDEV_FIX)


def _raw_nodes(sysfs: Path, kinds: Collection[tuple[int, int]]) -> Iterator[tuple[UsbIdentity, str]]:
    """(who, path of the node) of every USB device that is one of `kinds`."""
    for folder in sorted((sysfs / "bus/usb/devices").glob("*-*")):
        usb = usb_parent(folder)
        if usb is None or usb.path != folder.name or (usb.vendor, usb.product) not in kinds:
            continue  # interfaces and other instruments
        try:
            bus, number = (int((folder / name).read_text()) for name in ("busnum", "devnum"))
        except (OSError, ValueError):
            continue
        yield usb, f"/dev/bus/usb/{bus:03d}/{number:03d}"


def _sleeps(path: str, usb: UsbIdentity, sysfs: Path) -> Iterator[Fact]:
    try:
        control = (sysfs / "bus/usb/devices" / usb.path / "power/control").read_text().strip()
    except OSError:
        return
    if control != "on":
        yield Fact("warn", path, "the kernel may put it to sleep (autosuspend)", UDEV_FIX)


def _latency(path: str, sysfs: Path) -> Iterator[Fact]:
    try:
        timer_ms = int((sysfs / "class/tty" / Path(path).name / "device/latency_timer").read_text())
    except (OSError, ValueError):
        return
    if timer_ms > SLOW_LATENCY_MS:
        yield Fact("warn", path, f"the adapter holds bytes for {timer_ms} ms", UDEV_FIX)


def _modem_manager(paths: list[str]) -> Fact:
    if not any(_comm(folder) == "ModemManager" for folder in PROC.glob("[0-9]*")):
        return Fact("ok", "ModemManager", "does not run")
    bothered = [path for path in paths if not _is_left_alone(path)]
    if bothered:
        return Fact("warn", "ModemManager", f"runs and may talk into {', '.join(bothered)}", UDEV_FIX)
    return Fact("ok", "ModemManager", "runs and is told to keep off")


def _comm(folder: Path) -> str:
    try:
        return (folder / "comm").read_text().strip()
    except OSError:
        return ""


def _is_left_alone(path: str) -> bool:
    """Whether udev's record of the port tells ModemManager to ignore it."""
    try:
        number = os.stat(path).st_rdev
        record = (UDEV_DATA / f"c{os.major(number)}:{os.minor(number)}").read_text()
    except OSError:
        return False
    return "ID_MM_PORT_IGNORE=1" in record or "ID_MM_DEVICE_IGNORE=1" in record
