"""A small direct reader of Linux video nodes: raw bytes, kernel stamp, sequence number, error flag.

OpenCV gives neither the sequence number nor the flag.
"""

from __future__ import annotations

import ctypes
import errno
import fcntl
import heapq
import mmap
import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

from fieldkit.drivers.cameras import videodev2 as api
from fieldkit.drivers.permission import permission_fix
from fieldkit.model.clock import Clock
from fieldkit.model.device import Buffer
from fieldkit.model.errors import DeviceAccessError, DeviceError, DeviceLostError, DeviceNotFoundError

BUFFERS = 32  # the most there are: a second of a 30 Hz camera before a busy computer costs a picture
OVERTAKEN_NS = 750_000_000
"""How long to wait for a picture that later ones have overtaken.

The kernel's UVC driver copies the parts of pictures in several workers at once; one that is kept waiting on a
busy computer finishes its picture after those of the others.
"""


class V4l2Source:
    """A video node that streams one raw format; see `fieldkit.model.device.FrameSource`.

    `sizes` are (width, height) in order of preference; the first one the camera offers is taken.
    Raises `DeviceNotFoundError` (no such node, or it lacks the format) or `DeviceAccessError`.
    """

    backend = "v4l2"

    def __init__(self, path: str, fourcc: str, sizes: Sequence[tuple[int, int]], clock: Clock) -> None:
        self.port = path
        self._clock = clock
        self._maps: list[mmap.mmap] = []
        self._fd = -1
        self._early: list[tuple[int, Buffer]] = []  # a heap of pictures by number
        self._next, self._last_ns = -1, 0
        try:
            self._fd = os.open(path, os.O_RDWR | os.O_NONBLOCK)
            self._need_capture()
            self.size = self._choose(fourcc, sizes)
            self._start()
        except OSError as error:
            self.close()
            raise _failure(path, error) from error
        except DeviceError:
            self.close()
            raise

    def read(self, timeout_s: float) -> Buffer | None:
        """The next picture in the order they were taken, or None; raises `DeviceLostError`.

        One that comes after its successors have been passed on is marked as an error.
        """
        end_ns = self._clock.mono_ns() + int(timeout_s * 1e9)
        while (picture := self._due()) is None:
            now_ns = self._clock.mono_ns()
            until_ns = min(end_ns, self._last_ns + OVERTAKEN_NS) if self._early else end_ns
            try:
                arrived = self._arrived(max(until_ns - now_ns, 0) / 1e9)
            except DeviceLostError:
                if not self._early:
                    raise
                self._last_ns = now_ns - OVERTAKEN_NS  # what is missing will not come any more
                continue
            if arrived is not None:
                heapq.heappush(self._early, (arrived.sequence, arrived))
            elif until_ns == end_ns:
                return None
        return picture

    def skip_until(self, mono_ns: int) -> None:
        """Give every buffer back unread until a monotonic time."""
        self._early.clear()
        self._next = -1
        while (remaining_ns := mono_ns - self._clock.mono_ns()) > 0:
            taken = self._dequeue(remaining_ns / 1e9)
            if taken is not None:
                self._call(api.QBUF, taken)

    def get_control(self, unit: int, selector: int, length: int) -> bytes:
        """Read a control of an extension unit, `length` bytes or what the camera says it has."""
        size = int.from_bytes(self._extension(unit, selector, api.GET_LEN, bytes(2)), "little")
        return self._extension(unit, selector, api.GET_CUR, bytes(size or length))

    def set_control(self, unit: int, selector: int, data: bytes) -> None:
        """Write a control of an extension unit."""
        self._extension(unit, selector, api.SET_CUR, data)

    def set_zoom(self, value: int) -> None:
        """Write the absolute zoom, which some cameras take as a command."""
        try:
            fcntl.ioctl(self._fd, api.S_CTRL, api.Control(api.ZOOM_ABSOLUTE, value))
        except OSError as error:
            raise self._refused(f"zoom command {value:#06x}", error) from error

    def close(self) -> None:
        """Release the camera; a second call does nothing."""
        if self._fd < 0:
            return
        with suppress(OSError):
            fcntl.ioctl(self._fd, api.STREAMOFF, ctypes.c_int(api.CAPTURE))
        for view in self._maps:
            view.close()
        self._maps.clear()
        os.close(self._fd)
        self._fd = -1

    def _due(self) -> Buffer | None:
        """The first of the pictures that are here, unless one before it may still come."""
        if not self._early:
            return None
        number, picture = self._early[0]
        if number > self._next >= 0 and self._clock.mono_ns() < self._last_ns + OVERTAKEN_NS:
            return None
        heapq.heappop(self._early)
        if number < self._next and picture.mono_ns < self._last_ns:
            return replace(picture, error=True)
        self._next, self._last_ns = number + 1, picture.mono_ns
        return picture

    def _arrived(self, timeout_s: float) -> Buffer | None:
        """The next picture in the order the kernel has done with them."""
        taken = self._dequeue(timeout_s)
        if taken is None:
            return None
        monotonic = taken.flags & api.STAMP_MASK == api.STAMP_MONOTONIC
        stamp_ns = taken.seconds * 1_000_000_000 + taken.microseconds * 1000
        picture = Buffer(
            data=self._maps[taken.index][: taken.bytesused],
            mono_ns=stamp_ns if monotonic else self._clock.mono_ns(),
            sequence=taken.sequence,
            error=bool(taken.flags & api.FLAG_ERROR),
        )
        self._call(api.QBUF, taken)  # last: the kernel then clears the buffer's description
        return picture

    def _need_capture(self) -> None:
        """A camera has two nodes; the one for metadata cannot capture."""
        caps = api.Capability()
        fcntl.ioctl(self._fd, api.QUERYCAP, caps)
        if not (caps.device_caps & api.CAP_CAPTURE and caps.device_caps & api.CAP_STREAMING):
            raise DeviceNotFoundError(
                f"{self.port} is a metadata node, not the camera's picture",
                fix="leave port out of the configuration: fieldkit finds the node by identity",
            )

    def _choose(self, fourcc: str, sizes: Sequence[tuple[int, int]]) -> tuple[int, int]:
        offered = list(self._offered(fourcc))
        chosen = next((size for size in sizes if size in offered), None)
        if chosen is None:
            raise DeviceNotFoundError(
                f"{self.port} offers no {fourcc.strip()} picture of {_list(sizes)}; it has {_list(offered)}",
                fix="is it another camera, or in another mode? fieldkit devices shows what is plugged in",
            )
        wanted = api.Format(type=api.CAPTURE)
        wanted.fmt.pix = api.PixelFormat(
            width=chosen[0], height=chosen[1], pixelformat=_code(fourcc), field=1
        )
        fcntl.ioctl(self._fd, api.S_FMT, wanted)
        got = wanted.fmt.pix
        if (got.width, got.height, got.pixelformat) != (*chosen, _code(fourcc)):
            raise DeviceNotFoundError(
                f"{self.port} took {got.width}x{got.height} instead of {_list([chosen])}",
                fix="unplug the camera and plug it in again",
            )
        return chosen

    def _offered(self, fourcc: str) -> Sequence[tuple[int, int]]:
        sizes: list[tuple[int, int]] = []
        while True:
            entry = api.FrameSize(index=len(sizes), pixel_format=_code(fourcc))
            try:
                fcntl.ioctl(self._fd, api.ENUM_FRAMESIZES, entry)
            except OSError as error:
                if error.errno in (errno.EINVAL, errno.ENOTTY):
                    return sizes
                raise
            sizes.append((entry.width, entry.height))

    def _start(self) -> None:
        wish = api.RequestBuffers(count=BUFFERS, type=api.CAPTURE, memory=api.MMAP)
        fcntl.ioctl(self._fd, api.REQBUFS, wish)
        for index in range(wish.count):
            slot = api.VideoBuffer(index=index, type=api.CAPTURE, memory=api.MMAP)
            fcntl.ioctl(self._fd, api.QUERYBUF, slot)
            self._maps.append(mmap.mmap(self._fd, slot.length, offset=slot.m.offset))
            fcntl.ioctl(self._fd, api.QBUF, slot)
        fcntl.ioctl(self._fd, api.STREAMON, ctypes.c_int(api.CAPTURE))

    def _dequeue(self, timeout_s: float) -> api.VideoBuffer | None:
        if not self._clock.wait_readable(self._fd, timeout_s):
            return None
        slot = api.VideoBuffer(type=api.CAPTURE, memory=api.MMAP)
        return slot if self._call(api.DQBUF, slot) else None

    def _call(self, request: int, slot: api.VideoBuffer) -> bool:
        try:
            fcntl.ioctl(self._fd, request, slot)
        except BlockingIOError:
            return False
        except OSError as error:
            raise DeviceLostError(
                f"the camera at {self.port} is gone ({os.strerror(error.errno or 0)})",
                fix="plug it back in; it is opened again by identity",
            ) from error
        return True

    def _extension(self, unit: int, selector: int, query: int, data: bytes) -> bytes:
        content = ctypes.create_string_buffer(data, len(data))
        address = ctypes.addressof(content)
        try:
            fcntl.ioctl(
                self._fd, api.UVC_QUERY, api.ExtensionQuery(unit, selector, query, len(data), address)
            )
        except OSError as error:
            raise self._refused(f"control {selector} of unit {unit}", error) from error
        return content.raw

    def _refused(self, what: str, error: OSError) -> DeviceError:
        return DeviceError(f"the camera at {self.port} refused {what}: {os.strerror(error.errno or 0)}")


def _code(fourcc: str) -> int:
    return int.from_bytes(fourcc.ljust(4).encode(), "little")


def _list(sizes: Sequence[tuple[int, int]]) -> str:
    return ", ".join(f"{width}x{height}" for width, height in sizes) or "none"


def _failure(path: str, error: OSError) -> DeviceError:
    """Why a video node would not start, with what to type."""
    if error.errno in (errno.ENOENT, errno.ENODEV, errno.ENXIO):
        return DeviceNotFoundError(
            f"no camera at {path}", fix="fieldkit devices shows the identity to configure"
        )
    if error.errno in (errno.EACCES, errno.EPERM):
        return DeviceAccessError(f"no permission for the camera {path}", fix=permission_fix("video"))
    if error.errno == errno.EBUSY:
        return DeviceAccessError(
            f"the camera {path} is used by another program", fix=f"close it (fuser -v {path} names it)"
        )
    if error.errno == errno.ENOSPC:
        return DeviceAccessError(
            f"no USB bandwidth left for the camera {path}",
            fix="plug it into a socket of another USB controller, away from the other camera",
        )
    return DeviceAccessError(
        f"the camera {path} does not start: {error}", fix="unplug it and plug it in again"
    )
