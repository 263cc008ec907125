"""Reading the samples of one stream back, a brick at a time, each against its checksum.

A sample whose bytes do not match, or whose brick cannot be read, comes with the flag
`Quality.BAD_CRC`; what was declared in the header decides how much memory a read may take,
never the file's own sizes.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from fieldkit.device import StreamInfo
from fieldkit.errors import SessionError
from fieldkit.samples import Frame, Quality, Sample
from fieldkit.sessions.layout import Column, brick_shape, exact_time_ns, stream_columns
from fieldkit.sessions.records import build_frame, build_reading, sample_bytes, sample_crc32

Columns = dict[str, NDArray[Any]]
_MOST_UNINDEXED_BYTES = 1_000_000_000
_BLOCK_ROWS = 1024


def stored_here(group: h5py.Group, path: str) -> Any:
    """What a path leads to within this very file; raises `SessionError` where there is nothing, or a link."""
    found: Any = group
    for name in path.split("/"):
        if found.__class__ is h5py.Dataset or found.get(name, getlink=True).__class__ is not h5py.HardLink:
            raise SessionError(f"{path} is missing, or points somewhere else")
        try:
            found = found[name]
        except KeyError as error:
            raise SessionError(f"{path} cannot be read: {error}") from error
    return found


def dataset_of(group: h5py.Group, name: str, row_shape: tuple[int, ...], dtype: str) -> h5py.Dataset:
    """A dataset that really lies in this file and has the declared rows; raises `SessionError`."""
    path = f"{group.name.rstrip('/')}/{name}"
    dataset = stored_here(group, name)
    if not isinstance(dataset, h5py.Dataset) or dataset.is_virtual or dataset.external:
        raise SessionError(f"{path} does not hold its data itself")
    if dataset.ndim != 1 + len(row_shape) or dataset.shape[1:] != row_shape or dataset.dtype.str[1:] != dtype:
        raise SessionError(f"{path} has shape {dataset.shape}, {dataset.dtype}; expected rows of {row_shape}")
    return dataset


def column_dataset(group: h5py.Group, column: Column, *, salvage: bool = False) -> h5py.Dataset:
    """The dataset of a column, with no more rows than it has bytes for (unless torn: `salvage`)."""
    dataset = dataset_of(group, column.name, column.shape, np.dtype(column.dtype).str[1:])
    try:
        stored = int(dataset.id.get_storage_size())
    except RuntimeError as error:
        if not salvage:
            raise SessionError(f"the index of {dataset.name} is damaged: {error}") from error
        stored = _MOST_UNINDEXED_BYTES
    if dataset.shape[0] * column.row_bytes > stored:
        raise SessionError(f"{dataset.name} claims {dataset.shape[0]} rows that are not there")
    return dataset


def whole_rows(dataset: h5py.Dataset, row_bytes: int, end: int) -> NDArray[np.int64]:
    """Rows of an uncompressed growing dataset whose bytes lie in the first `end` bytes of the file."""
    spans: list[NDArray[np.int64]] = []

    def look(chunk: Any) -> None:
        first = int(chunk.chunk_offset[0])
        rows = min((end - chunk.byte_offset) // row_bytes, dataset.chunks[0], dataset.shape[0] - first)
        spans.append(np.arange(first, first + max(0, rows), dtype=np.int64))

    with contextlib.suppress(RuntimeError, OSError):  # a part of the index is gone: so are its chunks
        dataset.id.chunk_iter(look)
    return np.sort(np.concatenate([np.empty(0, np.int64), *spans]))


@dataclass(frozen=True, slots=True)
class _Pictures:
    """The brick datasets of a camera."""

    counts: h5py.Dataset
    metadata_rows: h5py.Dataset | None


class StreamReader:
    """The stored samples of one stream; raises `SessionError` where the file does not fit its header.

    With `salvage` a column may have lost a part of its index.
    """

    def __init__(self, file: h5py.File, info: StreamInfo, anchor_ns: int, *, salvage: bool = False) -> None:
        group = stored_here(file, info.name)
        if not isinstance(group, h5py.Group):
            raise SessionError(f"the group of stream {info.name!r} is missing")
        self.info = info
        self._anchor_ns = anchor_ns
        self._group = group
        self._columns = {
            column.name: column_dataset(group, column, salvage=salvage) for column in stream_columns(info)
        }
        self._pictures = self._open_pictures() if info.is_camera else None
        self._depth = brick_shape(info)[0] if info.is_camera else _BLOCK_ROWS
        self._block_rows = max(1, _BLOCK_ROWS // self._depth) * self._depth

    def _open_pictures(self) -> _Pictures:
        counts = self._brick_dataset("counts", self.info.shape)
        rows = self.info.metadata_shape
        return _Pictures(counts, self._brick_dataset("metadata_rows", rows) if rows[0] else None)

    def _brick_dataset(self, name: str, shape: tuple[int, ...]) -> h5py.Dataset:
        dataset = dataset_of(self._group, name, shape, "u2")
        depth = brick_shape(self.info)[0]
        if dataset.chunks is None or dataset.chunks[0] > depth or dataset.chunks[1:] > shape:
            raise SessionError(f"{dataset.name} is cut into chunks of {dataset.chunks}")
        return dataset

    def __len__(self) -> int:
        """Samples that every dataset of the stream has."""
        return min(int(dataset.shape[0]) for dataset in self._datasets())

    def _datasets(self) -> Iterator[h5py.Dataset]:
        yield from self._columns.values()
        yield from self.bricks

    @property
    def claimed(self) -> int:
        """Samples that the longest dataset of the stream is said to have."""
        return max(int(dataset.shape[0]) for dataset in self._datasets())

    def whole_rows(self, end: int) -> NDArray[np.int64]:
        """Rows of which everything but the picture lies in the first `end` bytes of the file."""
        rows = np.arange(0)
        for place, column in enumerate(stream_columns(self.info)):
            there = whole_rows(self._columns[column.name], column.row_bytes, end)
            rows = there if place == 0 else np.intersect1d(rows, there, assume_unique=True)
        return rows[rows < len(self)]

    def refresh(self) -> None:
        """See what a living writer has added."""
        for dataset in self._datasets():
            dataset.refresh()

    def column(self, name: str, start: int = 0, stop: int | None = None) -> NDArray[Any]:
        """Values of a column, as stored."""
        values: NDArray[Any] = self._columns[name][start : len(self) if stop is None else stop]
        return values

    def time_ns(self, start: int = 0, stop: int | None = None) -> NDArray[np.int64]:
        """UTC nanoseconds of the samples."""
        return exact_time_ns(
            self.column("time", start, stop), self.column("mono_ns", start, stop), self._anchor_ns
        )

    @property
    def counts(self) -> h5py.Dataset:
        """The pictures as stored; raises `SessionError` where the stream has none."""
        if self._pictures is None:
            raise SessionError(f"stream {self.info.name!r} is not a camera")
        return self._pictures.counts

    @property
    def bricks(self) -> list[h5py.Dataset]:
        """The datasets that are cut into bricks: of a camera its counts and metadata rows, else none."""
        pictures = self._pictures
        both = (pictures.counts, pictures.metadata_rows) if pictures is not None else ()
        return [dataset for dataset in both if dataset is not None]

    def samples(self, start: int = 0, stop: int | None = None) -> Iterator[Sample]:
        """The samples from row `start` up to `stop`, in the order they were recorded."""
        end = len(self) if stop is None else min(stop, len(self))
        for first in range(start - start % self._block_rows, end, self._block_rows):
            begin, last = max(first, start), min(first + self._block_rows, end)
            yield from self._block(begin, last)

    def frame(self, row: int) -> Frame:
        """One picture."""
        (frame,) = self.samples(row, row + 1)
        assert isinstance(frame, Frame)
        return frame

    def _block(self, start: int, stop: int) -> Iterator[Sample]:
        columns = {name: dataset[start:stop] for name, dataset in self._columns.items()}
        columns["time_ns"] = exact_time_ns(columns["time"], columns["mono_ns"], self._anchor_ns)
        build = self._readings if self._pictures is None else self._frames
        for row, sample in enumerate(build(columns, start, stop)):
            yield _verified(sample, int(columns["crc32"][row]))

    def _readings(self, columns: Columns, start: int, stop: int) -> Iterator[Sample]:
        for row in range(stop - start):
            raw = columns["raw"][row][: int(columns["raw_length"][row])].tobytes()
            yield build_reading(self.info, _stamps(columns, row), columns["value"][row].tobytes(), raw)

    def _frames(self, columns: Columns, start: int, stop: int) -> Iterator[Sample]:
        """The pictures of a block, of which only one brick is in memory."""
        for first in range(start - start % self._depth, stop, self._depth):
            begin, last = max(first, start), min(first + self._depth, stop)
            pictures = [_read(dataset, begin, last) for dataset in self.bricks]
            for n in range(last - begin):
                row = begin - start + n
                counts, more = (*(picture[n].tobytes() for picture in pictures), b"")[:2]
                fpa = float(columns["fpa_temperature"][row])
                yield build_frame(self.info, _stamps(columns, row), counts, more, fpa)


def _stamps(columns: Columns, row: int) -> dict[str, Any]:
    stamps = {
        name: int(columns[name][row]) for name in ("mono_ns", "time_ns", "device_time", "device_seq", "seq")
    }
    return {**stamps, "quality": Quality(int(columns["flags"][row]))}


def _read(dataset: h5py.Dataset, start: int, stop: int) -> NDArray[np.uint16]:
    """Pictures, or the fill value where the brick cannot be read: the checksum will tell."""
    try:
        pictures: NDArray[np.uint16] = dataset[start:stop]
    except (OSError, RuntimeError):
        return np.full((stop - start, *dataset.shape[1:]), 65535, "<u2")
    return pictures


def _verified(sample: Sample, crc32: int) -> Sample:
    if sample_crc32(sample, *sample_bytes(sample)) == crc32:
        return sample
    return sample._replace(quality=sample.quality | Quality.BAD_CRC)
