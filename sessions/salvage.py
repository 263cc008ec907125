"""What can still be read of an interrupted session: its journal, its file, and the file's loose chunks.

Each sample is looked for in the journal, then in the session file, then in the chunks whose
places the journal remembers (they survive even a file whose own index is destroyed); it counts
only if its checksum matches.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fieldkit.clock import ClockCheck
from fieldkit.device import StreamInfo
from fieldkit.errors import SessionError
from fieldkit.samples import Event, Health, Quality, Sample
from fieldkit.sessions.bricks import unpack
from fieldkit.sessions.journal import Identity
from fieldkit.sessions.journal_reader import JournalReader, SampleRow
from fieldkit.sessions.layout import brick_shape, journal_path
from fieldkit.sessions.reader import Session, open_interrupted
from fieldkit.sessions.records import Entry, MinuteRecord, RegionRecord

_KINDS: tuple[type[Entry], ...] = (RegionRecord, Event, ClockCheck, Health, MinuteRecord)


@dataclass
class Tally:
    """What became of one stream: samples kept, of those only in the journal, and numbers lost."""

    kept: int = 0
    from_journal: int = 0
    lost: list[int] = field(default_factory=list)
    crc32s: list[int] = field(default_factory=list)


class Salvage:
    """Both sides of an interrupted session, opened for reading; a context manager.

    Raises `SessionError` where neither the file nor the journal can be read.
    """

    def __init__(self, path: Path) -> None:
        self.damage: list[str] = []
        self._path = path
        self._stack = ExitStack()
        self._session = self._try_session()
        self._journal = self._try_journal()
        self.identity = self._identity()
        self.tallies = {info.name: Tally() for info in self.identity.header.streams}

    def __enter__(self) -> Salvage:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def _try_session(self) -> Session | None:
        try:
            return self._stack.enter_context(open_interrupted(self._path))
        except SessionError as error:
            self.damage.append(error.message)
            return None

    def _try_journal(self) -> JournalReader | None:
        try:
            journal = self._stack.enter_context(JournalReader(journal_path(self._path)))
        except SessionError as error:
            self.damage.append(error.message)
            return None
        self.damage.extend(journal.damage)
        journal.damage = self.damage
        return journal

    def _identity(self) -> Identity:
        if self._journal is not None:
            return self._journal.identity
        if self._session is not None:
            return self._session.identity
        self._stack.close()
        raise SessionError(f"nothing can be read of {self._path}: {'; '.join(self.damage)}")

    def samples(self, stream: str) -> Iterator[Sample]:
        """Every sample of a stream that can be had, by number."""
        number = [info.name for info in self.identity.header.streams].index(stream)
        info, tally = self.identity.header.streams[number], self.tallies[stream]
        rows = self._journal.stream_rows(number) if self._journal is not None else iter(())
        stored = _Stored(self._session, info, self.damage)
        loose = _LooseChunks(self._path, self._journal, info)
        row = next(rows, None)
        for seq in _numbers(stored.numbers, self._journal.last_seq(number) if self._journal else -1):
            while row is not None and row.seq < seq:
                row = next(rows, None)
            mine = row if row is not None and row.seq == seq else None
            sample = mine.sample(info) if mine is not None else None
            stored_sample = stored.get(seq) if sample is None else None
            if sample is None and stored_sample is None and mine is not None:
                stored_sample = loose.get(mine)
            self._count(tally, seq, sample or stored_sample, in_file=stored.has(seq))
            if (found := sample or stored_sample) is not None:
                yield found

    @staticmethod
    def _count(tally: Tally, seq: int, sample: Sample | None, *, in_file: bool) -> None:
        if sample is None:
            tally.lost.append(seq)
            return
        tally.kept += 1
        tally.from_journal += not in_file

    def entries(self) -> Iterator[Entry]:
        """Everything that is no sample: of each kind, from the side that has more of it."""
        journalled = list(self._journal.entries()) if self._journal is not None else []
        stored = _stored_entries(self._session, self.damage) if self._session is not None else []
        for kind in _KINDS:
            ours = [entry for entry in journalled if isinstance(entry, kind)]
            theirs = [entry for entry in stored if isinstance(entry, kind)]
            yield from ours if len(ours) >= len(theirs) else theirs


def _numbers(stored: NDArray[np.int64], last_journalled: int) -> range:
    """All numbers that were ever given, as far as either side knows."""
    last_stored = int(stored.max()) if stored.size else -1
    return range(max(last_stored, last_journalled) + 1)


class _Stored:
    """Samples of one stream in the session file, by number; a block at a time is kept."""

    def __init__(self, session: Session | None, info: StreamInfo, damage: list[str]) -> None:
        self._reader = session.stream(info.name) if session is not None else None
        self._damage = damage
        self._step = brick_shape(info)[0] if info.is_camera else 1024
        self._first, self._block = -1, list[Sample]()
        self.numbers: NDArray[np.int64] = np.empty(0, np.int64)
        try:
            if self._reader is not None:
                self.numbers = self._reader.column("seq")
        except (OSError, RuntimeError) as error:
            damage.append(f"{info.name}: {error}")
        self._rows = {int(seq): row for row, seq in enumerate(self.numbers)}

    def has(self, seq: int) -> bool:
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
            return list(self._reader.samples(first, first + self._step))
        except (OSError, RuntimeError, ValueError) as error:
            self._damage.append(f"{self._reader.info.name}, rows from {first}: {error}")
            return []


class _LooseChunks:
    """Pictures put together from chunks at remembered places, whatever became of the file's own index."""

    def __init__(self, path: Path, journal: JournalReader | None, info: StreamInfo) -> None:
        self._path = path
        self._journal = journal
        self._info = info
        self._bricks: dict[str, tuple[int, NDArray[np.uint16]]] = {}

    def get(self, row: SampleRow) -> Sample | None:
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
        chunks = self._journal.chunks(dataset, start) if self._journal is not None else []
        for chunk in sorted(chunks, key=lambda chunk: chunk.offset):
            data = _read_at(self._path, chunk.offset, chunk.size)
            if zlib.crc32(data) != chunk.crc32:
                continue
            y, x = chunk.y, chunk.x
            brick[:, y : y + tile[1], x : x + tile[2]] = unpack(data, tile)
        return brick


def _read_at(path: Path, offset: int, size: int) -> bytes:
    try:
        descriptor = os.open(path, os.O_RDONLY)
    except OSError:
        return b""
    try:
        return os.pread(descriptor, size, offset)
    finally:
        os.close(descriptor)


def _stored_entries(session: Session, damage: list[str]) -> list[Entry]:
    entries: list[Entry] = []
    for read in (
        session.region_history,
        session.events,
        session.clock_checks,
        session.health,
        session.minutes,
    ):
        try:
            entries.extend(read())
        except (SessionError, OSError, RuntimeError, ValueError, KeyError) as error:
            damage.append(str(error))
    return entries
