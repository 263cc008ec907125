"""Declaring a session complete: every sample in the file compared with the journal first."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import chain, zip_longest
from pathlib import Path

import numpy as np

from fieldkit.disk import sync
from fieldkit.model.errors import IntegrityError
from fieldkit.model.samples import Quality
from fieldkit.sessions.guarded_file import write_in_place
from fieldkit.sessions.reader import SessionReader, open_session
from fieldkit.sessions.stream_reader import StreamReader

_THREADS, _BLOCK = 2, 1024


@dataclass(frozen=True, slots=True)
class SealReport:
    """Content of a sealed session: samples of each stream, all verified, and bytes of the file."""

    path: Path
    counts: dict[str, int]
    bytes: int


def seal(path: Path, expected: Mapping[str, Iterable[int]], state: int) -> SealReport:
    """Verify a closed session file and mark it complete with `state`.

    `expected` has the checksums of each stream's samples, in order, and is gone through once. Raises
    `IntegrityError` where the file does not have exactly these.
    """
    with open_session(path) as session:
        counts = {name: _verify(session, name, crc32s) for name, crc32s in expected.items()}
        digests = [session.object_digest(name) for name in session.sealed_objects()]
    write_in_place(path, {"integrity/object_sha256": digests})
    write_in_place(path, {"entry/complete": state})  # last, one byte: the session is complete or it is not
    sync(path.parent)
    return SealReport(path, counts, path.stat().st_size)


def remove_journal(folder: Path) -> None:
    """Delete a journal that is not needed any more; its lock goes last."""
    for path in sorted(folder.glob("*"), key=lambda path: path.name.endswith("lock")):
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)
    shutil.rmtree(folder, ignore_errors=True)
    sync(folder.parent)


def _verify(session: SessionReader, stream: str, expected: Iterable[int]) -> int:
    """Number of samples of a stream, all of which are as expected."""
    reader = session.stream(stream)
    stored = reader.column("crc32")
    if any(crc != other for crc, other in zip_longest(stored, expected)):  # a day has a million
        problem = f"the {len(stored)} samples of {stream} are not those of the journal"
        raise IntegrityError(problem, place=session.path)
    with ThreadPoolExecutor(_THREADS) as pool:  # one reads while the other computes checksums
        bad = list(chain.from_iterable(pool.map(partial(_bad, reader), range(0, len(reader), _BLOCK))))
    if bad:
        problem = f"{len(bad)} samples of {stream} do not match, first number {bad[0]}"
        raise IntegrityError(problem, place=session.path)
    return len(stored)


def _bad(reader: StreamReader, start: int) -> list[int]:
    """Numbers of the samples of a block that do not match their checksum."""
    bad = reader.flags(start, start + _BLOCK) & Quality.BAD_CRC
    return [start + int(place) for place in np.flatnonzero(bad)]
