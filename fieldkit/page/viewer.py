"""One browser that is connected: what waits to be sent to it, the newest picture only."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Literal

from fieldkit.page.pictures import Mode
from fieldkit.phrases import ENGLISH

Role = Literal["view", "control"]
TEXTS_WAITING = 256
BURST, PER_SECOND = 80, 40
"""Requests that may come at once, and as a rate: dragging a corner asks some ten times a second."""


class ViewerLeftError(Exception):
    """A viewer is to be disconnected; the text is the end of a key, ``closed.REASON``."""


@dataclass(eq=False)
class Viewer:
    """Queue of one browser: every text in order, of pictures only the newest that it is ready for."""

    role: Role
    ends_at: float = float("inf")
    language: str = ENGLISH
    mode: Mode = "off"
    _texts: deque[str] = field(default_factory=deque)
    _picture: bytes | None = None
    _wake: asyncio.Event = field(default_factory=asyncio.Event)
    _reason: str = ""
    _allowed: float = BURST
    _counted_at: float = 0.0

    def text(self, message: str) -> None:
        """Queue a text; a viewer that does not read is disconnected."""
        if len(self._texts) < TEXTS_WAITING:
            self._texts.append(message)
            self._wake.set()
        else:
            self.leave("slow")

    def picture(self, message: bytes) -> None:
        """Offer a picture in place of one that still waits."""
        self._picture = message
        self._wake.set()

    def leave(self, reason: str) -> None:
        """Have `send` end."""
        self._reason = reason
        self._wake.set()

    def count_request(self) -> None:
        """Raise `ViewerLeftError` if requests come faster than a person can make them."""
        now = time.monotonic()
        allowed = min(BURST, self._allowed + (now - self._counted_at) * PER_SECOND)
        self._allowed, self._counted_at = allowed - 1, now
        if self._allowed < 0:
            raise ViewerLeftError("too_many")

    async def send(
        self, text: Callable[[str], Awaitable[None]], picture: Callable[[bytes], Awaitable[None]]
    ) -> None:
        """Send what comes in, until `leave`; raises `ViewerLeftError`."""
        while True:
            await self._wake.wait()
            self._wake.clear()
            await self._send_waiting(text, picture)
            if self._reason:
                raise ViewerLeftError(self._reason)

    async def _send_waiting(
        self, text: Callable[[str], Awaitable[None]], picture: Callable[[bytes], Awaitable[None]]
    ) -> None:
        while self._texts and not self._reason:
            await text(self._texts.popleft())
        waiting, self._picture = self._picture, None
        if waiting is not None and not self._reason:
            await picture(waiting)
