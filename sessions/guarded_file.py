"""Writing to a session file on a disk that may fail, with the HDF5 library and past it.

When the disk refuses what the HDF5 library wants to write, the library keeps it, cannot
close the file, and brings the whole process down at its end. A guarded file is then given
memory to write to instead of the disk, so that it closes in order; on the disk it stays as
it was when the disk failed.

Values stored contiguously lie at one place of the file and carry no checksum of the library's, so
`write_in_place` writes them like any bytes: one write each, which either fails or is done. Readers that have
the file open are not disturbed.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from fieldkit.model.arrays import AnyArray
from fieldkit.sessions.file_tree import LIBVER


def write_in_place(path: Path, values: Mapping[str, Any]) -> None:
    """Write each value over the dataset of that name, which must have its size, and sync.

    Raises `OSError` where the disk takes it not, `ValueError` where a value does not fit.
    """
    with h5py.File(path, "r", locking=False) as file:
        places = {name: _place(file[name], value) for name, value in values.items()}
    with path.open("r+b", buffering=0) as target:
        for offset, data in places.values():
            if os.pwrite(target.fileno(), data, offset) < len(data):
                raise OSError(f"{path} took only a part of a value")
        os.fsync(target.fileno())


def _place(dataset: h5py.Dataset, value: Any) -> tuple[int, bytes]:
    data: AnyArray = np.asarray(value, dataset.dtype)
    offset = dataset.id.get_offset()
    if data.shape != dataset.shape or offset is None:
        raise ValueError(
            f"{dataset.name} has shape {dataset.shape}, not {data.shape}, or no place of its own"
        )
    return offset, data.tobytes()


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
        self.file: Any = h5py.File(path, "r+", libver=LIBVER, locking=False)
        self._descriptor: int = self.file.id.get_vfd_handle()

    def __enter__(self) -> h5py.File:
        return self.file

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None:
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
        self._detach()
        if self.file:
            with contextlib.suppress(OSError, RuntimeError):
                self.file.close()

    def _detach(self) -> None:
        """Let the library's descriptor stand for memory, if it still stands for our file."""
        try:
            if os.readlink(f"/proc/self/fd/{self._descriptor}") != str(self._path):
                return
            memory = os.memfd_create("discarded")
        except OSError:
            return
        os.dup2(memory, self._descriptor)
        os.close(memory)
