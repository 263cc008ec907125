"""The usbredir protocol: how an emulated device speaks to QEMU's ``usb-redir``. Pure, no sockets.

Source: "USB Network Redirection protocol description", version 0.7. Little endian, packed.
The emulated device plays the "usb-host" of that text, QEMU the "usb-guest".
"""

from __future__ import annotations

import enum
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field

from usblab.uvc.descriptors import CONTROL_INTERFACE, STREAMING_INTERFACE, CameraShape


class Kind(enum.IntEnum):
    """Message types."""

    HELLO = 0
    DEVICE_CONNECT = 1
    DEVICE_DISCONNECT = 2
    RESET = 3
    INTERFACE_INFO = 4
    ENDPOINT_INFO = 5
    SET_CONFIGURATION = 6
    GET_CONFIGURATION = 7
    CONFIGURATION_STATUS = 8
    SET_ALTERNATE = 9
    GET_ALTERNATE = 10
    ALTERNATE_STATUS = 11
    START_ISO = 12
    STOP_ISO = 13
    ISO_STATUS = 14
    START_INTERRUPT = 15
    STOP_INTERRUPT = 16
    INTERRUPT_STATUS = 17
    CANCEL = 21
    FILTER = 23
    DISCONNECT_ACK = 24
    CONTROL = 100
    BULK = 101
    ISO = 102


class Status(enum.IntEnum):
    """How a transfer ended."""

    OK = 0
    CANCELLED = 1
    STALL = 4


CONTROL_HEADER = struct.Struct("<BBBBHHH")  # endpoint, request, type, status, value, index, length
BULK_HEADER = struct.Struct("<BBHIH")  # endpoint, status, length, stream, length (high half)
ISO_HEADER = struct.Struct("<BBH")  # endpoint, status, length
_CAPABILITIES = (1, 3, 4, 5, 6)  # version in connect, disconnect ack, packet sizes, 64-bit ids, long bulk
_WIDE_IDS = 5
_ABSENT = 255


@dataclass(frozen=True)
class Message:
    """One message as received."""

    kind: Kind
    id: int
    body: bytes


@dataclass
class Wire:
    """Packs and unpacks messages; ids are 4 bytes until both hellos are exchanged, then 8."""

    _waiting: bytearray = field(default_factory=bytearray)
    _wide: bool = False

    def pack(self, kind: Kind, body: bytes, id: int = 0) -> bytes:
        """One message."""
        return struct.pack("<IIQ" if self._wide else "<III", kind, len(body), id) + body

    def hello(self) -> bytes:
        """Our first message."""
        bits = sum(1 << bit for bit in _CAPABILITIES)
        return self.pack(Kind.HELLO, b"virtual USB lab".ljust(64, b"\0") + struct.pack("<I", bits))

    def feed(self, received: bytes) -> Iterator[Message]:
        """The messages completed by these bytes."""
        self._waiting += received
        while True:
            head = struct.Struct("<IIQ" if self._wide else "<III")
            if len(self._waiting) < head.size:
                return
            kind, length, id = head.unpack_from(self._waiting)
            if len(self._waiting) < head.size + length:
                return
            body = bytes(self._waiting[head.size : head.size + length])
            del self._waiting[: head.size + length]
            if kind == Kind.HELLO:
                self._wide = bool(struct.unpack_from("<I", body, 64)[0] >> _WIDE_IDS & 1)
            yield Message(Kind(kind), id, body)


def interface_info() -> bytes:
    """Two interfaces: video control and video streaming."""
    numbers = (CONTROL_INTERFACE, STREAMING_INTERFACE)

    def column(*values: int) -> bytes:
        return bytes(values).ljust(32, b"\0")

    return struct.pack("<I", 2) + column(*numbers) + column(0x0E, 0x0E) + column(1, 2) + column(0, 0)


def endpoint_info(shape: CameraShape, streaming_alternate: int) -> bytes:
    """Every endpoint there is in this alternate setting; an absent one has type 255."""
    types, intervals, interfaces, packets = [_ABSENT] * 32, [0] * 32, [0] * 32, [0] * 32

    def add(address: int, kind: int, interval: int, interface: int, packet: int) -> None:
        index = (address & 15) + (16 if address & 0x80 else 0)
        types[index], intervals[index], interfaces[index], packets[index] = kind, interval, interface, packet

    add(0x00, 0, 0, 0, 64)
    add(0x80, 0, 0, 0, 64)
    if shape.status_endpoint:
        add(shape.status_endpoint, 3, 8, CONTROL_INTERFACE, 8)
    pipe = shape.endpoint
    if not pipe.isochronous or streaming_alternate:
        # QEMU sizes its queue by this interval; by the shortest it is longest, and overflows last
        kind, interval = (1, 1) if pipe.isochronous else (2, pipe.interval)
        add(pipe.address, kind, interval, STREAMING_INTERFACE, pipe.max_packet)
    return bytes(types) + bytes(intervals) + bytes(interfaces) + struct.pack("<32H", *packets)


def device_connect(shape: CameraShape) -> bytes:
    """The device as plugged in, with its speed."""
    speed = 2 if shape.high_speed else 1
    return struct.pack("<BBBBHHH", speed, 0xEF, 2, 1, shape.vendor, shape.product, shape.release)
