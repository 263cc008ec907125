"""An HDF5 file open for writing on a disk that may fail.

When the disk refuses what the HDF5 library wants to write, the library keeps it, cannot
close the file, and brings the whole process down at its end. A guarded file is then given
memory to write to instead of the disk, so that it closes in order; on the disk it stays as
it was when the disk failed.
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from types import TracebackType

import h5py

from fieldkit.sessions.datasets import LIBVER


def write_new(path: Path, data: bytes) -> None:
    """Write a new file; raises `FileExistsError` where there is one, `OSError` if the disk fails."""
    with path.open("xb") as file:
        file.write(data)


class GuardedFile:
    """An existing session file open for writing; ``with GuardedFile(path) as file`` gives the h5py file."""

    def __init__(self, path: Path) -> None:
        self._path = path.resolve()
        # Not locked for HDF5: a reader that follows the recording must not keep it from being sealed.
        # Against a second writer there is the session's own lock.
        self.file = h5py.File(path, "r+", libver=LIBVER, locking=False)
        self._descriptor: int = self.file.id.get_vfd_handle()

    def __enter__(self) -> h5py.File:
        return self.file

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self.close()
        else:
            self.discard()

    def close(self) -> None:
        """Close; a second call does nothing. Raises `OSError` where the disk takes no more."""
        if not self.file:
            return
        try:
            self.file.flush()
            self.file.close()
        except (OSError, RuntimeError) as error:
            self.discard()
            raise OSError(f"{self._path.name} could not be closed: {error}") from error

    def discard(self) -> None:
        """Close, what is not yet on the disk going nowhere."""
        self._turn_away()
        if self.file:
            with contextlib.suppress(OSError, RuntimeError):
                self.file.close()

    def _turn_away(self) -> None:
        """Let the library's descriptor stand for memory, if it still stands for our file."""
        try:
            if os.readlink(f"/proc/self/fd/{self._descriptor}") != str(self._path):
                return
            memory = os.memfd_create("discarded")
        except OSError:
            return
        os.dup2(memory, self._descriptor)
        os.close(memory)
