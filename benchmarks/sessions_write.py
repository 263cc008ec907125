"""Writing sessions as fast as possible: what the disk sees, against what a user would write.

Ratios are taken in one run on one machine. MCAP and zarr are measured where they are
installed; uncompressed means our path with compression taken out of it.
"""

from __future__ import annotations

import importlib.util
import os
from collections import defaultdict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import h5py
import numpy as np

from benchmarks.result import Result, Row
from benchmarks.session_data import (
    LARGE,
    MEDIUM,
    SMALL,
    camera,
    folder,
    frame,
    header,
    noisy_frames,
    write_mcap,
    write_session,
)
from benchmarks.sides import in_rounds, seconds, share
from fieldkit.disk import sync
from fieldkit.model.arrays import CountArray
from fieldkit.model.clock import HostClock
from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import Reading
from fieldkit.sessions import chunks, file_tree
from fieldkit.sessions.chunks import FrameWriter
from fieldkit.sessions.file_tree import LIBVER
from fieldkit.sessions.layout import chunk_shape
from fieldkit.sessions.lock import journal_path
from fieldkit.sessions.writer import SessionWriter

RAW_FRAMES = 600
ROUNDS = 7
SYNCED = "640x512, uncompressed, synced"
CHUNKS = Row("chunks", "chunks alone over `os.write`", ">= 0.5", included=SYNCED)
BOTH = Row("journal-and-chunks", "journal and chunks over `os.write`", ">= 0.5", included=SYNCED)
TWICE = Row("twice", "the same bytes to two plain files at once over `os.write`", "", included=SYNCED)
OVER_TWICE = Row(
    "journal-and-chunks-twice", "journal and chunks over two plain files at once", ">= 0.8", included=SYNCED
)
OVER_MCAP = Row("chunks-mcap", "chunks alone over MCAP", ">= 1", included=SYNCED)
OVER_ZARR = Row("chunks-zarr", "chunks alone over zarr", ">= 1", included=SYNCED)
SIZE = Row(
    "size", "raw over stored bytes, 256x192 with 50 mK of noise", ">= 1.8", included="the sealed session"
)

JOURNAL = Row(
    "journal-size", "bytes of the journal over those of the samples, 160x120 at 9 Hz", "<= 1.3",
    included="with two readings a second",
)  # fmt: skip


def run() -> list[Result]:
    return [*_against_formats(), _size(), _journal_size()]


def _rate(work: Callable[[Path], None], data: CountArray) -> float:
    """Megabytes of frames a second, final sync included."""
    with folder() as place:
        return data.nbytes / seconds(lambda: work(place)) / 1e6


def _against_formats() -> list[Result]:
    info = camera(*LARGE)
    data = np.tile(noisy_frames(LARGE[0]), (RAW_FRAMES // 60, 1, 1))
    ways: dict[str, Callable[[Path], None]] = {
        "os.write": lambda place: _os_write(place / "raw", data),
        "twice": lambda place: _os_write_twice(place, data),
        "chunks": lambda place: _chunks(place / "chunks.h5", info, data),
        "both": lambda place: _session_uncompressed(place / "session.h5", data),
    }
    for name, write in (("mcap", write_mcap), ("zarr", _zarr)):
        if importlib.util.find_spec(name):
            ways[name] = _into(write, data)
    rates = in_rounds({name: partial(_rate, work, data) for name, work in ways.items()}, ROUNDS)
    pairs = (
        (CHUNKS, "chunks", "os.write"), (BOTH, "both", "os.write"), (TWICE, "twice", "os.write"),
        (OVER_TWICE, "both", "twice"), (OVER_MCAP, "chunks", "mcap"), (OVER_ZARR, "chunks", "zarr"),
    )  # fmt: skip
    return [
        share(row, list(zip(rates[a], rates[b], strict=True)), "MB/s") for row, a, b in pairs if b in rates
    ]


def _into(write: Callable[[Path, CountArray], None], data: CountArray) -> Callable[[Path], None]:
    return lambda place: write(place / "other", data)


def _os_write(path: Path, data: CountArray) -> None:
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT)
    for counts in data:
        os.write(descriptor, counts.tobytes())
    os.fsync(descriptor)
    os.close(descriptor)


def _plain_pack(chunk: CountArray) -> memoryview:
    return chunk.data.cast("B")


def _os_write_twice(place: Path, data: CountArray) -> None:
    with ThreadPoolExecutor(2) as two:
        list(two.map(lambda name: _os_write(place / name, data), ("one", "other")))


def _chunks(path: Path, info: StreamInfo, data: CountArray) -> None:
    with (
        h5py.File(path, "w", libver=LIBVER) as file,
        ThreadPoolExecutor(2) as pool,
        mock.patch.object(chunks, "pack", _plain_pack),
    ):
        dataset = _plain_dataset(file, "counts", chunk_shape(info), info.shape, 65535)
        file.swmr_mode = True
        writer = FrameWriter(dataset, pool, defaultdict(int))
        for counts in data:
            writer.put(counts)
            if writer.is_full:
                writer.write()
                file.flush()
    sync(path)


def _plain_dataset(
    group: Any, name: str, chunks: tuple[int, ...], shape: tuple[int, ...], fill: int | None
) -> h5py.Dataset:
    return group.create_dataset(
        name, (0, *shape), "<u2", maxshape=(None, *shape), chunks=chunks, fillvalue=fill, track_order=True
    )


def _session_uncompressed(path: Path, data: CountArray) -> None:
    """A whole recording, journal included, up to where every byte is in both and synced."""
    with (
        mock.patch.object(file_tree, "put_frames", _plain_dataset),
        mock.patch.object(chunks, "pack", _plain_pack),
    ):
        writer = write_session(path, LARGE, data)
        writer._stop()
        writer._file_thread.file.finish(0)
        writer._file_thread.close()
        writer._session_lock.release()


def _zarr(path: Path, data: CountArray) -> None:
    import zarr

    array = zarr.create_array(
        str(path), shape=data.shape, chunks=(1, *data.shape[1:]), dtype="uint16", compressors=None
    )
    for number, counts in enumerate(data):
        array[number] = counts
    for file in path.rglob("*"):
        sync(file)


def _size() -> Result:
    data = noisy_frames(MEDIUM[0], 250)
    with folder() as place:
        path = place / "size.h5"
        write_session(path, MEDIUM, data).close()
        with h5py.File(path) as file:
            stored_bytes = file["camera/counts"].id.get_storage_size()
    return SIZE.result(data.nbytes / stored_bytes)


def _journal_size() -> Result:
    """A minute, of which each reading once cost a page or two of a database."""
    clock, info = HostClock(), camera(*SMALL)
    lux = StreamInfo("lux", "illuminance", "lx", (1,), rate_hz=1.0)
    head = replace(header(info), streams=(info, lux))
    data = np.tile(noisy_frames(SMALL[0]), (9, 1, 1))
    with folder() as place:
        writer = SessionWriter(place / "a.h5", head, clock)
        for number, counts in enumerate(data):
            writer.append(frame(info, counts, clock))
            if number % 9 in (0, 4):
                now = clock.mono_ns()
                writer.append(Reading("lux", now, clock.to_utc_ns(now), (float(number),)))
        writer.abandon()
        journal_bytes = sum(log.stat().st_size for log in journal_path(writer.path).glob("*.log"))
    return JOURNAL.result(journal_bytes / (data.nbytes + 8 * 120))
