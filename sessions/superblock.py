"""Opening a session file whose writer was killed, without changing it.

The format of HDF5 1.10 keeps a "being written" byte and the file's length in its first 48
bytes, the superblock; after a crash an ordinary open refuses. `MendedFile` is a read-only
file object that shows HDF5 the same file with these two set right; where the file has lost
its end, zeros stand for it, so that what is in front of the cut can be read. Layout: "HDF5 File
Format Specification", version 3.0, II.A; checksum: Bob Jenkins, lookup3.c, public domain.
"""

from __future__ import annotations

import io
import re
import struct
from pathlib import Path
from typing import Protocol

from fieldkit.model.errors import SessionError, os_errors_as
from fieldkit.model.next_step import Action
from fieldkit.phrases import Words

SIGNATURE = b"\x89HDF\r\n\x1a\n"
SIZE, _VERSION, _FLAGS, _END, _CHECKSUM = 48, 8, 11, 28, 44
_WRITTEN, _SHARED = 1, 4
_MASK = 0xFFFFFFFF
CHECK_PATH = "check the path; " + Action.LIST_SESSIONS() + " shows the sessions of a campaign"
_ADDRESS = re.compile(r"[a-z][a-z0-9+.-]+:/")  # of Windows, a drive has one letter
_NAME = re.compile(rb"<mended session of (\d+) bytes>")  # from a dataset only the file's name can be had
_LONGEST = 2**46  # bytes; no disk is larger, a damaged or hostile file may claim more


class BinaryFile(Protocol):
    """A file object open for reading in binary, such as those of fsspec."""

    def read(self, size: int = -1, /) -> bytes:
        """Read at most so many bytes."""
        ...

    def seek(self, offset: int, whence: int = 0, /) -> int:
        """Move; returns the new position."""
        ...


def is_clean(path: Path) -> bool:
    """True if the file was closed by its writer; raises `SessionError` if it is not such an HDF5 file."""
    with _open(path) as file:
        return _superblock(path, file)[_FLAGS] == 0


def refuse_address(path: Path) -> None:
    """Raise `SessionError` for an address in place of a path."""
    if _ADDRESS.match(str(path)) and not path.exists():
        opened = "fieldkit.open_session(fsspec.open(...).open())"
        fix = f"copy it to this computer, or give a file object: {opened}"
        raise SessionError("an address, not a path", place=str(path), fix=fix)


def _open(path: Path) -> io.FileIO:
    refuse_address(path)
    if path.exists() and not path.is_file():  # a pipe would wait for its other end
        raise SessionError("a directory, pipe or device, not a file", place=path, fix=CHECK_PATH)
    with os_errors_as(SessionError, "cannot read", place=path, fix=CHECK_PATH):
        return path.open("rb", buffering=0)


def _superblock(path: Path, file: BinaryFile) -> bytes:
    with os_errors_as(SessionError, "cannot read", place=path, fix=CHECK_PATH):
        file.seek(0)
        head = file.read(SIZE)
    if len(head) < SIZE or not head.startswith(SIGNATURE):
        raise SessionError(Words("error.not_hdf5"), place=path, fix=CHECK_PATH)
    if head[_VERSION] != 3:
        raise SessionError(Words("error.not_session"), place=path, fix=CHECK_PATH)
    return head


def real_bytes(name: bytes) -> int:
    """Bytes that a mended file has on the disk, by the name that HDF5 knows it by; 0 for other files."""
    mended = _NAME.fullmatch(name)
    return int(mended[1]) if mended else 0


def mend(superblock: bytes, length: int) -> bytes:
    """The superblock of a file of `length` bytes that is not being written."""
    return _with_flags(superblock, 0, length)


def share(superblock: bytes) -> bytes:
    """The superblock of a file being written as others may open it meanwhile.

    To files that are not the library's own it writes "one writer, many readers" without "being written".
    """
    flags, (end,) = superblock[_FLAGS], struct.unpack_from("<Q", superblock, _END)
    return _with_flags(superblock, flags | _WRITTEN if flags & _SHARED else flags, end)


def _with_flags(superblock: bytes, flags: int, length: int) -> bytes:
    head = bytearray(superblock)
    head[_FLAGS] = flags
    struct.pack_into("<Q", head, _END, length)
    struct.pack_into("<I", head, _CHECKSUM, lookup3(bytes(head[:_CHECKSUM])))
    return bytes(head)


def _recorded_end(superblock: bytes) -> int:
    """Length of the file when its superblock was written; 0 where that cannot be trusted."""
    (end,) = struct.unpack_from("<Q", superblock, _END)
    (checksum,) = struct.unpack_from("<I", superblock, _CHECKSUM)
    return int(end) if lookup3(superblock[:_CHECKSUM]) == checksum and end < _LONGEST else 0


def lookup3(data: bytes) -> int:
    """Jenkins' hashlittle of up to a few dozen bytes, start value 0, as HDF5 checks its metadata."""
    a = b = c = (0xDEADBEEF + len(data)) & _MASK
    while len(data) > 12:
        x, y, z = struct.unpack("<III", data[:12])
        a, b, c = _mix((a + x) & _MASK, (b + y) & _MASK, (c + z) & _MASK)
        data = data[12:]
    if not data:
        return c
    x, y, z = struct.unpack("<III", data.ljust(12, b"\0"))
    return _final((a + x) & _MASK, (b + y) & _MASK, (c + z) & _MASK)


def _rotate(value: int, bits: int) -> int:
    return (value << bits | value >> (32 - bits)) & _MASK


def _mix(a: int, b: int, c: int) -> tuple[int, int, int]:
    for bits in (4, 6, 8, 16, 19, 4):
        # each round subtracts, rotates and adds; then the three change places
        a = (a - c) & _MASK ^ _rotate(c, bits)
        c = (c + b) & _MASK
        a, b, c = b, c, a
    return a, b, c


def _final(a: int, b: int, c: int) -> int:
    for bits in (14, 11, 25, 16, 4, 14, 24):
        c = ((c ^ b) - _rotate(b, bits)) & _MASK
        a, b, c = b, c, a
    return b  # the last round's c has moved on by one place


class MendedFile(io.RawIOBase):
    """A session file as HDF5 may open it, whatever became of its writer; for reading only.

    A `file` object that is given stays open. Raises `SessionError` where the superblock itself is gone.
    """

    def __init__(self, path: Path, file: BinaryFile | None = None) -> None:
        self._file: BinaryFile = _open(path) if file is None else file
        self._is_own = file is None
        head = _superblock(path, self._file)
        self._bytes = self._file.seek(0, io.SEEK_END)
        self._length = max(self._bytes, _recorded_end(head))
        self._head = mend(head, self._length)
        self._position = 0

    def __repr__(self) -> str:
        """The name that HDF5 knows the file by."""
        return f"<mended session of {self._bytes} bytes>"

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Move; returns the new position."""
        base = {io.SEEK_SET: 0, io.SEEK_CUR: self._position, io.SEEK_END: self._length}[whence]
        self._position = base + offset
        return self._position

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        """Fill the buffer; what the file has lost is zeros."""
        view = memoryview(buffer).cast("B")
        self._file.seek(self._position)
        count = 0
        while count < len(view) and (part := self._file.read(len(view) - count)):
            view[count : count + len(part)] = part
            count += len(part)
        view[count:] = bytes(len(view) - count)
        head = self._head[self._position : self._position + len(view)]
        view[: len(head)] = head
        self._position += len(view)
        return len(view)

    def close(self) -> None:
        """Let go of the file, if it was opened here."""
        if self.__dict__.get("_is_own"):  # which is not there where opening it failed
            self._file.close()  # type: ignore[attr-defined]  # of others only reading is asked
        super().close()
