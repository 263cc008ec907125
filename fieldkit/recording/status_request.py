"""Asking a recorder for its status: one request and one reply on a socket beside the session.

The recorder has everything at hand and draws it, so that the command that asks loads no library for it.
"""

from __future__ import annotations

import json
import socket
from pathlib import Path
from typing import Any

from fieldkit.recording.running import unresponsive_recorder
from fieldkit.sessions.lock import journal_path
from fieldkit.views import unix_socket

NAME = "status"
WAITS_S = 5.0
"""A recorder on a busy small computer needs a second for its status."""


def status_path(session: Path) -> Path:
    """The socket of the recorder of a session."""
    return journal_path(session) / NAME


def present_status(session: Path, cols: int = 80) -> dict[str, Any]:
    """The status of a session in progress: its recorder's, or what is stored if that does not respond."""
    if (status := recorder_status(session, cols)) is not None:
        return status
    from fieldkit.recording.status import status_reply, stored_status

    return status_reply(stored_status(session), cols)


def recorder_status(session: Path, cols: int = 80) -> dict[str, Any] | None:
    """The reply of `fieldkit.recording.status.status_reply` by the recorder of a session.

    None of a recorder that does not respond, has no sample yet, is of another version or of another user.
    """
    if unresponsive_recorder(session) is not None:
        return None
    try:
        with unix_socket.connect(status_path(session), WAITS_S) as connection:
            connection.sendall(json.dumps({"cols": cols}).encode())
            connection.shutdown(socket.SHUT_WR)
            with connection.makefile("rb") as stream:
                reply: dict[str, Any] = json.loads(stream.read())
    except (OSError, ValueError):
        return None
    return reply
