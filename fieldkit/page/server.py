"""The server of the field page: one document, one WebSocket, keys for cookies, reports and files."""

from __future__ import annotations

import asyncio
import errno
import gzip
import json
import logging
import secrets
import socket
import threading
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from html import escape
from pathlib import Path

import uvicorn
from starlette.applications import Starlette
from starlette.datastructures import Headers
from starlette.requests import ClientDisconnect, HTTPConnection, Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp
from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState

from fieldkit.config import Config
from fieldkit.model.errors import FieldkitError, StorageError
from fieldkit.page import checks, requests
from fieldkit.page.answers import Answers, failure
from fieldkit.page.checks import CHECKS, Check, Guarded, PromptProtocol, bearer
from fieldkit.page.conductor import Conductor
from fieldkit.page.document import document
from fieldkit.page.hub import Hub
from fieldkit.page.keys import SESSION_LASTS_S, Keys
from fieldkit.page.phrases import PageError, preferred_language
from fieldkit.page.pictures import still
from fieldkit.page.service import keep_recording, report_page
from fieldkit.page.sessions import PRODUCTS, PastSessions
from fieldkit.page.viewer import Role, Viewer, ViewerLeftError
from fieldkit.phrases import in_language, phrases
from fieldkit.results.json_document import plain_json
from fieldkit.views.metrics import MEDIA_TYPE, metrics
from fieldkit.views.service_manager import notify

log: logging.Logger = logging.getLogger(__name__)
_Serve = Callable[[Request], Awaitable[Response]]

HEADERS_MAX_BYTES, KEY_MAX_BYTES = 16_384, 1000
ACKNOWLEDGED_WITHIN_S = 20.0
"""A browser that receives nothing for this long is gone, or asleep in a pocket."""
UNSENT_BYTES = 32_768
"""Held by the kernel for a slow connection: a second of pictures, so that the newest is never far."""
WRONG_TRIES_FREE = 5
WRONG_TRIES_WAITING = 20
ANSWERS_AT_ONCE = 8
FULL, NO_KEY, LEFT = 4001, 4003, 4008
"""Codes with which a WebSocket is closed: too many viewers, no key, disconnected with a reason."""
REPORT_POLICY = "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:"
WAITING_POLICY = "default-src 'none'; style-src 'unsafe-inline'; frame-ancestors 'none'"
"""Without a sandbox: what a sandboxed page loads again, browsers ask for without the cookie."""

WAITING = """<!doctype html>
<html lang="{language}"><meta charset="utf-8"><meta name="color-scheme" content="light dark">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>body {{ margin: 15vh auto; max-width: 30rem; padding: 0 16px; overflow-wrap: anywhere;
font: 17px/1.4 system-ui, sans-serif }}
h1 {{ font-size: 1.3rem }}
progress {{ width: 100%; height: 16px }}</style>
<main><h1>{title}</h1>
<p>{text}</p>
<progress aria-label="{title}"></progress></main></html>
"""


@dataclass
class Page:
    """The page of one campaign: its parts, and the application that serves them."""

    config: Config
    port: int
    settings: Sequence[str] = ()
    preview: bool = True
    record: bool = False
    checks: Sequence[Check] = CHECKS
    _wrong_tries: int = 0
    _waiting: int = 0
    _thread: threading.Thread | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        self.keys: Keys = Keys(self.config.recordings)
        self.hub: Hub = Hub(self.config)
        self.conductor: Conductor = Conductor(self.config, self.hub, self.settings, preview=self.preview)
        self.past: PastSessions = PastSessions(self.config)
        self.answers: Answers = Answers(self.config, self.hub, self.conductor, self.past)

    @property
    def cookie(self) -> str:
        """Name of the cookie: browsers share cookies among all ports of a host."""
        return f"fieldkit-{self.port}"

    def app(self) -> ASGIApp:
        """The application."""
        routes = [
            Route("/", self.serve_document),
            Route("/role", self.serve_role),
            Route("/metrics", self.serve_metrics),
            Route("/key", self.take_key, methods=["POST"]),
            *(
                Route(f"/session/{{session}}/{kind}", partial(self._of_session, partial(self.product, kind)))
                for kind in PRODUCTS
            ),
            Route("/session/{session}/download", partial(self._of_session, self.download)),
            Route("/session/{session}/picture", partial(self._of_session, self.still)),
            Route("/session/{session}/thumbnail", partial(self._of_session, self.thumbnail)),
            WebSocketRoute("/socket", self.serve_socket),
        ]
        return Guarded(Starlette(routes=routes, lifespan=self._running), self.keys, self.checks)

    @asynccontextmanager
    async def _running(self, _: Starlette) -> AsyncIterator[None]:
        beat = asyncio.create_task(self.hub.run())
        reports = asyncio.create_task(report_page(self.hub))
        thread = threading.Thread(target=self.conductor.run, name="conductor", daemon=True)
        thread.start()
        ending = threading.Event()
        if self.record:
            unattended = (self.conductor, ending)
            threading.Thread(target=keep_recording, args=unattended, name="unattended", daemon=True).start()
        try:
            yield
        finally:
            notify("STOPPING=1")
            ending.set()
            self.conductor.close()
            beat.cancel()
            reports.cancel()
            await asyncio.to_thread(thread.join, 5.0)

    # --- the document

    async def serve_document(self, request: Request) -> Response:
        """The page itself, which knows nothing without a key; compressed where the browser takes it."""
        nonce = secrets.token_urlsafe(16)
        headers = {"content-security-policy": _policy(nonce)}
        body = document(nonce, _language(request)).encode()
        if "gzip" in request.headers.get("accept-encoding", ""):
            headers["content-encoding"] = "gzip"
            body = gzip.compress(body, compresslevel=5)
        return Response(body, media_type="text/html", headers=headers)

    # --- keys

    def session_of(self, connection: HTTPConnection) -> tuple[Role, float] | None:
        """Role and end of the session that a request belongs to, by its cookie or its bearer key."""
        key = connection.cookies.get(self.cookie) or bearer(Headers(scope=connection.scope))
        return self.keys.session(key) if key else None

    async def serve_role(self, request: Request) -> Response:
        """Role of this browser: ``view``, ``control``, or null without a key."""
        session = self.session_of(request)
        return JSONResponse({"role": session[0] if session else None})

    async def serve_metrics(self, request: Request) -> Response:
        """The present numbers in OpenMetrics, for a program that brings a key."""
        if self.session_of(request) is None:
            return await self._refuse()
        text = metrics(self.hub.latest, is_recording=self.hub.state.phase == "recording")
        return Response(text, media_type=MEDIA_TYPE)

    async def take_key(self, request: Request) -> Response:
        """Exchange the key of a link for a session, in a cookie that no script can read."""
        key = await self._sent_key(request)
        try:
            grant = await asyncio.to_thread(self.keys.exchange, key) if key else None
        except StorageError as error:
            log.error("a link was not exchanged: %s", error)
            return JSONResponse({"key": "refused.storage"}, 507)
        if grant is None:
            return await self._refuse()
        self._wrong_tries = 0
        session, role = grant
        answer = JSONResponse({"role": role})
        answer.set_cookie(
            self.cookie, session, max_age=int(SESSION_LASTS_S), path="/", httponly=True, samesite="strict"
        )
        return answer

    async def _sent_key(self, request: Request) -> str:
        """The key of a request; none for whatever else arrives, or for a request that is broken off."""
        if (key := bearer(request.headers)) and not self.keys.session(key):
            return key
        if request.headers.get("content-type", "").partition(";")[0] != "application/json":
            return ""
        with suppress(ValueError, KeyError, TypeError, AttributeError, RecursionError):
            return str(json.loads(await _short_body(request))["key"])
        return ""

    async def _refuse(self) -> Response:
        """A wrong key; after a few of them each takes a second, and many at once are not even tried."""
        self._wrong_tries += 1
        if self._waiting >= WRONG_TRIES_WAITING:
            return JSONResponse({"key": "refused.too_many"}, 429)
        if self._wrong_tries > WRONG_TRIES_FREE:
            self._waiting += 1
            try:
                await asyncio.sleep(1.0)
            finally:
                self._waiting -= 1
        return JSONResponse({"key": "refused.used"}, 403)

    # --- sessions

    async def _of_session(self, serve: _Serve, request: Request) -> Response:
        grant = self.session_of(request)
        if grant is None or grant[0] != "control":
            return _explain(PageError("view_only"), request, 403)
        try:
            return await serve(request)
        except FieldkitError as error:
            return _explain(error, request, 404)
        except Exception as error:
            return _explain(_failure(error, request.url.path), request, 500)

    async def product(self, kind: str, request: Request) -> Response:
        """A session's report, image or film; while it is made, a page that asks again."""
        session, texts = request.path_params["session"], phrases(_language(request))
        product = self.past.product(kind, session)
        if isinstance(product, Path):
            if kind == "report":
                return FileResponse(product, headers={"content-security-policy": REPORT_POLICY})
            return FileResponse(product, filename=_file_name(product))
        headers = {"content-security-policy": WAITING_POLICY}
        if product.done() and product.result():
            return _text(in_language(product.result(), _language(request)), 500, headers)
        title = escape(f"{texts[f'sessions.{kind}']}: {self.past.path(session).stem}")
        text = texts["page.making"].format(seconds=f"{self.past.waited_s(kind, session):.0f}")
        waiting = WAITING.format(language=_language(request), title=title, text=text).encode(errors="replace")
        return HTMLResponse(waiting, 202, {**headers, "refresh": "2"})

    async def download(self, request: Request) -> Response:
        """A session's file."""
        path = self.past.sealed_path(request.path_params["session"])
        return FileResponse(path, media_type="application/x-hdf5", filename=_file_name(path))

    async def still(self, request: Request) -> Response:
        """A frame of a session, to draw on."""
        kelvin = await asyncio.to_thread(self.past.frame_k, request.path_params["session"])
        return Response(still(kelvin), media_type="application/octet-stream")

    async def thumbnail(self, request: Request) -> Response:
        """A small image of a session, for the list."""
        small = await asyncio.to_thread(self.past.thumbnail, request.path_params["session"])
        return Response(small, media_type="application/octet-stream")

    # --- the socket

    async def serve_socket(self, socket: WebSocket) -> None:
        """Everything that moves: state and pictures to the browser, requests from it."""
        session = self.session_of(socket)
        if session is None:
            await self._refuse()
            await socket.close(NO_KEY)
            return
        await socket.accept()
        viewer = Viewer(*session, language=_language(socket))
        try:
            if self.hub.join(viewer):
                await self._serve(socket, viewer)
            else:
                await socket.close(FULL, "full")
        finally:
            self.hub.leave(viewer)

    async def _serve(self, socket: WebSocket, viewer: Viewer) -> None:
        """Send and receive until either ends."""
        sending = asyncio.create_task(viewer.send(socket.send_text, socket.send_bytes))
        receiving = asyncio.create_task(self._receive(socket, viewer))
        ended, others = await asyncio.wait((sending, receiving), return_when=asyncio.FIRST_COMPLETED)
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)
        causes = (error for task in ended if isinstance(error := task.exception(), ViewerLeftError))
        cause = next(causes, None)
        if cause is not None and socket.application_state is WebSocketState.CONNECTED:
            with suppress(RuntimeError, WebSocketDisconnect):
                await socket.close(LEFT, str(cause))

    async def _receive(self, socket: WebSocket, viewer: Viewer) -> None:
        busy: set[asyncio.Task[None]] = set()
        try:
            while True:
                message = await socket.receive()
                if message["type"] == "websocket.disconnect":
                    return
                viewer.count_request()
                if len(busy) >= ANSWERS_AT_ONCE:  # the browser waits
                    await asyncio.wait(busy, return_when=asyncio.FIRST_COMPLETED)
                busy.add(task := asyncio.create_task(self._answer(viewer, message.get("text") or "")))
                task.add_done_callback(busy.discard)
        finally:
            for task in busy:  # a start or stop goes on in its thread
                task.cancel()

    async def _answer(self, viewer: Viewer, text: str) -> None:
        try:
            request = requests.parse(text)
        except requests.BadRequestError as error:
            viewer.text(plain_json(failure(error.id, error, viewer.language)))
            return
        try:
            answered = await self.answers.to(viewer, request)
        except Exception as error:  # the browser waits for an answer, whatever fails
            answered = failure(request.id, _failure(error, request.do), viewer.language)
        if request.id is not None:
            viewer.text(plain_json(answered))


async def _short_body(request: Request) -> bytes:
    """The body of a request; empty if it is too long, late or broken off."""
    body = b""
    with suppress(ClientDisconnect, TimeoutError):
        async with asyncio.timeout(checks.REQUEST_WITHIN_S):
            async for part in request.stream():
                body += part
                if len(body) > KEY_MAX_BYTES:
                    return b""
            return body
    return b""


def _failure(error: Exception, asked: str) -> PageError:
    """The error for a browser whose request failed unexpectedly: it is referred to the log."""
    log.error("a request failed: %s", asked, exc_info=error)
    return PageError("failed")


def _explain(error: FieldkitError, request: Request, status: int) -> Response:
    """An error in place of a file, in the browser's language."""
    return _text(in_language(error.words, _language(request)), status)


def _language(request: HTTPConnection) -> str:
    """The language of a browser: the one chosen on the page, or the first that it prefers."""
    return preferred_language(request.headers.get("accept-language", ""), request.cookies.get("language", ""))


def _file_name(path: Path) -> str:
    """The name of a file, also one that is not UTF-8."""
    return path.name.encode(errors="replace").decode()


def _text(words: str, status: int, headers: Mapping[str, str] | None = None) -> Response:
    """Words that may name a file whose name is not UTF-8."""
    return PlainTextResponse(words.encode(errors="replace"), status, headers)


def _policy(nonce: str) -> str:
    return (
        f"default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; img-src blob: data:; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )


def server(page: Page) -> uvicorn.Server:
    """The server that runs a page on sockets; ``run(sockets=[…])`` returns when it is interrupted."""
    return uvicorn.Server(
        uvicorn.Config(
            page.app(),
            http=PromptProtocol,
            ws="websockets-sansio",
            loop="asyncio",
            lifespan="on",
            log_config=None,
            log_level="warning",
            access_log=False,
            proxy_headers=False,
            server_header=False,
            date_header=False,
            ws_max_size=requests.MAX_BYTES,
            ws_per_message_deflate=False,
            ws_ping_interval=10.0,
            ws_ping_timeout=10.0,
            h11_max_incomplete_event_size=HEADERS_MAX_BYTES,
            timeout_keep_alive=5,
            timeout_graceful_shutdown=2,
        )
    )


def listening(address: str, port: int) -> socket.socket:
    """A socket that listens at an address; raises `OSError` if it cannot, or for none, which would be all."""
    if not address:
        raise OSError(errno.EADDRNOTAVAIL, "the address is empty")
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        # connections inherit both: the kernel aborts those that acknowledge nothing, which asyncio cannot see
        acknowledged_within_ms = round(1000 * ACKNOWLEDGED_WITHIN_S)
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, acknowledged_within_ms)
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, UNSENT_BYTES)
        listener.bind((address, port))
        listener.listen(128)  # links that are printed work at once
    except OSError:
        listener.close()
        raise
    return listener
