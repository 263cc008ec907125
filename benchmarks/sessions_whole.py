"""Whole recordings as fast as possible, from the first append to sealed and synced, against other formats.

Ours writes every frame to the journal and to the file, and compares each with its checksum before it is
sealed; the others write a file. Each side works in every round.
"""

from __future__ import annotations

import importlib.util
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.result import Result, Row
from benchmarks.session_data import (
    LARGE,
    MEDIUM,
    Camera,
    folder,
    noisy_frames,
    write_mcap,
    write_naively,
    write_session,
)
from benchmarks.sides import Steal, in_rounds, times_as_fast
from fieldkit.model.arrays import CountArray

FRAMES, ROUNDS = 600, 5
NAIVE_LARGE_FRAMES = 60  # more would take minutes, and each takes as long as the one before
WHOLE = "append to sealed and synced: journal, compression, verification; unpaced"
NAIVE = f"{WHOLE}; theirs: one resizable dataset, shuffle and gzip 1, flushed each second, synced"
THEIR_MCAP = f"{WHOLE}; theirs: chunks of 1 MB, synced; no verification"

LARGE_CPU = Row("large-cpu", "whole recording, 640x512: CPU of a frame", "<= 10", "ms", WHOLE)
LARGE_NAIVE = Row(
    "large-naive", "whole recording over h5py as one writes it first, 640x512", ">= 40", included=NAIVE
)
LARGE_ZSTD = Row("large-zstd", "whole recording over MCAP with zstd, 640x512", ">= 0.8", included=THEIR_MCAP)
LARGE_PLAIN = Row("large-plain", "whole recording over MCAP uncompressed, 640x512", "", included=THEIR_MCAP)
LARGE_SIZE = Row(
    "large-size", "size of the session over that of MCAP with zstd, 640x512", "<= 1", included="whole files"
)
MEDIUM_NAIVE = Row(
    "medium-naive", "whole recording over h5py as one writes it first, 256x192", ">= 1.5", included=NAIVE
)


@dataclass(frozen=True, slots=True)
class Cost:
    """Cost of one frame of a recording: seconds, seconds of the processor, bytes of the file."""

    wall_s: float
    cpu_s: float
    file_bytes: float


def run() -> list[Result]:
    """The large camera takes about two minutes, the other half of one."""
    steal = Steal()
    large, medium = _costs(LARGE, NAIVE_LARGE_FRAMES), _costs(MEDIUM, FRAMES)
    results = [_cpu(LARGE_CPU, large), _over(LARGE_NAIVE, large, "h5py")]
    results += [_over(MEDIUM_NAIVE, medium, "h5py")]
    if "ZSTD" in large:
        results += [_over(LARGE_ZSTD, large, "ZSTD"), _over(LARGE_PLAIN, large, "NONE")]
        results += [_size(LARGE_SIZE, large)]
    return [replace(result, steal=steal.share()) for result in results]


def _costs(size: Camera, naive_frames: int) -> dict[str, list[Cost]]:
    """Costs of every side, round by round."""
    few = noisy_frames(size[0])
    many = np.tile(few, (FRAMES // len(few), 1, 1))
    sides = {
        "ours": partial(_cost, partial(_session, size), many),
        "h5py": partial(_cost, partial(write_naively, flush_every=round(size[1])), many[:naive_frames]),
    }
    if importlib.util.find_spec("mcap"):
        sides |= {
            name: partial(_cost, partial(write_mcap, compression=name), many) for name in ("ZSTD", "NONE")
        }
    return in_rounds(sides, ROUNDS)


def _cost(write: Callable[[Path, CountArray], None], data: CountArray) -> Cost:
    with folder() as place:
        began, cpu_began = time.perf_counter(), time.process_time()
        write(place / "recording", data)
        wall_s, cpu_s = time.perf_counter() - began, time.process_time() - cpu_began
        file_bytes = (place / "recording").stat().st_size
    return Cost(wall_s / len(data), cpu_s / len(data), file_bytes / len(data))


def _cpu(row: Row, costs: dict[str, list[Cost]]) -> Result:
    return row.result(1e3 * statistics.median(cost.cpu_s for cost in costs["ours"]), f"{ROUNDS} rounds")


def _over(row: Row, costs: dict[str, list[Cost]], other: str) -> Result:
    """By the clock; by the processor, which a busy machine disturbs less, in the note."""
    pairs = list(zip(costs["ours"], costs[other], strict=True))
    cpu = statistics.median(theirs.cpu_s / ours.cpu_s for ours, theirs in pairs)
    return times_as_fast(
        row, [(ours.wall_s, theirs.wall_s) for ours, theirs in pairs], f"{cpu:.3g} x of the CPU"
    )


def _size(row: Row, costs: dict[str, list[Cost]]) -> Result:
    return row.result(costs["ours"][0].file_bytes / costs["ZSTD"][0].file_bytes)


def _session(size: Camera, path: Path, data: CountArray) -> None:
    write_session(path, size, data).close()
