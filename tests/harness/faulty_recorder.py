"""A recording for `disk`: many small syncs, parts and flushes in a short time.

``python -m tests.harness.faulty_recorder record FOLDER`` records once; marks in FOLDER say
how many samples a completed sync has covered. ``... fail FOLDER TASK ERRNO HOW MS N N N`` does a task once
for each N in a child process of its own, the disk failing from its N-th change on as `disk.c` describes,
and prints what came of it.
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
from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path

import numpy as np

from fieldkit import disk
from fieldkit.disk import replacing
from fieldkit.estimation.pixel_slopes import PixelBounds, SlopeMap
from fieldkit.model.errors import FieldkitError, StorageError
from fieldkit.model.samples import Event, EventKind
from fieldkit.results import map_file
from fieldkit.results.cache import Cache
from fieldkit.results.export import export
from fieldkit.sessions import guarded_file, journal, session_file, writer
from fieldkit.sessions.finished_file import add_later_events, apply_time_map
from fieldkit.sessions.journal import Journal
from fieldkit.sessions.recovery import recover
from fieldkit.sessions.time_map import TimeStep
from fieldkit.sessions.writer import SessionWriter
from tests.harness.recording import CountedClock, header, sample

HEADER = header((24, 32))
FRAMES = 60
MARKS = "marks"
LATER = "seen later"


def hurry() -> None:
    """Everything that happens each second or each few hundred megabytes happens all the time.

    Seconds of a failing disk are a tenth.
    """
    disk.PATIENCE_S, disk.RETRY_EVERY_S = disk.PATIENCE_S / 10, disk.RETRY_EVERY_S / 10
    journal.SYNC_EVERY_S = 0.02
    guarded_file.BEGIN_BYTES = 5_000
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


def append(session: SessionWriter, pause_s: float = 0.0) -> Iterator[int]:
    """Append `FRAMES` frames and a reading with each fifth, counting what was stored."""
    stored = 0
    for seq in range(FRAMES):
        for info in HEADER.streams[:2] if seq % 5 == 0 else HEADER.streams[:1]:
            session.append(sample(info, seq if info.is_camera else seq // 5))
            yield (stored := stored + 1)
        time.sleep(pause_s)  # syncs, flushes and samples take turns, as in a field


def record(path: Path, pause_s: float = 0.004) -> int:
    """Record and seal; returns how many samples were stored, which is the status if the disk stops that."""
    session = SessionWriter(path, HEADER, CountedClock())
    stored = 0
    try:
        for count in append(session, pause_s):
            stored = count
    except StorageError:
        with contextlib.suppress(StorageError):
            session.close()
        raise SystemExit(stored) from None
    session.close()
    return stored


class Task(StrEnum):
    """What is under way when the disk fails."""

    RECORD = "record"
    SEAL = "seal"
    RECOVER = "recover"
    MARK = "mark"
    CORRECT = "correct"
    ESTIMATE = "estimate"
    EXPORT = "export"
    MAP = "map"


def add_mark(path: Path) -> None:
    add_later_events(path, [Event(EventKind.MARK, 0, 0, LATER)])


def correct_times(path: Path) -> None:
    apply_time_map(path, [TimeStep(0, 10**9, LATER)])


def keep_estimates(path: Path) -> None:
    """Estimates made later are kept beside the session."""
    Cache(path.parent / "cache", checksums=["sealed"]).store(LATER, {"estimates": ESTIMATES})


def export_netcdf(path: Path) -> None:
    export(path, "netcdf", folder=path.parent / "exported")


def write_map(path: Path) -> None:
    numbers = [np.full((60, 80), number, np.float32) for number in range(4)]
    slopes = SlopeMap(*numbers, numbers[0].astype(np.uint8))
    site, regions = HEADER.site, HEADER.regions
    with replacing(path.with_name("map.nc"), synced=False) as draft:
        map_file.write_map(draft, slopes, PixelBounds(*numbers), (), regions, site, {"title": LATER})


WRITE = (add_mark, correct_times, keep_estimates, export_netcdf, write_map)
ADDITIONS = dict(zip(list(Task)[3:], WRITE, strict=True))
"""Additions to a sealed session, or beside it."""
ESTIMATES = np.arange(100_000)


def fail(folder: Path, task: Task, error: int, how: int, milliseconds: int, chosen: list[int]) -> None:
    """One child for each chosen change; prints a JSON line of what it stored and how it ended."""
    before = folder.with_name("before")
    before.mkdir()
    if task in ADDITIONS:
        record(before / "field.h5", pause_s=0.0)
    elif task is Task.RECOVER:
        _interrupt(before / "field.h5")
    for number in chosen:
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(before, folder)
        progress = folder.parent / "progress"
        progress.unlink(missing_ok=True)
        child = os.fork()
        if child == 0:
            _child(folder / "field.h5", task, progress, (number, error, how, milliseconds))
        _, status = os.waitpid(child, 0)
        outcome = json.loads(progress.read_text()) if progress.exists() else {}
        print(json.dumps({"n": number, "status": status, **outcome}), flush=True)
        remains = folder.parent / f"kept-{number}"
        shutil.rmtree(remains, ignore_errors=True)
        shutil.move(folder, remains)


def _interrupt(path: Path) -> None:
    session = SessionWriter(path, HEADER, CountedClock())
    list(append(session))
    session.abandon()


def _child(path: Path, task: Task, progress: Path, failure: tuple[int, ...]) -> None:
    library = ctypes.CDLL(None)
    outcome, session, stored = "whole", None, 0
    if task is Task.SEAL:
        session = SessionWriter(path, HEADER, CountedClock())
        stored = max(append(session))
    library.faulty_arm(*map(ctypes.c_long, failure))
    try:
        if session is not None:
            session.close()
        elif task is Task.RECORD:
            stored = record(path, pause_s=0.0005)
        elif task is Task.RECOVER:
            recover(path)
        else:
            ADDITIONS[task](path)
    except SystemExit as end:
        stored, outcome = int(str(end.code)), "stopped"
    except FieldkitError as problem:
        outcome = f"{type(problem).__name__} {problem.exit_code}"
        stored = FRAMES + FRAMES // 5 if "sealed" in problem.message else stored
    except OSError as problem:  # which the command line puts into words
        outcome = type(problem).__name__
    count = library.faulty_count()
    library.faulty_arm(*map(ctypes.c_long, (0, 0, 0, 0)))
    progress.write_text(json.dumps({"stored": stored, "outcome": outcome, "changes": count}))
    sys.exit(0)  # an ordinary end, with everything that libraries do at exit


def main() -> None:
    """See the module."""
    hurry()
    if sys.argv[1] == "record":
        folder = Path(sys.argv[2])
        folder.mkdir(exist_ok=True)
        mark_syncs(os.open(folder / MARKS, os.O_RDWR | os.O_CREAT))
        print(record(folder / "field.h5"))
    else:
        error, how, milliseconds, *chosen = map(int, sys.argv[4:])
        fail(Path(sys.argv[2]), Task(sys.argv[3]), error, how, milliseconds, chosen)


if __name__ == "__main__":
    main()
