"""Reading sessions: curves of regions, following a recording, recovery; against one-frame chunks."""

from __future__ import annotations

import json
import multiprocessing
import os
import time
from pathlib import Path

import h5py
import numpy as np

from benchmarks.result import Result, Row
from benchmarks.session_data import MEDIUM, SMALL, camera, folder, frame, header, noisy_frames
from benchmarks.sides import times_as_fast
from fieldkit.model.clock import HostClock
from fieldkit.model.device import StreamInfo
from fieldkit.model.site import Region, RegionKind
from fieldkit.sessions.analysis import region_series
from fieldkit.sessions.lock import is_locked, journal_path
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.recovery import recover
from fieldkit.sessions.writer import SessionWriter

SERIES_FRAMES, THREE_HOURS = 6000, 3 * 3600
RECOVERY_FRAMES = 9000
FOLLOWED_S = 20.0
SCALED = "scaled from a shorter one"
SERIES = Row(
    "series", "series of a 20x20 region over 3 h of 256x192 at 25 Hz", "<= 20", "s", f"cold cache; {SCALED}"
)
OVER_FRAMES = Row("series-chunks", "the same, one-frame chunks over ours", ">= 4", included="cold cache")
AGE = Row("age", "a second process sees a frame after, median", "<= 1.1", "s", "256x192 at 25 Hz")
AGE_WORST = Row("age-worst", "a second process sees a frame after, worst", "<= 2", "s", "256x192 at 25 Hz")
FOLLOWER_CPU = Row("follower-cpu", "CPU of that process", "<= 2", "% of a core", "ten looks a second")
RECOVERY = Row("recovery", "recovery of 3 h of 160x120 at 9 Hz", "<= 60", "s", SCALED)


def run() -> list[Result]:
    return [*_series(), *_live(), _recovery()]


def _forget(path: Path) -> None:
    """Have the kernel drop the file from its cache."""
    descriptor = os.open(path, os.O_RDONLY)
    os.fsync(descriptor)
    os.posix_fadvise(descriptor, 0, 0, os.POSIX_FADV_DONTNEED)
    os.close(descriptor)


def _record(path: Path, info: StreamInfo, count: int) -> SessionWriter:
    clock, writer = HostClock(), SessionWriter(path, header(info), HostClock())
    ready = noisy_frames((info.shape[0], info.shape[1]))
    for number in range(count):
        writer.append(frame(info, ready[number % len(ready)], clock))
        while writer._file_thread.is_behind():
            time.sleep(0.01)
    return writer


def _series() -> list[Result]:
    """A 20x20 region over all frames, files dropped from the cache before; scaled to three hours."""
    info = camera(*MEDIUM)
    corners = ((100.0, 80.0), (119.0, 80.0), (119.0, 99.0), (100.0, 99.0))
    region = Region("bed", RegionKind.TARGET, corners)
    with folder() as place:
        ours, theirs = place / "ours.h5", place / "theirs.h5"
        _record(ours, info, SERIES_FRAMES).close()
        with open_session(ours) as session, h5py.File(theirs, "w") as file:
            file.create_dataset(
                "frames", data=session.raw("camera")[:], chunks=(1, *info.shape), shuffle=True,
                compression="gzip", compression_opts=1,
            )  # fmt: skip
        for path in (ours, theirs):
            _forget(path)
        began = time.perf_counter()
        with open_session(ours) as session:
            mine = region_series(session, [region]).mean_k[:, 0]
        middle = time.perf_counter()
        with h5py.File(theirs) as file:
            one_by_one = [file["frames"][n, 80:100, 100:120].mean() * 0.01 for n in range(SERIES_FRAMES)]
        our_s, their_s = middle - began, time.perf_counter() - middle
    assert np.allclose(mine, one_by_one)
    scale = THREE_HOURS * info.rate_hz / SERIES_FRAMES
    return [SERIES.result(our_s * scale), times_as_fast(OVER_FRAMES, [(our_s, their_s)])]


def _follow(path: Path, ages_file: Path) -> None:
    """Look ten times a second and note how old each frame is when first seen."""
    ages, first, cpu_began, began = [], 0, time.process_time(), time.monotonic()
    with open_session(path) as session:
        while is_locked(journal_path(path)):
            time.sleep(0.1)
            session.stream("camera").refresh()
            count = session.count("camera")
            stamps = session.stream("camera").column("mono_ns", first, count)
            ages += ((time.monotonic_ns() - stamps) / 1e9).tolist()
            first = count
    share = (time.process_time() - cpu_began) / (time.monotonic() - began)
    ages_file.write_text(json.dumps({"ages": ages, "share": share}))


def _live() -> list[Result]:
    info, clock = camera(*MEDIUM), HostClock()
    ready = noisy_frames(MEDIUM[0])
    with folder() as place:
        path, ages_file = place / "live.h5", place / "ages.json"
        writer = SessionWriter(path, header(info), clock)
        reader = multiprocessing.get_context("spawn").Process(target=_follow, args=(path, ages_file))
        reader.start()
        began = time.monotonic()
        for number in range(int(FOLLOWED_S * info.rate_hz)):
            writer.append(frame(info, ready[number % len(ready)], clock))
            time.sleep(max(0.0, began + number / info.rate_hz - time.monotonic()))
        writer.abandon()
        reader.join()
        follower = json.loads(ages_file.read_text())
    ages = np.array(follower["ages"][int(5 * info.rate_hz) :])  # after the reader has got going
    return [
        AGE.result(float(np.median(ages))),
        AGE_WORST.result(float(ages.max())),
        FOLLOWER_CPU.result(100 * follower["share"]),
    ]


def _record_until_killed(path: Path, info: StreamInfo) -> None:
    """A recording that ended without being sealed; its file is as far as one in its own time would be."""
    writer = _record(path, info, RECOVERY_FRAMES)
    while writer._file_thread._next_id < RECOVERY_FRAMES:
        time.sleep(0.01)
    writer.abandon()


def _recovery() -> Result:
    info = camera(*SMALL)
    with folder() as place:
        path = place / "killed.h5"
        _record_until_killed(path, info)
        began = time.perf_counter()
        assert recover(path).counts["camera"] == RECOVERY_FRAMES
        took_s = time.perf_counter() - began
    return RECOVERY.result(took_s * THREE_HOURS * info.rate_hz / RECOVERY_FRAMES)
