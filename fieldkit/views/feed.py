"""The feed: what a recording shows, passed to other processes of the same user on a Unix socket.

`Feed` is a view of the recorder that listens beside the session. A connection begins with a message of
the reader: after ``["Status", {"cols": 80}]`` it receives one message, the status; after ``["Feed", {}]``
what is known so far, then every small item and the newest frame of each stream. Each reader has a thread that
waits for it, so a slow reader loses frames and never delays the recorder.

The header of a message (`unix_socket`) names the kind of item, its body are the counts of a frame.
"""

from __future__ import annotations

import json
import logging
import socket
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fieldkit.estimation.estimator import Minute
from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import Event, Frame, Health, Quality, Reading
from fieldkit.model.site import Region, RegionRecord, Site
from fieldkit.sessions.json_forms import build
from fieldkit.views import unix_socket
from fieldkit.views.latest import Item, Latest, Trend
from fieldkit.views.unix_socket import FEED, STATUS

log: logging.Logger = logging.getLogger(__name__)

MAX_READERS = 8
SMALL_ITEMS_KEPT = 4096
"""Readings, events and minutes that may wait for a reader; the oldest are dropped."""


@dataclass(frozen=True, slots=True)
class FeedStart:
    """Message that a reader receives first: the recording's place, regions, streams and planned end (UTC)."""

    site: Site
    regions: tuple[Region, ...]
    streams: tuple[StreamInfo, ...]
    title: str = ""
    planned_end_ns: int | None = None
    start_ns: int = 0

    def latest(self) -> Latest:
        """The state that further items update."""
        latest = Latest(self.site, self.regions, self.streams, self.title, self.planned_end_ns)
        latest.start_ns = self.start_ns
        return latest


KINDS: dict[str, type[Any]] = {
    kind.__name__: kind for kind in (FeedStart, Trend, Minute, Event, RegionRecord, Health, Frame, Reading)
}


class Feed:
    """A view that serves a recording to readers on a Unix socket, which only this user can open.

    `status(cols)` returns the recording's status as JSON, for a screen of so many columns.
    Raises `OSError` if it cannot listen.
    """

    def __init__(self, path: Path, latest: Latest, status: Callable[..., str]) -> None:
        self._latest, self._status = latest, status
        self._readers: list[_Sender] = []
        self._is_closed = False
        self._lock = threading.Lock()
        self._socket = unix_socket.listening(path)
        threading.Thread(target=self._accept, name="feed", daemon=True).start()

    def show(self, item: Item) -> None:
        """Keep an item for readers to come and offer it to the present ones."""
        with self._lock:
            self._latest.update(item)
            for reader in self._readers:
                reader.offer(item)

    def close(self) -> None:
        """End: readers receive what waits for them, then the end of the stream."""
        unix_socket.end(self._socket)
        with self._lock:
            self._is_closed = True
            for reader in self._readers:
                reader.offer(None)

    def _accept(self) -> None:
        while True:
            try:
                connection, _ = self._socket.accept()
            except OSError:  # closed
                return
            threading.Thread(target=self._serve, args=(connection,), name="feed reader", daemon=True).start()

    def _serve(self, connection: socket.socket) -> None:
        """Send what is asked for, until the feed or the reader ends."""
        try:
            with connection, connection.makefile("rb") as stream, suppress(OSError):
                connection.settimeout(unix_socket.WAITS_S)
                header, _ = unix_socket.read_message(stream) or (b"", b"")
                name, values = json.loads(header)
                if name == STATUS:
                    connection.sendall(unix_socket.message(f'["{STATUS}", {self._status(**values)}]'))
                elif name == FEED:
                    connection.settimeout(None)
                    self._send(connection)
        except (ValueError, TypeError) as error:
            log.warning("a request to this recording was not understood: %r", error)

    def _send(self, connection: socket.socket) -> None:
        with self._lock:
            if self._is_closed or len(self._readers) >= MAX_READERS:
                return
            self._readers.append(reader := _Sender(connection, self._so_far()))
        try:
            reader.run()
        finally:
            with self._lock:
                self._readers.remove(reader)

    def _so_far(self) -> list[Any]:
        latest = self._latest
        streams = tuple(latest.streams.values())
        start = FeedStart(
            latest.site, latest.regions, streams, latest.title, latest.planned_end_ns, latest.start_ns
        )
        last = (*latest.events, *latest.readings.values(), *latest.frames.values(), latest.health)
        return [start, latest.trend, *(item for item in (*last, latest.minute) if item is not None)]


class _Sender:
    """Sends items to one reader; `offer` never waits for it."""

    def __init__(self, connection: socket.socket, first: Sequence[Any]) -> None:
        self._connection = connection
        self._small: deque[Any] = deque(first, SMALL_ITEMS_KEPT)
        self._frames: dict[str, Frame] = {}
        self._wake = threading.Condition()

    def offer(self, item: Item | None) -> None:
        """Queue an item; a frame replaces the one of its stream that still waits. None ends the stream."""
        with self._wake:
            if isinstance(item, Frame):
                self._frames[item.stream] = item
            else:
                self._small.append(item)
            self._wake.notify()

    def run(self) -> None:
        """Send until the feed or the reader ends."""
        while True:
            for item in self._waiting():
                if item is None:
                    return
                self._connection.sendall(encode(item))

    def _waiting(self) -> list[Any]:
        with self._wake:
            self._wake.wait_for(lambda: self._small or self._frames)
            items = [*self._frames.values(), *self._small]
            self._frames.clear()
            self._small.clear()
            return items


# --- the reader's end


class FeedReader:
    """A connection to the feed of a recording; raises `OSError` if there is none."""

    def __init__(self, path: Path) -> None:
        self._socket = unix_socket.connect(path)
        self._stream = self._socket.makefile("rb")
        self._socket.sendall(unix_socket.message(f'["{FEED}", {{}}]'))

    def items(self) -> Iterator[Any]:
        """A `FeedStart`, a `Trend`, then items of the recording until it ends, its process dies, or `close`.

        Raises `ValueError` for bytes of another format.
        """
        with self._socket, self._stream, suppress(OSError):
            while received := unix_socket.read_message(self._stream):
                yield decode(*received)

    def close(self) -> None:
        """End `items`, also while another thread waits in it."""
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)


# --- messages


def encode(item: Any) -> bytes:
    """An item as a message."""
    body = b""
    if isinstance(item, Frame):
        plain = item._asdict()
        rows = (plain.pop("counts"), plain.pop("metadata_rows"))
        plain["shapes"] = [part.shape for part in rows]
        body = b"".join(np.ascontiguousarray(part, "<u2").tobytes() for part in rows)
    elif isinstance(item, Reading):
        plain = {**item._asdict(), "raw": item.raw.hex()}
    else:
        plain = asdict(item)
    return unix_socket.message(json.dumps([type(item).__name__, plain], default=_plain), body)


def decode(header: bytes, body: bytes) -> Any:
    """The item of a message; raises `ValueError` for another format."""
    try:
        name, plain = json.loads(header)
        kind = KINDS[name]
        if kind is Frame:
            return _frame(plain, body)
        if kind is Reading:
            raw, quality = bytes.fromhex(plain.pop("raw")), Quality(plain.pop("quality"))
            return Reading(**{**plain, "values": tuple(plain["values"])}, raw=raw, quality=quality)
        return build(kind, plain)
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"a message is not of a feed: {error!r}") from error


def _frame(plain: dict[str, Any], body: bytes) -> Frame:
    (rows, cols), (more_rows, more_cols) = plain.pop("shapes")
    values, size = np.frombuffer(body, "<u2").astype(np.uint16, copy=False), rows * cols
    counts, metadata_rows = values[:size].reshape(rows, cols), values[size:].reshape(more_rows, more_cols)
    quality = Quality(plain.pop("quality"))
    return Frame(**plain, counts=counts, metadata_rows=metadata_rows, quality=quality)


def _plain(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else str(value)
