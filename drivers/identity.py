"""USB identities that survive a reboot and a replug, and fixes for permissions.

An identity is written ``vendor:product`` or ``vendor:product:serial`` (hexadecimal, as `lsusb`
prints them) or, for two look-alikes without serial numbers, the USB path of the socket
(``1-1.2``, as the kernel names it). A port of an adapter that has several is named by its USB interface
behind that, as udev does: ``0403:6010:FT1-if01``. Node numbers (`/dev/video0`, `/dev/ttyUSB0`) are never one.
"""

from __future__ import annotations

import errno
import grp
import os
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from fieldkit.model.device import DeviceSettings, DiscoveredDevice
from fieldkit.model.errors import DeviceAccessError, DeviceLostError, DeviceNotFoundError
from fieldkit.model.next_step import Action, Text

# --- what to type when an instrument may not be opened

UDEV_FIX = Action.UDEV_RULES()


def permission_fix(group: str) -> Text:
    """Commands that give access to a node of `group`; root is not a group to join."""
    rules = UDEV_FIX + ", then unplug and plug it"
    return rules if group == "root" else rules + f"; or: sudo usermod -aG {group} $USER, then log in again"


def refusal(place: str, error: Exception, group: str, fix: Text) -> DeviceAccessError | None:
    """The error of what is there and may not be used, `fix` being to free it; None for another cause."""
    code = getattr(error, "errno", None)
    if code in (errno.EACCES, errno.EPERM):
        return DeviceAccessError(f"no permission (group {group})", place=place, fix=permission_fix(group))
    if code in (errno.EAGAIN, errno.EBUSY):
        return DeviceAccessError("used by another program", place=place, fix=fix)
    return None


def unplugged(place: str, problem: str) -> DeviceLostError:
    """The error of an instrument on a cable that was open and does not respond any more."""
    return DeviceLostError(problem, place=place, fix="plug it back in; it is opened again by identity")


def group_of(path: str) -> str:
    """The group of a node; ``dialout``, which most systems use, where it cannot be read."""
    try:
        return grp.getgrgid(os.stat(path).st_gid).gr_name
    except (OSError, KeyError):
        return "dialout"


SYSFS = Path("/sys")
_IDS = re.compile(r"([0-9a-fA-F]{4}):([0-9a-fA-F]{4})(?::(.+))?")
_INTERFACE = re.compile(r"-(if[0-9a-f]{2}(?:-port\d+)?)$")


@dataclass(frozen=True, slots=True)
class UsbIdentity:
    """Identifiers of one USB instrument; `path` is its socket, `interface` its place in the instrument."""

    vendor: int
    product: int
    serial: str = ""
    path: str = ""
    title: str = ""
    interface: str = ""

    def matches(self, wanted: str) -> bool:
        """True if `wanted` (see the module) names this instrument; without an interface, each port of it."""
        interface = _INTERFACE.search(wanted)
        if interface is not None:
            return interface[1] == self.interface and self.matches(wanted[: interface.start()])
        match = _IDS.fullmatch(wanted)
        if match is None:
            return wanted == self.path
        vendor, product, serial = match.groups()
        same_kind = (int(vendor, 16), int(product, 16)) == (self.vendor, self.product)
        return same_kind and (serial is None or serial == self.serial)

    def ports(self, present: Sequence[UsbIdentity]) -> list[UsbIdentity]:
        """Those of `present` that belong to the same instrument, each interface once."""
        return [usb for usb in dict.fromkeys(present) if usb == self or (usb.path and usb.path == self.path)]

    def as_text(self, present: Sequence[UsbIdentity] = ()) -> str:
        """The shortest identity that is unique among `present`."""
        kind = f"{self.vendor:04x}:{self.product:04x}"
        alike = [usb for usb in present if (usb.vendor, usb.product) == (self.vendor, self.product)]
        own = self.ports(alike)
        others = [usb for usb in alike if usb not in own]
        port = f"-{self.interface}" if len(own) > 1 else ""
        if self.serial and self.serial not in [other.serial for other in others]:
            return f"{kind}:{self.serial}{port}"
        return f"{self.path if others and self.path else kind}{port}"


Found: TypeAlias = tuple[str, UsbIdentity]
"""Path of a port or node, and what hangs on it."""
Kind: TypeAlias = tuple[int, int]
"""Vendor and product."""

NO_USB = UsbIdentity(0, 0)
"""Of an instrument that is none of USB's."""


def candidates(
    driver: str, title: str, present: Sequence[Found], kinds: Collection[Kind] | None, caveat: str = ""
) -> list[DiscoveredDevice]:
    """Those of `present` that are one of `kinds` (all if None) for `Driver.find`; `title` if one has none."""
    units = [usb for _, usb in present]
    return [
        DiscoveredDevice(driver, usb.as_text(units), path, usb.title or title, caveat)
        for path, usb in present
        if kinds is None or (usb.vendor, usb.product) in kinds
    ]


def only_one(settings: DeviceSettings, present: Sequence[Found], kinds: Sequence[Kind], what: str) -> Found:
    """The only one with the identity that `settings` name; without one, of `kinds`, or of all without those.

    Raises `DeviceNotFoundError` with all that is connected instead; `what` is it in words, such as
    "USB camera".
    """
    identity = settings.identity
    of = [
        (path, usb)
        for path, usb in present
        if (usb.matches(identity) if identity else not kinds or (usb.vendor, usb.product) in kinds)
    ]
    if len(of) == 1:
        return of[0]
    which = f"with identity {identity}" if identity else f"for the driver {settings.driver}"
    raise DeviceNotFoundError(
        f"{len(of) or 'no'} {what}s {which}; {listing(present, what)}",
        place=settings.name,
        fix=identity_fix(settings.name, present),
    )


def listing(present: Sequence[Found], what: str) -> str:
    """All that is connected, as text."""
    units = [usb for _, usb in present]
    names = [f"{usb.as_text(units)} at {path} ({usb.title})" for path, usb in present]
    return "connected: " + ", ".join(names) if names else f"no {what} is connected"


def identity_fix(name: str, present: Sequence[object]) -> Text:
    """Next step when the instrument called `name` is not found among those `present`."""
    if not present:
        return "plug it in and switch it on; " + Action.FIND_DEVICES() + " shows what this computer sees"
    return f'write the right one into the configuration of {name}: identity = "..."'


def usb_parent(node: Path) -> UsbIdentity | None:
    """The USB device that a sysfs node (a tty, a video node) hangs on, or None."""
    for folder in (node, *node.parents):
        if (folder / "idVendor").is_file():
            vendor, product = text_in(folder / "idVendor"), text_in(folder / "idProduct")
            if not (vendor and product):  # unplugged just now
                return None
            return UsbIdentity(
                vendor=int(vendor, 16),
                product=int(product, 16),
                serial=text_in(folder / "serial"),
                path=folder.name,
                title=f"{text_in(folder / 'manufacturer')} {text_in(folder / 'product')}".strip(),
                interface=_interface(node),
            )
    return None


def _interface(node: Path) -> str:
    """The USB interface of a node and, of several ports on one interface, which; as udev writes them."""
    numbers = (text_in(folder / "bInterfaceNumber") for folder in (node, *node.parents))
    port = text_in(node / "port_number")
    return next(
        (f"if{number}" + (f"-port{port}" if port not in ("", "0") else "") for number in numbers if number),
        "",
    )


def text_in(path: Path) -> str:
    """What stands in a file of the kernel's, empty where it cannot be read."""
    try:
        return path.read_text(errors="replace").strip()
    except OSError:
        return ""
