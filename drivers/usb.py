"""USB instruments without a kernel driver of their own, and vendor commands beside one that has, by pyusb.

pyusb is loaded when used; without it or libusb, nothing is found. Its exceptions end here.
"""

from __future__ import annotations

import errno
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from fieldkit.drivers.identity import Found, Kind, UsbIdentity, only_one, refusal, unplugged
from fieldkit.model.clock import Clock, time_left
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import DeviceError, DeviceTimeoutError

PATIENCE_S = 2.0


def usb_instruments(kinds: Sequence[Kind]) -> list[tuple[Any, UsbIdentity]]:
    """(pyusb device, identity) of every connected device that is one of `kinds`."""
    try:
        import usb.core

        present = list(usb.core.find(find_all=True))
    except (ImportError, ValueError, OSError):  # no pyusb, no libusb, or no permission
        return []
    return [(unit, _identity(unit)) for unit in present if (unit.idVendor, unit.idProduct) in kinds]


def usb_nodes(kinds: Sequence[Kind]) -> list[Found]:
    """(path, identity) of every connected device that is one of `kinds`."""
    return [(f"usb:{usb.path}", usb) for _, usb in usb_instruments(kinds)]


def pick_usb(settings: DeviceSettings, kinds: Sequence[Kind]) -> tuple[Any, UsbIdentity]:
    """The instrument that `settings` name, or the only one of `kinds`; raises `DeviceNotFoundError`."""
    units = usb_instruments(kinds)
    present = [(f"usb:{usb.path}", usb) for _, usb in units]
    chosen = only_one(settings, present, kinds, "USB instrument")
    return units[present.index(chosen)]


@contextmanager
def usb_errors(place: str) -> Iterator[None]:
    """Around pyusb calls: their errors become `DeviceAccessError`, `DeviceLostError` or `DeviceError`."""
    try:
        yield
    except DeviceError:
        raise
    except OSError as error:  # usb.core.USBError is one
        code = error.errno
        if cause := refusal(place, error, "plugdev", "close it, or unplug and plug it"):
            raise cause from error
        if code in (errno.ENODEV, errno.ENOENT, errno.EIO):
            raise unplugged(place, "the USB instrument is gone") from error
        raise DeviceError(
            f"the USB instrument refused: {error}", place=place, fix="unplug it and plug it in again"
        ) from error


def read_until(unit: Any, endpoint: int, size: int, timeout_ms: int) -> bytes:
    """Bytes of an endpoint, empty if none come within the time; raises `OSError`."""
    try:
        return bytes(unit.read(endpoint, size, timeout_ms))
    except OSError as error:
        if error.errno == errno.ETIMEDOUT:
            return b""
        raise


def await_ready(is_ready: Callable[[], bool], clock: Clock, place: str) -> None:
    """Ask until a camera has carried out a command; raises `DeviceTimeoutError` after `PATIENCE_S`."""
    for _ in time_left(clock, PATIENCE_S):
        if is_ready():
            return
        clock.sleep(0.001)
    raise DeviceTimeoutError("stays busy", place=place, fix="unplug it and plug it in again")


def _identity(unit: Any) -> UsbIdentity:
    socket = "-".join([str(unit.bus), ".".join(str(port) for port in unit.port_numbers or ())])
    return UsbIdentity(
        unit.idVendor, unit.idProduct, _text(unit, "serial_number"), socket, _text(unit, "product")
    )


def _text(unit: Any, name: str) -> str:
    """A string descriptor, empty where there is none or it may not be read."""
    try:
        return str(getattr(unit, name) or "")
    except (OSError, ValueError):
        return ""
