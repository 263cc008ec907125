"""Sessions whose every sample is a function of its number, so that any of them can be checked afterwards."""

from __future__ import annotations

import mmap
import multiprocessing
import struct
import time
from collections.abc import Iterator
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import numpy as np

from fieldkit.model.clock import HostClock
from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import Event, EventKind, Frame, Quality, Reading, Sample
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.sessions.finished_file import apply_time_map
from fieldkit.sessions.layout import SessionHeader
from fieldkit.sessions.recovery import recover
from fieldkit.sessions.time_map import TimeStep
from fieldkit.sessions.writer import SessionWriter
from tests.harness.waiting import PATIENCE_S

START_NS = 1_480_000_000_000_000_000
BELOW_US_NS = 123
STREAMS = ("camera", "lux", "thermometer")
SPAWN = multiprocessing.get_context("forkserver")
SPAWN.set_forkserver_preload(["tests.harness.recording"])


def header(shape: tuple[int, int] = (120, 160), rate_hz: float = 9.0, rows: int = 2) -> SessionHeader:
    """A camera with metadata rows, an illuminometer and a four-channel thermometer; two regions."""
    camera = StreamInfo(
        "camera", "brightness_temperature", "K", shape, 0.01, rate_hz=rate_hz, metadata_shape=(rows, shape[1])
    )
    lux = StreamInfo("lux", "illuminance", "lx", (1,), raw_bytes=16, rate_hz=1.0)
    channels = ("T1", "T2", "T3", "T4")
    thermometer = StreamInfo("thermometer", "temperature", "K", (4,), channels=channels, raw_bytes=45)
    corners = ((1.0, 1.0), (shape[1] / 2, 1.0), (shape[1] / 2, shape[0] / 2), (1.0, shape[0] / 2))
    regions = (
        Region("flat", RegionKind.REFERENCE, corners, 0.0, 180.0, 0.9),
        Region("b05", RegionKind.TARGET, corners, 5.0, 180.0),
    )
    site = Site(35.558675, 139.395232, 9.0, "Asia/Tokyo")
    return SessionHeader(
        "three beds – テスト", site, (camera, lux, thermometer), regions, "schema = 1  # é\n[site]\n"
    )


class CountedClock(HostClock):
    """A clock that counts a millisecond at each look: a session is the same however long it takes."""

    def __init__(self) -> None:
        super().__init__()
        self._now = 5_000_000_000

    def mono_ns(self) -> int:
        self._now += 1_000_000
        return self._now

    def to_utc_ns(self, mono_ns: int) -> int:
        return mono_ns + START_NS + BELOW_US_NS


def picture(seq: int, shape: tuple[int, int]) -> np.ndarray:
    """Slopes and noise like a thermal picture's, and the number in its first pixels."""
    noise = np.random.default_rng(seq).integers(0, 12, shape)
    counts = (29_500 + noise + np.arange(shape[1]) % 97).astype("<u2")
    counts[0, :4] = np.array([seq], "<u8").view("<u2")
    return counts


def sample(stream: StreamInfo, seq: int, mono_ns: int | None = None, time_ns: int | None = None) -> Sample:
    """The sample of that number: a function of its number alone, apart from the stamps if they are given."""
    mono = seq * 5_000_000 if mono_ns is None else mono_ns
    utc = START_NS + BELOW_US_NS + mono if time_ns is None else time_ns
    flags = Quality.SHUTTER if seq % 50 == 7 else Quality.GOOD
    if stream.is_camera:
        rows = np.full(stream.metadata_shape, seq % 65536, "<u2")
        fpa = float("nan") if seq % 3 == 0 else 300.0 + seq / 7
        counts = picture(seq, (stream.shape[0], stream.shape[1]))
        return Frame(stream.name, mono, utc, counts, rows, flags, seq * 3, seq + 100, fpa, seq)
    coldest = 250.0 if stream.unit == "K" else 0.0  # what cannot be would be flagged on reading
    values = tuple(coldest + n + seq % 300 / 3 for n in range(stream.shape[0]))
    raw = (b"\x02" + str(seq).encode() + b"\0\r\0")[: stream.raw_bytes]
    return Reading(stream.name, mono, utc, values, raw, flags, device_seq=seq, seq=seq)


def same(one: Sample, other: Sample) -> bool:
    """Whether two samples are the same in everything."""
    if isinstance(one, Frame) and isinstance(other, Frame):
        sensor_k = one.fpa_temperature_k, other.fpa_temperature_k
        return (
            _without_arrays(one) == _without_arrays(other)
            and np.array_equal(one.counts, other.counts)
            and np.array_equal(one.metadata_rows, other.metadata_rows)
            and np.array_equal(*sensor_k, equal_nan=True)
        )
    return one == other


def _without_arrays(frame: Frame) -> Frame:
    return frame._replace(counts=None, metadata_rows=None, fpa_temperature_k=0.0)  # type: ignore[arg-type]


def fill(writer: SessionWriter, frames: int, clock: HostClock | CountedClock) -> list[Sample]:
    """Append frames, and a reading of each meter with every fourth; returns what was appended."""
    appended = list(_samples(writer.header, frames, clock))
    for item in appended:
        writer.append(item)
    now = clock.mono_ns()
    writer.put(Event(EventKind.MARK, now, clock.to_utc_ns(now), "wolke über b05", data={"from": 3}))
    return appended


def recorded(path: Path, head: SessionHeader, frames: int) -> list[Sample]:
    """Record a session of so many frames, and seal it; returns its samples."""
    writer, appended = _filled(path, head, frames)
    writer.close()
    return appended


def session_of(path: Path, head: SessionHeader, *entries: Any) -> Path:
    """A sealed session of these samples, events, minutes and comparisons of clocks, in this order."""
    writer = SessionWriter(path, head, CountedClock())
    for entry in entries:
        (writer.append if isinstance(entry, Frame | Reading) else writer.put)(entry)
    writer.close()
    return path


def interrupted(path: Path, head: SessionHeader, frames: int) -> list[Sample]:
    """Record so many frames and leave the session to recovery; returns its samples."""
    writer, appended = _filled(path, head, frames)
    writer.abandon()
    return appended


def _filled(path: Path, head: SessionHeader, frames: int) -> tuple[SessionWriter, list[Sample]]:
    clock = CountedClock()
    writer = SessionWriter(path, head, clock)
    return writer, fill(writer, frames, clock)


def _samples(head: SessionHeader, frames: int, clock: HostClock | CountedClock) -> Iterator[Sample]:
    for seq in range(frames):
        for info in head.streams if seq % 4 == 0 else head.streams[:1]:
            now = clock.mono_ns()
            yield sample(info, seq if info.is_camera else seq // 4, now, clock.to_utc_ns(now))


class Counters:
    """How many samples of each stream a process has stored, in memory that outlives it."""

    def __init__(self, path: Path) -> None:
        if not path.exists():
            path.write_bytes(bytes(8 * (len(STREAMS) + 1)))
        with path.open("r+b") as file:
            self._memory = mmap.mmap(file.fileno(), 0)

    def __getitem__(self, stream: int) -> int:
        return int(struct.unpack_from("<q", self._memory, 8 * stream)[0])

    def __setitem__(self, stream: int, count: int) -> None:
        struct.pack_into("<q", self._memory, 8 * stream, count)

    @property
    def stage(self) -> int:
        """0 starting, 1 recording, 2 closing, 3 done."""
        return self[len(STREAMS)]

    @stage.setter
    def stage(self, stage: int) -> None:
        self[len(STREAMS)] = stage


def record_until_killed(path: Path, counters: Path, frames: int, rate_hz: float) -> None:
    """What the doomed process does: record at `rate_hz`, counting what is stored.

    It closes after `frames`, or before when somebody else sets the stage to closing.
    """
    counted, clock, head = Counters(counters), HostClock(), header()
    writer = SessionWriter(path, head, clock)
    counted.stage = 1
    began = time.monotonic()
    for seq in range(frames):
        if counted.stage > 1:
            break
        for number, info in enumerate(head.streams):
            if number == 0 or seq % 10 == 0:
                own = seq if number == 0 else seq // 10
                now = clock.mono_ns()
                writer.append(sample(info, own, now, clock.to_utc_ns(now)))
                counted[number] = own + 1
        time.sleep(max(0.0, began + seq / rate_hz - time.monotonic()))  # the camera's rate
    counted.stage = 2
    writer.close()
    counted.stage = 3


def recover_until_killed(path: Path, counters: Path) -> None:
    """What the doomed process does: recover a session."""
    counted = Counters(counters)
    counted.stage = 1
    recover(path)
    counted.stage = 3


def apply_until_killed(path: Path, counters: Path) -> None:
    """What the doomed process does: correct the times of a session, over and over."""
    counted = Counters(counters)
    counted.stage = 1
    while True:
        apply_time_map(path, [TimeStep(0, 10**9, "gps"), TimeStep(5, 2 * 10**9, "slept")])


def started(target: object, *arguments: object, counters: Path, stage: int) -> BaseProcess:
    """Start a process and wait until it has come to a stage."""
    Counters(counters)  # made here, so that the two do not both make it
    process = SPAWN.Process(target=target, args=arguments)  # type: ignore[arg-type]
    process.start()
    deadline = time.monotonic() + PATIENCE_S
    while Counters(counters).stage < stage:
        assert time.monotonic() < deadline, "the recording process did not get going"
        assert process.is_alive() or Counters(counters).stage >= stage, "the recording process ended at once"
        time.sleep(0.0005)  # no longer: the moment of the kill is counted from here
    return process


def kill(process: BaseProcess) -> None:
    """SIGKILL, and wait until it is gone."""
    process.kill()
    process.join()
