"""Instruments in the network: an address of the configuration, and a TCP connection as a port."""

from __future__ import annotations

import os
import socket

from fieldkit.drivers.decoding import Layout
from fieldkit.drivers.opening import close_on_failure
from fieldkit.drivers.ports import CHUNK_BYTES, Framer, Stamped
from fieldkit.model.clock import Clock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import ConfigError, DeviceLostError, DeviceNotFoundError

CONNECT_S = 5.0
LAST_PORT = 65_535


def address_of(settings: DeviceSettings, usual_port: int, usual_host: str = "") -> tuple[str, int]:
    """(host, port) of ``port = "host:port"`` or ``"host"``; raises `ConfigError` if no host is known."""
    host, colon, number = (settings.port or usual_host).partition(":")
    if not host:
        raise ConfigError(
            f"the driver {settings.driver} needs the instrument's address",
            place=settings.name,
            fix='port = "192.168.4.1", or with another port "192.168.4.1:5001"',
        )
    if colon and not (number.isdecimal() and 0 < int(number) <= LAST_PORT):
        raise ConfigError(
            f"behind the host stands {number!r}, not a number from 1 to {LAST_PORT}",
            place=f"{settings.name}.port",
            fix=f'port = "{host}:{usual_port}"',
        )
    return host, int(number) if colon else usual_port


class SocketPort:
    """A TCP connection as a port; see `fieldkit.drivers.ports.Port`.

    `peer` is what answers at the address, `advice` what to do where nothing does.
    """

    byte_ns = 0
    identity = ""

    def __init__(self, address: tuple[str, int], clock: Clock, peer: str, advice: str) -> None:
        self.path: str = f"{address[0]}:{address[1]}"
        self.facts: dict[str, str] = {"line": "tcp"}
        self.framer: Framer = Framer(self.byte_ns)
        self._clock, self._peer, self._advice = clock, peer, advice
        try:
            self._socket = socket.create_connection(address, timeout=CONNECT_S)
        except (OSError, UnicodeError) as error:  # no name of a host
            raise DeviceNotFoundError(f"no {peer} there: {error}", place=self.path, fix=advice) from error
        self._socket.setblocking(False)
        close_on_failure(self.close)

    def write(self, data: bytes) -> None:
        """Send bytes."""
        try:
            self._socket.sendall(data)
        except OSError as error:
            raise self._lost() from error

    def read(self, layout: Layout, timeout_s: float, request: bytes = b"") -> Stamped | None:
        """The next record, or the reply to `request`; None if none is complete within `timeout_s`."""
        if request:
            self.framer.discard()
            self.write(request)
        deadline_ns = self._clock.mono_ns() + int(timeout_s * 1e9)
        stamped, left_s = self.framer.next_record(layout), timeout_s
        while stamped is None and left_s >= 0.0 and self._clock.wait_readable(self._socket.fileno(), left_s):
            chunk, now_ns = self._chunk(), self._clock.mono_ns()
            stamped = self.framer.feed(layout, chunk, now_ns)
            left_s = (deadline_ns - now_ns) / 1e9
        return stamped

    def close(self) -> None:
        """Close the connection; a second call does nothing."""
        self._socket.close()

    def _chunk(self) -> bytes:
        try:
            chunk = os.read(self._socket.fileno(), CHUNK_BYTES)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self._lost() from error
        if not chunk:
            raise self._lost()
        return chunk

    def _lost(self) -> DeviceLostError:
        return DeviceLostError(f"{self._peer} hung up", place=self.path, fix=self._advice)
