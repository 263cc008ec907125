"""The limit of connections that uvicorn has no setting for: how long a request may take to arrive."""

from __future__ import annotations

import asyncio
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

REQUEST_WITHIN_S = 10.0
"""A browser sends its request at once; what stays silent for longer would only hold a place."""


class PromptProtocol(H11Protocol):
    """HTTP/1.1 of uvicorn, which aborts connections on which no whole request arrives in time."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]  # as uvicorn's
        """Accept a connection."""
        super().connection_made(transport)
        self.loop.call_later(REQUEST_WITHIN_S, self._abort_if_silent, None)

    def _abort_if_silent(self, previous: Any) -> None:
        """Abort if there was no request after the `previous` one, which is answered."""
        if self.transport.is_closing() or self.transport.get_protocol() is not self:  # or a WebSocket now
            return
        is_answered = previous is None or previous.response_complete
        if is_answered and self.cycle is previous:
            self.transport.abort()
        else:
            self.loop.call_later(REQUEST_WITHIN_S, self._abort_if_silent, self.cycle)
