"""Sockets beside a session, which only this user can open."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


def listening(path: Path) -> socket.socket:
    """A socket that listens at a path; raises `OSError`."""
    server = socket.socket(socket.AF_UNIX)
    try:
        with _short(path) as address:
            server.bind(address)
            Path(address).chmod(0o600)  # before `listen`: until then nobody can connect
        server.listen()
    except OSError:
        server.close()
        raise
    return server


def connect(path: Path, timeout_s: float | None = None) -> socket.socket:
    """A connection to what listens at a path; raises `OSError` also where nothing does."""
    connection = socket.socket(socket.AF_UNIX)
    connection.settimeout(timeout_s)
    try:
        with _short(path) as address:
            connection.connect(address)
    except OSError:
        connection.close()
        raise
    return connection


def end(server: socket.socket) -> None:
    """Stop listening; ``accept`` of another thread raises `OSError`."""
    with suppress(OSError):
        server.shutdown(socket.SHUT_RDWR)
    server.close()


@contextmanager
def _short(path: Path) -> Iterator[str]:
    """A socket's address through its open folder: an address holds 107 bytes, a path may be longer."""
    folder = os.open(path.parent, os.O_PATH | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{folder}/{path.name}"
    finally:
        os.close(folder)
