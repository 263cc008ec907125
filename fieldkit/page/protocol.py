"""HTTP connections that must not hold up others: late headers, too many at once, unread answers."""

from __future__ import annotations

import asyncio
import socket
from contextlib import suppress
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

HEADERS_WITHIN_S = 10.0
MOST_CONNECTIONS = 100
UNSENT_BYTES = 32_768
"""What the kernel may hold for a slow connection: a second of pictures, so that the newest is never far."""


class CarefulProtocol(H11Protocol):
    """Closes a connection whose request is not complete in time, and those above a number."""

    _late: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Accept a connection, or close it at once where there are too many."""
        if len(self.connections) >= MOST_CONNECTIONS:
            self.transport = transport
            transport.abort()
            return
        super().connection_made(transport)
        transport.set_write_buffer_limits(high=UNSENT_BYTES)
        with suppress(OSError):  # a kernel without it has pictures wait a little longer
            raw: Any = transport.get_extra_info("socket")
            raw.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, UNSENT_BYTES)
        self._await_request()

    def data_received(self, data: bytes) -> None:
        """Read on; the first bytes of another request begin its time."""
        if self._late is None and self.conn.their_state is h11.IDLE:
            self._await_request()
        super().data_received(data)
        if self.conn.their_state is not h11.IDLE and self._is_read():
            self._stop_waiting()

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        """Pass the connection on: its request is complete."""
        self._stop_waiting()
        super().handle_websocket_upgrade(event)

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._stop_waiting()
        if self in self.connections:
            super().connection_lost(exc)

    def _is_read(self) -> bool:
        return self.conn.their_state in (h11.DONE, h11.MUST_CLOSE, h11.CLOSED, h11.ERROR)

    def _await_request(self) -> None:
        self._late = self.loop.call_later(HEADERS_WITHIN_S, self.transport.abort)

    def _stop_waiting(self) -> None:
        if self._late is not None:
            self._late.cancel()
            self._late = None
