"""Readable remains of an interrupted session: its journal, its file, and the file's loose chunks.

A block of frames that the file has whole is taken as it is, packed; of everything else, each
sample is looked for in the journal, then in the session file, then in the chunks whose places the
journal remembers (they survive even a file whose own index is destroyed). A sample counts only if
its checksum matches.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from fieldkit.model.arrays import AnyArray, CountArray, IntArray
from fieldkit.model.clock import ClockCheck
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import SessionError, message_of
from fieldkit.model.samples import Event, EventKind, Health, Quality, Sample
from fieldkit.sessions.chunks import PackedBlock, PackedChunk, corners, read_chunk, unpack
from fieldkit.sessions.journal import Chunk, SessionIdentity
from fieldkit.sessions.journal_reader import JournalReader
from fieldkit.sessions.layout import TIME_MAP_COLUMNS, chunk_shape, entry_columns
from fieldkit.sessions.lock import journal_path
from fieldkit.sessions.reader import SessionReader, open_interrupted
from fieldkit.sessions.records import (
    Entry,
    MinuteRecord,
    RegionRecord,
    SampleRow,
    sample_bytes,
    sample_crc32,
)
from fieldkit.sessions.sample_fields import of_frame
from fieldkit.sessions.stored import columns_of, whole_rows
from fieldkit.sessions.time_map import corrections, row_crc32s

_KINDS: tuple[type[Entry], ...] = (RegionRecord, Event, ClockCheck, Health, MinuteRecord)

_READING_BLOCK = 1024
_CUT_IMPORT = "it was being imported, and the rest of its source is missing: delete it and import it again"


class Salvage:
    """Both sides of an interrupted session, opened for reading; a context manager.

    Without `packed` no block is taken as it is. Raises `SessionError` where neither the file nor
    the journal can be read.
    """

    def __init__(self, path: Path, *, packed: bool = True) -> None:
        self._file_damage: list[str] = []
        self._missing: list[str] = []
        self._path = path
        self._packed = packed
        self._stack = ExitStack()
        self._journal = self._try_journal()
        self._session = self._try_session()
        self._is_finished = self._session is not None and self._session.was_finished
        self._is_import = False
        self.identity: SessionIdentity = self._identity()
        nothing = (0,) * (len(self.identity.header.streams) + 1)
        self._written = self._journal.written if self._journal is not None else nothing
        self.statistics: dict[str, RecoveryStatistics] = {
            info.name: RecoveryStatistics(info.name) for info in self.identity.header.streams
        }

    def __enter__(self) -> Salvage:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def damage(self) -> list[str]:
        """In words, what could not be read, of the file and of the journal, or was not yet written."""
        cut = [_CUT_IMPORT] if self._is_cut_import else []
        return [*dict.fromkeys(self._file_damage), *self._journal_damage, *cut]

    @property
    def losses(self) -> list[str]:
        """In words, what does not come back: damage of the file alone is made good by the journal."""
        runs = [run for stats in self.statistics.values() for run in stats.lost]
        return [*(f"{run.stream}: {run.count} samples lost" for run in runs), *self._journal_damage]

    @property
    def has_end(self) -> bool:
        """True if the last record there ever was is known: from the journal, or from a file once finished."""
        if self._journal is None:
            return self._is_finished
        return self._journal.has_end and not self._is_cut_import

    @property
    def _is_cut_import(self) -> bool:
        """True if the entries are of an import that ended before its source did: its journal looks whole."""
        return self._is_import and self._journal is not None and not self._is_finished

    @property
    def _journal_damage(self) -> list[str]:
        damage = self._journal.damage if self._journal is not None else []
        return list(dict.fromkeys([*self._missing, *damage]))

    def _try_session(self) -> SessionReader | None:
        try:
            return self._stack.enter_context(open_interrupted(self._path, salvage=True))
        except SessionError as error:
            self._file_damage.append(error.message)
            return None

    def _try_journal(self) -> JournalReader | None:
        folder = journal_path(self._path)
        try:
            if any(folder.glob("*.log")):
                return self._stack.enter_context(JournalReader(folder))
        except SessionError as error:
            self._missing.append(error.message)
            return None
        self._missing.append("the journal is gone: only what the file itself holds is recovered")
        return None

    def _identity(self) -> SessionIdentity:
        if self._journal is not None:
            return self._journal.identity
        if self._session is not None:
            return self._session.identity
        self._stack.close()
        raise SessionError(
            f"nothing can be read of {self._path}: {'; '.join(self.damage)}",
            fix="take a copy of it if you have one, with its .journal folder; else the recording is lost",
        )

    def samples(self, stream: str) -> Iterator[Sample | PackedBlock]:
        """Every sample of a stream that can be had, by number; whole blocks of frames in one piece."""
        place = [info.name for info in self.identity.header.streams].index(stream)
        info, stats = self.identity.header.streams[place], self.statistics[stream]
        stored = StoredSamples(self._session, info, self._file_damage)
        loose = LooseChunks(self._path, self._session, self._journal, info)
        journalled = self._journal.numbers(place) if self._journal is not None else np.empty(0, np.int64)
        numbers = np.union1d(journalled, stored.numbers)
        depth = chunk_shape(info)[0] if info.is_camera else _READING_BLOCK
        for wanted in _parts(numbers, numbers // depth):
            rows = self._rows(place, wanted)
            block = self._whole_block(info, loose, wanted, rows, stats)
            if block is not None:
                yield block
                continue
            for seq in wanted.tolist():
                sample = _found(rows.get(seq), info, stored, loose, seq)
                if sample is not None and stats.expects(seq):
                    stats.from_journal += not stored.has(seq)
                    stats.keep_sample(sample)
                    yield sample
        stats.finish(max(stored.total, self._written[place]))

    def _rows(self, place: int, wanted: IntArray) -> dict[int, SampleRow]:
        """The journal's rows of a block of samples, by number."""
        if self._journal is None:
            return {}
        return {row.seq: row for row in self._journal.rows(place, int(wanted[0]), int(wanted[-1]))}

    def _whole_block(
        self,
        info: StreamInfo,
        loose: LooseChunks,
        wanted: IntArray,
        rows: dict[int, SampleRow],
        stats: RecoveryStatistics,
    ) -> PackedBlock | None:
        """The block of these samples, if both sides have it whole and nothing before it is lost."""
        whole = info.is_camera and len(wanted) == len(rows) == chunk_shape(info)[0]
        if not (self._packed and whole and wanted[0] == stats.kept):
            return None
        chunks = loose.packed(int(wanted[0]))
        if chunks is None:
            return None
        for row in rows.values():
            stats.keep(row.seq, of_frame(row.stamps)["time_ns"], row.crc32)
        return PackedBlock(info.name, [row.columns() for row in rows.values()], chunks)

    def entries(self) -> Iterator[Entry]:
        """Everything but samples: from the journal, and from the file what a damaged journal lost."""
        journalled = list(self._journal.entries()) if self._journal is not None else []
        stored = _stored_entries(self._session, self._file_damage) if self._session is not None else []
        found = 0
        for kind in _KINDS:
            ours = [entry for entry in journalled if isinstance(entry, kind)]
            theirs = [entry for entry in stored if isinstance(entry, kind)]
            more = _together(ours, theirs) if self._journal_damage else max(ours, theirs, key=len)
            found += len(more)
            self._is_import |= any(isinstance(one, Event) and one.kind is EventKind.IMPORTED for one in more)
            yield from more
        if (lost := self._written[-1] - found) > 0:
            what = "events, slopes and records of health"
            self._missing.append(f"{lost} of {self._written[-1]} {what} are lost")
        if self._session is not None and self._journal is None:
            self._file_damage.extend(_lost_rows(self._session))

    def time_map(self) -> dict[str, AnyArray]:
        """The corrections of the clock written since, which only the file has; empty without any."""
        if self._session is None:
            return {}
        try:
            return _time_map(self._session)
        except (SessionError, OSError, RuntimeError, ValueError, KeyError) as error:
            self._file_damage.append(f"time_map: {message_of(error)}")
            return {}


def _together(ours: list[Entry], theirs: list[Entry]) -> list[Entry]:
    """Entries of one kind that the journal has or the file, in the order they were written.

    The file has all up to some point, the journal may have holes, but is exact.
    """
    exact = {_key(entry): entry for entry in ours}
    stored = [exact.pop(_key(entry), entry) for entry in theirs]
    return stored + list(exact.values())


def _key(entry: Entry) -> tuple[object, ...]:
    """Identity of an entry among others of its kind, in the file's precision."""
    if isinstance(entry, RegionRecord):
        return entry.time_ns // 1000, entry.region.name, entry.region.vertices
    if isinstance(entry, MinuteRecord):
        return (entry.time_ns // 1000,)
    return (entry.mono_ns, entry.kind, entry.text) if isinstance(entry, Event) else (entry.mono_ns,)


def _time_map(session: SessionReader) -> dict[str, AnyArray]:
    """The columns of the corrections; a part of them would be a wrong map: raises `SessionError`."""
    group, end = session.group("time_map"), session.path.stat().st_size
    datasets = columns_of(group, TIME_MAP_COLUMNS)
    length = max(dataset.shape[0] for dataset in datasets.values())
    if any(len(whole_rows(dataset, end)) < length for dataset in datasets.values()):
        raise SessionError(f"the {length} corrections of the clock are lost: apply them again")
    if not length:
        return {}
    columns = corrections(group, TIME_MAP_COLUMNS)
    return {**columns, "crc32": np.array(row_crc32s(columns), np.uint32)}


def _parts(numbers: IntArray, keys: IntArray) -> list[IntArray]:
    """Numbers cut where their keys change."""
    borders = np.flatnonzero(np.diff(keys)) + 1
    return [part for part in np.split(numbers, borders) if part.size]


def _found(
    row: SampleRow | None, info: StreamInfo, stored: StoredSamples, loose: LooseChunks, seq: int
) -> Sample | None:
    """The sample from the first side that has it whole."""
    if row is not None and (sample := row.sample(info)) is not None:
        return sample
    if (sample := stored.get(seq)) is not None:
        return sample
    return loose.get(row) if row is not None else None


def _stored_entries(session: SessionReader, damage: list[str]) -> list[Entry]:
    entries: list[Entry] = []
    for read in (
        partial(session.region_history, recorded=True),
        partial(session.events, recorded=True),
        session.clock_checks,
        partial(session.health, recorded=True),
        partial(session.minutes, recorded=True),
    ):
        try:
            entries.extend(read())
        except (SessionError, OSError, RuntimeError, ValueError, KeyError) as error:
            damage.append(message_of(error))
    return entries


def _lost_rows(session: SessionReader) -> Iterator[str]:
    """Rows of tables that the file claims but does not hold, in words."""
    columns_by_table = entry_columns(session.header)
    for name in session.tables:
        columns = columns_by_table[name]
        try:
            claimed = int(session.group(name)[columns[0].name].shape[0])
            there = len(session.table(name)[columns[0].name])
        except (SessionError, OSError, RuntimeError, ValueError, KeyError):
            continue  # reported when its entries were read
        if there < claimed:
            yield f"{name}: rows {there} to {claimed - 1} are lost ({claimed - there} of {claimed})"


# --- counting what is kept and what is lost


@dataclass(frozen=True, slots=True)
class LostRange:
    """A run of lost samples: first and last number, and UTC of the samples around it (0: there is none)."""

    stream: str
    first: int
    last: int
    after_ns: int
    before_ns: int

    @property
    def count(self) -> int:
        """Number of samples."""
        return self.last - self.first + 1


@dataclass
class RecoveryStatistics:
    """Outcome of one stream: samples kept, of those only in the journal, checksums, runs lost."""

    stream: str
    kept: int = 0
    from_journal: int = 0
    lost: list[LostRange] = field(default_factory=list)
    crc32s: list[int] = field(default_factory=list)
    last_ns: int = 0
    _next: int = 0

    def keep(self, seq: int, time_ns: int, crc32: int) -> None:
        """Count a sample; numbers between it and the one before are lost."""
        self._lose(seq, time_ns)
        self.kept += 1
        self.crc32s.append(crc32)
        self.last_ns, self._next = time_ns, seq + 1

    def keep_sample(self, sample: Sample) -> None:
        """Count a sample that was looked at by itself."""
        crc32 = sample_crc32(sample, *sample_bytes(sample))
        self.keep(sample.seq, sample.time_ns, crc32)

    def finish(self, total: int) -> None:
        """Set how many numbers were given: those after the last kept one are lost."""
        self._lose(total, 0)

    def _lose(self, until: int, before_ns: int) -> None:
        if until > self._next:
            self.lost.append(LostRange(self.stream, self._next, until - 1, self.last_ns, before_ns))

    def expects(self, seq: int) -> bool:
        """True if this number comes after all that were kept."""
        return seq >= self._next


# --- what the session's file still has: samples by its own index, chunks by the journal's

Index = dict[tuple[int, ...], tuple[int, int]]
"""Offset and size of chunks by the first row, and row and column of the frame."""


class StoredSamples:
    """Samples of one stream in the session file, by number; a block at a time is kept.

    `numbers` are those of the rows whose bytes are there, `total` how many were ever given.
    """

    def __init__(self, session: SessionReader | None, info: StreamInfo, damage: list[str]) -> None:
        self._reader = session.stream(info.name) if session is not None else None
        self._damage = damage
        self._step = chunk_shape(info)[0] if info.is_camera else 1024
        self._first, self._block = -1, list[Sample]()
        self.numbers: IntArray = np.empty(0, np.int64)
        self._whole: IntArray = np.empty(0, np.int64)
        self.total: int = 0
        if session is not None:
            try:
                self._count_up(session.path.stat().st_size)
            except (SessionError, OSError, RuntimeError) as error:
                damage.append(f"{info.name}: {message_of(error)}")
        self._rows = dict(zip(self.numbers.tolist(), self._whole.tolist(), strict=True))

    def _count_up(self, end: int) -> None:
        assert self._reader is not None
        self._whole = self._reader.whole_rows(end)
        runs = _parts(self._whole, self._whole - np.arange(len(self._whole)))
        spans = [(int(run[0]), int(run[-1]) + 1) for run in runs]
        numbers = [self._reader.column("seq", start, stop) for start, stop in spans]
        self.numbers = np.concatenate([self.numbers, *numbers])
        self.total = self._reader.claimed
        if len(self.numbers):  # after a recovery that lost some, numbers run ahead of rows
            ahead = int(self.numbers[-1] - self._whole[-1])
            self.total += ahead if 0 < ahead < self.total else 0

    def has(self, seq: int) -> bool:
        """True if the file has a row of that number."""
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
            return list(self._reader.samples(first, last + 1, recorded=True))
        except (SessionError, OSError, RuntimeError, ValueError) as error:
            self._damage.append(f"{self._reader.info.name}, rows from {first}: {message_of(error)}")
            return []


class LooseChunks:
    """Chunks of frames at the places the journal remembers, whatever became of the file's own index."""

    def __init__(
        self, path: Path, session: SessionReader | None, journal: JournalReader | None, info: StreamInfo
    ) -> None:
        self._path = path
        self._session = session
        self._journal = journal
        self._info = info
        self._blocks: dict[str, tuple[int, CountArray]] = {}
        self._indexes: dict[str, Index] = {}

    def packed(self, start: int) -> list[PackedChunk] | None:
        """Every chunk of the block that begins with that row, packed; None if one is not as written."""
        if self._session is None:
            return None
        chunks = []
        for dataset in self._session.stream(self._info.name).frame_datasets:
            if dataset.shape[0] < start + dataset.chunks[0]:
                return None
            index = self._indexes.get(dataset.name) or self._indexes.setdefault(dataset.name, _index(dataset))
            noted = {
                (chunk.n, chunk.y, chunk.x, chunk.offset, chunk.size): chunk
                for chunk in self._noted(dataset.name, start)
            }
            for corner in corners(dataset):
                # copied unread only where file and journal agree on its place
                chunk = noted.get((start, *corner, *index.get((start, *corner), (-1, -1))))
                data = read_chunk(self._path, chunk) if chunk is not None else None
                if data is None:
                    return None
                chunks.append(PackedChunk(dataset.name, corner, data))
        return chunks

    def get(self, row: SampleRow) -> Sample | None:
        """The frame of a row, put together from the chunks that can be read."""
        if not self._info.is_camera:
            return None
        counts = self._frame("counts", row.seq, chunk_shape(self._info), self._info.shape)
        depth = chunk_shape(self._info)[0]
        shape = self._info.metadata_shape
        more = self._frame("metadata_rows", row.seq, (depth, *shape), shape) if shape[0] else b""
        return row.with_bytes(counts, more).sample(self._info)

    def _frame(self, name: str, seq: int, cut: tuple[int, int, int], shape: tuple[int, ...]) -> bytes:
        start = seq - seq % cut[0]
        if self._blocks.get(name, (-1, None))[0] != start:
            self._blocks[name] = (
                start,
                self._block(f"/{self._info.name}/{name}", start, cut, shape),
            )
        frame: bytes = self._blocks[name][1][seq - start].tobytes()
        return frame

    def _block(
        self, dataset: str, start: int, cut: tuple[int, int, int], shape: tuple[int, ...]
    ) -> CountArray:
        """The block with every chunk that can be read; later places of a chunk overrule earlier ones."""
        block = np.zeros((cut[0], *shape), "<u2")
        for chunk in sorted(self._noted(dataset, start), key=lambda chunk: chunk.offset):
            data = read_chunk(self._path, chunk)
            if data is not None:
                y, x = chunk.y, chunk.x
                block[:, y : y + cut[1], x : x + cut[2]] = unpack(data, cut)
        return block

    def _noted(self, dataset: str, start: int) -> list[Chunk]:
        return self._journal.chunks(dataset, start) if self._journal is not None else []


def _index(dataset: h5py.Dataset) -> Index:
    """Place of each chunk in the file's own index: read in one go, asking for single ones is slow."""
    index: Index = {}

    def visit(chunk: Any) -> None:
        index[tuple(chunk.chunk_offset)] = chunk.byte_offset, chunk.size

    with contextlib.suppress(OSError, RuntimeError):
        dataset.id.chunk_iter(visit)
    return index
