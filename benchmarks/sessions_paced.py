"""Recording at a camera's own rate: what a sample waits for, what it costs, alone and beside other work.

Each recording lasts 20 s; the goal for the loaded one is five minutes: set FIELDKIT_BENCH_S to 300.
On a computer that is shared, the slowest appends are those during which it was not there at all: before each
recording a bare checksum of a frame, at the same rate, shows what is the computer's own.
"""

from __future__ import annotations

import multiprocessing
import os
import time
import zlib
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.result import Result, Row
from benchmarks.session_data import (
    LARGE,
    MEDIUM,
    Camera,
    camera,
    folder,
    frame,
    header,
    noisy_frames,
    write_session,
)
from benchmarks.sides import Steal, seconds
from fieldkit.model.clock import HostClock
from fieldkit.recorder.sample_queue import queue_limit
from fieldkit.sessions.writer import SessionWriter

SECONDS = float(os.environ.get("FIELDKIT_BENCH_S", "20"))
STORED = "until a frame is in the journal"
RECORDER = "journal and compressed chunks, all threads"
LARGE_SLOWEST = Row("append-large", "storing a 640x512 frame at 30 Hz, 99.9 %", "<= 10", "ms", STORED)
LARGE_DROPPED = Row("dropped-large", "frames dropped meanwhile, 640x512", "0", "frames")
LARGE_CPU = Row("cpu-large", "CPU of recording 640x512 at 30 Hz", "<= 35", "% of a core", RECORDER)
MEDIUM_SLOWEST = Row("append-medium", "storing a 256x192 frame at 25 Hz, 99.9 %", "<= 10", "ms", STORED)
MEDIUM_DROPPED = Row("dropped-medium", "frames dropped meanwhile, 256x192", "0", "frames")
MEDIUM_CPU = Row("cpu-medium", "CPU of recording 256x192 at 25 Hz", "<= 7", "% of a core", RECORDER)
LOADED = "beside two busy cores and a program that writes flat out"
LOADED_SLOWEST = Row(
    "append-loaded", "storing a 640x512 frame at 30 Hz, 99.9 %, loaded", "<= 250", "ms", LOADED
)
LOADED_DROPPED = Row("dropped-loaded", "frames dropped meanwhile, loaded", "0", "frames", LOADED)
BURST = Row("burst", "frames kept of a burst of 50 of 640x512", "50", "frames")


def run() -> list[Result]:
    large = (LARGE_SLOWEST, LARGE_DROPPED, LARGE_CPU)
    medium = (MEDIUM_SLOWEST, MEDIUM_DROPPED, MEDIUM_CPU)
    return [*_at_camera_rate(LARGE, large), *_at_camera_rate(MEDIUM, medium), *_beside_load(), _burst()]


def _record_paced(size: Camera, place: Path) -> tuple[list[float], float, int]:
    """Append at the camera's rate: milliseconds of each append, share of a core used, frames dropped.

    Dropped is a frame that would find the recorder's queue full, or that is missing from the sealed file.
    """
    info, clock = camera(*size), HostClock()
    ready, waits = noisy_frames(info.shape), []  # type: ignore[arg-type]
    writer = SessionWriter(place / "paced.h5", header(info), clock)
    missing = 0
    patience_s = queue_limit(info) / info.rate_hz
    began, cpu_began = time.monotonic(), time.process_time()
    for number, late_s in _turns(info.rate_hz):
        missing += late_s > patience_s
        sample = frame(info, ready[number % len(ready)], clock)
        waits.append(1000 * seconds(partial(writer.append, sample)))
    share = (time.process_time() - cpu_began) / (time.monotonic() - began)
    return waits, 100 * share, missing + len(waits) - writer.close().counts["camera"]


def _turns(rate_hz: float) -> Iterator[tuple[int, float]]:
    """At that rate: the number of each turn and by how many seconds it is late."""
    began = time.monotonic()
    for number in range(int(SECONDS * rate_hz)):
        yield number, time.monotonic() - began - number / rate_hz
        time.sleep(max(0.0, began + (number + 1) / rate_hz - time.monotonic()))


def _bare_checksums(size: Camera) -> list[float]:
    """Milliseconds of each checksum of a frame at the camera's rate, with nothing else going on."""
    checksum = partial(zlib.crc32, noisy_frames(size[0], 1).tobytes())
    return [1000 * seconds(checksum) for _ in _turns(size[1])]


def _at_camera_rate(size: Camera, rows: tuple[Row, Row, Row]) -> list[Result]:
    bare = float(np.quantile(_bare_checksums(size), 0.999))
    steal = Steal()
    with folder() as place:
        waits, share, missing = _record_paced(size, place)
    slowest, dropped, cpu = rows
    results = [
        slowest.result(
            float(np.quantile(waits, 0.999)), f"{len(waits)} frames; a bare checksum {bare:.1f} ms"
        ),
        dropped.result(missing),
        cpu.result(share),
    ]
    return [replace(result, steal=steal.share()) for result in results]


def _spin(until: float) -> None:
    while time.monotonic() < until:
        sum(range(1000))


def _write_flat_out(path: Path, until: float) -> None:
    block = os.urandom(4_000_000)
    with path.open("wb") as file:
        while time.monotonic() < until:
            file.write(block)
            if file.tell() > 2_000_000_000:
                file.seek(0)


def _beside_load() -> list[Result]:
    """Two busy cores and a process that writes flat out beside the largest camera."""
    until = time.monotonic() + SECONDS + 5
    with folder() as place:
        spawn = multiprocessing.get_context("spawn")
        others = [spawn.Process(target=_spin, args=(until,)) for _ in range(2)]
        others.append(spawn.Process(target=_write_flat_out, args=(place / "flat", until)))
        for other in others:
            other.start()
        waits, _, missing = _record_paced(LARGE, place)
        for other in others:
            other.join()
    return [
        LOADED_SLOWEST.result(float(np.quantile(waits, 0.999)), f"{len(waits)} frames"),
        LOADED_DROPPED.result(missing),
    ]


def _burst() -> Result:
    with folder() as place:
        summary = write_session(place / "burst.h5", LARGE, noisy_frames(LARGE[0], 50)).close()
    return BURST.result(summary.counts["camera"])
