"""A recording for `disk`: many small syncs, parts and flushes in a short time.

``python -m tests.harness.faulty_recorder record FOLDER`` records once; marks in FOLDER say
how many samples a completed sync has covered. ``... fail FOLDER ERRNO HOW N N N`` records once
for each N in a child process of its own, the N-th change of the disk failing, and prints what
came of it.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import shutil
import struct
import sys
import time
from pathlib import Path

from fieldkit.model.errors import FieldkitError, StorageError
from fieldkit.sessions import chunks, journal, session_file, writer
from fieldkit.sessions.journal import Journal
from fieldkit.sessions.writer import SessionWriter
from tests.harness.recording import CountedClock, header, sample

HEADER = header((24, 32))
FRAMES = 60
MARKS = "marks"


def hurry() -> None:
    """Everything that happens each second or each few hundred megabytes happens all the time."""
    journal.SYNC_EVERY_S = 0.02
    chunks.BEGIN_BYTES = journal.BEGIN_BYTES = 5_000
    writer.RESERVE_BYTES = 100_000
    session_file.FLUSH_EVERY_S = 0.01
    session_file.SYNC_EVERY_S = 0.05
    session_file.JOURNAL_BYTES = 40_000  # parts are deleted as soon as may be
    journal.PART_BYTES = 30_000


def mark_syncs(marks: int) -> None:
    """Write how many samples each sync has covered once it is over, whatever the journal itself notes."""
    confirm = Journal.confirm

    def marked(self: Journal, written: tuple[int, ...]) -> None:
        os.pwrite(marks, struct.pack("<q", sum(written[:-1])), 0)
        confirm(self, written)

    Journal.confirm = marked  # type: ignore[method-assign]


def record(path: Path, pause_s: float = 0.004) -> int:
    """Record `FRAMES` frames and a reading with each fifth; returns how many samples were stored."""
    session = SessionWriter(path, HEADER, CountedClock())
    stored = 0
    try:
        for seq in range(FRAMES):
            for info in HEADER.streams[:2] if seq % 5 == 0 else HEADER.streams[:1]:
                session.append(sample(info, seq if info.is_camera else seq // 5))
                stored += 1
            time.sleep(pause_s)  # syncs, flushes and samples take turns, as in a field
    except StorageError:
        with contextlib.suppress(StorageError):
            session.close()
        raise SystemExit(stored) from None
    session.close()
    return stored


def fail(folder: Path, error: int, how: int, chosen: list[int]) -> None:
    """One child for each chosen change; prints a JSON line of what it stored and how it ended."""
    for number in chosen:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        progress = folder.parent / "progress"
        progress.unlink(missing_ok=True)
        child = os.fork()
        if child == 0:
            _child(folder, progress, error, how, number)
        _, status = os.waitpid(child, 0)
        told = json.loads(progress.read_text()) if progress.exists() else {}
        print(json.dumps({"n": number, "status": status, **told}), flush=True)
        kept = folder.parent / f"kept-{number}"
        shutil.rmtree(kept, ignore_errors=True)
        shutil.move(folder, kept)


def _child(folder: Path, progress: Path, error: int, how: int, number: int) -> None:
    library = ctypes.CDLL(None)
    stored, outcome = 0, "sealed"
    library.faulty_arm(ctypes.c_long(number), ctypes.c_long(error), ctypes.c_long(how))
    try:
        stored = record(folder / "field.h5", pause_s=0.0005)
    except SystemExit as end:
        stored, outcome = int(str(end.code)), "stopped"
    except FieldkitError as failure:
        outcome = f"{type(failure).__name__} {failure.exit_code}"
        stored = FRAMES + FRAMES // 5 if "sealed" in failure.message else 0
    count = library.faulty_count()
    library.faulty_arm(ctypes.c_long(0), ctypes.c_long(0), ctypes.c_long(0))
    progress.write_text(json.dumps({"stored": stored, "outcome": outcome, "changes": count}))
    sys.exit(0)  # an ordinary end, with everything that libraries do at exit


def main() -> None:
    """See the module."""
    hurry()
    what, folder = sys.argv[1], Path(sys.argv[2])
    if what == "record":
        folder.mkdir(exist_ok=True)
        mark_syncs(os.open(folder / MARKS, os.O_RDWR | os.O_CREAT))
        print(record(folder / "field.h5"))
    else:
        fail(folder, int(sys.argv[3]), int(sys.argv[4]), [int(word) for word in sys.argv[5:]])


if __name__ == "__main__":
    main()
