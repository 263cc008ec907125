"""Readable remains of an interrupted session: its journal, its file, and the file's loose chunks.

Each sample is looked for in the journal, then in the session file, then in the chunks whose places the
journal remembers (they survive even a file whose own index is destroyed). A sample counts only if
its checksum matches.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field, replace
from operator import attrgetter
from pathlib import Path

import numpy as np

from fieldkit.model.arrays import AnyArray, CountArray, IntArray
from fieldkit.model.clock import ClockCheck
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import FormatError, SessionError, message_of
from fieldkit.model.samples import Event, EventKind, Health, Quality, Sample
from fieldkit.sessions.chunks import read_chunk, unpack
from fieldkit.sessions.journal import SessionIdentity
from fieldkit.sessions.journal_reader import JournalReader
from fieldkit.sessions.layout import FRAME_DATASETS, TIME_MAP_COLUMNS, block_rows, chunk_shape, entry_columns
from fieldkit.sessions.lock import journal_path
from fieldkit.sessions.reader import SessionReader, entry_readers, open_interrupted
from fieldkit.sessions.records import Entry, MinuteRecord, RegionRecord, SampleRow, sample_bytes, sample_crc32
from fieldkit.sessions.stored import DEFLATE_RATIO, columns_of, whole_rows
from fieldkit.sessions.time_map import corrections, row_crc32s

_KINDS: tuple[type[Entry], ...] = (RegionRecord, Event, ClockCheck, Health, MinuteRecord)

_UNREADABLE = (SessionError, OSError, RuntimeError, ValueError, KeyError)
_CUT_IMPORT = "it was being imported, and the rest of its source is missing: delete it and import it again"


class Salvage(AbstractContextManager["Salvage"]):
    """Both sides of an interrupted session, opened for reading; a context manager.

    Raises `SessionError` where neither the file nor the journal can be read.
    """

    def __init__(self, path: Path) -> None:
        self._damage: list[str] = []
        self._path = path
        self._is_import = self._file_is_ahead = False
        self.lost_entries: int = 0
        with ExitStack() as stack:
            self._session = self._try_session(stack)
            self._journal = self._open_journal(stack)
            self._stack = stack.pop_all()
        self._is_finished = self._session is not None and self._session.was_finished
        self.identity: SessionIdentity = self._journal.identity
        self.statistics: dict[str, RecoveryStatistics] = {
            info.name: RecoveryStatistics(info.name) for info in self.identity.header.streams
        }

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def damage(self) -> list[str]:
        """In words, what could not be read of the file and of the journal, and what was left out."""
        return [*dict.fromkeys([*self._damage, *self._journal.damage]), *self._journal.left_out]

    @property
    def lost(self) -> list[LostRange]:
        """Every run of lost samples."""
        return [run for stats in self.statistics.values() for run in stats.lost]

    @property
    def doubt(self) -> str:
        """Why it is not known what was the last record there ever was, in words; empty where it is known."""
        if self._is_finished:
            return ""
        if self._is_import:  # its journal looks whole
            return _CUT_IMPORT
        # the journal is synced each second, the file's pages may reach the disk before
        return "the session file goes on behind the journal" if self._file_is_ahead else self._journal.doubt

    def _try_session(self, stack: ExitStack) -> SessionReader | None:
        try:
            return stack.enter_context(open_interrupted(self._path, salvage=True))
        except FormatError:
            raise
        except SessionError as error:
            self._damage.append(error.message)
            return None

    def _open_journal(self, stack: ExitStack) -> JournalReader:
        """The journal of the file's session; without the file of that which most of its logs are of."""
        identity = self._session.identity if self._session is not None else None
        try:
            journal = stack.enter_context(JournalReader(journal_path(self._path), identity))
            journal.compare_sizes()
            return journal
        except FormatError:
            raise
        except SessionError as error:
            problem = f"nothing can be read of {self._path}: {'; '.join([*self._damage, error.message])}"
            fix = "take a copy of it if you have one, with its .journal folder; else the recording is lost"
            raise SessionError(problem, fix=fix) from error

    def samples(self, stream: str) -> Iterator[tuple[Sample, int]]:
        """Every sample of a stream that can be had, by number, with its checksum."""
        place = [info.name for info in self.identity.header.streams].index(stream)
        info, stats = self.identity.header.streams[place], self.statistics[stream]
        stored = StoredSamples(self._session, info, self._damage)
        loose = LooseChunks(self._path, self._journal, info)
        numbers = np.union1d(self._journal.numbers(place), stored.numbers)
        for block in _parts(numbers, numbers // block_rows(info)):
            rows = {row.seq: row for row in self._journal.rows(place, int(block[0]), int(block[-1]))}
            ours = {seq: sample for seq, row in rows.items() if (sample := row.sample(info))}
            theirs = stored.samples([seq for seq in block.tolist() if seq not in ours])
            for seq in block.tolist():
                row = rows.get(seq)
                sample = ours.get(seq) or theirs.get(seq) or (loose.get(row) if row else None)
                if sample is not None and seq >= stats.next_seq:
                    stats.from_journal += seq not in stored.rows
                    stats.from_file += row is None
                    crc32 = sample_crc32(sample, *sample_bytes(sample))
                    stats.keep(seq, sample.time_ns, crc32)
                    yield sample, crc32
        written = self._journal.written[place]
        stats.lose(max(stored.total, written), 0)
        self._file_is_ahead |= stored.total > written
        if stats.from_file and not self._is_finished:
            self._damage.append(f"{stream}: the journal lacks {stats.from_file} samples of the session file")

    def entries(self) -> Iterator[Entry]:
        """Everything but samples: from the journal, and from the file what a damaged journal lost."""
        journalled, written = list(self._journal.entries()), self._journal.written[-1]
        stored = _stored_entries(self._session, self._damage) if self._session is not None else []
        count = 0
        for kind in _KINDS:
            ours = [entry for entry in journalled if isinstance(entry, kind)]
            theirs = [entry for entry in stored if isinstance(entry, kind)]
            is_whole = len(journalled) == written and len(ours) >= len(theirs)
            entries = ours if is_whole else _together(ours, theirs)
            count += len(entries)
            events = (entry for entry in entries if isinstance(entry, Event))
            self._is_import |= any(event.kind is EventKind.IMPORTED for event in events)
            yield from entries
        self._file_is_ahead |= count > written
        if (lost := written - count) > 0:
            self._lose(lost, f"{lost} of {written} events, slopes and records of health are lost")
        if self._session is not None and not written:
            for name, there, claimed in _lost_rows(self._session):
                self._lose(claimed - there, f"{name}: rows {there} to {claimed - 1} of {claimed} are lost")

    def time_map(self) -> dict[str, AnyArray]:
        """The corrections of the clock written since, which only the file has; empty without any."""
        if self._session is None:
            return {}
        try:
            return _time_map(self._session)
        except _UNREADABLE as error:
            self._lose(1, f"time_map: {message_of(error)}")
            return {}

    def _lose(self, count: int, text: str) -> None:
        self.lost_entries += count
        self._damage.append(text)


def _together(ours: list[Entry], theirs: list[Entry]) -> list[Entry]:
    """Entries of one kind that the journal has or the file, in the order they were written.

    The file has all up to some point, the journal may have holes, but is exact.
    """
    exact = {_key(entry): entry for entry in ours}
    in_file = [exact.pop(_key(entry), entry) for entry in theirs]
    return in_file + list(exact.values())


def _key(entry: Entry) -> tuple[object, ...]:
    """Identity of an entry among others of its kind, in the file's precision."""
    if isinstance(entry, RegionRecord):
        return entry.time_ns // 1000, entry.region.name, entry.region.points_px
    if isinstance(entry, MinuteRecord):
        return (entry.time_ns // 1000,)
    if isinstance(entry, Event):
        return entry.mono_ns, entry.kind, str(entry.text)[:60]  # the file may have cut it
    return (entry.mono_ns,)


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
    return [part for part in np.split(numbers, np.flatnonzero(np.diff(keys)) + 1) if part.size]


def _stored_entries(session: SessionReader, damage: list[str]) -> list[Entry]:
    entries: list[Entry] = []
    for read in entry_readers(session):
        try:
            entries.extend(read())
        except _UNREADABLE as error:
            damage.append(message_of(error))
    return entries


def _lost_rows(session: SessionReader) -> Iterator[tuple[str, int, int]]:
    """Tables with how many rows the file holds, and how many more it claims."""
    for name, (first, *_) in entry_columns(session.header).items():
        column = first.name
        try:
            claimed, there = len(session.group(name)[column]), len(session.table(name)[column])
        except _UNREADABLE:
            continue  # reported when its entries were read
        if there < claimed:
            yield name, there, claimed


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
    """Outcome of one stream: samples that only one side had, checksums of those kept, runs lost."""

    stream: str
    from_journal: int = 0
    from_file: int = 0
    lost: list[LostRange] = field(default_factory=list)
    crc32s: list[int] = field(default_factory=list)
    last_ns: int = 0
    next_seq: int = 0

    def keep(self, seq: int, time_ns: int, crc32: int) -> None:
        """Count a sample; numbers between it and the one before are lost."""
        self.lose(seq, time_ns)
        self.crc32s.append(crc32)
        self.last_ns, self.next_seq = time_ns, seq + 1

    def lose(self, until: int, before_ns: int) -> None:
        """Count the numbers before `until` that do not come back; `before_ns` is the time of that one."""
        if until > self.next_seq:
            self.lost.append(LostRange(self.stream, self.next_seq, until - 1, self.last_ns, before_ns))


# --- what the session's file still has: samples by its own index, chunks by the journal's


class StoredSamples:
    """Samples of one stream in the session file, by number.

    `rows` has the row of each number whose bytes are there, `total` is how many numbers were ever given.
    """

    def __init__(self, session: SessionReader | None, info: StreamInfo, damage: list[str]) -> None:
        self._damage = damage
        self.numbers: IntArray = np.empty(0, np.int64)
        self.rows: dict[int, int] = {}
        self.total: int = 0
        if session is None:
            return
        self._reader = session.stream(info.name)
        try:
            whole = self._reader.whole_rows(session.path.stat().st_size)
            runs = _parts(whole, whole - np.arange(len(whole)))
            numbers = [self._reader.column("seq", int(run[0]), int(run[-1]) + 1) for run in runs]
            self.numbers = np.concatenate([self.numbers, *numbers])
            self.rows = dict(zip(self.numbers.tolist(), whole.tolist(), strict=True))
            self.total = self._claimed = self._reader.claimed
        except (SessionError, OSError, RuntimeError) as error:
            damage.append(f"{info.name}: {message_of(error)}")

    def samples(self, numbers: Iterable[int]) -> dict[int, Sample]:
        """Those of the samples that are there and whole, by number."""
        rows = [self.rows[seq] for seq in numbers if seq in self.rows]
        whole: dict[int, Sample] = {}
        if not rows:
            return whole
        first = min(rows)
        try:
            stored = self._reader.samples(first, max(rows) + 1, recorded=True)
            for row, sample in enumerate(stored, start=first):
                if not sample.quality & Quality.BAD_CRC and self.rows.get(sample.seq) == row:
                    whole[sample.seq] = sample
                    # numbers that an earlier recovery lost
                    self.total = max(self.total, self._claimed + sample.seq - row)
        except _UNREADABLE as error:
            self._damage.append(f"{self._reader.info.name}, rows from {first}: {message_of(error)}")
        return whole


class LooseChunks:
    """Chunks of frames at the places the journal remembers, whatever became of the file's own index."""

    def __init__(self, path: Path, journal: JournalReader, info: StreamInfo) -> None:
        self._path = path
        self._journal = journal
        self._info = info
        self._blocks: dict[str, tuple[int, CountArray | None]] = {}

    def get(self, row: SampleRow) -> Sample | None:
        """The frame of a row, put together from the chunks that can be read."""
        if not self._info.is_camera:
            return None
        counts, metadata_rows = (self._frame(name, row.seq) for name in FRAME_DATASETS)
        return replace(row, data=counts, more=metadata_rows).sample(self._info)

    def _frame(self, name: str, seq: int) -> bytes:
        start = seq - seq % block_rows(self._info)
        if self._blocks.get(name, (-1, None))[0] != start:
            self._blocks[name] = start, self._block(name, start)
        block = self._blocks[name][1]
        return b"" if block is None else block[seq - start].tobytes()

    def _block(self, name: str, start: int) -> CountArray | None:
        """The block with every chunk that can be read; later places of a chunk overrule earlier ones.

        None where these are too few to fill one.
        """
        depth, rows, cols = chunk_shape(self._info)
        shape = self._info.shape
        if name != "counts":  # metadata rows are cut into whole frames
            rows, cols = shape = self._info.metadata_shape
        chunks = self._journal.chunks(f"/{self._info.name}/{name}", start)
        chunks.sort(key=attrgetter("offset"))
        there = [(chunk, data) for chunk in chunks if (data := read_chunk(self._path, chunk)) is not None]
        if DEFLATE_RATIO * sum(len(data) for _, data in there) < 2 * depth * math.prod(shape):
            return None
        block = np.zeros((depth, *shape), "<u2")
        for chunk, data in there:
            place = np.s_[:, chunk.y : chunk.y + rows, chunk.x : chunk.x + cols]
            if block[place].shape == (depth, rows, cols):
                block[place] = unpack(data, (depth, rows, cols))
        return block
