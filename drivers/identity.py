"""USB identities that survive a reboot and a replug, and fixes for permissions.

An identity is written ``vendor:product`` or ``vendor:product:serial`` (hexadecimal, as `lsusb`
prints them) or, for two look-alikes without serial numbers, the USB path of the socket
(``1-1.2``, as the kernel names it). Node numbers (`/dev/video0`, `/dev/ttyUSB0`) are never one.
"""

from __future__ import annotations

import grp
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

# --- what to type when an instrument may not be opened

UDEV_FIX = "fieldkit doctor --udev | sudo tee /etc/udev/rules.d/70-fieldkit.rules"


def permission_fix(group: str) -> str:
    """Commands that give access to a node of `group`; root is not a group to join."""
    rules = f"{UDEV_FIX}, then unplug and plug it"
    return rules if group == "root" else f"{rules}; or: sudo usermod -aG {group} $USER, then log in again"


def group_of(path: str) -> str:
    """The group of a node; ``dialout``, which most systems use, where it cannot be read."""
    try:
        return grp.getgrgid(os.stat(path).st_gid).gr_name
    except (OSError, KeyError):
        return "dialout"


SYSFS = Path("/sys")
_IDS = re.compile(r"([0-9a-fA-F]{4}):([0-9a-fA-F]{4})(?::(.+))?")


@dataclass(frozen=True, slots=True)
class UsbIdentity:
    """Identifiers of one USB instrument; `path` is its socket."""

    vendor: int
    product: int
    serial: str = ""
    path: str = ""
    title: str = ""

    def matches(self, wanted: str) -> bool:
        """Whether `wanted` (see the module) names this instrument."""
        found = _IDS.fullmatch(wanted)
        if found is None:
            return wanted == self.path
        vendor, product, serial = found.groups()
        same_kind = (int(vendor, 16), int(product, 16)) == (self.vendor, self.product)
        return same_kind and (serial is None or serial == self.serial)

    def as_text(self, present: Sequence[UsbIdentity] = ()) -> str:
        """The shortest identity that is unique among `present`."""
        kind = f"{self.vendor:04x}:{self.product:04x}"
        alike = [other for other in present if (other.vendor, other.product) == (self.vendor, self.product)]
        if self.serial and sum(other.serial == self.serial for other in alike) <= 1:
            return f"{kind}:{self.serial}"
        return kind if len(alike) <= 1 or not self.path else self.path


def identity_fix(name: str, present: Sequence[object]) -> str:
    """What to do when the instrument called `name` is not found among those `present`."""
    if not present:
        return "plug it in and switch it on; fieldkit devices shows what this computer sees"
    return f'write the right one into the configuration of {name}: identity = "..."'


def usb_parent(node: Path) -> UsbIdentity | None:
    """The USB device that a sysfs node (a tty, a video node) hangs on, or None."""
    for folder in (node, *node.parents):
        if (folder / "idVendor").is_file():
            return UsbIdentity(
                vendor=int(_line(folder / "idVendor"), 16),
                product=int(_line(folder / "idProduct"), 16),
                serial=_line(folder / "serial"),
                path=folder.name,
                title=f"{_line(folder / 'manufacturer')} {_line(folder / 'product')}".strip(),
            )
    return None


def _line(path: Path) -> str:
    try:
        return path.read_text(errors="replace").strip()
    except OSError:
        return ""
