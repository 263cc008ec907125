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

from fieldkit.drivers.identity import refusal, unplugged
from fieldkit.model.clock import Clock
from fieldkit.model.device import Buffer
from fieldkit.model.errors import DeviceAccessError, DeviceError, DeviceLostError, DeviceNotFoundError
from fieldkit.model.next_step import Action
from fieldkit.model.units import SECOND_NS

# --- structures and request numbers of linux/videodev2.h and linux/uvcvideo.h
# ctypes lays the structures out for the machine at hand, so that 32- and 64-bit systems both fit.

CAPTURE = 1  # V4L2_BUF_TYPE_VIDEO_CAPTURE
MMAP = 1  # V4L2_MEMORY_MMAP
CAP_CAPTURE = 0x0000_0001
CAP_STREAMING = 0x0400_0000
FLAG_ERROR = 0x0040
STAMP_MASK = 0xE000
STAMP_MONOTONIC = 0x2000
ZOOM_ABSOLUTE = 0x009A_090D  # V4L2_CID_ZOOM_ABSOLUTE
SET_CUR, GET_CUR, GET_LEN = 0x01, 0x81, 0x85


def _words(*names: str) -> tuple[tuple[str, type], ...]:
    """Fields of 32 bits without a sign, as most are."""
    return tuple((name, ctypes.c_uint32) for name in names)


class Capability(ctypes.Structure):
    """`struct v4l2_capability`."""

    _fields_ = (
        ("driver", ctypes.c_char * 16),
        ("card", ctypes.c_char * 32),
        ("bus_info", ctypes.c_char * 32),
        *_words("version", "capabilities", "device_caps"),
        ("reserved", ctypes.c_uint32 * 3),
    )


class FrameSize(ctypes.Structure):
    """`struct v4l2_frmsizeenum`, discrete sizes only."""

    _fields_ = (*_words("index", "pixel_format", "type", "width", "height"), ("rest", ctypes.c_uint32 * 6))


class PixelFormat(ctypes.Structure):
    """`struct v4l2_pix_format`."""

    _fields_ = (
        *_words("width", "height", "pixelformat", "field", "bytesperline", "sizeimage"),
        *_words("colorspace", "priv", "flags", "encoding", "quantization", "transfer"),
    )


class _FormatUnion(ctypes.Union):
    _fields_ = (("pix", PixelFormat), ("raw", ctypes.c_uint8 * 200), ("align", ctypes.c_void_p))


class Format(ctypes.Structure):
    """`struct v4l2_format`."""

    _fields_ = (("type", ctypes.c_uint32), ("fmt", _FormatUnion))


class RequestBuffers(ctypes.Structure):
    """`struct v4l2_requestbuffers`."""

    _fields_ = _words("count", "type", "memory", "capabilities", "reserved")


class _TimeCode(ctypes.Structure):
    _fields_ = (*_words("type", "flags"), ("fields", ctypes.c_uint8 * 8))


class _Place(ctypes.Union):
    _fields_ = (("offset", ctypes.c_uint32), ("userptr", ctypes.c_ulong))


class VideoBuffer(ctypes.Structure):
    """`struct v4l2_buffer`."""

    _fields_ = (
        *_words("index", "type", "bytesused", "flags", "field"),
        ("seconds", ctypes.c_long),
        ("microseconds", ctypes.c_long),
        ("timecode", _TimeCode),
        *_words("sequence", "memory"),
        ("m", _Place),
        *_words("length", "reserved", "request_fd"),
    )


class Control(ctypes.Structure):
    """`struct v4l2_control`."""

    _fields_ = (("id", ctypes.c_uint32), ("value", ctypes.c_int32))


class ExtensionQuery(ctypes.Structure):
    """`struct uvc_xu_control_query`."""

    _fields_ = (
        ("unit", ctypes.c_uint8),
        ("selector", ctypes.c_uint8),
        ("query", ctypes.c_uint8),
        ("size", ctypes.c_uint16),
        ("data", ctypes.c_void_p),
    )


def _request(direction: int, group: str, number: int, kind: type) -> int:
    """`_IOC` of `asm-generic/ioctl.h`: 1 the kernel reads, 2 it writes."""
    return direction << 30 | ctypes.sizeof(kind) << 16 | ord(group) << 8 | number


QUERYCAP = _request(2, "V", 0, Capability)
S_FMT = _request(3, "V", 5, Format)
REQBUFS = _request(3, "V", 8, RequestBuffers)
QUERYBUF = _request(3, "V", 9, VideoBuffer)
QBUF = _request(3, "V", 15, VideoBuffer)
DQBUF = _request(3, "V", 17, VideoBuffer)
STREAMON = _request(1, "V", 18, ctypes.c_int)
STREAMOFF = _request(1, "V", 19, ctypes.c_int)
S_CTRL = _request(3, "V", 28, Control)
ENUM_FRAMESIZES = _request(3, "V", 74, FrameSize)
UVC_QUERY = _request(3, "u", 0x21, ExtensionQuery)


BUFFERS = 32  # the most there are: a second of a 30 Hz camera before a busy computer costs a frame
OVERTAKEN_NS = 750_000_000
"""Time to wait for a frame that later ones have overtaken.

The kernel's UVC driver copies the parts of frames in several workers at once; one that is kept waiting on a
busy computer finishes its frame after those of the others.
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
        self._early: list[tuple[int, Buffer]] = []  # a heap of frames by number
        self._next, self._last_ns = -1, 0
        try:
            self._fd = os.open(path, os.O_RDWR | os.O_NONBLOCK)
            self._need_capture()
            self.size: tuple[int, int] = self._choose(fourcc, sizes)
            self._start()
        except OSError as error:
            self.close()
            raise _failure(path, error) from error
        except DeviceError:
            self.close()
            raise

    def read(self, timeout_s: float) -> Buffer | None:
        """The next frame in the order they were taken, or None; raises `DeviceLostError`.

        One that comes after its successors have been passed on is marked as an error.
        """
        end_ns = self._clock.mono_ns() + int(timeout_s * 1e9)
        while (frame := self._due()) is None:
            now_ns = self._clock.mono_ns()
            until_ns = min(end_ns, self._last_ns + OVERTAKEN_NS) if self._early else end_ns
            try:
                arrived = self._next_arrival(max(until_ns - now_ns, 0) / 1e9)
            except DeviceLostError:
                if not self._early:
                    raise
                self._last_ns = now_ns - OVERTAKEN_NS  # what is missing will not come any more
                continue
            if arrived is not None:
                heapq.heappush(self._early, (arrived.sequence, arrived))
            elif until_ns == end_ns:
                return None
        return frame

    def skip_until(self, mono_ns: int) -> None:
        """Give every buffer back unread until a monotonic time."""
        self._early.clear()
        self._next = -1
        while (remaining_ns := mono_ns - self._clock.mono_ns()) > 0:
            descriptor = self._dequeue(remaining_ns / 1e9)
            if descriptor is not None:
                self._call(QBUF, descriptor)

    def get_control(self, unit: int, selector: int, length: int) -> bytes:
        """Read a control of an extension unit, `length` bytes or as many as the camera reports."""
        size = int.from_bytes(self._extension(unit, selector, GET_LEN, bytes(2)), "little")
        return self._extension(unit, selector, GET_CUR, bytes(size or length))

    def set_control(self, unit: int, selector: int, data: bytes) -> None:
        """Write a control of an extension unit."""
        self._extension(unit, selector, SET_CUR, data)

    def set_zoom(self, value: int) -> None:
        """Write the absolute zoom, which some cameras take as a command."""
        try:
            fcntl.ioctl(self._fd, S_CTRL, Control(ZOOM_ABSOLUTE, value))
        except OSError as error:
            raise self._refusal(f"zoom command {value:#06x}", error) from error

    def close(self) -> None:
        """Release the camera; a second call does nothing."""
        if self._fd < 0:
            return
        with suppress(OSError):
            fcntl.ioctl(self._fd, STREAMOFF, ctypes.c_int(CAPTURE))
        for view in self._maps:
            view.close()
        self._maps.clear()
        os.close(self._fd)
        self._fd = -1

    def _due(self) -> Buffer | None:
        """The first of the frames that are here, unless one before it may still come."""
        if not self._early:
            return None
        number, frame = self._early[0]
        if number > self._next >= 0 and self._clock.mono_ns() < self._last_ns + OVERTAKEN_NS:
            return None
        heapq.heappop(self._early)
        if number < self._next and frame.mono_ns < self._last_ns:
            return replace(frame, error=True)
        self._next, self._last_ns = number + 1, frame.mono_ns
        return frame

    def _next_arrival(self, timeout_s: float) -> Buffer | None:
        """The next frame in the order the kernel has done with them."""
        descriptor = self._dequeue(timeout_s)
        if descriptor is None:
            return None
        monotonic = descriptor.flags & STAMP_MASK == STAMP_MONOTONIC
        stamp_ns = descriptor.seconds * SECOND_NS + descriptor.microseconds * 1000
        frame = Buffer(
            data=self._maps[descriptor.index][: descriptor.bytesused],
            mono_ns=stamp_ns if monotonic else self._clock.mono_ns(),
            sequence=descriptor.sequence,
            error=bool(descriptor.flags & FLAG_ERROR),
        )
        self._call(QBUF, descriptor)  # last: the kernel then clears the buffer's description
        return frame

    def _need_capture(self) -> None:
        """A camera has two nodes; the one for metadata cannot capture."""
        caps = Capability()
        fcntl.ioctl(self._fd, QUERYCAP, caps)
        if not (caps.device_caps & CAP_CAPTURE and caps.device_caps & CAP_STREAMING):
            raise DeviceNotFoundError(
                "a metadata node, not the camera's frame",
                place=self.port,
                fix="omit port from the configuration: the node is found by identity",
            )

    def _choose(self, fourcc: str, sizes: Sequence[tuple[int, int]]) -> tuple[int, int]:
        offered = list(self._sizes_offered(fourcc))
        chosen = next((size for size in sizes if size in offered), None)
        if chosen is None:
            raise DeviceNotFoundError(
                f"offers no {fourcc.strip()} frame of {_list(sizes)}; it has {_list(offered)}",
                place=self.port,
                fix="is it another camera, or in another mode? " + Action.FIND_DEVICES() + " shows it",
            )
        request = Format(type=CAPTURE)
        request.fmt.pix = PixelFormat(width=chosen[0], height=chosen[1], pixelformat=_code(fourcc), field=1)
        fcntl.ioctl(self._fd, S_FMT, request)
        got = request.fmt.pix
        if (got.width, got.height, got.pixelformat) != (*chosen, _code(fourcc)):
            raise DeviceNotFoundError(
                f"took {got.width}x{got.height} instead of {_list([chosen])}",
                place=self.port,
                fix="unplug the camera and plug it in again",
            )
        return chosen

    def _sizes_offered(self, fourcc: str) -> Sequence[tuple[int, int]]:
        sizes: list[tuple[int, int]] = []
        while True:
            entry = FrameSize(index=len(sizes), pixel_format=_code(fourcc))
            try:
                fcntl.ioctl(self._fd, ENUM_FRAMESIZES, entry)
            except OSError as error:
                if error.errno in (errno.EINVAL, errno.ENOTTY):
                    return sizes
                raise
            sizes.append((entry.width, entry.height))

    def _start(self) -> None:
        setting = RequestBuffers(count=BUFFERS, type=CAPTURE, memory=MMAP)
        fcntl.ioctl(self._fd, REQBUFS, setting)
        for index in range(setting.count):
            slot = VideoBuffer(index=index, type=CAPTURE, memory=MMAP)
            fcntl.ioctl(self._fd, QUERYBUF, slot)
            self._maps.append(mmap.mmap(self._fd, slot.length, offset=slot.m.offset))
            fcntl.ioctl(self._fd, QBUF, slot)
        fcntl.ioctl(self._fd, STREAMON, ctypes.c_int(CAPTURE))

    def _dequeue(self, timeout_s: float) -> VideoBuffer | None:
        if not self._clock.wait_readable(self._fd, timeout_s):
            return None
        slot = VideoBuffer(type=CAPTURE, memory=MMAP)
        return slot if self._call(DQBUF, slot) else None

    def _call(self, request: int, slot: VideoBuffer) -> bool:
        try:
            fcntl.ioctl(self._fd, request, slot)
        except BlockingIOError:
            return False
        except OSError as error:
            raise unplugged(self.port, f"the camera is gone ({os.strerror(error.errno or 0)})") from error
        return True

    def _extension(self, unit: int, selector: int, query: int, data: bytes) -> bytes:
        content = ctypes.create_string_buffer(data, len(data))
        address = ctypes.addressof(content)
        try:
            fcntl.ioctl(self._fd, UVC_QUERY, ExtensionQuery(unit, selector, query, len(data), address))
        except OSError as error:
            raise self._refusal(f"control {selector} of unit {unit}", error) from error
        return content.raw

    def _refusal(self, what: str, error: OSError) -> DeviceError:
        return DeviceError(f"refused {what}: {os.strerror(error.errno or 0)}", place=self.port)


def _code(fourcc: str) -> int:
    return int.from_bytes(fourcc.ljust(4).encode(), "little")


def _list(sizes: Sequence[tuple[int, int]]) -> str:
    return ", ".join(f"{width}x{height}" for width, height in sizes) or "none"


def _failure(path: str, error: OSError) -> DeviceError:
    """Error of a video node that would not start, with what to type."""
    if error.errno in (errno.ENOENT, errno.ENODEV, errno.ENXIO):
        return DeviceNotFoundError(
            "no camera here", place=path, fix=Action.FIND_DEVICES() + " shows the identity"
        )
    if cause := refusal(path, error, "video", f"close it (fuser -v {path} names it)"):
        return cause
    if error.errno == errno.ENOSPC:
        return DeviceAccessError(
            "no USB bandwidth left",
            place=path,
            fix="plug it into a socket of another USB controller, away from the other camera",
        )
    return DeviceAccessError(
        f"the camera does not start: {error}", place=path, fix="unplug it and plug it in again"
    )
