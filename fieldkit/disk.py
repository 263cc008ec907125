"""Files on the disk: asking it to keep what was written, replacing a file as a whole, its checksum.

Linux leaves written bytes in memory for half a minute. A sync then has all of them to wait for, while the
disk has had nothing to do; so what writes much has the disk begin early.
"""

from __future__ import annotations

import contextlib
import errno
import gzip
import hashlib
import os
import stat
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")

BEGIN_BYTES = 8_000_000
"""After so much the disk should begin; to begin with less is not worth a call and wears a small card."""


PATIENCE_S, RETRY_EVERY_S = 4.0, 0.05
"""For longer than a plug or a network drive is loose for a moment (3 s), and less than `QUEUED_S`."""
_PASSING = {errno.EIO, errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.ESTALE, errno.ENXIO, errno.ETIMEDOUT}
"""Failures of a disk that may be over soon."""


class Patience:
    """Does again what a disk refuses for a moment; after `PATIENCE_S` no more, until it has taken something.

    What is done must be doable again from its beginning.
    """

    def __init__(self) -> None:
        self._refused_s: float | None = None

    def __call__(self, act: Callable[[], T]) -> T:
        """The result of `act`; raises what that raises when the disk is not back in time."""
        while True:
            try:
                result = act()
            except Exception as error:
                self._refused_s = self._refused_s or time.monotonic()
                if time.monotonic() - self._refused_s > PATIENCE_S or not _is_passing(error):
                    raise
                time.sleep(RETRY_EVERY_S)
            else:
                self._refused_s = None
                return result


def _is_passing(error: BaseException | None) -> bool:
    """Whether an error, or one that it was raised from, is of a disk that may be back soon."""
    causes = []
    while error is not None and error not in causes:  # an error may be its own cause
        causes.append(error)
        error = error.__cause__
    return any(getattr(cause, "errno", None) in _PASSING for cause in causes)


def write_all(descriptor: int, data: memoryview, offset: int) -> None:
    """Write bytes at a place: a disk that is nearly full takes a part, and then says why it takes no more."""
    while data:
        count = os.pwrite(descriptor, data, offset)
        data, offset = data[count:], offset + count


def sync(path: Path, flush: Callable[[int], None] = os.fsync) -> None:
    """Ask the disk to keep what was written to a file or folder; raises `OSError`."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        flush(descriptor)
    finally:
        os.close(descriptor)


def sync_data(path: Path) -> None:
    """The same for a file's bytes alone; one that has gone needs none. Raises `OSError`."""
    with contextlib.suppress(FileNotFoundError):
        sync(path, os.fdatasync)


def put_in_place(draft: Path, path: Path) -> None:
    """Let a finished draft take the place of a file in the same folder, on the disk too; raises `OSError`.

    Whatever happens meanwhile, a kill or a power cut, the path leads to the old file or to the new one.
    """
    sync(draft)
    move_into_place(draft, path)


def move_into_place(draft: Path, path: Path) -> None:
    """The same for a draft that the disk has already."""
    Patience()(partial(os.replace, draft, path))
    Patience()(partial(sync, path.parent))


@contextlib.contextmanager
def replacing(path: Path, *, synced: bool = True) -> Iterator[Path]:
    """A draft beside a file, which takes its place as a whole at the end of the block; raises `OSError`.

    Readers find the old or the new file. Without `synced` a power cut may cost the new one. A block that
    raises leaves the old file and no draft.
    """
    draft = path.with_name(f".{path.name}.{os.getpid()}.new")
    try:
        yield draft
        if synced:
            put_in_place(draft, path)
        else:
            Patience()(partial(os.replace, draft, path))
    except BaseException:
        with contextlib.suppress(OSError):
            draft.unlink(missing_ok=True)
        raise


def is_regular(path: Path) -> bool:
    """Whether a path is a file itself: neither a link, which may lead anywhere, nor a pipe or device."""
    try:
        return stat.S_ISREG(path.lstat().st_mode)
    except OSError:
        return False


def unpacked(path: Path, most: int) -> bytes:
    """The first `most` bytes of a file, unpacked where it is gzipped; raises what `gzip` does."""
    with path.open("rb") as file:
        is_packed = file.read(2) == b"\x1f\x8b"
    with gzip.open(path) if is_packed else path.open("rb") as file:
        return file.read(most)


def sha256(path: Path) -> str:
    """SHA-256 of a file in hexadecimal; raises `OSError`."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextlib.contextmanager
def one_at_a_time(folder: Path) -> Iterator[None]:
    """Wait until no other process changes files of a folder in this way; raises `OSError` without the folder.

    The kernel lets go of the lock when its process dies. A network drive, or Windows, may not know locks of
    folders: there the block runs unlocked.
    """
    try:
        import fcntl
    except ImportError:
        yield
        return
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        with contextlib.suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def begin_sync(descriptor: int, start: int, length: int) -> None:
    """Have the disk begin with bytes just written, without waiting for it; only a sync says that it has them.

    "Not needed soon" is the one way that Python has to say so. Bytes on their way to the disk stay in memory
    all the same, so a reader that follows finds them there.
    """
    if hasattr(os, "posix_fadvise"):
        with contextlib.suppress(OSError):  # a file system that cannot begin early begins late
            os.posix_fadvise(descriptor, start, length, os.POSIX_FADV_DONTNEED)
