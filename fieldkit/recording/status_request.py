"""Asking a recorder for its status: one message and one reply on the socket of its feed.

The recorder has everything at hand and draws it, so that the command that asks loads no library for it.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from fieldkit.recording.running import unresponsive_recorder
from fieldkit.sessions.lock import journal_path
from fieldkit.views import unix_socket


def feed_path(session: Path) -> Path:
    """The socket of the recorder of a session."""
    return journal_path(session) / "feed"


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
        with unix_socket.connect(feed_path(session), unix_socket.WAITS_S) as connection:
            connection.sendall(unix_socket.message(json.dumps([unix_socket.STATUS, {"cols": cols}])))
            with connection.makefile("rb") as stream:
                header, _ = unix_socket.read_message(stream) or (b"[null, null]", b"")
        status: dict[str, Any] | None = json.loads(header)[1]
    except (OSError, ValueError):
        return None
    return status
