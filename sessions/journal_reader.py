"""Reading a journal, also while it is written, after a kill, and whatever became of its bytes.

Every file is scanned for records; a sample is returned only if record and sample match their checksums. Since
each record says how many there were before it, what is missing is known up to the last one that survives.
Whose a record is, and where it belongs, is decided by the numbers in it, never by a file's name.
"""

from __future__ import annotations

import contextlib
from array import array
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from functools import cached_property
from itertools import islice
from pathlib import Path
from statistics import mode
from typing import Any

import numpy as np

from fieldkit.model.arrays import IntArray, TableArray
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import FormatError, SessionError
from fieldkit.sessions.journal import Chunk, SessionIdentity, decode_chunks
from fieldkit.sessions.lock import OWNER_BYTES, RECORDING
from fieldkit.sessions.log import Head, Kind, LogReader, boot_id, session_number
from fieldkit.sessions.records import Entry, SampleRow, decode_entry

_PLACE = np.dtype([("seq", "<i8"), ("kind", "<i8"), ("log", "<i8"), ("at", "<i8")])


class JournalReader(contextlib.AbstractContextManager["JournalReader"]):
    """The records of one session in the folder of a journal; a context manager.

    The session is that of `identity`, of which there may be nothing; or else the one that most of the files
    are of. `damage` names what was found to be damaged by what was read so far. Raises `FormatError` for a
    journal of another version, `SessionError` where no file says what session it is of.
    """

    def __init__(self, folder: Path, identity: SessionIdentity | None = None) -> None:
        self.folder = folder
        self._logs = list(_open_logs(folder))
        self._unreadable: list[str] = []
        numbers = [session_number(identity.session_id)] if identity else session_numbers(folder)
        self._session = mode(numbers or [0])
        try:
            self._stated = [*self._identities(), *([identity] if identity else [])]
            if not self._stated:
                raise SessionError("holds no readable journal", place=folder)
        except SessionError:
            self.close()
            raise
        self.identity: SessionIdentity = self._stated[0]
        self._in_file = identity
        self._logs.sort(key=lambda log: (log.part, log.is_copy))
        self._entries = len(self.identity.header.streams)

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the files."""
        for log in self._logs:
            log.close()

    def compare_sizes(self) -> None:
        """Take the first header that declares the streams as large as their samples are.

        Raises `SessionError` where none does: arrays are made of the declared sizes.
        """
        samples = [self._last_sample(stream) for stream in range(self._entries)]
        for identity in self._stated:
            streams = identity.header.streams
            in_file = self._in_file.header.streams if self._in_file else streams
            fits = all(row is None or row.sample(info) for info, row in zip(streams, samples, strict=False))
            if fits and _sizes(streams) == _sizes(in_file):
                self.identity = identity
                return
        raise SessionError("declares samples of other sizes than it holds", place=self.folder)

    def _last_sample(self, stream: int) -> SampleRow | None:
        """The last sample whose bytes are here; the first ones are in the session file alone."""
        latest = self._index.places[stream]["seq"][-9:]
        return next((row for row in self.rows(stream, *latest[:1]) if row.data is not None), None)

    @property
    def damage(self) -> list[str]:
        """In words, what of the journal cannot be read."""
        return [*(line for log in self._logs for line in log.damage), *self._unreadable]

    @property
    def written(self) -> tuple[int, ...]:
        """Number of samples of each stream and, last, of other records written, as far as that is known."""
        return self._index.written

    @property
    def left_out(self) -> list[str]:
        """In words, the records that are of another session, or stand twice or out of order, by file."""
        return [f"{count} {records}" for records, count in self._index.left_out.items()]

    @property
    def doubt(self) -> str:
        """Why the end is not known, in words; empty where it is.

        It is known where the writer closed the journal, and where the lock counts the last record of the
        parts, or all but that one: under the same boot the kernel has kept both. It is not known in a copy:
        one made while it was recorded may have a lock as old as its parts.
        """
        index, last = self._index, self._logs[-1] if self._logs else None
        if index.is_closed:
            return ""
        if last is None or last.origin is None:
            return "no part of the journal is there"
        if last.origin.boot != boot_id():
            return "the computer was started again since"
        if last.is_copy:
            return f"{last.name} is a copy"
        is_whole = index.in_parts == sum(index.written) <= index.in_lock + 1
        return "" if is_whole else "the last records of the journal are gone"

    def numbers(self, stream: int) -> IntArray:
        """The numbers of the samples of a stream that the journal has, in order."""
        return np.unique(self._index.places[stream]["seq"])

    def rows(self, stream: int, first: int = 0, last: int = 2**62) -> Iterator[SampleRow]:
        """The samples of a stream with numbers `first` to `last`, in order, without damaged ones."""
        for seq, payload in self._payloads(stream, first, last):
            yield SampleRow.decode(stream, seq, payload)

    def crc32s(self, stream: int) -> Iterator[int]:
        """The checksums of that stream's samples, in order."""
        return (row.crc32 for row in self.rows(stream))

    def entries(self) -> Iterator[Entry]:
        """Everything but samples, in order."""
        for _, payload in self._payloads(self._entries):
            try:
                yield _entry(payload)
            except SessionError as error:
                self._unreadable.append(error.message)

    def chunks(self, dataset: str, n: int) -> list[Chunk]:
        """Places of the chunks of a dataset from row `n` on in the session file."""
        chunks: list[Chunk] = []
        for log, at in self._index.chunks[dataset, n]:
            if (payload := self._payload_at(log, at)) is not None:
                chunks += decode_chunks(payload)
        return chunks

    def since(self, number: int, before: int) -> Iterator[SampleRow | Entry]:
        """Records `number` to `before`, the last excluded, of a journal that is being written."""
        parts = [log for log in self._logs if log.part]
        # the first record of a part, its identity, counts those of the parts before
        starts = [next((head.number + 1 for head in log.heads()), 0) for log in parts]
        ends = [*starts[1:], before]
        for log, end in zip(parts, ends, strict=True):
            for head in log.heads() if end > number else ():
                is_wanted = head.kind in (Kind.SAMPLE, Kind.ENTRY) and number <= head.number < before
                if is_wanted and (payload := self._payload(log, head)) is not None:
                    is_entry = head.kind == Kind.ENTRY
                    yield _entry(payload) if is_entry else SampleRow.decode(head.stream, head.seq, payload)

    def _identities(self) -> Iterator[SessionIdentity]:
        """The session, as the head of each log states it; notes of each log what file it was made as."""
        for log in self._logs:
            own = (Kind.IDENTITY, self._session)
            heads = (head for head in log.heads() if (head.kind, head.session) == own)
            for payload in filter(None, map(log.payload, islice(heads, 1))):
                try:
                    identity, log.origin = SessionIdentity.from_json(payload, self.folder)
                except FormatError:
                    raise
                except (SessionError, ValueError, TypeError) as error:
                    self._unreadable.append(f"{log.name}: {error}")
                else:
                    yield identity

    def _payloads(self, stream: int, first: int = 0, last: int = 2**62) -> Iterator[tuple[int, bytes]]:
        """The payload of each record of a stream; of one that stands twice, the first that can be read."""
        places = self._index.places[stream]
        some = places[np.searchsorted(places["seq"], first) : np.searchsorted(places["seq"], last, "right")]
        latest = -1
        for place in some:  # a day has a million: not all at once
            seq, _, log, at = place.item()
            if seq != latest and (payload := self._payload_at(log, at)) is not None:
                yield seq, payload
                latest = seq

    def _payload(self, log: LogReader, head: Head) -> bytes | None:
        if (payload := log.payload(head)) is None:
            self._unreadable.append(f"{log.name}: the record at byte {head.at} is damaged")
        return payload

    def _payload_at(self, log: int, at: int) -> bytes | None:
        head = self._logs[log].head_at(at)
        return None if head is None else self._payload(self._logs[log], head)

    @cached_property
    def _index(self) -> _Index:
        return _Index(self._logs, self._session, self._entries + 1)


def _sizes(streams: Iterable[StreamInfo]) -> list[tuple[Any, ...]]:
    return [(info.name, info.shape, info.metadata_shape, info.raw_bytes) for info in streams]


def session_numbers(folder: Path) -> list[int]:
    """The number of the session of a folder's lock, which nobody copies alone, and of each log there.

    Of a log it is that of its first record.
    """
    numbers = []
    for log in _open_logs(folder):
        with contextlib.closing(log):
            begun = (head for head in log.heads() if head.number >= 0 or head.kind == Kind.IDENTITY)
            numbers += [head.session for head in islice(begun, 1)]
    return numbers


def _open_logs(folder: Path) -> Iterator[LogReader]:
    """The lock of a folder, which says how much was written, and its logs."""
    for path in (folder / RECORDING, *sorted(folder.glob("*.log"))):
        with contextlib.suppress(FileNotFoundError):  # a part that has just been retired
            yield LogReader(path, OWNER_BYTES if path.name == RECORDING else 0)


def _entry(payload: bytes) -> Entry:
    kind, _, body = payload.decode(errors="replace").partition("\n")
    return decode_entry(kind, body)


class _Index:
    """Places of the records of a session in some logs, by stream and number, and their counts.

    The logs are its parts in their order, behind all others. `in_parts` is how many records these count,
    `in_lock` how many the lock does; `left_out` counts records that are not taken, by what they are.
    """

    def __init__(self, logs: list[LogReader], session: int, streams: int) -> None:
        self.written: tuple[int, ...] = (0,) * streams
        self.chunks: defaultdict[tuple[str, int], list[tuple[int, int]]] = defaultdict(list)
        self.is_closed: bool = False
        self.in_parts: int = 0
        self.in_lock: int = -2  # without it, not even the end of an empty journal is known
        self.left_out: Counter[str] = Counter()
        self._places = [array("q") for _ in range(streams)]
        for number, log in enumerate(logs):
            for head in log.heads():
                if head.session == session and len(head.counts) == streams:
                    self._take(number, log, head)
                else:
                    self.left_out[f"records of another session in {log.name}"] += 1
        self.places: list[TableArray] = [_sort(places) for places in self._places]

    def _take(self, number: int, log: LogReader, head: Head) -> None:
        self.written = tuple(map(max, self.written, head.counts))
        self.is_closed |= head.kind == Kind.CLOSED
        count = head.number + 1
        if head.kind == Kind.WRITTEN:
            self.in_lock = count
        elif head.kind == Kind.CHUNKS and (payload := log.payload(head)) is not None:
            for key in {chunk[:2] for chunk in decode_chunks(payload)}:
                self.chunks[key].append((number, head.at))
        elif head.kind in (Kind.SAMPLE, Kind.STAMPS, Kind.ENTRY):
            if log.part and count <= self.in_parts:
                self.left_out[f"records twice or out of order in {log.name}"] += 1
            self._places[head.stream].extend((head.seq, head.kind, number, head.at))
        if log.part:
            self.in_parts = max(self.in_parts, count)


def _sort(places_of_stream: array[int]) -> TableArray:
    """Places by number, and of one number first that with all its bytes."""
    places = np.frombuffer(places_of_stream, _PLACE)
    return places[np.lexsort((places["kind"], places["seq"]))]
