"""Writing sessions: what a sample waits for, what the disk sees, against what a user would write.

Ratios are taken in one run on one machine. MCAP and zarr are measured where they are
installed; uncompressed means our path with compression taken out of it.
"""

from __future__ import annotations

import importlib.util
import multiprocessing
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import h5py
import numpy as np
from numpy.typing import NDArray

from benchmarks.result import Result
from fieldkit.clock import HostClock
from fieldkit.device import StreamInfo
from fieldkit.samples import Frame
from fieldkit.sessions import bricks, schema
from fieldkit.sessions.bricks import BrickWriter
from fieldkit.sessions.layout import SessionHeader, brick_shape
from fieldkit.sessions.writer import SessionWriter
from fieldkit.site import Site

LARGE, MEDIUM, SMALL = ((512, 640), 30.0), ((192, 256), 25.0), ((120, 160), 9.0)
PACED_S = 20.0
RAW_FRAMES = 600
NAIVE_FRAMES = 60
Frames = NDArray[np.uint16]


def camera(shape: tuple[int, int], rate_hz: float) -> StreamInfo:
    """A camera of that size and rate, 10 mK a count."""
    return StreamInfo("camera", "brightness_temperature", "K", shape, 0.01, rate_hz=rate_hz)


def header(info: StreamInfo) -> SessionHeader:
    """A session of one camera."""
    return SessionHeader("benchmark", Site(35.56, 139.4), (info,))


def pictures(shape: tuple[int, int], count: int = 60) -> Frames:
    """Sky, ground and beds with 50 mK of noise, as counts of 10 mK; the same every time."""
    rng = np.random.default_rng(7)
    rows, cols = shape
    scene = 29_000 + 800 * (np.arange(rows)[:, None] > rows // 3) + 3 * np.arange(cols)[None, :] / cols * 50
    scene[rows // 2 : rows * 3 // 4, cols // 4 : cols // 2] += 600
    fixed = rng.normal(0, 3, shape)
    return np.rint(scene + fixed + rng.normal(0, 5, (count, *shape))).astype("<u2")


def frame(info: StreamInfo, counts: Frames, clock: HostClock) -> Frame:
    """A frame stamped now."""
    now = clock.mono_ns()
    return Frame(info.name, now, clock.to_utc_ns(now), counts, np.empty((0, 0), np.uint16))


@contextmanager
def folder() -> Iterator[Path]:
    """A scratch folder on the disk of the current folder: /tmp may be memory."""
    place = Path(tempfile.mkdtemp(prefix="bench-", dir=Path.cwd()))
    try:
        yield place
    finally:
        shutil.rmtree(place, ignore_errors=True)


def run() -> list[Result]:
    results = [*_paced(LARGE, "640x512 at 30 Hz", 35.0), *_paced(MEDIUM, "256x192 at 25 Hz", 7.0)]
    results += _loaded()
    results += _sustained()
    for (shape, rate_hz), words, must in ((MEDIUM, "256x192", 1.3), (LARGE, "640x512", 40.0)):
        results.append(_against_naive(shape, rate_hz, words, must))
    results += [_burst(), _size()]
    return results


def _record_paced(size: tuple[tuple[int, int], float], place: Path) -> tuple[list[float], float, int]:
    """Append at the camera's rate: milliseconds of each append, share of a core used, frames missing."""
    info, clock = camera(*size), HostClock()
    ready, waits = pictures(info.shape), []  # type: ignore[arg-type]
    writer = SessionWriter(place / "paced.h5", header(info), clock)
    count = int(PACED_S * info.rate_hz)
    began, used = time.monotonic(), time.process_time()
    for number in range(count):
        sample = frame(info, ready[number % len(ready)], clock)
        before = time.perf_counter()
        writer.append(sample)
        waits.append((time.perf_counter() - before) * 1000)
        time.sleep(max(0.0, began + (number + 1) / info.rate_hz - time.monotonic()))
    share = (time.process_time() - used) / (time.monotonic() - began)
    return waits, 100 * share, count - writer.close().counts["camera"]


def _paced(size: tuple[tuple[int, int], float], words: str, most: float) -> list[Result]:
    with folder() as place:
        waits, share, missing = _record_paced(size, place)
    return [
        Result(f"append, {words}, idle, p50", float(np.median(waits)), "ms", "", f"{len(waits)} frames"),
        Result(f"append, {words}, idle, p99.9", float(np.quantile(waits, 0.999)), "ms", "<= 20"),
        Result(f"frames dropped, {words}", missing, "", "0"),
        Result(f"CPU with compression, {words}", share, "% of a core", f"<= {most:g}"),
    ]


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


def _loaded() -> list[Result]:
    """Two busy cores and a process that writes flat out beside the largest camera."""
    until = time.monotonic() + PACED_S + 5
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
        Result("append, 640x512 at 30 Hz, loaded, p99.9", float(np.quantile(waits, 0.999)), "ms", "<= 250"),
        Result("frames dropped, loaded", missing, "", "0"),
    ]


def _rate(work: Callable[[Path], None], data: Frames, repeats: int = 3) -> float:
    """Megabytes of frames a second, the best of some runs, final sync included."""
    best = 0.0
    for _ in range(repeats):
        with folder() as place:
            before = time.perf_counter()
            work(place)
            best = max(best, data.nbytes / (time.perf_counter() - before) / 1e6)
    return best


def _sustained() -> list[Result]:
    info = camera(*LARGE)
    data = np.tile(pictures(LARGE[0]), (RAW_FRAMES // 60, 1, 1))
    plain = _rate(lambda place: _os_write(place / "raw", data), data)
    alone = _rate(lambda place: _bricks(place / "bricks.h5", info, data), data)
    both = _rate(lambda place: _session_uncompressed(place / "session.h5", info, data), data)
    note = f"os.write {plain:.0f} MB/s"
    results = [
        Result("bricks alone, uncompressed, over os.write", alone / plain, "x", ">= 0.5", note),
        Result("journal and bricks, uncompressed, over os.write", both / plain, "x", ">= 0.3", note),
    ]
    for name, write in (("mcap", _mcap), ("zarr", _zarr)):
        if importlib.util.find_spec(name) is None:
            continue
        other = _rate(_into(write, data), data)
        results.append(Result(f"bricks alone, uncompressed, over {name}", alone / other, "x", ">= 1"))
    return results


def _into(write: Callable[[Path, Frames], None], data: Frames) -> Callable[[Path], None]:
    return lambda place: write(place / "other", data)


def _os_write(path: Path, data: Frames) -> None:
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT)
    for one in data:
        os.write(descriptor, one.tobytes())
    os.fsync(descriptor)
    os.close(descriptor)


def _plain_pack(tile: Frames) -> memoryview:
    return tile.data.cast("B")


def _bricks(path: Path, info: StreamInfo, data: Frames) -> None:
    with (
        h5py.File(path, "w", libver=schema.LIBVER) as file,
        ThreadPoolExecutor(2) as pool,
        mock.patch.object(bricks, "pack", _plain_pack),
    ):
        dataset = _plain_dataset(file, "counts", brick_shape(info), info.shape, 65535)
        file.swmr_mode = True
        writer = BrickWriter(dataset, pool)
        for one in data:
            writer.put(one)
            if writer.is_full:
                writer.write()
                file.flush()
    _sync(path)


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    os.fsync(descriptor)
    os.close(descriptor)


def _plain_dataset(
    group: Any, name: str, chunks: tuple[int, ...], shape: tuple[int, ...], fill: int | None
) -> h5py.Dataset:
    return group.create_dataset(
        name, (0, *shape), "<u2", maxshape=(None, *shape), chunks=chunks, fillvalue=fill, track_order=True
    )


def _session_uncompressed(path: Path, info: StreamInfo, data: Frames) -> None:
    """A whole recording, journal included, up to where every byte is in both and synced."""
    clock = HostClock()
    with (
        mock.patch.object(schema, "_brick_dataset", _plain_dataset),
        mock.patch.object(bricks, "pack", _plain_pack),
    ):
        writer = SessionWriter(path, header(info), clock)
        for one in data:
            writer.append(frame(info, one, clock))
        writer._stop()
        writer._bricks.finish(0)
        writer._bricks.close()
        writer._session_lock.release()


def _mcap(path: Path, data: Frames) -> None:
    from mcap.writer import CompressionType, Writer

    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start()
        schema_id = writer.register_schema("raw", "", b"")
        channel = writer.register_channel("camera", "raw", schema_id)
        for number, one in enumerate(data):
            writer.add_message(channel, number, one.tobytes(), number)
        writer.finish()
        file.flush()
        os.fsync(file.fileno())


def _zarr(path: Path, data: Frames) -> None:
    import zarr

    array = zarr.create_array(
        str(path), shape=data.shape, chunks=(1, *data.shape[1:]), dtype="uint16", compressors=None
    )
    for number, one in enumerate(data):
        array[number] = one
    os.sync()


def _naive(path: Path, data: Frames) -> None:
    """What one writes first: resize, assign, gzip, h5py's own chunks."""
    with h5py.File(path, "w") as file:
        dataset = file.create_dataset(
            "frames", (0, *data.shape[1:]), "u2", maxshape=(None, *data.shape[1:]), chunks=True,
            shuffle=True, compression="gzip", compression_opts=1,
        )  # fmt: skip
        for number, one in enumerate(data):
            dataset.resize(number + 1, axis=0)
            dataset[number] = one


def _compressed(path: Path, info: StreamInfo, data: Frames) -> None:
    with h5py.File(path, "w", libver=schema.LIBVER) as file, ThreadPoolExecutor(2) as pool:
        dataset = schema._brick_dataset(file, "counts", brick_shape(info), info.shape, 65535)
        writer = BrickWriter(dataset, pool)
        for one in data:
            writer.put(one)
            if writer.is_full:
                writer.write()
        writer.write()


def _against_naive(shape: tuple[int, int], rate_hz: float, words: str, must: float) -> Result:
    info = camera(shape, rate_hz)
    few = pictures(shape, NAIVE_FRAMES)
    many = np.tile(few, (5, 1, 1))
    ours = _rate(lambda place: _compressed(place / "a.h5", info, many), many) / few[0].nbytes * 1e6
    naive = _rate(lambda place: _naive(place / "a.h5", few), few, 1) / few[0].nbytes * 1e6
    note = f"{ours:.0f} against {naive:.1f} frames/s"
    return Result(
        f"frames/s over h5py as one writes it first, {words}", ours / naive, "x", f">= {must:g}", note
    )


def _burst() -> Result:
    info, clock = camera(*LARGE), HostClock()
    with folder() as place:
        writer = SessionWriter(place / "burst.h5", header(info), clock)
        for one in pictures(LARGE[0], 50):
            writer.append(frame(info, one, clock))
        kept = writer.close().counts["camera"]
    return Result("burst of 50 frames at once, kept", kept, "frames", "50")


def _size() -> Result:
    info, clock = camera(*MEDIUM), HostClock()
    with folder() as place:
        path = place / "size.h5"
        writer = SessionWriter(path, header(info), clock)
        data = pictures(MEDIUM[0], 250)
        for one in data:
            writer.append(frame(info, one, clock))
        writer.close()
        with h5py.File(path) as file:
            stored = file["camera/counts"].id.get_storage_size()
    return Result("raw over stored bytes, synthetic with 50 mK noise", data.nbytes / stored, "x", ">= 1.8")
