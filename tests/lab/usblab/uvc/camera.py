"""The requests a camera answers: standard, video streaming (probe, commit), unit controls, vendor."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, replace

from usblab.uvc import descriptors, payload
from usblab.uvc.descriptors import CameraShape

SET_CUR, GET_CUR, GET_MIN, GET_MAX, GET_RES, GET_LEN, GET_INFO, GET_DEF = 0x01, *range(0x81, 0x88)
PROBE, COMMIT = 1, 2
_NEGOTIATION = struct.Struct("<HBBIHHHHHII")  # 26 bytes, UVC 1.0


class StallError(Exception):
    """The camera refuses the request."""


@dataclass(frozen=True)
class Setup:
    """The eight bytes that begin a control transfer."""

    request_type: int
    request: int
    value: int
    index: int
    length: int


@dataclass
class Control:
    """One control of a unit. `minimum` and `maximum` default to all zeros and all ones.

    `run` is called after each write with the bytes written.
    """

    value: bytes
    run: Callable[[bytes], None] | None = None
    read: Callable[[], bytes] | None = None
    minimum: bytes = b""
    maximum: bytes = b""

    def answer(self, request: int) -> bytes:
        """The answer to a GET request; raises `StallError` for one it does not know."""
        size = len(self.value)
        answers: dict[int, Callable[[], bytes]] = {
            GET_CUR: lambda: self.read() if self.read else self.value,
            GET_MIN: lambda: self.minimum or bytes(size),
            GET_MAX: lambda: self.maximum or b"\xff" * size,
            GET_RES: lambda: (1).to_bytes(size, "little"),
            GET_DEF: lambda: bytes(size),
            GET_LEN: lambda: struct.pack("<H", size),
            GET_INFO: lambda: b"\x03",
        }
        if request not in answers:
            raise StallError(f"request {request:#04x} to a control")
        return answers[request]()

    def write(self, data: bytes) -> None:
        """SET_CUR; raises `StallError` if the size is not the control's."""
        if len(data) != len(self.value):
            raise StallError(f"{len(data)} bytes for a control of {len(self.value)}")
        self.value = bytes(data)
        if self.run:
            self.run(self.value)


class UvcCamera:
    """A camera without pictures of its own; models add controls and override `picture`.

    `controls` is by (unit or terminal, selector). `streaming` says whether the host wants pictures.
    """

    def __init__(self, shape: CameraShape) -> None:
        self.shape = shape
        self.controls: dict[tuple[int, int], Control] = {}
        self.streaming = False
        self.format = self.frame = 1
        self.power_on_s = 0.0
        self._toggle = False
        self._configuration = descriptors.configuration(shape)

    def power_on(self, time_s: float) -> None:
        """The camera gets its current: no stream yet, and uptime counts from here."""
        self.power_on_s = time_s
        self.streaming = False

    def slow_down(self) -> None:
        """Half the picture rate from the next plugging on, for a computer that is too busy for the whole."""
        self.shape = replace(self.shape, interval_100ns=2 * self.shape.interval_100ns)
        self._configuration = descriptors.configuration(self.shape)

    def picture(self, time_s: float) -> bytes:
        """The picture taken at a time, in the size and format the host chose."""
        raise NotImplementedError

    def vendor(self, setup: Setup, data: bytes) -> bytes:
        """A request of the maker's own; refused unless a model knows it."""
        raise StallError(f"vendor request {setup}")

    @property
    def frame_bytes(self) -> int:
        """Bytes of one picture as negotiated."""
        return self.shape.formats[self.format - 1].frame_bytes(self.frame)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height as negotiated."""
        return self.shape.formats[self.format - 1].sizes[self.frame - 1]

    def transfer(self, picture: bytes) -> list[bytes]:
        """A picture as it goes over the cable: one bulk payload, or isochronous packets."""
        self._toggle = not self._toggle
        if self.shape.endpoint.isochronous:
            return payload.packets(picture, self._toggle, self.shape.endpoint.packet_bytes)
        return [payload.bulk(picture, self._toggle)]

    def control(self, setup: Setup, data: bytes = b"") -> bytes:
        """Answer a control transfer, cut to the length asked for; raises `StallError` to refuse."""
        kind = setup.request_type >> 5 & 3
        answer = (self._standard, self._class, self.vendor)[kind](setup, data) if kind < 3 else b""
        return answer[: setup.length]

    def select_alternate(self, interface: int, alternate: int) -> None:
        """SET_INTERFACE: an isochronous camera starts and stops with it."""
        if interface == descriptors.STREAMING_INTERFACE and self.shape.endpoint.isochronous:
            self.streaming = alternate > 0

    def _standard(self, setup: Setup, data: bytes) -> bytes:
        if setup.request_type == 0x80 and setup.request == 6:
            return self._descriptor(setup.value >> 8, setup.value & 0xFF)
        if setup.request == 0:  # GET_STATUS
            return bytes(2)
        if setup.request == 1:  # CLEAR_FEATURE; on the bulk endpoint it ends the stream
            if setup.request_type == 2 and setup.index == self.shape.endpoint.address:
                self.streaming = False
            return b""
        raise StallError(f"standard request {setup}")

    def _descriptor(self, kind: int, index: int) -> bytes:
        if kind == 1:
            return descriptors.device(self.shape)
        if kind == 2 and index == 0:
            return self._configuration
        if kind == 3 and index == 0:
            return descriptors.LANGUAGES
        if kind == 3 and index <= len(self.shape.strings) and self.shape.strings[index - 1]:
            return descriptors.string(self.shape.strings[index - 1])
        if kind == 6 and self.shape.high_speed:
            return descriptors.qualifier()
        raise StallError(f"descriptor {kind}, {index}")

    def _class(self, setup: Setup, data: bytes) -> bytes:
        interface, entity, selector = setup.index & 0xFF, setup.index >> 8, setup.value >> 8
        if interface == descriptors.STREAMING_INTERFACE and selector in (PROBE, COMMIT):
            return self._negotiate(selector, setup.request, data)
        control = self.controls.get((entity, selector))
        if interface != descriptors.CONTROL_INTERFACE or control is None:
            raise StallError(f"no control {entity}, {selector}")
        if setup.request == SET_CUR:
            control.write(data)
            return b""
        return control.answer(setup.request)

    def _negotiate(self, selector: int, request: int, data: bytes) -> bytes:
        if request == SET_CUR:
            self._choose(data)
            if selector == COMMIT and not self.shape.endpoint.isochronous:
                self.streaming = True
            return b""
        if request in (GET_CUR, GET_MIN, GET_MAX, GET_DEF):
            return self._offer()
        if request in (GET_LEN, GET_INFO):
            return struct.pack("<H", _NEGOTIATION.size) if request == GET_LEN else b"\x03"
        raise StallError(f"streaming request {request:#04x}")

    def _choose(self, data: bytes) -> None:
        if len(data) < _NEGOTIATION.size:
            raise StallError("negotiation block too short")
        wanted = _NEGOTIATION.unpack_from(data)
        self.format = wanted[1] if 1 <= wanted[1] <= len(self.shape.formats) else 1
        sizes = self.shape.formats[self.format - 1].sizes
        self.frame = wanted[2] if 1 <= wanted[2] <= len(sizes) else 1

    def _offer(self) -> bytes:
        pipe = self.shape.endpoint
        size = pipe.packet_bytes if pipe.isochronous else self.frame_bytes + payload.HEADER_BYTES
        interval = self.shape.interval_100ns
        return _NEGOTIATION.pack(0, self.format, self.frame, interval, 0, 0, 0, 0, 0, self.frame_bytes, size)
