"""Single bits of a sealed session file turned over: which object that changes, if it changes any."""

from __future__ import annotations

import json
import shutil
from bisect import bisect
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from fieldkit.model.clock import ClockCheck
from fieldkit.model.learnt import Learnt, LearntParameter
from fieldkit.model.samples import Event, EventKind, Health, Severity, StreamHealth
from fieldkit.model.slope import SlopeEstimate, SlopeState
from fieldkit.sessions.check import check
from fieldkit.sessions.digests import ROOT, object_digest, object_paths
from fieldkit.sessions.finished_file import add_later_events, apply_time_map
from fieldkit.sessions.layout import FRAME_DATASETS
from fieldkit.sessions.records import MinuteRecord, RegionRecord
from fieldkit.sessions.time_map import TimeStep
from fieldkit.sessions.writer import SessionWriter
from tests.harness.recording import CountedClock, fill, header


def small_session(path: Path, license: str = "") -> Path:
    """A sealed session that has something in every table, and a corrected clock and mark."""
    clock = CountedClock()
    writer = SessionWriter(path, replace(header((8, 10)), license=license), clock)
    fill(writer, 10, clock)
    now = clock.mono_ns()
    time_ns = clock.to_utc_ns(now)
    slope = SlopeEstimate(time_ns, "b05", SlopeState.OK, 5.1, 181.0, 4.0, 6.0, 170.0, 190.0, model="paper")
    inertia = LearntParameter(
        "thermal_inertia", "J m-2 K-1 s-1/2", 800.0, 400.0, 1600.0, 750.0, 700.0, 800.0, 0.1
    )
    learnt = Learnt((inertia,), {"b05": 0.05}, {"b05": 0.1}, 1.1)
    writer.put(MinuteRecord(time_ns, (slope,), 812.5, "clear sky", learnt=learnt))
    writer.put(RegionRecord(writer.header.regions[1], time_ns, is_removed=True))
    writer.put(ClockCheck(now, clock.to_utc_ns(0), 1_000_000, "ntp"))
    writer.put(Health(now, time_ns, (StreamHealth("camera", 10, 0, 0),), 10**9, 10**5, 1.5, 2.5, 3.5))
    writer.close()
    apply_time_map(path, [TimeStep(0, 2_500_000_000, "gps")])
    data = {"corrects": 1}
    add_later_events(path, [Event(EventKind.MARK, now, time_ns, "a cloud", "", Severity.INFO, data)])
    return path


def flip_byte(path: Path, place: int, bits: int = 1) -> None:
    """Turn these bits of one byte of a file."""
    with path.open("r+b") as file:
        file.seek(place)
        byte = file.read(1)[0]
        file.seek(place)
        file.write(bytes([byte ^ bits]))


def mark_unfinished(path: Path) -> None:
    """Let the superblock of a session say that it is being written, as if its writer had been killed."""
    with path.open("r+b") as file:
        file.seek(11)
        file.write(b"\1")


def change_header(file: h5py.File, change: Callable[[Any], object]) -> None:
    """Give a session file the header that `change` makes of its own."""
    plain = json.loads(file["config/header"][()])
    change(plain)
    text = json.dumps(plain).encode()
    del file["config/header"]
    file["config/header"] = np.array(text, h5py.string_dtype("utf-8", len(text)))


@dataclass(frozen=True, slots=True)
class Span:
    """Bytes of the file that are values of a dataset."""

    dataset: str
    start: int
    stop: int


class Faults:
    """A session file in memory, of which single bits are turned over."""

    def __init__(self, path: Path) -> None:
        self.data = path.read_bytes()
        with self._opened(self.data) as file:
            self.paths = object_paths(file)
            self._digests = {name: object_digest(file, name) for name in self.paths}
            self._content = self._content_of(file)
            self.values = [span for name in self.paths for span in _spans(file, name)]
            headers = {h5py.h5o.get_info(file[name].id).addr: name for name in self.paths}
        self._headers = sorted(headers.items())
        self._likely = ROOT

    def flipped(self, place: int, bit: int) -> bytes:
        """The file with one bit turned over."""
        data = bytearray(self.data)
        data[place] ^= 1 << bit
        return bytes(data)

    def near(self, place: int) -> str:
        """The object whose header lies before a place: its own, if the place is of its structures."""
        return self._headers[max(0, bisect(self._headers, (place, "~")) - 1)][1]

    def noticed(self, data: bytes, *likely: str) -> str:
        """The object that is not as it was (the `likely` ones looked at first); empty where all are."""
        try:
            file = self._opened(data)
        except (OSError, RuntimeError, ValueError):  # the last where HDF5 gives up after it has begun
            return "the file"
        with file:
            for name in dict.fromkeys((*likely, self._likely, *self.paths)):
                if self._is_changed(file, name):
                    self._likely = name
                    return name
        return ""

    def reads_the_same(self, data: bytes) -> bool:
        """Whether every value and attribute, pictures among them, is read as before."""
        with self._opened(data) as file:
            return self._content_of(file) == self._content

    def _is_changed(self, file: h5py.File, name: str) -> bool:
        try:
            return object_digest(file, name) != self._digests[name]
        except Exception:  # as `check` has it
            return True

    def _content_of(self, file: h5py.File) -> dict[str, str]:
        """Digests that leave nothing out."""
        return {name: object_digest(file, name) + _values_of(file, name) for name in self.paths}

    @staticmethod
    def _opened(data: bytes) -> h5py.File:
        return h5py.File(h5py.h5f.open_file_image(data))


def failures(path: Path, data: bytes) -> list[str]:
    """What `check` calls damaged in a file of these bytes."""
    path.write_bytes(data)
    try:
        return [one.what for one in check(path) if one.level == "fail"]
    finally:
        path.unlink()
        shutil.rmtree(path.with_name(path.name + ".journal"), ignore_errors=True)


def _spans(file: h5py.File, name: str) -> Iterator[Span]:
    """Where the values of a dataset lie, rows that are not in use left out; none of packed pictures."""
    node = file[name]
    if not isinstance(node, h5py.Dataset) or name.rsplit("/", 1)[-1] in FRAME_DATASETS:
        return
    if node.chunks is None:
        yield Span(name, node.id.get_offset(), node.id.get_offset() + node.id.get_storage_size())
        return
    row_bytes = node.dtype.itemsize * int(np.prod(node.shape[1:]))
    for number in range(node.id.get_num_chunks()):
        chunk = node.id.get_chunk_info(number)
        rows = min(node.chunks[0], len(node) - chunk.chunk_offset[0])
        yield Span(name, chunk.byte_offset, chunk.byte_offset + rows * row_bytes)


def _values_of(file: h5py.File, name: str) -> str:
    node = file[name]
    return sha256(np.asarray(node[()]).tobytes()).hexdigest() if isinstance(node, h5py.Dataset) else ""
