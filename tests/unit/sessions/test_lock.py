"""One process records a session; who asks about it keeps nobody from beginning."""

from __future__ import annotations

import fcntl
import os
import threading
from pathlib import Path

import pytest

from fieldkit.errors import RefusedError
from fieldkit.sessions.lock import RECORDING, SessionLock, is_locked, owner


def test_lock_is_for_one_and_names_its_process(tmp_path: Path) -> None:
    lock = SessionLock(tmp_path)
    assert is_locked(tmp_path)
    assert owner(tmp_path) == os.getpid()
    with pytest.raises(RefusedError, match=f"in use by process {os.getpid()}"):
        SessionLock(tmp_path)
    lock.release()
    assert owner(tmp_path) is None
    SessionLock(tmp_path).release()


def test_a_look_at_the_lock_does_not_keep_a_recorder_from_beginning(tmp_path: Path) -> None:
    """Another process looks, and is held up for 20 ms while it does."""
    (tmp_path / RECORDING).touch()
    descriptor = os.open(tmp_path / RECORDING, os.O_RDONLY)
    fcntl.flock(descriptor, fcntl.LOCK_SH)
    threading.Timer(0.02, os.close, [descriptor]).start()
    SessionLock(tmp_path).release()
