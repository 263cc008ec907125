"""Sockets beside a session, which only this user can open, and the messages on them.

A message is two lengths (header, body; little-endian, 32 bits), a JSON header ``[name, values]``, and bytes.
Both ends are of one computer and read with the same code.
"""

from __future__ import annotations

import os
import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

LENGTHS = struct.Struct("<II")
FEED, STATUS = "Feed", "Status"
"""Names of the message that a connection begins with: what it asks for."""
WAITS_S = 5.0
"""A recorder on a busy small computer needs a second for its status."""
HEADER_MAX, BODY_MAX = 16_000_000, 64_000_000


def message(header: str, body: bytes = b"") -> bytes:
    """A message of a JSON header and a body."""
    data = header.encode()
    return LENGTHS.pack(len(data), len(body)) + data + body


def read_message(stream: BinaryIO) -> tuple[bytes, bytes] | None:
    """Header and body of the next message, None at the end; raises `ValueError` for bytes that are none."""
    lengths = stream.read(LENGTHS.size)
    if len(lengths) < LENGTHS.size:
        return None
    header_size, body_size = LENGTHS.unpack(lengths)
    if header_size > HEADER_MAX or body_size > BODY_MAX:
        raise ValueError(f"a message of {header_size} + {body_size} bytes is not of a feed")
    header, body = stream.read(header_size), stream.read(body_size)
    return (header, body) if len(header) == header_size and len(body) == body_size else None


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
