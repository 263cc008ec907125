"""Structures and request numbers of `linux/videodev2.h` and `linux/uvcvideo.h` that a camera needs.

ctypes lays the structures out for the machine at hand, so that 32- and 64-bit systems both fit.
"""

from __future__ import annotations

import ctypes

CAPTURE = 1  # V4L2_BUF_TYPE_VIDEO_CAPTURE
MMAP = 1  # V4L2_MEMORY_MMAP
CAP_CAPTURE = 0x0000_0001
CAP_STREAMING = 0x0400_0000
FLAG_ERROR = 0x0040
STAMP_MASK = 0xE000
STAMP_MONOTONIC = 0x2000
ZOOM_ABSOLUTE = 0x009A_090D  # V4L2_CID_ZOOM_ABSOLUTE
SET_CUR, GET_CUR, GET_LEN = 0x01, 0x81, 0x85


class Capability(ctypes.Structure):
    """`struct v4l2_capability`."""

    _fields_ = (
        ("driver", ctypes.c_char * 16),
        ("card", ctypes.c_char * 32),
        ("bus_info", ctypes.c_char * 32),
        ("version", ctypes.c_uint32),
        ("capabilities", ctypes.c_uint32),
        ("device_caps", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32 * 3),
    )


class FrameSize(ctypes.Structure):
    """`struct v4l2_frmsizeenum`, discrete sizes only."""

    _fields_ = (
        ("index", ctypes.c_uint32),
        ("pixel_format", ctypes.c_uint32),
        ("type", ctypes.c_uint32),
        ("width", ctypes.c_uint32),
        ("height", ctypes.c_uint32),
        ("rest", ctypes.c_uint32 * 6),
    )


class PixelFormat(ctypes.Structure):
    """`struct v4l2_pix_format`."""

    _fields_ = tuple(
        (name, ctypes.c_uint32)
        for name in (
            *("width", "height", "pixelformat", "field", "bytesperline", "sizeimage"),
            *("colorspace", "priv", "flags", "encoding", "quantization", "transfer"),
        )
    )


class _FormatUnion(ctypes.Union):
    _fields_ = (("pix", PixelFormat), ("raw", ctypes.c_uint8 * 200), ("align", ctypes.c_void_p))


class Format(ctypes.Structure):
    """`struct v4l2_format`."""

    _fields_ = (("type", ctypes.c_uint32), ("fmt", _FormatUnion))


class RequestBuffers(ctypes.Structure):
    """`struct v4l2_requestbuffers`."""

    _fields_ = tuple(
        (name, ctypes.c_uint32) for name in ("count", "type", "memory", "capabilities", "reserved")
    )


class _TimeCode(ctypes.Structure):
    _fields_ = (
        ("type", ctypes.c_uint32),
        ("flags", ctypes.c_uint32),
        ("fields", ctypes.c_uint8 * 8),
    )


class _Place(ctypes.Union):
    _fields_ = (("offset", ctypes.c_uint32), ("userptr", ctypes.c_ulong))


class VideoBuffer(ctypes.Structure):
    """`struct v4l2_buffer`."""

    _fields_ = (
        ("index", ctypes.c_uint32),
        ("type", ctypes.c_uint32),
        ("bytesused", ctypes.c_uint32),
        ("flags", ctypes.c_uint32),
        ("field", ctypes.c_uint32),
        ("seconds", ctypes.c_long),
        ("microseconds", ctypes.c_long),
        ("timecode", _TimeCode),
        ("sequence", ctypes.c_uint32),
        ("memory", ctypes.c_uint32),
        ("m", _Place),
        ("length", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
        ("request_fd", ctypes.c_uint32),
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
