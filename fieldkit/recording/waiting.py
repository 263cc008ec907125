"""A recorder that waits for its time: its instruments are open and shown, and nothing is stored yet."""

from __future__ import annotations

import threading
from collections.abc import Sequence

from fieldkit.recorder import View
from fieldkit.recording.preview import LivePreview
from fieldkit.recording.record import PreparedRecording
from fieldkit.recording.running import WAITING_NAME
from fieldkit.sessions.lock import SessionLock


def await_begin(prepared: PreparedRecording, views: Sequence[View], stopping: threading.Event) -> bool:
    """Show the instruments until the recording is to begin; False if `stopping` is set before.

    They are read all the time, so that the first samples of the recording are not old ones from a buffer.
    """
    waiting = SessionLock(prepared.path.parent, WAITING_NAME)
    try:
        preview = LivePreview(prepared.config, prepared.instruments, views)
        preview.run(prepared.begins_in_s(), stopping.is_set)
    finally:
        waiting.release()
    return not stopping.is_set()
