"""A serial adapter in the network, its instrument in the test's hand: bytes by TCP, or RFC 2217."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress

import serial
from serial.rfc2217 import PortManager

EVERY_S = 0.02


class NetworkAdapter:
    """Listens on the loopback; `port` is its address in the configuration.

    Its instrument sends `talk`, or what it gives, again and again, or replies from `replies`. While it is
    unplugged its connections are closed and nothing listens.
    """

    def __init__(
        self,
        scheme: str = "",
        talk: bytes | Callable[[], bytes] = b"",
        replies: Mapping[bytes, bytes] | None = None,
    ) -> None:
        self._scheme, self._talk, self._replies = scheme, talk, replies or {}
        self._address = ("127.0.0.1", 0)
        self._threads: list[threading.Thread] = []
        self.plug()

    @property
    def port(self) -> str:
        """The address as the configuration has it."""
        return f"{self._scheme}{self._address[0]}:{self._address[1]}"

    def plug(self) -> None:
        """Listen, at the same address as before."""
        self._plugged = True
        self._listener = socket.create_server(self._address)
        self._listener.settimeout(EVERY_S)
        self._address = self._listener.getsockname()
        self._threads = [threading.Thread(target=self._listen, args=(self._listener,))]
        self._threads[0].start()

    def unplug(self) -> None:
        """Close what is connected, and stop listening."""
        self._plugged = False
        for thread in self._threads:
            thread.join(5)
        self._listener.close()

    def _listen(self, listener: socket.socket) -> None:
        while self._plugged:
            with suppress(TimeoutError):
                connection, _ = listener.accept()
                self._threads.append(threading.Thread(target=self._serve, args=(connection,)))
                self._threads[-1].start()

    def _serve(self, connection: socket.socket) -> None:
        connection.settimeout(EVERY_S)
        with connection, suppress(OSError):
            received, incoming, outgoing = b"", bytes, bytes
            if self._scheme == "rfc2217://":
                incoming, outgoing = _rfc2217(connection)
            while self._plugged:
                if self._talk:
                    talk = self._talk() if callable(self._talk) else self._talk
                    connection.sendall(outgoing(talk))
                try:
                    chunk = connection.recv(1024)
                except TimeoutError:
                    continue
                if not chunk:
                    return
                received += incoming(chunk)
                for request, reply in self._replies.items():
                    if received.endswith(request):
                        received = b""
                        connection.sendall(outgoing(reply))
                        break


def _rfc2217(connection: socket.socket) -> tuple[Callable[[bytes], bytes], Callable[[bytes], bytes]]:
    """Take out and answer what pyserial's own server does, and escape what is sent."""

    class Far:
        write = staticmethod(connection.sendall)

    manager = PortManager(serial.serial_for_url("loop://"), Far())
    return lambda data: b"".join(manager.filter(data)), lambda data: b"".join(manager.escape(data))
