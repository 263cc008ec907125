"""The recorder's end of `status_request`: a view that reports how the recording is doing."""

from __future__ import annotations

import json
import logging
import socket
import threading
from contextlib import suppress
from pathlib import Path

from fieldkit.recorder.recorder import Shown
from fieldkit.recording.status import RecordingStatus, status_reply
from fieldkit.recording.status_request import WAITS_S, status_path
from fieldkit.results.json_document import plain_json
from fieldkit.views import unix_socket
from fieldkit.views.latest import Latest

log: logging.Logger = logging.getLogger(__name__)


class StatusServer:
    """A view that replies to requests for the status from `latest`, which another view updates.

    Raises `OSError` if it cannot listen.
    """

    def __init__(self, session: Path, title: str, latest: Latest) -> None:
        self._session, self._title, self._latest = session, title, latest
        self._socket = unix_socket.listening(status_path(session))
        threading.Thread(target=self._serve, name="status", daemon=True).start()

    def show(self, item: Shown) -> None:
        """Nothing is drawn until it is asked for."""

    def close(self) -> None:
        """Reply no more."""
        unix_socket.end(self._socket)

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self._socket.accept()
            except OSError:  # closed
                return
            connection.settimeout(WAITS_S)
            with connection, suppress(OSError):  # the command that asked has ended
                self._reply(connection)

    def _reply(self, connection: socket.socket) -> None:
        """Reply to one request; nothing before the first sample."""
        with connection.makefile("rb") as stream:
            request = stream.read()
        try:
            if (status := self._status()) is not None:
                connection.sendall(plain_json(status_reply(status, **json.loads(request))).encode())
        except (ValueError, TypeError) as error:
            log.warning("a request for the status of this recording was not understood: %r", error)

    def _status(self) -> RecordingStatus | None:
        latest = self._latest
        times_ns = [frame.time_ns for frame in latest.frames.values()]
        times_ns += [reading.time_ns for reading in latest.readings.values()]
        if not times_ns:
            return None
        streams = latest.health.streams if latest.health else ()
        counts = {stream.stream: stream.received for stream in streams}
        return RecordingStatus(
            self._session, self._title, latest.start_ns, max(times_ns), counts, latest, None
        )
