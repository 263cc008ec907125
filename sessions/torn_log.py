"""Rows of a journal that SQLite does not reach: behind a tear of its write-ahead log, or in a damaged file.

SQLite reads its log up to the first frame that is not whole, because what follows could be half a
transaction. In the journal every record is a transaction of its own and is never changed or deleted, so the
frames behind a tear are as good as those before it. Here pages are read without the tree that leads to them:
every leaf whose frame matches its checksum gives its rows. Formats: "Database File Format",
sqlite.org/fileformat2.html, sections 1.6 (b-tree pages), 2.1 (records), 4.1 to 4.3 (the log, its checksum).
"""

from __future__ import annotations

import contextlib
import sqlite3
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldkit.sessions.journal import TABLES, open_part, wal_of

_HEADER_BYTES, _LEAF = 32, 0x0D
_BIG_ENDIAN, _LITTLE_ENDIAN = 0x377F0683, 0x377F0682
_BATCH = 64
_INTEGER_BYTES = {1: 1, 2: 2, 3: 3, 4: 4, 5: 6, 6: 8}
_TABLE_OF = {5: "session", 12: "sample", 3: "entry"}
"""Tables whose rows lie in leaves of their own kind, by their number of columns; rows of `chunk` do not."""

Row = tuple[str, list[Any]]


def salvaged_part(path: Path) -> tuple[sqlite3.Connection, int | None]:
    """A database of the journal with all rows that can be read, and how many SQLite did not reach.

    None where SQLite reaches every row: then it is the database itself, otherwise a copy.
    """
    part = _open_readable(path)
    if part is not None and _reaches_every_frame(path):
        return part, None
    pages = _Pages(path)
    if part is not None and not pages.is_torn:
        return part, None
    if part is not None:
        part.close()
    copy = sqlite3.connect("", isolation_level=None)  # on disk, and gone with the connection
    copy.executescript(TABLES + "BEGIN;")
    _copy_reached(path, copy)
    return copy, _add_unreached(copy, pages)


def _open_readable(path: Path) -> sqlite3.Connection | None:
    """The database opened, None where SQLite cannot read all of it."""
    if _is_empty(path):
        return None
    part = open_part(path)  # stays open: SQLite verifies the whole log again each time it is opened
    try:
        for table in ("session", "sample", "entry"):
            part.execute(f"SELECT count(*) FROM {table}").fetchone()  # goes through every leaf
    except (sqlite3.Error, UnicodeDecodeError):
        part.close()
        return None
    return part


def _reaches_every_frame(path: Path) -> bool:
    """Whether SQLite found every frame of the log whole: it counts them in the index it makes on opening.

    Only while the database is open. Format: sqlite.org/walformat.html, section 2.1.
    """
    log = _bytes_of(wal_of(path))
    frames = len(_frames(log, int.from_bytes(log[8:12].tobytes(), "big")))
    in_index = int.from_bytes(_bytes_of(path.with_name(path.name + "-shm"))[16:20].tobytes(), sys.byteorder)
    return len(log) == 0 or frames == in_index > 0


def _copy_reached(path: Path, copy: sqlite3.Connection) -> None:
    """Every row up to the first that SQLite cannot read."""
    if _is_empty(path):
        return
    with contextlib.closing(open_part(path)) as part:
        for table in ("session", "sample", "entry", "chunk"):
            with contextlib.suppress(sqlite3.Error, UnicodeDecodeError, OverflowError):
                for row in part.execute(f"SELECT * FROM {table}"):
                    _insert(copy, table, row)


def _is_empty(path: Path) -> bool:
    """Whether a database has lost all its bytes: SQLite would delete its log on opening it."""
    return not path.stat().st_size


def _add_unreached(copy: sqlite3.Connection, pages: _Pages) -> int:
    """Add rows found in pages; what is known already by its number is left as it is."""
    known = {number for table in ("sample", "entry") for (number,) in copy.execute(f"SELECT id FROM {table}")}
    has_identity = copy.execute("SELECT count(*) FROM session").fetchone()[0] > 0
    before = len(known)
    for table, row in pages.rows(known):
        if table == "session":
            if not has_identity:
                _insert(copy, table, row)
                has_identity = True
        elif _insert(copy, table, row):
            known.add(row[0])
    copy.execute("COMMIT")
    return len(known) - before


def _insert(copy: sqlite3.Connection, table: str, row: Any) -> bool:
    places = ", ".join("?" * len(row))
    try:
        copy.execute(f"INSERT OR IGNORE INTO {table} VALUES ({places})", row)
    except (sqlite3.Error, OverflowError):
        return False
    return True


class _Pages:
    """The pages of a database and its log, by what they hold."""

    def __init__(self, path: Path) -> None:
        self._database = _bytes_of(path)
        log = _bytes_of(wal_of(path))
        self._header = log[:_HEADER_BYTES]
        self.page_size = self._page_size()
        self._frames = _frames(log, self.page_size)
        self._sound, self.is_torn = self._verified()
        self._latest = self._latest_frames()
        self._bytes = len(self._database) + len(log)

    def _page_size(self) -> int:
        """From the header of the log, or of the database (another page); 4096 where neither has it."""
        in_log = int.from_bytes(self._header[8:12].tobytes(), "big")
        in_database = int.from_bytes(self._database[16:18].tobytes(), "big")
        for size in (in_log, 65536 if in_database == 1 else in_database):
            if 512 <= size <= 65536 and size & (size - 1) == 0:
                return size
        return 4096

    def _verified(self) -> tuple[NDArray[np.bool_], bool]:
        """Which frames match the checksum that follows from the one before; whether SQLite stops early."""
        magic = int.from_bytes(self._header[:4].tobytes(), "big")
        order = {_BIG_ENDIAN: ">", _LITTLE_ENDIAN: "<"}.get(magic, "<" if sys.byteorder == "little" else ">")
        if not len(self._frames):
            return np.empty(0, bool), False
        stored = self._frames["checksum"].astype(np.uint32)
        first = np.frombuffer(self._header[24:32].tobytes(), ">u4").astype(np.uint32)
        seeds = np.concatenate([first[None], stored[:-1]])
        sound = np.all(_checksums(self._frames, seeds, order) == stored, axis=1)
        return sound, self._stops_early(sound, order)

    def _stops_early(self, sound: NDArray[np.bool_], order: str) -> bool:
        """Whether a frame of this generation of the log is not as SQLite wants it.

        After a checkpoint the log begins again from the front, with new salts; frames of the generation
        before stand behind its end.
        """
        head = np.frombuffer(self._header[:24].tobytes(), f"{order}u4").astype(np.uint32)
        own = np.frombuffer(self._header[24:32].tobytes(), ">u4").astype(np.uint32)
        salts = np.frombuffer(self._header[16:24].tobytes(), ">u4")
        ours = np.all(self._frames["salt"] == salts, axis=1)
        has_begun_again = any(self._header[12:16])
        end = int(np.flatnonzero(ours)[-1]) + 1 if has_begun_again and ours.any() else len(ours)
        is_whole = np.array_equal(_folded([head[None]], np.zeros((1, 2), np.uint32))[0], own)
        return not (is_whole and bool((sound & ours)[:end].all()))

    def _latest_frames(self) -> dict[int, int]:
        """Of each page the last frame that is sound, or else the last one."""
        numbers = self._frames["page"].tolist()
        latest = {page: n for n, page in enumerate(numbers)}
        return latest | {page: n for n, page in enumerate(numbers) if self._sound[n]}

    def rows(self, known: set[int]) -> Iterator[Row]:
        """Rows whose number is not known, first from the log, then from the database itself."""
        for n in np.flatnonzero(self._sound & (self._frames["content"][:, 0] == _LEAF)):
            yield from self._rows_of(self._frames["content"][n].tobytes(), known)
        for start in range(self.page_size, len(self._database) - self.page_size + 1, self.page_size):
            if self._database[start] == _LEAF:
                yield from self._rows_of(self._database[start : start + self.page_size].tobytes(), known)

    def _rows_of(self, page: bytes, known: set[int]) -> Iterator[Row]:
        """The rows of one leaf that can be taken apart."""
        for place in range(int.from_bytes(page[3:5], "big")):
            with contextlib.suppress(IndexError, ValueError, UnicodeDecodeError):
                at = int.from_bytes(page[8 + 2 * place : 10 + 2 * place], "big")
                size, at = _varint(page, at)
                number, at = _varint(page, at)
                if number not in known:
                    values = _record(self._payload(page, at, size))
                    if table := _TABLE_OF.get(len(values)):
                        yield table, values if table == "session" else [number, *values[1:]]

    def _payload(self, page: bytes, at: int, size: int) -> bytes:
        """The bytes of a row, what did not fit into its leaf collected from the pages that follow."""
        if size > self._bytes:
            raise ValueError(f"a row of {size} bytes cannot be in here")
        here = _local_bytes(size, self.page_size)
        parts, left = [page[at : at + here]], size - here
        following = int.from_bytes(page[at + here : at + here + 4], "big") if left else 0
        while left > 0:
            content = self._page(following)
            following = int.from_bytes(content[:4], "big")
            parts.append(content[4 : 4 + left])
            left -= self.page_size - 4
        return b"".join(parts)

    def _page(self, number: int) -> bytes:
        if (frame := self._latest.get(number)) is not None:
            return bytes(self._frames["content"][frame].tobytes())
        content = self._database[(number - 1) * self.page_size : number * self.page_size].tobytes()
        if number < 1 or len(content) < self.page_size:
            raise ValueError(f"page {number} is gone")
        return bytes(content)


def _bytes_of(path: Path) -> NDArray[np.uint8]:
    """A file as bytes, read lazily; empty without a file."""
    try:
        return np.memmap(path, np.uint8, "r") if path.stat().st_size else np.empty(0, np.uint8)
    except OSError:
        return np.empty(0, np.uint8)


def _frames(log: NDArray[np.uint8], page_size: int) -> NDArray[Any]:
    """The whole frames of a log."""
    head = [("page", ">u4"), ("commit", ">u4"), ("salt", ">u4", 2), ("checksum", ">u4", 2)]
    kind = np.dtype([*head, ("content", "u1", page_size)])
    count = max(0, len(log) - _HEADER_BYTES) // kind.itemsize
    return log[_HEADER_BYTES : _HEADER_BYTES + count * kind.itemsize].view(kind)


def _checksums(frames: NDArray[Any], seeds: NDArray[np.uint32], order: str) -> NDArray[np.uint32]:
    """The checksum of each frame that continues from its seed: over page, commit and content."""
    sums = np.empty_like(seeds)
    for n in range(0, len(frames), _BATCH):  # a batch stays in the processor's cache
        batch = frames[n : n + _BATCH]
        head = batch.view(np.uint8).reshape(len(batch), -1)[:, :8]
        words = [part.view(f"{order}u4") for part in (head, batch["content"])]
        sums[n : n + _BATCH] = _folded(words, seeds[n : n + _BATCH])
    return sums


def _folded(parts: list[NDArray[np.uint32]], seeds: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """SQLite's checksum of rows of words, given in parts: ``s0 += x0 + s1; s1 += x1 + s0`` for every two.

    That is linear, so it is one product with what each word counts in the end.
    """
    weights, start = _weights(sum(part.shape[1] for part in parts))
    sums, at = seeds @ start, 0
    for part in parts:
        counted = weights[:, at : at + part.shape[1]]
        # row by row of the weights: both lie in one piece in memory, which einsum multiplies fastest
        sums += np.stack([np.einsum("ij,j->i", part, row) for row in counted], axis=1)
        at += part.shape[1]
    return sums


@cache
def _weights(count: int) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
    """What each of so many words (2, count), and the two of the seed, add to the checksum, modulo 2^32."""
    mask = 0xFFFFFFFF
    weights = np.zeros((2, count), np.uint32)
    # what s0 and s1 add to the result when so many pairs still follow
    s0, s1 = (1, 0), (0, 1)
    for n in range(count - 2, -1, -2):
        both = (s0[0] + s1[0]) & mask, (s0[1] + s1[1]) & mask
        weights[:, n], weights[:, n + 1] = both, s1
        s0, s1 = both, ((both[0] + s1[0]) & mask, (both[1] + s1[1]) & mask)
    return weights, np.array([s0, s1], np.uint32)


def _local_bytes(size: int, page_size: int) -> int:
    """How much of a row's payload lies in its leaf."""
    most, least = page_size - 35, (page_size - 12) * 32 // 255 - 23
    if size <= most:
        return size
    here = least + (size - least) % (page_size - 4)
    return here if here <= most else least


def _varint(data: bytes, at: int) -> tuple[int, int]:
    """A number of 1 to 9 bytes, and where it ends."""
    value = 0
    for n in range(8):
        byte = data[at + n]
        value = value << 7 | byte & 0x7F
        if byte < 0x80:
            return value, at + n + 1
    return value << 8 | data[at + 8], at + 9


def _record(payload: bytes) -> list[Any]:
    """The values of a row; raises `ValueError` or `IndexError` where the bytes are none."""
    end, at = _varint(payload, 0)
    kinds = []
    while at < end:
        kind, at = _varint(payload, at)
        kinds.append(kind)
    values = []
    for kind in kinds:
        value, at = _value(payload, at, kind)
        values.append(value)
    if at != len(payload):
        raise ValueError("not a row")
    return values


def _value(payload: bytes, at: int, kind: int) -> tuple[Any, int]:
    if kind >= 12:
        size = (kind - 12) // 2
        data = payload[at : at + size]
        return (data.decode() if kind % 2 else data), at + size
    if kind == 7:
        return float(np.frombuffer(payload[at : at + 8], ">f8")[0]), at + 8
    if kind in _INTEGER_BYTES:
        size = _INTEGER_BYTES[kind]
        return int.from_bytes(payload[at : at + size], "big", signed=True), at + size
    return {0: None, 8: 0, 9: 1}.get(kind), at
