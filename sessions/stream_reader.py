"""Reading the samples of one stream back, a chunk at a time, each against its checksum.

`StreamReader._parts` is the one place where samples leave a session file. A sample whose bytes do not
match, or whose chunk cannot be read, comes with the flag `Quality.BAD_CRC` and is remembered as
`damaged`, whether it is read as a sample, as an array or as a column of flags. What was declared in the
header decides how much memory a read may take, never the file's own sizes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial, reduce
from itertools import repeat

import h5py
import numpy as np

from fieldkit.model.arrays import AnyArray, BoolArray, CountArray, FlagArray, FloatArray, IntArray
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import SessionError
from fieldkit.model.limits import Bounds, Excess, bounds_of, changed_rows, excesses, labels_of
from fieldkit.model.samples import Frame, Quality, Sample
from fieldkit.model.site import Site
from fieldkit.physics.sun import sun_vectors
from fieldkit.sessions import stored
from fieldkit.sessions.chunks import is_packed, read_block
from fieldkit.sessions.layout import FILL_COUNT, MOST_BLOCK_BYTES, block_rows, chunk_shape, stream_columns
from fieldkit.sessions.records import build_sample, stored_crc32s
from fieldkit.sessions.sample_fields import from_columns
from fieldkit.sessions.time_map import StoredTimes

Columns = dict[str, AnyArray]
_BLOCK_ROWS = 1024
_NOTHING = np.empty(0, np.uint8)


@dataclass(frozen=True, slots=True)
class Readings:
    """Readings of a meter as arrays.

    `time_ns` (n,) UTC; `values` (n, channels) in the stream's unit, NaN where there is none;
    `flags` (n,) as `Quality`.
    """

    time_ns: IntArray
    values: FloatArray
    flags: FlagArray


@dataclass(frozen=True, slots=True)
class FrameBlock:
    """Consecutive frames of a camera as arrays, from row `start` of the stream.

    `counts` (n, rows, cols), or the part asked for; `metadata_rows` (n, extra rows, cols), `flags` (n,).
    """

    start: int
    counts: CountArray
    metadata_rows: CountArray
    flags: FlagArray


_Part = tuple[int, Columns, list[CountArray]]
"""Consecutive rows of all that a stream stores, from a first one on: columns, the flags verified, and frames.

Those of a camera lie within one chunk.
"""


class StreamReader:
    """The stored samples of one stream; raises `SessionError` where the file does not fit its header.

    `damaged` has the rows that were found not to match their checksum so far, by whatever was read.
    With `salvage` a column may have lost a part of its index; an `outline` has the times alone, to the
    microsecond. Times are corrected by the active time map, and readings beyond their limits flagged, unless
    `recorded` asks for what is stored.
    """

    def __init__(
        self,
        file: h5py.File,
        info: StreamInfo,
        site: Site,
        times: StoredTimes,
        *,
        salvage: bool = False,
        outline: bool = False,
    ) -> None:
        self.info = info
        self._site = site
        self.bounds: Bounds = bounds_of(info, changed_rows({}, site.body) | dict(info.limits))
        self.damaged: set[int] = set()
        self._times = times
        self._group = stored.group_of(file, info.name)
        self._declared = {column.name: column for column in stream_columns(info)}
        self._is_outline = outline
        columns = [self._declared["time"]] if outline else self._declared.values()
        self._columns = stored.columns_of(self._group, columns, salvage=salvage)
        shapes = {"counts": info.shape, "metadata_rows": info.metadata_shape}
        self.frame_datasets: list[h5py.Dataset] = [
            self._frame_dataset(name, shape)
            for name, shape in shapes.items()
            if info.is_camera and shape[0] and not outline
        ]
        """Those of a camera: its counts and metadata rows."""
        self._depth = block_rows(info)
        self._block_rows = max(1, _BLOCK_ROWS // self._depth) * self._depth
        self._packed = {frames.name for frames in self.frame_datasets if is_packed(frames)}

    def _frame_dataset(self, name: str, shape: tuple[int, ...]) -> h5py.Dataset:
        dataset = stored.dataset_of(self._group, name, shape, "u2")
        block = (chunk_shape(self.info)[0], *shape)
        if 2 * math.prod(block) > _most_bytes(dataset):
            raise SessionError(f"frames of {shape}, larger than any camera's", place=dataset.name)
        if any(side > most for side, most in zip(dataset.chunks or (math.inf,), block, strict=False)):
            raise SessionError(f"cut into chunks of {dataset.chunks}", place=dataset.name)
        return dataset

    def __len__(self) -> int:
        """Samples that every dataset of the stream has."""
        return min(int(dataset.shape[0]) for dataset in self._datasets())

    def _require_open(self) -> None:
        if not self._group:
            raise stored.closed_error(self._times.path)

    def _datasets(self) -> Iterator[h5py.Dataset]:
        self._require_open()
        yield from self._columns.values()
        yield from self.frame_datasets

    @property
    def claimed(self) -> int:
        """Samples that the longest dataset of the stream claims to have."""
        return max(int(dataset.shape[0]) for dataset in self._datasets())

    def whole_rows(self, end: int) -> IntArray:
        """Rows of which everything but the frame lies in the first `end` bytes of the file."""
        rows = (stored.whole_rows(dataset, end) for dataset in self._columns.values())
        whole: IntArray = reduce(partial(np.intersect1d, assume_unique=True), rows)
        return whole[whole < len(self)]

    def refresh(self) -> None:
        """See what a living writer has added."""
        for dataset in self._datasets():
            dataset.refresh()

    def column(self, name: str, start: int = 0, stop: int | None = None) -> AnyArray:
        """Values of a column as stored, compared with no checksum; raises `SessionError` where unreadable.

        What enters a result comes from `samples`, `readings`, `frame_blocks` or `flags`.
        """
        if name not in self._declared:
            fix = f"name one of its columns: {', '.join(self._declared)}"
            raise SessionError(f"no column {name!r}", place=self.info.name, fix=fix)
        end = len(self) if stop is None else min(stop, len(self))
        if name not in self._columns:
            return stored.unknown_rows(self._group, self._declared[name], max(0, end - start))
        try:
            return np.asarray(self._columns[name][start:end])
        except (OSError, RuntimeError) as error:
            raise SessionError(f"cannot be read: {error}", place=self._columns[name].name) from error

    def time_ns(self, start: int = 0, stop: int | None = None, *, recorded: bool = False) -> IntArray:
        """UTC nanoseconds of the samples."""
        time_us = self.column("time", start, stop)
        mono_ns = None if self._is_outline else self.column("mono_ns", start, stop)
        return self._times.utc_ns(time_us, mono_ns, recorded=recorded)

    @property
    def counts(self) -> h5py.Dataset:
        """The frames as stored; raises `SessionError` where the stream has none."""
        if not self.info.is_camera:
            raise SessionError("is not a camera", place=self.info.name)
        self._require_open()
        return self.frame_datasets[0]

    def samples(self, start: int = 0, stop: int | None = None, *, recorded: bool = False) -> Iterator[Sample]:
        """The samples from row `start` up to `stop`, in the order they were recorded."""
        for _, columns, frames in self._timed_parts(start, stop, recorded):
            bodies = _bodies(columns, frames)
            for stamps, (data, more) in zip(from_columns(columns), bodies, strict=True):
                yield build_sample(self.info, stamps, data.tobytes(), more.tobytes())

    def frame(self, row: int) -> Frame:
        """One frame."""
        (frame,) = self.samples(row, row + 1)
        assert isinstance(frame, Frame)
        return frame

    def flags(self, start: int = 0, stop: int | None = None) -> FlagArray:
        """`Quality` of the samples (n,), each compared with its checksum, which reads all that it holds."""
        parts = (columns["flags"] for _, columns, _ in self._timed_parts(start, stop, recorded=False))
        return np.concatenate([np.empty(0, np.uint32), *parts])

    def readings(self, start: int = 0, stop: int | None = None, *, recorded: bool = False) -> Readings:
        """The readings of a meter as arrays; raises `SessionError` for a camera.

        At the times `recorded` no limit by the height of the sun applies: they may be wrong.
        """
        if self.info.is_camera:
            raise SessionError("is a camera", place=self.info.name, fix="read its frames: kelvin()")
        parts = [columns for _, columns, _ in self._timed_parts(start, stop, recorded)]
        values = (np.where(self._beyond(part, recorded), np.nan, self._values(part)) for part in parts)
        return Readings(
            np.concatenate([np.empty(0, np.int64), *(part["time_ns"] for part in parts)]),
            np.concatenate([np.empty((0, *self.info.shape)), *values]),
            np.concatenate([np.empty(0, np.uint32), *(part["flags"] for part in parts)]),
        )

    def excesses(self) -> list[Excess]:
        """How many readings of each channel are beyond what its quantity can be, and the first, by its row.

        Compared with no checksum; empty for a camera.
        """
        if not len(self) or self.info.is_camera:
            return []
        columns = {"value": self.column("value"), "time_ns": self.time_ns()}
        return excesses(labels_of(self.info), self.bounds, self._values(columns), self._beyond(columns))

    def frame_blocks(self, start: int = 0, stop: int | None = None) -> Iterator[FrameBlock]:
        """The frames of a camera as arrays, a chunk at a time."""
        for first, columns, (counts, *more) in self._parts(start, stop):
            rows = more[0] if more else np.empty((len(counts), *self.info.metadata_shape), np.uint16)
            yield FrameBlock(first, counts, rows, columns["flags"])

    def crops(self, box: tuple[slice, slice], step: int, *, with_rows: bool) -> Iterator[FrameBlock]:
        """A `box` of rows and columns of all frames, `step` chunks at a time, the rest of them unread.

        Metadata rows are read only `with_rows`. The flags are those stored, and `BAD_CRC` where the box
        cannot be read: the compressed bytes have a checksum of their own, so damage inside is found; damage
        elsewhere in a frame is not looked for.
        """
        for start, stop in _spans(0, len(self), step * self._depth):
            counts, bad = self._read(self.counts, start, stop, box)
            rows = np.empty((stop - start, 0, 0), np.uint16)
            if with_rows:
                rows, also_bad = self._read(self.frame_datasets[1], start, stop)
                bad |= also_bad
            yield FrameBlock(start, counts, rows, self._flag(self.column("flags", start, stop), start, bad))

    def _timed_parts(self, start: int, stop: int | None, recorded: bool) -> Iterator[_Part]:
        for first, columns, frames in self._parts(start, stop):
            time_us, mono_ns = columns["time"], columns["mono_ns"]
            columns["time_ns"] = self._times.utc_ns(time_us, mono_ns, recorded=recorded)
            if not (recorded or self.info.is_camera):
                exceeded = self._beyond(columns).any(axis=-1)
                columns["flags"] = columns["flags"] | exceeded * np.uint32(Quality.IMPLAUSIBLE)
            yield first, columns, frames

    def _beyond(self, columns: Columns, recorded: bool = False) -> BoolArray:
        """True for values (n, channels) beyond what their quantity can be, whatever the flags."""
        values = self._values(columns)
        if recorded or not self.bounds.depend_on_sun:
            return self.bounds.is_exceeded(values)
        sun = sun_vectors(columns["time_ns"], self._site).reshape(-1, 3)
        return self.bounds.is_exceeded(values, sun[:, 2])

    def _values(self, columns: Columns) -> FloatArray:
        return columns["value"].reshape(-1, *self.info.shape)

    def _parts(self, start: int, stop: int | None) -> Iterator[_Part]:
        """The rows from `start` to `stop`, each compared with its checksum."""
        end = len(self) if stop is None else min(stop, len(self))
        for begin, last in _spans(start, end, self._block_rows):
            block = {name: self.column(name, begin, last) for name in self._declared}
            for first, until in _spans(begin, last, self._depth):
                columns = {name: values[first - begin : until - begin] for name, values in block.items()}
                frames = [self._frames_of_chunk(dataset, first, until) for dataset in self.frame_datasets]
                bad = stored_crc32s(columns, _bodies(columns, frames)) != columns["crc32"]
                columns["flags"] = self._flag(columns["flags"], first, bad)
                yield first, columns, frames

    def _frames_of_chunk(self, dataset: h5py.Dataset, first: int, until: int) -> CountArray:
        """Frames within one chunk; those that cannot be read are the fill value."""
        whole = first % self._depth == 0 and until == min(first + self._depth, len(self))
        if whole and dataset.name in self._packed and dataset.chunks[0] == self._depth:
            with suppress(OSError, RuntimeError, ValueError):  # then as far as HDF5 can read it
                return read_block(dataset, first)[: until - first]
        return self._read(dataset, first, until)[0]

    def _flag(self, flags: FlagArray, start: int, bad: BoolArray) -> FlagArray:
        """Flags of the rows from `start` on with what was found out about them, which is remembered."""
        self.damaged.update((start + np.flatnonzero(bad)).tolist())
        return np.where(bad, flags | np.uint32(Quality.BAD_CRC), flags)

    def _read(
        self, dataset: h5py.Dataset, start: int, stop: int, box: tuple[slice, ...] = ()
    ) -> tuple[CountArray, BoolArray]:
        """Frames, or a `box` of them, and which cannot be read: those are the fill value."""
        try:
            return dataset[(slice(start, stop), *box)], np.zeros(stop - start, np.bool_)
        except (OSError, RuntimeError):
            if stop - start > self._depth:
                parts = [self._read(dataset, *span, box) for span in _spans(start, stop, self._depth)]
                frames, lost = zip(*parts, strict=True)
                return np.concatenate(frames), np.concatenate(lost)
        missing = np.broadcast_to(np.uint16(FILL_COUNT), (stop - start, *dataset.shape[1:]))
        return missing[(slice(None), *box)].copy(), np.ones(stop - start, np.bool_)


def _most_bytes(dataset: h5py.Dataset) -> int:
    """Most bytes of a block of frames: what is there of all of them must be able to fill one."""
    try:
        packed = stored.stored_bytes(dataset)
    except SessionError:  # a damaged index costs the frames that it leads to, not all the session
        packed = stored.file_bytes(dataset)
    return min(MOST_BLOCK_BYTES, stored.DEFLATE_RATIO * packed) if len(dataset) else MOST_BLOCK_BYTES


def _bodies(columns: Columns, frames: list[CountArray]) -> Iterable[tuple[AnyArray, AnyArray]]:
    """Measured values and what came with them, row by row: see `fieldkit.sessions.records.sample_bytes`."""
    if frames:
        return zip(frames[0], frames[1] if len(frames) > 1 else repeat(_NOTHING), strict=False)
    lengths = columns["raw_length"].tolist()
    raws = (row[:length] for row, length in zip(columns["raw"], lengths, strict=True))
    return zip(columns["value"].reshape(len(lengths), -1), raws, strict=True)


def _spans(start: int, stop: int, step: int) -> Iterator[tuple[int, int]]:
    """First row and end of every block of `step` rows that `start`..`stop` runs through."""
    for first in range(start - start % step, stop, step) if start < stop else ():
        yield max(first, start), min(first + step, stop)
