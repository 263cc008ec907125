"""How many records of a journal the disk has confirmed, in a small file beside its databases.

A log that has lost its end looks like a shorter log; only a count kept elsewhere says that something is
missing. It is written in place after each sync of the log, so it is never ahead of what was stored. It is not
synced itself: after a power cut it may be behind, and then the log is all there is to go by.
"""

from __future__ import annotations

import os
import struct
import zlib
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

NAME = "written"


@dataclass(frozen=True, slots=True)
class Written:
    """How many records a journal was given, and how many of them were samples of each stream."""

    records: int
    samples: tuple[int, ...]

    @property
    def entries(self) -> int:
        """How many were not samples."""
        return self.records - sum(self.samples)


def note_written(folder: Path, written: Written) -> None:
    """Replace the count; raises `OSError`."""
    numbers = struct.pack(f"<{1 + len(written.samples)}q", written.records, *written.samples)
    descriptor = os.open(folder / NAME, os.O_WRONLY | os.O_CREAT, 0o644)
    try:
        os.pwrite(descriptor, numbers + zlib.crc32(numbers).to_bytes(4, "little"), 0)
    finally:
        os.close(descriptor)


def read_written(folder: Path, streams: int) -> Written:
    """What was counted; zeros where that is not known: an older journal, or a damaged count."""
    size = 8 * (1 + streams)
    with suppress(OSError):
        data = (folder / NAME).read_bytes()
        if len(data) == size + 4 and zlib.crc32(data[:size]).to_bytes(4, "little") == data[size:]:
            records, *samples = struct.unpack(f"<{1 + streams}q", data[:size])
            return Written(records, tuple(samples))
    return Written(0, (0,) * streams)
