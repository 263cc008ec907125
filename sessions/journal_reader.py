"""Reading a journal, also while it is written, after a kill, and whatever became of its bytes.

Every file is scanned for records; a sample is returned only if record and sample match their checksums. Since
each record says how many there were before it, what is missing is known up to the last one that survives.
"""

from __future__ import annotations

import contextlib
from array import array
from collections import defaultdict
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path

import numpy as np

from fieldkit.model.arrays import IntArray, TableArray
from fieldkit.model.errors import FormatError, SessionError
from fieldkit.sessions.journal import Chunk, SessionIdentity, decode_chunks
from fieldkit.sessions.log import Head, Kind, LogReader, session_number
from fieldkit.sessions.records import Entry, SampleRow, decode_entry

_PLACE = np.dtype([("seq", "<i8"), ("kind", "<i8"), ("log", "<i8"), ("at", "<i8")])


class JournalReader:
    """The records of a journal; a context manager.

    `damage` names what was found to be damaged by what was read so far. Raises `FormatError` for a
    journal of another version, `SessionError` where the folder holds no readable one.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._logs = list(_open_logs(folder))
        self._unreadable: list[str] = []
        self.identity: SessionIdentity = self._identity()
        self._session = session_number(self.identity.session_id)
        self._entries = len(self.identity.header.streams)

    def __enter__(self) -> JournalReader:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the files."""
        for log in self._logs:
            log.close()

    @property
    def damage(self) -> list[str]:
        """In words, what of the journal cannot be read."""
        missing = {"kept.log", "confirmed.log"} - {log.name for log in self._logs}
        gone = [f"{name} is gone" for name in sorted(missing)]
        return [*gone, *(line for log in self._logs for line in log.damage), *self._unreadable]

    @property
    def written(self) -> tuple[int, ...]:
        """Number of samples of each stream and, last, of other records written, as far as that is known."""
        return self._index.written

    @property
    def has_end(self) -> bool:
        """True if the last record there ever was is known: nothing unreadable stands behind it."""
        return self._index.has_end

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
        parts = [log for log in self._logs if log.name[0].isdigit()]
        # the first record of a part, its identity, counts those of the parts before
        starts = [next((head.number + 1 for head in log.heads()), 0) for log in parts]
        ends = [*starts[1:], before]
        for log, end in zip(parts, ends, strict=True):
            for head in log.heads() if end > number else ():
                is_wanted = head.kind in (Kind.SAMPLE, Kind.ENTRY) and number <= head.number < before
                if is_wanted and (payload := self._payload(log, head)) is not None:
                    is_entry = head.kind == Kind.ENTRY
                    yield _entry(payload) if is_entry else SampleRow.decode(head.stream, head.seq, payload)

    def _identity(self) -> SessionIdentity:
        for head, payload in self._identities():
            try:
                identity = SessionIdentity.from_json(payload, self.folder)
            except FormatError:
                self.close()
                raise
            except (SessionError, ValueError, TypeError) as error:
                self._unreadable.append(str(error))
                continue
            if session_number(identity.session_id) == head.session:
                return identity
        damage = "; ".join(self._unreadable) or "nothing in it can be read"
        self.close()
        raise SessionError(f"holds no readable journal: {damage}", place=self.folder)

    def _identities(self) -> Iterator[tuple[Head, bytes]]:
        for log in self._logs:
            for head in log.heads():
                if head.kind == Kind.IDENTITY and (payload := log.payload(head)) is not None:
                    yield head, payload

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
        payload = log.payload(head)
        if payload is None:
            self._unreadable.append(f"{log.name}: the record at byte {head.at} is damaged")
        return payload

    def _payload_at(self, log: int, at: int) -> bytes | None:
        head = self._logs[log].head_at(at)
        return None if head is None else self._payload(self._logs[log], head)

    @cached_property
    def _index(self) -> _Index:
        return _Index(self._logs, self._session, self._entries + 1)


def _open_logs(folder: Path) -> Iterator[LogReader]:
    for path in sorted(folder.glob("*.log")):
        with contextlib.suppress(FileNotFoundError):  # a part that has just been retired
            yield LogReader(path)


def _entry(payload: bytes) -> Entry:
    kind, _, body = payload.decode(errors="replace").partition("\n")
    return decode_entry(kind, body)


class _Index:
    """Places of the records of a session in some logs, by stream and number, and their counts."""

    def __init__(self, logs: list[LogReader], session: int, streams: int) -> None:
        self.written: tuple[int, ...] = (0,) * streams
        self.chunks: defaultdict[tuple[str, int], list[tuple[int, int]]] = defaultdict(list)
        self._found = [array("q") for _ in range(streams)]
        self._in_parts = 0
        for number, log in enumerate(logs):
            for head in log.heads():
                if head.session == session and len(head.counts) == streams:
                    self._take(number, log, head)
        self.places: list[TableArray] = [_sort(found) for found in self._found]
        # another log that counts more than the parts have shows that they lost their end
        parts = [log for log in logs if log.name[0].isdigit()]
        self.has_end: bool = bool(parts) and parts[-1].is_whole and self._in_parts == sum(self.written)

    def _take(self, number: int, log: LogReader, head: Head) -> None:
        self.written = tuple(map(max, self.written, head.counts))
        if log.name[0].isdigit():
            self._in_parts = max(self._in_parts, sum(head.counts))
        if head.kind == Kind.CHUNKS and (payload := log.payload(head)) is not None:
            for key in {chunk[:2] for chunk in decode_chunks(payload)}:
                self.chunks[key].append((number, head.at))
        elif head.kind in (Kind.SAMPLE, Kind.STAMPS, Kind.ENTRY):
            self._found[head.stream].extend((head.seq, head.kind, number, head.at))


def _sort(found: array[int]) -> TableArray:
    """Places by number, and of one number first that with all its bytes."""
    places = np.frombuffer(found, _PLACE)
    return places[np.lexsort((places["kind"], places["seq"]))]
