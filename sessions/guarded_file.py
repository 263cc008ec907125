"""Writing HDF5 files on a disk that may fail, with the library and past it.

When the disk refuses what the HDF5 library wants to write, the library is left with objects that it can
neither close nor forget, and brings the whole process down at its end. So it writes through a guarded disk,
which never refuses; whether the disk has it is asked of that.

Values stored contiguously lie at one place of the file and carry no checksum of the library's, so
`write_in_place` writes them like any bytes: one write each, which either fails or is done. Readers that have
the file open are not disturbed.
"""

from __future__ import annotations

import atexit
import contextlib
import io
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from fieldkit.disk import BEGIN_BYTES, Patience, begin_sync, write_all
from fieldkit.model.arrays import AnyArray
from fieldkit.sessions import superblock
from fieldkit.sessions.file_tree import LIBVER


def write_in_place(path: Path, values: Mapping[str, Any]) -> None:
    """Write each value over the dataset of that name, which must have its size, and sync.

    Raises `OSError` where the disk takes it not, `ValueError` where a value does not fit.
    """
    with h5py.File(path, "r", locking=False) as file:
        places = {name: _place(file[name], value) for name, value in values.items()}
    with path.open("r+b", buffering=0) as target:
        for offset, data in places.values():
            write_all(target.fileno(), memoryview(data), offset)
        os.fsync(target.fileno())


def _place(dataset: h5py.Dataset, value: Any) -> tuple[int, bytes]:
    data: AnyArray = np.asarray(value, dataset.dtype)
    offset = dataset.id.get_offset()
    if data.shape != dataset.shape or offset is None:
        problem = f"has shape {dataset.shape}, not {data.shape}, or no place of its own"
        raise ValueError(f"{dataset.name} {problem}")
    return offset, data.tobytes()


class GuardedDisk(io.RawIOBase):
    """A file as the HDF5 library may write it: nothing that it asks for ever fails.

    What the disk refuses is asked of it again for a while. From the first `error` on the disk gets nothing
    more, and what is written stays in memory.
    """

    def __init__(self, path: Path) -> None:
        self.error: OSError | None = None
        self.places: dict[int, int] = {}
        """Offset of the last write of each size: where a chunk that was just written lies."""
        self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        self._patience = Patience()
        self._position = 0
        self.size: int = os.fstat(self._descriptor).st_size
        self._begun = self.size
        self._unwritten: list[tuple[int, bytes]] = []

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Move; returns the new position."""
        base = {io.SEEK_SET: 0, io.SEEK_CUR: self._position, io.SEEK_END: self.size}[whence]
        self._position = base + offset
        return self._position

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        """Fill the buffer; what the disk does not give is zeros, which HDF5 takes for damage."""
        view, at = memoryview(buffer).cast("B"), self._position
        data = self._ask(lambda: os.pread(self._descriptor, len(view), at)) or b""
        view[:] = data.ljust(len(view), b"\0")
        for start, unwritten in self._unwritten:
            first, last = max(at, start), min(at + len(view), start + len(unwritten))
            if first < last:
                view[first - at : last - at] = unwritten[first - start : last - start]
        self._position += len(view)
        return len(view)

    def write(self, data: memoryview) -> int:  # type: ignore[override]
        """Write everything."""
        at, size = self._position, len(data)
        if (at, size) == (0, superblock.SIZE):
            data = memoryview(superblock.share(bytes(data)))
        self._ask(lambda: write_all(self._descriptor, data, at))
        if self.error is not None:
            self._unwritten.append((at, bytes(data)))
        self.places[size] = at
        self._position = at + size
        self.size = max(self.size, self._position)
        if self.size - self._begun >= BEGIN_BYTES:
            begin_sync(self._descriptor, self._begun, self.size - self._begun)
            self._begun = self.size
        return size

    def truncate(self, size: int | None = None) -> int:
        """Cut off or extend; the size is always given."""
        self.size = size or 0
        self._ask(lambda: os.ftruncate(self._descriptor, self.size))
        return self.size

    def _ask(self, act: Callable[[], Any]) -> Any:
        if self.error is None:
            try:
                return self._patience(act)
            except OSError as error:
                self.error = error
        return None

    def close(self) -> None:
        """Let go of the file."""
        if not self.closed:
            os.close(self._descriptor)
        super().close()


def limit_cache(file: h5py.File, size: int) -> None:
    """Let the library keep so many bytes of indexes and headers, where it would keep more by and by."""
    config = file.id.get_mdc_config()
    config.set_initial_size = True
    config.initial_size = config.max_size = config.min_size = size
    config.incr_mode = config.flash_incr_mode = config.decr_mode = 0
    file.id.set_mdc_config(config)


class GuardedFile:
    """An HDF5 file open for writing; ``with GuardedFile(path) as file`` gives the h5py file.

    A new one has the `mode` ``w``, and `options` of h5py. It is not locked for HDF5: a reader that follows
    the recording must not keep it from being sealed. Against a second writer there is the session's own lock.
    """

    def __init__(self, path: Path, mode: str = "r+", **options: Any) -> None:
        self.disk: GuardedDisk = GuardedDisk(path)
        try:
            self.file: Any = h5py.File(self.disk, mode, libver=LIBVER, **options)
        except BaseException:
            self.disk.close()
            raise
        atexit.register(self.discard)  # HDF5 would write through the disk when there is no Python any more

    def __enter__(self) -> h5py.File:
        return self.file

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None:
            self.close()
        else:
            self.discard()

    def check(self) -> None:
        """Raise `OSError` where the disk has not taken all that it was given."""
        if self.disk.error is not None:
            raise self.disk.error

    def flush(self) -> None:
        """Give the disk everything; raises as `check`."""
        self.file.flush()
        self.check()

    def close(self) -> None:
        """Close; a second call does nothing. Raises as `check`."""
        if self.file:
            self.file.close()
            self.disk.close()
            atexit.unregister(self.discard)
            self.check()

    def discard(self) -> None:
        """Close, what is not yet on the disk going nowhere."""
        self.disk.error = self.disk.error or OSError("discarded")
        with contextlib.suppress(OSError, RuntimeError):
            self.close()
