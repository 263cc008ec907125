"""One process records a session; who asks about it keeps nobody from beginning."""

import fcntl
import os
import threading
import time
from pathlib import Path

import pytest

from fieldkit.model.errors import RefusedError
from fieldkit.sessions.lock import OWNER_BYTES, PATIENCE_S, RECORDING, SessionLock, is_locked, owner


def test_lock_is_for_one_and_names_its_process(tmp_path):
    lock = SessionLock(tmp_path)
    assert is_locked(tmp_path)
    assert owner(tmp_path) == os.getpid()
    with pytest.raises(RefusedError, match=f"in use by process {os.getpid()}"):
        SessionLock(tmp_path)
    lock.release()
    assert owner(tmp_path) is None
    SessionLock(tmp_path).release()


def test_what_stands_behind_the_owner_outlives_a_lock(tmp_path):
    (tmp_path / RECORDING).write_bytes(b"123456789\n".ljust(OWNER_BYTES) + b"how much was written")
    SessionLock(tmp_path).release()
    text = (tmp_path / RECORDING).read_bytes()
    assert (int(text[:OWNER_BYTES]), text[OWNER_BYTES:]) == (os.getpid(), b"how much was written")


def look_for(tmp_path: Path, seconds: float) -> threading.Timer:
    """A look at the lock that is held up for so long."""
    (tmp_path / RECORDING).touch()
    descriptor = os.open(tmp_path / RECORDING, os.O_RDONLY)
    fcntl.flock(descriptor, fcntl.LOCK_SH)
    timer = threading.Timer(seconds, os.close, [descriptor])
    timer.start()
    return timer


def test_a_look_at_the_lock_does_not_keep_a_recorder_from_beginning(tmp_path):
    """Another process looks, and is held up for 20 ms while it does."""
    look = look_for(tmp_path, 0.02)
    lock = SessionLock(tmp_path)
    assert not look.is_alive() or look.finished.is_set()  # it was waited for, not passed by
    assert owner(tmp_path) == os.getpid()
    lock.release()


def test_a_lock_that_stays_is_refused_after_a_moment(tmp_path):
    look = look_for(tmp_path, 60.0)
    began = time.monotonic()
    with pytest.raises(RefusedError):
        SessionLock(tmp_path)
    assert 0.5 * PATIENCE_S < time.monotonic() - began < 5.0
    look.cancel()
    os.close(look.args[0])
    SessionLock(tmp_path).release()
