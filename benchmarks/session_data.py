"""Cameras, frames and scratch folders for the measurements of sessions."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from fieldkit.model.arrays import CountArray
from fieldkit.model.clock import HostClock
from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import Frame
from fieldkit.model.site import Site
from fieldkit.sessions.layout import SessionHeader
from fieldkit.sessions.writer import SessionWriter

LARGE, MEDIUM, SMALL = ((512, 640), 30.0), ((192, 256), 25.0), ((120, 160), 9.0)
Camera = tuple[tuple[int, int], float]
"""Rows and columns, frames a second."""


def camera(shape: tuple[int, int], rate_hz: float) -> StreamInfo:
    """A camera of that size and rate, 10 mK a count."""
    return StreamInfo("camera", "brightness_temperature", "K", shape, 0.01, rate_hz=rate_hz)


def header(info: StreamInfo) -> SessionHeader:
    """A session of one camera."""
    return SessionHeader("benchmark", Site(35.56, 139.4), (info,))


def noisy_frames(shape: tuple[int, int], count: int = 60) -> CountArray:
    """Sky, ground and beds with 50 mK of noise, as counts of 10 mK; the same every time."""
    rng = np.random.default_rng(7)
    rows, cols = shape
    scene = 29_000 + 800 * (np.arange(rows)[:, None] > rows // 3) + 3 * np.arange(cols)[None, :] / cols * 50
    scene[rows // 2 : rows * 3 // 4, cols // 4 : cols // 2] += 600
    fixed = rng.normal(0, 3, shape)
    return np.rint(scene + fixed + rng.normal(0, 5, (count, *shape))).astype("<u2")


def frame(info: StreamInfo, counts: CountArray, clock: HostClock) -> Frame:
    """A frame stamped now."""
    now = clock.mono_ns()
    return Frame(info.name, now, clock.to_utc_ns(now), counts, np.empty((0, 0), np.uint16))


def write_session(path: Path, size: Camera, data: CountArray) -> SessionWriter:
    """A recording of some frames as fast as possible, not closed yet."""
    info, clock = camera(*size), HostClock()
    writer = SessionWriter(path, header(info), clock)
    for counts in data:
        writer.append(frame(info, counts, clock))
    return writer


def write_naively(path: Path, data: CountArray, flush_every: int = 0) -> None:
    """As one writes first: resize, assign, gzip, h5py's own chunks, perhaps a flush each second."""
    with h5py.File(path, "w") as file:
        dataset = file.create_dataset(
            "frames", (0, *data.shape[1:]), "u2", maxshape=(None, *data.shape[1:]), chunks=True,
            shuffle=True, compression="gzip", compression_opts=1,
        )  # fmt: skip
        for number, counts in enumerate(data):
            dataset.resize(number + 1, axis=0)
            dataset[number] = counts
            if flush_every and (number + 1) % flush_every == 0:
                file.flush()
    with path.open("rb") as written:
        os.fsync(written)


def write_mcap(path: Path, data: CountArray, compression: str = "NONE") -> None:
    """One message for each frame, in the chunks that the writer makes by itself, synced."""
    from mcap.writer import CompressionType, Writer

    with path.open("wb") as file:
        writer: Any = Writer(file, compression=CompressionType[compression])
        writer.start()
        schema_id = writer.register_schema("raw", "", b"")
        channel = writer.register_channel("camera", "raw", schema_id)
        for number, counts in enumerate(data):
            writer.add_message(channel, number, counts.tobytes(), number)
        writer.finish()
        file.flush()
        os.fsync(file)


@contextmanager
def folder() -> Iterator[Path]:
    """A scratch folder on the disk of the current folder: /tmp may be memory."""
    place = Path(tempfile.mkdtemp(prefix="bench-", dir=Path.cwd()))
    try:
        yield place
    finally:
        shutil.rmtree(place, ignore_errors=True)
