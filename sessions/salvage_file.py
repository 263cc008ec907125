"""What an interrupted session's file still has: samples by its own index, and chunks by the journal's."""

from __future__ import annotations

import contextlib
import os
import zlib
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import SessionError
from fieldkit.model.samples import Quality, Sample
from fieldkit.sessions.bricks import Tile, corners, unpack
from fieldkit.sessions.journal import Chunk
from fieldkit.sessions.journal_reader import JournalReader, SampleRow
from fieldkit.sessions.layout import brick_shape
from fieldkit.sessions.reader import Session

Index = dict[tuple[int, ...], tuple[int, int]]
"""Offset and size of chunks by the first row, and row and column of the picture."""


class StoredSamples:
    """Samples of one stream in the session file, by number; a block at a time is kept.

    `numbers` are those of the rows whose bytes are there, `total` how many were ever given.
    """

    def __init__(self, session: Session | None, info: StreamInfo, damage: list[str]) -> None:
        self._reader = session.stream(info.name) if session is not None else None
        self._damage = damage
        self._step = brick_shape(info)[0] if info.is_camera else 1024
        self._first, self._block = -1, list[Sample]()
        self.numbers: NDArray[np.int64] = np.empty(0, np.int64)
        self._whole: NDArray[np.int64] = np.empty(0, np.int64)
        self.total = 0
        if session is not None:
            try:
                self._look(session.path.stat().st_size)
            except (SessionError, OSError, RuntimeError) as error:
                damage.append(f"{info.name}: {error}")
        self._rows = dict(zip(self.numbers.tolist(), self._whole.tolist(), strict=True))

    def _look(self, end: int) -> None:
        assert self._reader is not None
        self._whole = self._reader.whole_rows(end)
        spans = [(int(span[0]), int(span[-1]) + 1) for span in _runs(self._whole)]
        numbers = [self._reader.column("seq", start, stop) for start, stop in spans]
        self.numbers = np.concatenate([self.numbers, *numbers])
        self.total = self._reader.claimed
        if len(self.numbers):  # after a recovery that lost some, numbers run ahead of rows
            ahead = int(self.numbers[-1] - self._whole[-1])
            self.total += ahead if 0 < ahead < self.total else 0

    def has(self, seq: int) -> bool:
        """Whether the file has a row of that number."""
        return seq in self._rows

    def get(self, seq: int) -> Sample | None:
        """The sample, if it is there and whole."""
        row = self._rows.get(seq)
        if row is None:
            return None
        first = row - row % self._step
        if first != self._first:
            self._first, self._block = first, self._read(first)
        sample = self._block[row - first] if row - first < len(self._block) else None
        return None if sample is None or sample.quality & Quality.BAD_CRC or sample.seq != seq else sample

    def _read(self, first: int) -> list[Sample]:
        assert self._reader is not None
        try:
            last = int(self._whole[np.searchsorted(self._whole, first + self._step) - 1])
            return list(self._reader.samples(first, last + 1))
        except (SessionError, OSError, RuntimeError, ValueError) as error:
            self._damage.append(f"{self._reader.info.name}, rows from {first}: {error}")
            return []


def _runs(rows: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Runs of consecutive rows."""
    return [run for run in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1) if run.size]


class LooseChunks:
    """Chunks of pictures at the places the journal remembers, whatever became of the file's own index."""

    def __init__(
        self, path: Path, session: Session | None, journal: JournalReader | None, info: StreamInfo
    ) -> None:
        self._path = path
        self._session = session
        self._journal = journal
        self._info = info
        self._bricks: dict[str, tuple[int, NDArray[np.uint16]]] = {}
        self._indexes: dict[str, Index] = {}

    def packed(self, start: int) -> list[Tile] | None:
        """Every tile of the brick that begins with that row, packed; None if one is not as it was written."""
        if self._session is None:
            return None
        tiles = []
        for dataset in self._session.stream(self._info.name).bricks:
            if dataset.shape[0] < start + dataset.chunks[0]:
                return None
            index = self._indexes.get(dataset.name) or self._indexes.setdefault(dataset.name, _index(dataset))
            noted = {
                (chunk.n, chunk.y, chunk.x, chunk.offset, chunk.size): chunk
                for chunk in self._noted(dataset.name, start)
            }
            for corner in corners(dataset):
                chunk = noted.get((start, *corner, *index.get((start, *corner), (-1, -1))))
                data = _read_at(self._path, chunk) if chunk is not None else None
                if data is None:
                    return None
                tiles.append(Tile(dataset.name, corner, data))
        return tiles

    def get(self, row: SampleRow) -> Sample | None:
        """The picture of a row, put together from the chunks that can be read."""
        if not self._info.is_camera:
            return None
        counts = self._picture("counts", row.seq, brick_shape(self._info), self._info.shape)
        depth = brick_shape(self._info)[0]
        shape = self._info.metadata_shape
        more = self._picture("metadata_rows", row.seq, (depth, *shape), shape) if shape[0] else b""
        return row.with_bytes(counts, more).sample(self._info)

    def _picture(self, name: str, seq: int, tile: tuple[int, int, int], shape: tuple[int, ...]) -> bytes:
        start = seq - seq % tile[0]
        if self._bricks.get(name, (-1, None))[0] != start:
            self._bricks[name] = start, self._brick(f"/{self._info.name}/{name}", start, tile, shape)
        picture: bytes = self._bricks[name][1][seq - start].tobytes()
        return picture

    def _brick(
        self, dataset: str, start: int, tile: tuple[int, int, int], shape: tuple[int, ...]
    ) -> NDArray[np.uint16]:
        """The brick with every tile that can be read; later places of a chunk overrule earlier ones."""
        brick = np.zeros((tile[0], *shape), "<u2")
        for chunk in sorted(self._noted(dataset, start), key=lambda chunk: chunk.offset):
            data = _read_at(self._path, chunk)
            if data is not None:
                y, x = chunk.y, chunk.x
                brick[:, y : y + tile[1], x : x + tile[2]] = unpack(data, tile)
        return brick

    def _noted(self, dataset: str, start: int) -> list[Chunk]:
        return list(self._journal.chunks(dataset, start)) if self._journal is not None else []


def _index(dataset: h5py.Dataset) -> Index:
    """Where the file's own index has each chunk: read in one go, asking for single ones is slow."""
    index: Index = {}

    def look(chunk: Any) -> None:
        index[tuple(chunk.chunk_offset)] = chunk.byte_offset, chunk.size

    with contextlib.suppress(OSError, RuntimeError):
        dataset.id.chunk_iter(look)
    return index


def _read_at(path: Path, chunk: Chunk) -> bytes | None:
    """The bytes of a chunk, if they are as they were written."""
    try:
        descriptor = os.open(path, os.O_RDONLY)
    except OSError:
        return None
    try:
        data = os.pread(descriptor, chunk.size, chunk.offset)
    finally:
        os.close(descriptor)
    return data if zlib.crc32(data) == chunk.crc32 else None
