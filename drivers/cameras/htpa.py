"""Heimann HTPA32x32d on the maker's application board or ESP32 shield, by UDP.

The board listens on port 30444. It answers ``Calling HTPA series devices`` with its array type (10 for
32x32d), lets itself be bound to one computer by ``Bind HTPA series device``, and after ``K`` sends frames in
two datagrams of 1292 and 1288 bytes until ``x``. A frame has little-endian words: 1024 pixels in kelvin x 10,
row by row, 256 electrical offsets, supply voltage, ambient temperature in kelvin x 10, 8 times PTAT.

Source: the maker's "UDP Transfer protocol WiFi Shield Rev1" and firmware (HeimannSensor on GitHub,
ESP32_ApplicationShield). Some boards answer to port 30444 alone, so that is the local port too while it is
free. A thermopile array has no shutter. Other array types have other packets and are refused.
"""

from __future__ import annotations

import re
import socket
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from fieldkit.drivers.cameras import camera
from fieldkit.drivers.cameras.camera import DecodedFrame, decode_frames, pixel_view
from fieldkit.drivers.cameras.source import CameraDriver, OpenedSource
from fieldkit.drivers.cameras.streaming import StreamSource
from fieldkit.drivers.connections import address_of
from fieldkit.drivers.decoding import Decoded, Rejected
from fieldkit.model.clock import Clock, time_left
from fieldkit.model.device import Buffer, DeviceSettings
from fieldkit.model.errors import DeviceAccessError, DeviceError, DeviceLostError, DeviceNotFoundError

PORT = 30444
CALL = b"Calling HTPA series devices"
BIND = b"Bind HTPA series device"
RELEASE = b"x Release HTPA series device"
TEMPERATURES = b"K"
ARRAY_TYPE = 10
SIDE = 32
FIRST, SECOND = 1292, 1288
LENGTH = FIRST + SECOND
AMBIENT = (SIDE * SIDE + 256 + 1) * 2  # byte of the ambient temperature
SCALE = 0.1
LONGEST = 2048
REPLY_S = 2.0


def decode(data: bytes) -> DecodedFrame | Rejected:
    """A frame, its two datagrams together."""
    if len(data) != LENGTH:
        return Rejected(len(data), f"{len(data)} bytes; a frame of 32x32 has {LENGTH}")
    counts = pixel_view(data, (SIDE, SIDE))
    ambient_k = int.from_bytes(data[AMBIENT : AMBIENT + 2], "little") * SCALE
    return DecodedFrame(counts, scale=SCALE, shutter=False, fpa_temperature_k=ambient_k)


class UdpSource(StreamSource):
    """A board that sends datagrams, bound to this computer while it is open."""

    backend = "udp"

    def __init__(self, address: tuple[str, int], clock: Clock) -> None:
        super().__init__(f"{address[0]}:{address[1]}", clock)
        self._first = b""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        with suppress(OSError):  # another camera's, or not free: most boards answer to any port
            self._socket.bind(("", PORT))
        try:
            self._socket.connect(address)
        except (OSError, UnicodeError) as error:  # no name of a host
            self._socket.close()
            raise DeviceNotFoundError(f"cannot be reached: {error}", place=self.port, fix=_ADVICE) from error
        self._socket.setblocking(False)

    def ask(self, request: bytes, reply: bytes) -> str:
        """The text that begins with `reply`; raises `DeviceNotFoundError` if none comes in `REPLY_S`."""
        self.send(request)
        for left_s in time_left(self._clock, REPLY_S):
            datagram = self._datagram(left_s)
            if datagram.startswith(b"Device already bound"):
                raise DeviceAccessError(
                    "bound to another computer",
                    place=self.port,
                    fix="end its program there, or switch the board off and on",
                )
            if datagram.startswith(reply):
                return datagram.decode("latin-1")
        raise DeviceNotFoundError("no HTPA board replies", place=self.port, fix=_ADVICE)

    def send(self, command: bytes) -> None:
        """Send a command; raises `DeviceLostError`."""
        try:
            self._socket.send(command)
        except OSError as error:
            raise self._lost(error) from error

    def close(self) -> None:
        """Release the board."""
        with suppress(DeviceError):
            self.send(RELEASE)
        self._socket.close()

    def _receive(self, timeout_s: float) -> Buffer | None:
        """A frame of two datagrams; of one without the other `decode` finds the length wrong."""
        for left_s in time_left(self._clock, timeout_s):
            datagram = self._datagram(left_s)
            first, self._first = self._first, datagram if len(datagram) == FIRST else b""
            if len(datagram) == SECOND or (first and datagram):
                return Buffer(first + datagram, self._clock.mono_ns())
            self._first = self._first or first
        return None

    def _datagram(self, timeout_s: float) -> bytes:
        """The next datagram, empty if none comes."""
        if not self._clock.wait_readable(self._socket.fileno(), timeout_s):
            return b""
        try:
            return self._socket.recv(LONGEST)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self._lost(error) from error

    def _lost(self, error: OSError) -> DeviceLostError:
        return DeviceLostError(f"the camera is gone: {error}", place=self.port, fix=_ADVICE)


_ADVICE = "switch the board on and join its network, or give its address: port = host"


class Htpa(CameraDriver):
    """Driver of the HTPA32x32d; `port` is the board's address, options are those of every camera."""

    name = "htpa"
    title = "Heimann HTPA32x32d"
    noise_k: float = 0.2
    host_port = PORT
    options: tuple[str, ...] = camera.OPTIONS

    def decode(self, data: bytes, options: Mapping[str, Any]) -> Decoded:
        """Explain bytes of one or more frames; see `fieldkit.drivers.decoding.Decodes`."""
        return decode_frames(data, decode, (LENGTH,))

    def open(self, settings: DeviceSettings, clock: Clock) -> camera.ThermalCamera:
        """Bind the board to this computer and let it send temperatures."""
        source = UdpSource(address_of(settings, PORT), clock)
        handle = OpenedSource(source, settings.identity)
        facts = _facts(settings.name, source.ask(CALL, b"HTPA series responsed"))
        source.ask(BIND, b"HW Filter is")
        source.send(TEMPERATURES)
        first = camera.first_frame(source, decode, settings.name, clock)
        info = camera.describe(settings, handle, first, facts, vendor="Heimann Sensor")
        return camera.ThermalCamera(info, source, decode, clock)


def _facts(name: str, answer: str) -> dict[str, Any]:
    """A board's report of itself; raises `DeviceError` for another array than 32x32d."""
    array = re.search(r"Arraytype (\d+)", answer)
    if array is None or int(array[1]) != ARRAY_TYPE:
        what = array[0] if array else "an unknown array"
        raise DeviceError(
            f"{what} is not an HTPA32x32d (array type {ARRAY_TYPE})",
            place=name,
            fix="use a 32x32d board: only these are read",
        )
    serial, firmware = re.search(r"DevID: *(\d+)", answer), re.search(r"v\. ?(\d+\.\d+)", answer)
    facts = {"model": "HTPA32x32d", "serial_number": serial, "firmware": firmware}
    return {key: value[1] if isinstance(value, re.Match) else value for key, value in facts.items() if value}
