"""Growing datasets, written as direct chunks: frames compressed, columns as plain chunks.

Compression thus happens in our own threads instead of all at once in a flush, and the library keeps little.
A reader trusts a row once every dataset of its group has it, `time` last.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from itertools import chain
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from isal import isal_zlib

from fieldkit.model.arrays import AnyArray, CountArray
from fieldkit.sessions.journal import Chunk
from fieldkit.sessions.layout import Column

_LEVEL = 1  # of the ISA-L library: higher ones take longer and gain nothing on noise
_ROWS_WAITING = 1024


def pack(chunk: CountArray) -> bytes:
    """A chunk of 16-bit numbers that HDF5's gzip and shuffle filters read."""
    numbers = chunk.reshape(-1)
    planes = np.empty((2, numbers.size), np.uint8)
    planes[0], planes[1] = numbers.astype(np.uint8), numbers >> 8
    return isal_zlib.compress(planes.data, _LEVEL)


def unpack(data: bytes, shape: tuple[int, ...]) -> CountArray:
    """The chunk that `pack` packed; raises `ValueError` where the bytes are none."""
    size = 2 * int(np.prod(shape))
    try:
        planes = isal_zlib.decompressobj().decompress(data, size)
    except isal_zlib.error as error:  # type: ignore[misc]  # declared as an instance
        raise ValueError(f"a chunk does not decompress: {error}") from error
    if len(planes) != size:
        raise ValueError(f"a chunk has {len(planes)} bytes instead of {size}")
    # HDF5's shuffle: all low bytes, then all high bytes
    low, high = np.frombuffer(planes, np.uint8).reshape(2, *shape)
    numbers: CountArray = high.astype("<u2")
    numbers <<= 8
    numbers |= low
    return numbers


def read_chunk(path: Path, chunk: Chunk) -> bytes | None:
    """The packed bytes of a chunk, wherever the file's own index may be; None if they are not as written."""
    try:
        with path.open("rb", buffering=0) as file:
            if chunk.offset + chunk.size > os.fstat(file.fileno()).st_size:
                return None
            data = os.pread(file.fileno(), chunk.size, chunk.offset)
    except OSError:
        return None
    return data if len(data) == chunk.size and isal_zlib.crc32(data) == chunk.crc32 else None


def corners(dataset: h5py.Dataset) -> list[tuple[int, int]]:
    """First row and column of each chunk that the frames of a dataset are cut into."""
    _, rows, cols = dataset.chunks
    return [(y, x) for y in range(0, dataset.shape[1], rows) for x in range(0, dataset.shape[2], cols)]


def is_packed(dataset: h5py.Dataset) -> bool:
    """True if the chunks of a dataset are as `pack` makes them, and fill its frames."""
    filters = dataset.id.get_create_plist().get_nfilters()
    sides = zip(dataset.shape[1:], dataset.chunks[1:], strict=True) if dataset.chunks else ()
    return (
        (filters, dataset.shuffle, dataset.compression) == (2, True, "gzip")
        and dataset.dtype == "<u2"
        and all(side % chunk_side == 0 for side, chunk_side in sides)
    )


def read_block(dataset: h5py.Dataset, start: int) -> CountArray:
    """The whole block of frames that begins at row `start`, of a dataset that `is_packed`.

    HDF5 reads the same, in twice the time and holding up all other threads. Raises `OSError`, `RuntimeError`
    or `ValueError` where a chunk is missing or damaged.
    """
    _, rows, cols = dataset.chunks
    block = np.empty((dataset.chunks[0], *dataset.shape[1:]), "<u2")
    for y, x in corners(dataset):
        skipped_filters, data = dataset.id.read_direct_chunk((start, y, x))
        if skipped_filters:
            raise ValueError(f"a chunk of {dataset.name} was stored without some of its filters")
        block[:, y : y + rows, x : x + cols] = unpack(data, dataset.chunks)
    return block


class FrameWriter:
    """One dataset of frames: gathers frames into a block and writes it chunk by chunk.

    `places` has the offset of the last write of each size (`GuardedDisk.places`).
    """

    def __init__(self, dataset: h5py.Dataset, pool: Executor, places: dict[int, int]) -> None:
        self._dataset, self._name = dataset, dataset.name
        self._pool, self._places = pool, places
        self.depth, rows, cols = dataset.chunks
        self._corners = corners(dataset)
        self._fill = int(dataset.fillvalue)
        down, across = dataset.shape[1] // rows, dataset.shape[2] // cols
        # Cut while it is gathered, so that each chunk lies in one piece when the block is full.
        self._chunks = np.empty((down, across, self.depth, rows, cols), "<u2")
        self.length: int = 0

    @property
    def is_full(self) -> bool:
        """True if the block has its last frame."""
        return self.length > 0 and self.length % self.depth == 0

    def put(self, frame: CountArray) -> None:
        """Take one frame; write the block before the next when it is full."""
        down, across, depth, rows, cols = self._chunks.shape
        self._chunks[:, :, self.length % depth] = frame.reshape(down, rows, across, cols).swapaxes(1, 2)
        self.length += 1

    def write(self) -> list[Chunk]:
        """Write the block as it is, filled up to its depth, and return where its chunks lie."""
        start = (self.length - 1) // self.depth * self.depth
        self._chunks[:, :, self.length - start :] = self._fill
        packed = self._pool.map(_pack_strip, self._chunks)  # some are written meanwhile
        self._dataset.id.set_extent((self.length, *self._dataset.shape[1:]))
        chunks: list[Chunk] = []
        for corner, (data, crc32) in zip(self._corners, chain.from_iterable(packed), strict=True):
            self._places.clear()  # a week of recording has as many sizes as chunks
            self._dataset.id.write_direct_chunk((start, *corner), data)
            # the library itself would look through all chunks there are, longer and longer
            chunks.append(Chunk(self._name, start, *corner, self._places[len(data)], len(data), crc32))
        return chunks


def _pack_strip(strip: CountArray) -> list[tuple[bytes, int]]:
    """Packed bytes of each chunk of a strip, and their checksum."""
    return [(data, isal_zlib.crc32(data)) for data in map(pack, strip)]


def as_column(values: Sequence[Any], column: Column) -> AnyArray:
    """The values of some rows as a column stores them."""
    return np.array(values, column.dtype).reshape(len(values), *column.shape)


class TableWriter:
    """The datasets of one group that grow together; rows wait until `write`, or until they are many.

    The last, unfinished chunk stays in memory and is written again as it fills. `as_column` makes an array of
    the values that some rows have for a column.
    """

    def __init__(
        self,
        group: h5py.Group,
        columns: Iterable[Column],
        as_column: Callable[[Sequence[Any], Column], AnyArray] = as_column,
    ) -> None:
        ordered = sorted(columns, key=lambda column: column.name == "time")  # time last: it declares the row
        self._columns = [(column, group[column.name].id) for column in ordered]
        self._chunk_rows = group["time"].chunks[0]
        self._as_column = as_column
        self._rows: list[Mapping[str, Any]] = []
        self._first, self._is_dirty = 0, False

    def append(self, *rows: Mapping[str, Any]) -> None:
        """Take rows, each with a value for every column."""
        self._rows += rows
        self._is_dirty = True
        if len(self._rows) >= _ROWS_WAITING:
            self.write()

    def write(self) -> None:
        """Write everything to the file, chunk by chunk."""
        while self._rows and self._is_dirty:
            rows = self._rows[: self._chunk_rows]
            for column, dataset in self._columns:
                values = column.unknown(self._chunk_rows)
                values[: len(rows)] = self._as_column([row[column.name] for row in rows], column)
                dataset.set_extent((self._first + len(rows), *column.shape))
                dataset.write_direct_chunk((self._first, *(0 for _ in column.shape)), values.tobytes())
            self._is_dirty = len(self._rows) > len(rows)
            if len(rows) == self._chunk_rows:
                del self._rows[: self._chunk_rows]
                self._first += self._chunk_rows
