"""Find a camera by its USB identity and open its video node, by V4L2 or, said openly, by OpenCV.

The node is found through sysfs, never by number: index 0 of an interface is the picture, index 1 metadata.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fieldkit.drivers import options
from fieldkit.drivers.cameras.opencv import OpenCvSource
from fieldkit.drivers.cameras.v4l2 import V4l2Source
from fieldkit.drivers.identity import SYSFS, UsbIdentity, right_one_fix, usb_parent
from fieldkit.model.clock import Clock
from fieldkit.model.device import DeviceSettings, Found, FrameSource
from fieldkit.model.errors import DeviceNotFoundError


@dataclass(frozen=True, slots=True)
class Wanted:
    """What a family's camera looks like: USB kinds, raw format, (width, height) by preference."""

    kinds: tuple[tuple[int, int], ...]
    fourcc: str
    sizes: tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class OpenedSource:
    """A source, and who it is."""

    source: FrameSource
    usb: UsbIdentity
    identity: str


def cameras(sysfs: Path = SYSFS) -> list[tuple[str, UsbIdentity]]:
    """(path, identity) of the picture node of every USB camera."""
    found: list[tuple[str, UsbIdentity]] = []
    for node in sorted(
        (sysfs / "class/video4linux").glob("video*"), key=lambda node: (len(node.name), node.name)
    ):
        usb = usb_parent(node.resolve())
        if usb is not None and _index(node) == 0:
            found.append((f"/dev/{node.name}", usb))
    return found


def find_cameras(driver: str, title: str, wanted: Wanted, doubt: str = "") -> list[Found]:
    """Plugged-in cameras of the wanted kinds."""
    present = cameras()
    return [
        Found(driver, usb.written([other for _, other in present]), path, usb.title or title, doubt)
        for path, usb in present
        if (usb.vendor, usb.product) in wanted.kinds
    ]


def open_source(settings: DeviceSettings, wanted: Wanted, clock: Clock) -> OpenedSource:
    """The source that `settings` give or name; raises `DeviceNotFoundError` or `DeviceAccessError`.

    Option `backend`: ``v4l2``, ``opencv``, or ``auto`` (V4L2 on Linux, OpenCV elsewhere).
    """
    if settings.source is not None:
        return OpenedSource(settings.source, UsbIdentity(0, 0), settings.identity)
    backend = options.text(settings, "backend", "auto", ("auto", "v4l2", "opencv"))
    present = cameras()
    path, usb = _pick(settings, wanted, present)
    direct = backend == "v4l2" or (backend == "auto" and sys.platform == "linux")
    reader = V4l2Source if direct else OpenCvSource
    identity = usb.written([other for _, other in present]) if usb.vendor else settings.identity
    return OpenedSource(reader(path, wanted.fourcc, wanted.sizes, clock), usb, identity)


def _pick(
    settings: DeviceSettings, wanted: Wanted, present: list[tuple[str, UsbIdentity]]
) -> tuple[str, UsbIdentity]:
    """The node that identity or port name; another camera in its place is an error, not a fallback."""
    if settings.identity:
        fitting = [(path, usb) for path, usb in present if usb.matches(settings.identity)]
    elif settings.port:
        real = os.path.realpath(settings.port)
        fitting = [(path, usb) for path, usb in present if path == real] or [
            (settings.port, UsbIdentity(0, 0))
        ]
    else:
        fitting = [(path, usb) for path, usb in present if (usb.vendor, usb.product) in wanted.kinds]
    if len(fitting) == 1:
        return fitting[0]
    what = f"with identity {settings.identity}" if settings.identity else f"for the driver {settings.driver}"
    raise DeviceNotFoundError(
        f"{settings.name}: {len(fitting) or 'no'} cameras {what}; {listing(present)}",
        fix=right_one_fix(settings.name, present),
    )


def listing(present: Sequence[tuple[str, UsbIdentity]]) -> str:
    """What is plugged in, in words."""
    everybody = [usb for _, usb in present]
    names = [f"{usb.written(everybody)} at {path} ({usb.title})" for path, usb in present]
    return "plugged in: " + ", ".join(names) if names else "no USB camera is plugged in"


def _index(node: Path) -> int:
    try:
        return int((node / "index").read_text())
    except (OSError, ValueError):
        return -1
