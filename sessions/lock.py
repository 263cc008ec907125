"""Lock of the program that writes a session: a lock that the kernel lets go of when its process dies.

So a lock is never stale; the file's text names the process that holds it.
"""

from __future__ import annotations

import os
import time
from contextlib import AbstractContextManager, suppress
from pathlib import Path

from fieldkit.model.errors import RefusedError
from fieldkit.phrases import Words

RECORDING = "lock"
RECOVERY = "recovery.lock"
PATIENCE_S = 0.1

OWNER_BYTES = 32
"""The process that holds a lock, as text; what a journal has written stands behind it."""


def journal_path(path: Path) -> Path:
    """The folder beside a session file where its journal stands while it is recorded."""
    return path.parent / f"{path.name}.journal"  # also of a folder without a name


class SessionLock(AbstractContextManager["SessionLock"]):
    """Held by the process that records a session, or that recovers one (`name`).

    Raises `RefusedError` if another process has it.
    """

    def __init__(self, folder: Path, name: str = RECORDING) -> None:
        self._descriptor = os.open(folder / name, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            self._take(folder)
        except BaseException:  # on a full disk, for one: the next attempt must not find it locked
            self.release()
            raise

    def _take(self, folder: Path) -> None:
        try:
            _lock(self._descriptor)
        except OSError as error:
            owner = os.read(self._descriptor, OWNER_BYTES).decode(errors="replace").strip()
            problem = Words("error.in_use", folder=folder, process=owner)
            raise RefusedError(problem, fix=Words("fix.wait")) from error
        os.pwrite(self._descriptor, f"{os.getpid()}\n".encode().ljust(OWNER_BYTES), 0)

    def __exit__(self, *_: object) -> None:
        self.release()

    def release(self) -> None:
        """Let others in; a second call does nothing."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


def _lock(descriptor: int) -> None:
    """Lock for us alone; who only asks whether it is locked holds it for a moment, which is waited for."""
    deadline = time.monotonic() + PATIENCE_S
    while True:
        try:
            _flock(descriptor, "LOCK_EX")
            return
        except OSError:
            if time.monotonic() > deadline:
                raise
        time.sleep(PATIENCE_S / 100)


def _flock(descriptor: int, operation: str) -> None:
    """Raises `OSError` when another process holds it, `RefusedError` where the system has no such locks."""
    try:
        import fcntl
    except ImportError as error:
        fix = "record there; here sessions can be read, estimated and reported"
        raise RefusedError("sessions are recorded and recovered on Linux", fix=fix) from error
    fcntl.flock(descriptor, getattr(fcntl, operation) | fcntl.LOCK_NB)


def is_locked(folder: Path, name: str = RECORDING) -> bool:
    """True if a living process is recording the session of a journal folder, or holds another lock there."""
    try:
        descriptor = os.open(folder / name, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))  # a pipe would wait
    except OSError:
        return False
    try:
        _flock(descriptor, "LOCK_SH")
    except RefusedError:
        return False
    except OSError:
        return True
    finally:
        os.close(descriptor)
    return False


def await_unlocked(folder: Path, name: str, seconds: float) -> None:
    """Wait until no process holds a lock of a folder, at most so long."""
    deadline = time.monotonic() + seconds
    while is_locked(folder, name) and time.monotonic() < deadline:
        time.sleep(PATIENCE_S / 2)


def locked_within(folder: Path, seconds: float) -> bool:
    """True if the session of a journal folder is being recorded, begun within the last `seconds`."""
    with suppress(OSError):  # it has ended since
        return is_locked(folder) and time.time() - (folder / RECORDING).stat().st_mtime < seconds
    return False


def owner(folder: Path, name: str = RECORDING) -> int | None:
    """The process that holds the lock of a journal folder, or another lock there; None if it is free."""
    if not is_locked(folder, name):
        return None
    try:
        return int((folder / name).read_bytes()[:OWNER_BYTES])
    except (OSError, ValueError):
        return None
