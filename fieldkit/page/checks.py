"""Checks that every request passes before the page looks at it; each is one function.

A browser obeys whatever page it shows. A page of another origin may send it here (so the origin is checked),
or give this computer's address to a name of its own (so the host is checked). Addresses are never trusted,
nor what a proxy says about them.
"""

from __future__ import annotations

import asyncio
import ipaddress
import socket
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from fieldkit.page.keys import Keys
from fieldkit.page.phrases import preferred_language
from fieldkit.phrases import Words, in_language

Check = Callable[[Scope, Keys], str | None]
"""Why a request is refused, or None."""

ANSWERED = {
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cache-control": "no-store",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "x-frame-options": "DENY",
}
"""Headers of every answer."""


def known_host(scope: Scope, _: Keys) -> str | None:
    """The host must be this computer's name, or the very address at which the connection arrived.

    A page that has its own name resolve to this computer (DNS rebinding) sends its own name.
    """
    host = host_name(Headers(scope=scope).get("host", ""))
    address = str((scope.get("server") or ("",))[0])
    if host in own_names(address) or (_ip(host) is not None and _ip(host) == _ip(address)):
        return None
    return Words("refused.host", host=host)


def host_name(host: str) -> str:
    """The host of ``host:port`` in lower case, without the port or the brackets of an IPv6 address."""
    if host.startswith("["):
        return host[1:].partition("]")[0].lower()
    return host.partition(":")[0].lower()


def own_names(address: str) -> set[str]:
    """Names under which browsers may know this computer, at the address where a connection arrived."""
    name = socket.gethostname().lower()
    names = {name, f"{name.partition('.')[0]}.local"}
    ip = _ip(address)
    return names | {"localhost"} if ip is not None and ip.is_loopback else names


def _ip(text: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    """An address; one of IPv4 also where a socket of both kinds writes it as ``::ffff:192.168.4.1``."""
    try:
        address = ipaddress.ip_address(text)
    except ValueError:
        return None
    return getattr(address, "ipv4_mapped", None) or address


def same_origin(scope: Scope, keys: Keys) -> str | None:
    """Requests that may change something must come from this page itself, or with a key from a program.

    Browsers name the origin with every upgrade and every POST; programs that name none must bring a key.
    """
    if scope["type"] == "http" and scope["method"] in ("GET", "HEAD"):
        return None
    headers = Headers(scope=scope)
    origin = headers.get("origin")
    if origin is not None:
        host = headers.get("host", "")
        return None if origin.lower() == f"http://{host.lower()}" else Words("refused.origin", origin=origin)
    key = bearer(headers)
    if key and (keys.session(key) or keys.is_link(key)):
        return None
    return Words("refused.program")


def bearer(headers: Headers) -> str:
    """The key of an ``Authorization: Bearer`` header, or nothing."""
    scheme, _, key = headers.get("authorization", "").partition(" ")
    return key.strip() if scheme.lower() == "bearer" else ""


CHECKS: tuple[Check, ...] = (known_host, same_origin)


@dataclass
class Guarded:
    """An application behind checks; what they refuse never reaches it."""

    app: ASGIApp
    keys: Keys
    checks: Sequence[Check] = CHECKS

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on or refuse it, and add the headers that every answer has."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        refusals = [why for check in self.checks if (why := check(scope, self.keys))]
        if not refusals:
            await self.app(scope, receive, _with_headers(send))
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        else:
            text = in_language(
                refusals[0], preferred_language(Headers(scope=scope).get("accept-language", ""))
            )
            await PlainTextResponse(text, 403)(scope, receive, _with_headers(send))


def _with_headers(send: Send) -> Send:
    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            own = {name for name, _ in message["headers"]}
            more = [(name.encode(), value.encode()) for name, value in ANSWERED.items()]
            message["headers"] = [*message["headers"], *(pair for pair in more if pair[0] not in own)]
        await send(message)

    return sending


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
