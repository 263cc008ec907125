"""Connections that must not hold up others: late headers, too many at once, unread answers, floods."""

from __future__ import annotations

import asyncio
import socket
from collections import Counter
from contextlib import suppress
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import Frame

from fieldkit.page.viewer import BURST, PER_SECOND, Allowance

HEADERS_WITHIN_S = 10.0
MOST_CONNECTIONS, MOST_OF_ONE = 100, 20
"""Connections of all, and of one address, which may be a router with eight browsers behind it."""
UNSENT_BYTES = 32_768
"""What the kernel may hold for a slow connection: a second of pictures, so that the newest is never far."""
HEADERS_MAX_BYTES = 16_384
TAKEN_WITHIN_S = 20.0
"""A browser that takes nothing for this long is gone, or asleep in a pocket."""
REQUEST_BYTES = 3_000
"""The largest that a browser sends, a region of 64 corners."""
MOST_PARTS = 1_000
"""Of one message: their size is limited, but they may be empty."""


class CarefulProtocol(asyncio.Protocol):
    """Closes a connection whose request is not complete in time, and older ones where there are too many.

    uvicorn's protocol behind it (`options` are its own) sees the events of an `asyncio.Protocol` and nothing
    else: `connections`, of all that share a server, and the request that arrives are followed here.
    """

    def __init__(self, connections: set[CarefulProtocol], **options: Any) -> None:
        self._http, self._connections = H11Protocol(**options), connections
        self._late: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Accept a connection; where there are too many, in place of the oldest that still waits."""
        assert isinstance(transport, asyncio.Transport)
        self.transport: asyncio.Transport = transport
        self.host: str = str((transport.get_extra_info("peername") or ("",))[0])
        self._loop = asyncio.get_running_loop()
        self._since_s = self._loop.time()
        self._make_room()
        self._connections.add(self)
        self._http.connection_made(transport)
        transport.set_write_buffer_limits(high=UNSENT_BYTES)
        with suppress(OSError):  # a kernel without it has pictures wait a little longer
            raw: Any = transport.get_extra_info("socket")
            raw.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, UNSENT_BYTES)
        self._await_request()

    def data_received(self, data: bytes) -> None:
        """Read on; the first bytes of another request begin its time."""
        self._http.data_received(data)
        while data and self.transport.get_protocol() is self:
            if self._late is None:
                self._await_request()
            data = self._after_request(data)
        if self.transport.get_protocol() is not self:  # a WebSocket now
            self._stop_waiting()

    def eof_received(self) -> None:
        """Pass it on."""
        self._http.eof_received()

    def pause_writing(self) -> None:
        """Pass it on."""
        self._http.pause_writing()

    def resume_writing(self) -> None:
        """Pass it on."""
        self._http.resume_writing()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._stop_waiting()
        self._connections.discard(self)
        self._http.connection_lost(exc)

    def _make_room(self) -> None:
        """Abort a connection of this address if it has too many, else one of all if there are too many.

        Where all are WebSockets, that is the new one.
        """
        # one that became a WebSocket has another protocol, which receives the end
        self._connections -= {
            connection for connection in self._connections if connection.transport.is_closing()
        }
        requests = [
            connection
            for connection in self._connections
            if connection.transport.get_protocol() is connection
        ]
        count = Counter(request.host for request in requests)
        if count[self.host] >= MOST_OF_ONE:
            requests = [request for request in requests if request.host == self.host]
        elif len(self._connections) < MOST_CONNECTIONS:
            return
        # first those whose request is not complete, of the address that has most
        requests.sort(key=lambda one: (one._late is None, -count[one.host], one._since_s))
        (requests or [self])[0].transport.abort()

    def _after_request(self, data: bytes) -> bytes:
        """Follow the request that arrives; what comes behind its end, where its time ends."""
        try:
            self._request.receive_data(data)
            while (event := self._request.next_event()) not in (h11.NEED_DATA, h11.PAUSED):
                if isinstance(event, h11.EndOfMessage):
                    self._stop_waiting()
                    return self._request.trailing_data[0]
        except h11.RemoteProtocolError:  # uvicorn refuses it
            self._stop_waiting()
        return b""

    def _await_request(self) -> None:
        self._request = h11.Connection(h11.SERVER, HEADERS_MAX_BYTES)
        self._late = self._loop.call_later(HEADERS_WITHIN_S, self.transport.abort)

    def _stop_waiting(self) -> None:
        if self._late is not None:
            self._late.cancel()
            self._late = None


class CarefulSocket(WebSocketsSansIOProtocol):
    """A WebSocket that is aborted where its browser takes nothing, or sends more than requests need.

    A browser that takes nothing never takes the message that would close the connection either. Parts of
    messages and pings are kept and answered by uvicorn; the application, which counts requests, never sees
    them.
    """

    _untaken: asyncio.TimerHandle | None = None
    _parts: int = 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Accept a connection."""
        super().connection_made(transport)
        self._allowance = Allowance(BURST * REQUEST_BYTES, PER_SECOND * REQUEST_BYTES)

    def data_received(self, data: bytes) -> None:
        """Read on, unless there is too much."""
        if self._allowance.allows(len(data)):
            super().data_received(data)
        else:
            self.transport.abort()

    def handle_cont(self, event: Frame) -> None:
        """Add a part to a message."""
        super().handle_cont(event)
        self._parts = 0 if event.fin else self._parts + 1
        if self._parts > MOST_PARTS:
            self.transport.abort()

    def pause_writing(self) -> None:
        """Wait for the browser to take what it was sent, but not for ever."""
        super().pause_writing()
        self._untaken = self.loop.call_later(TAKEN_WITHIN_S, self.transport.abort)

    def resume_writing(self) -> None:
        """Go on sending."""
        super().resume_writing()
        self._stop_waiting()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._stop_waiting()
        super().connection_lost(exc)

    def _stop_waiting(self) -> None:
        if self._untaken is not None:
            self._untaken.cancel()
            self._untaken = None
