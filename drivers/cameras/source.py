"""Find a camera by its USB identity and open its video node, by V4L2 or by OpenCV.

The node is found through sysfs, never by number: index 0 of an interface is the frame, index 1 metadata.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fieldkit.drivers import options
from fieldkit.drivers.cameras.v4l2 import V4l2Source
from fieldkit.drivers.identity import (
    NO_USB,
    SYSFS,
    Found,
    Kind,
    UsbIdentity,
    candidates,
    only_one,
    unplugged,
    usb_parent,
)
from fieldkit.drivers.opening import close_on_failure
from fieldkit.model.clock import Clock
from fieldkit.model.device import Buffer, DeviceSettings, DiscoveredDevice, FrameSource
from fieldkit.model.errors import DeviceError, DeviceNotFoundError
from fieldkit.model.next_step import Action

_STOPPED = "the camera stopped sending frames"
_ANOTHER_CAMERA = "use another camera, or import what the maker's program records: " + Action.IMPORT()

# --- OpenCV, where there is no Video4Linux or the configuration selects it


class OpenCvSource:
    """A camera by OpenCV, raw; see `fieldkit.model.device.FrameSource`.

    `port` is a video node's path, or elsewhere than on Linux the camera's number. A frame is
    recognised by its byte count, never by the shape OpenCV reports: 4.11 returns raw frames as one row.
    OpenCV waits up to ten seconds by itself, whatever the timeout.
    """

    backend = "opencv"

    def __init__(self, port: str, fourcc: str, sizes: Sequence[tuple[int, int]], clock: Clock) -> None:
        import cv2

        self.port = port
        self._clock = clock
        self._capture = cv2.VideoCapture()
        for size in sizes:
            if self._start(fourcc, size):
                self.size = size
                return
        self.close()
        raise DeviceNotFoundError(
            f"OpenCV gets no raw {fourcc.strip()} frame",
            place=port,
            fix="close other programs that use the camera; " + Action.FIND_DEVICES() + " shows what there is",
        )

    def read(self, timeout_s: float) -> Buffer | None:
        """The next frame; raises `DeviceLostError` when OpenCV gets none any more."""
        good, image = self._capture.read()
        if not good:
            raise unplugged(self.port, _STOPPED)
        return Buffer(image.tobytes(), self._stamp_ns())

    def skip_until(self, mono_ns: int) -> None:
        """Grab frames without fetching them until a monotonic time."""
        while self._clock.mono_ns() < mono_ns:
            if not self._capture.grab():
                raise unplugged(self.port, _STOPPED)

    def set_zoom(self, value: int) -> None:
        """Write the absolute zoom, which some cameras take as a command."""
        import cv2

        if not self._capture.set(cv2.CAP_PROP_ZOOM, float(value)):
            raise DeviceError(f"refused zoom command {value:#06x}", place=self.port)

    def close(self) -> None:
        """Release the camera; a second call does nothing."""
        self._capture.release()

    def _start(self, fourcc: str, size: tuple[int, int]) -> bool:
        """Open and set in the order that works; changing the format restarts the stream."""
        import cv2

        capture, code = self._capture, cv2.VideoWriter.fourcc(*fourcc.ljust(4))
        linux = sys.platform == "linux"
        where = self.port if linux or not self.port.isdigit() else int(self.port)
        if not capture.open(where, cv2.CAP_V4L2 if linux else cv2.CAP_ANY):
            return False
        for key, value in (
            (cv2.CAP_PROP_CONVERT_RGB, 0),
            (cv2.CAP_PROP_FOURCC, code),
            (cv2.CAP_PROP_FRAME_WIDTH, size[0]),
            (cv2.CAP_PROP_FRAME_HEIGHT, size[1]),
            (cv2.CAP_PROP_CONVERT_RGB, 0),
        ):
            capture.set(key, value)
        good, image = capture.read()
        return bool(good) and image.nbytes == 2 * size[0] * size[1]

    def _stamp_ns(self) -> int:
        """The kernel's stamp where the backend passes it on, else now."""
        import cv2

        now_ns = self._clock.mono_ns()
        stamp_ns = int(self._capture.get(cv2.CAP_PROP_POS_MSEC) * 1e6)
        return stamp_ns if 0 <= now_ns - stamp_ns < 10_000_000_000 else now_ns


@dataclass(frozen=True, slots=True)
class CameraFormat:
    """A family's USB kinds, raw format, (width, height) by preference.

    `otherwise` is what a camera of these kinds without these sizes is, where others share the identity.
    """

    kinds: tuple[Kind, ...]
    fourcc: str
    sizes: tuple[tuple[int, int], ...]
    otherwise: str = ""


NO_FORMAT = CameraFormat((), "", ())


class CameraDriver:
    """Base of the drivers of cameras; a family without a `video` format is not looked for."""

    name: str
    title: str
    quantity = "brightness_temperature"
    video: CameraFormat = NO_FORMAT
    caveat = ""
    noise_k: float = 0.1
    """Of a pixel in one frame: the makers of microbolometers state less."""

    def find(self) -> list[DiscoveredDevice]:
        """Connected cameras of the family."""
        return candidates(self.name, self.title, cameras(), self.video.kinds, self.caveat)


def cannot_command(source: FrameSource) -> DeviceError:
    """The error of a source that has no way to send this camera its commands."""
    return DeviceError(
        f"cannot be commanded through {source.backend}", place=source.port, fix='set backend = "v4l2" for it'
    )


@dataclass(frozen=True, slots=True)
class OpenedSource:
    """A source and its identity."""

    source: FrameSource
    identity: str
    usb: UsbIdentity = NO_USB

    def __post_init__(self) -> None:
        close_on_failure(self.source.close)


WITHOUT_TEMPERATURES = {
    (0x04B4, 0x0100): "an InfiRay T2S+ of the second version sends uncorrected data, not temperatures"
}
"""Cameras that are refused, and why, whatever their frames look like; by USB kind."""


def cameras(sysfs: Path = SYSFS) -> list[Found]:
    """(path, identity) of the frame node of every USB camera."""
    nodes: list[Found] = []
    for node in sorted(
        (sysfs / "class/video4linux").glob("video*"), key=lambda node: (len(node.name), node.name)
    ):
        usb = usb_parent(node.resolve())
        if usb is not None and _index(node) == 0:
            nodes.append((f"/dev/{node.name}", usb))
    return nodes


def open_source(settings: DeviceSettings, video: CameraFormat, clock: Clock) -> OpenedSource:
    """The source that `settings` give or name; raises `DeviceNotFoundError` or `DeviceAccessError`.

    Option `backend`: ``v4l2``, ``opencv``, or ``auto`` (V4L2 on Linux, OpenCV elsewhere).
    """
    if settings.source is not None:
        return OpenedSource(settings.source, settings.identity)
    backend = options.text(settings, "backend", "auto", ("auto", "v4l2", "opencv"))
    present = cameras()
    path, usb = _pick(settings, video, present)
    if reason := WITHOUT_TEMPERATURES.get((usb.vendor, usb.product)):
        raise DeviceNotFoundError(reason, place=settings.name, fix=_ANOTHER_CAMERA)
    direct = backend == "v4l2" or (backend == "auto" and sys.platform == "linux")
    reader = V4l2Source if direct else OpenCvSource
    identity = usb.as_text([other for _, other in present]) if usb.vendor else settings.identity
    try:
        return OpenedSource(reader(path, video.fourcc, video.sizes, clock), identity, usb)
    except DeviceNotFoundError as error:
        if not video.otherwise or (usb.vendor, usb.product) not in video.kinds:
            raise
        raise DeviceNotFoundError(
            error.problem + f": {video.otherwise}", place=error.place, fix=_ANOTHER_CAMERA
        ) from error


def _pick(settings: DeviceSettings, video: CameraFormat, present: list[Found]) -> Found:
    """The node that identity or port name; another camera in its place is an error, not a fallback."""
    if settings.port and not settings.identity:
        real = os.path.realpath(settings.port)
        return next(((path, usb) for path, usb in present if path == real), (settings.port, NO_USB))
    return only_one(settings, present, video.kinds, "USB camera")


def _index(node: Path) -> int:
    try:
        return int((node / "index").read_text())
    except (OSError, ValueError):
        return -1
