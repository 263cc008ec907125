"""A field page on real sockets of this computer, and browsers in a few lines."""

from __future__ import annotations

import http.client
import json
import socket
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.sync.client import ClientConnection, connect

from fieldkit.config import load_config
from fieldkit.model.samples import EventKind
from fieldkit.page.checks import CHECKS, Check
from fieldkit.page.keys import Keys
from fieldkit.page.server import Page, listening, server
from fieldkit.page.viewer import Role
from fieldkit.recording.campaign import init_campaign
from fieldkit.results.check import check
from fieldkit.sessions.reader import open_session
from tests.harness.waiting import PATIENCE_S, wait_until

HOST = "127.0.0.1"


def free_port() -> int:
    """A port on which nothing listens."""
    with socket.socket() as listener:
        listener.bind((HOST, 0))
        return int(listener.getsockname()[1])


def campaign(folder: Path) -> Path:
    """A simulated campaign."""
    init_campaign(folder, simulated=True)
    return folder


@dataclass
class Answer:
    """What the server answered."""

    status: int
    headers: dict[str, str]
    body: bytes

    @property
    def json(self) -> Any:
        return json.loads(self.body)


@dataclass
class Served:
    """A page that is being served."""

    page: Page
    port: int

    @property
    def host(self) -> str:
        return f"{HOST}:{self.port}"

    @property
    def origin(self) -> str:
        return f"http://{self.host}"

    @property
    def keys(self) -> Keys:
        return self.page.keys

    def ask(self, method: str, path: str, body: Any = None, **headers: str) -> Answer:
        """A request; underscores of header names become dashes, Host and all else as given."""
        sent = {name.replace("_", "-"): value for name, value in headers.items()}
        connection = http.client.HTTPConnection(HOST, self.port, timeout=PATIENCE_S)
        try:
            text = None if body is None else json.dumps(body)
            if text is not None:
                sent.setdefault("Content-Type", "application/json")
            connection.request(method, path, text, sent)
            answer = connection.getresponse()
            return Answer(
                answer.status, {name.lower(): value for name, value in answer.headers.items()}, answer.read()
            )
        finally:
            connection.close()

    def cookie(self, role: Role = "control") -> str:
        """A browser's cookie, for a new link."""
        key = self.keys.new_link(role)
        answer = self.ask("POST", "/key", {"key": key}, Origin=self.origin)
        assert answer.status == 200, answer
        return answer.headers["set-cookie"].partition(";")[0]

    def browser(self, role: Role = "control", **more: Any) -> Browser:
        """A browser that came by a new link."""
        return self.opened(Cookie=self.cookie(role), **more)

    def opened(self, origin: str | None = "", **headers: str) -> Browser:
        """A WebSocket with these headers; `origin` "" stands for the page's own."""
        connection = connect(
            f"ws://{self.host}/socket", origin=self.origin if origin == "" else origin,  # type: ignore[arg-type]
            additional_headers=headers, open_timeout=PATIENCE_S, compression=None,
            ping_interval=None,  # browsers send none
        )  # fmt: skip
        opened = ExitStack()
        return Browser(opened.enter_context(connection), opened)


@dataclass
class Browser:
    """A WebSocket's browser end."""

    socket: ClientConnection
    opened: ExitStack
    number: int = 0
    unread: list[dict[str, Any]] = field(default_factory=list)

    def __enter__(self) -> Browser:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave the page."""
        self.opened.close()

    def request(self, **what: Any) -> dict[str, Any]:
        """Send a request; its answer."""
        self.number += 1
        self.socket.send(json.dumps({**what, "id": self.number}))
        messages, ahead = self._messages(), list[dict[str, Any]]()
        while not _is(message := next(messages), "answer", {"id": self.number}):
            ahead.append(message)
        self.unread = ahead  # what a request changes may be told before its answer
        return message

    def next(self, kind: str, **wanted: Any) -> dict[str, Any]:
        """The next message of a type with these values, among those since the last request."""
        return next(message for message in self._messages() if _is(message, kind, wanted))

    def _messages(self) -> Iterator[dict[str, Any]]:
        deadline = time.monotonic() + PATIENCE_S
        while True:
            while self.unread:
                yield self.unread.pop(0)
            message = self.socket.recv(timeout=max(0.0, deadline - time.monotonic()))
            if isinstance(message, str):
                yield json.loads(message)

    def picture(self) -> tuple[dict[str, Any], bytes]:
        """Header and body of the next picture."""
        deadline = time.monotonic() + PATIENCE_S
        while True:
            message = self.socket.recv(timeout=max(0.0, deadline - time.monotonic()))
            if isinstance(message, bytes):
                size = int.from_bytes(message[:2], "little")
                return json.loads(message[2 : 2 + size]), message[2 + size :]


def _is(message: dict[str, Any], kind: str, wanted: dict[str, Any]) -> bool:
    return message["type"] == kind and all(message[key] == value for key, value in wanted.items())


@contextmanager
def served(
    folder: Path, *, port: int = 0, preview: bool = False, checks: Sequence[Check] = CHECKS, **settings: Any
) -> Iterator[Served]:
    """Serve the page of a campaign in a thread; without instruments unless `preview`."""
    with listening(HOST, port) as listener:
        number = int(listener.getsockname()[1])
        values = [f"{key.replace('__', '.')}={value}" for key, value in settings.items()]
        config = load_config(folder / "fieldkit.toml", settings=values)
        page = Page(config, number, values, preview, checks=checks)
        running = server(page)
        thread = threading.Thread(target=running.run, kwargs={"sockets": [listener]}, daemon=True)
        thread.start()
        wait_until(lambda: running.started or not thread.is_alive(), "the page does not start", PATIENCE_S)
        assert thread.is_alive()
        try:
            yield Served(page, number)
        finally:
            running.should_exit = True
            thread.join(PATIENCE_S)
            assert not thread.is_alive()


def lost_nothing(folder: Path, seconds: float | None = None) -> None:
    """The only session is sealed and sound; no sample was dropped, and no frame is missing in its seconds."""
    (path,) = (folder / "recordings").glob("*.h5")
    assert check(path).level != "fail"
    with open_session(path) as session:
        assert session.state == "sealed"
        assert not [event for event in session.events() if event.kind in (EventKind.GAP, EventKind.VIEW)]
        assert all(stream.dropped == 0 for health in session.health() for stream in health.streams)
        times_s = np.array([frame.time_ns for frame in session.samples("camera")]) / 1e9
        rate_hz = session.streams["camera"].rate_hz
    assert np.diff(times_s).max() < 1.5 / rate_hz
    assert seconds is None or len(times_s) == pytest.approx(seconds * rate_hz, abs=2)
