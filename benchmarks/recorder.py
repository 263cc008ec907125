"""The recorder on two cores: CPU, losses, memory, latency, and one frame's cost against a plain loop.

Real recorder, real drivers, real session; prepared frames and meters in another process
(`benchmarks.replayed`). Set FIELDKIT_BENCH_S to change how long each recording lasts.
"""

from __future__ import annotations

import os
import resource
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import h5py
import numpy as np

from benchmarks.replayed import PreparedCamera, meters
from benchmarks.result import Result, Row
from benchmarks.sides import seconds, share
from fieldkit.drivers import registry
from fieldkit.drivers.cameras.camera import DecodedFrame, ThermalCamera
from fieldkit.drivers.simulated.lepton import SimulatedLepton
from fieldkit.estimation.estimator import Estimator, EstimatorSettings
from fieldkit.model.clock import HostClock
from fieldkit.model.device import Device, DeviceSettings, StreamInfo
from fieldkit.recorder import Recorder, Summary
from fieldkit.sessions.layout import SessionHeader
from fieldkit.sessions.writer import SessionWriter
from fieldkit.simulation import sand_slopes
from fieldkit.simulation.simulated_clock import SimulatedClock

SECONDS = float(os.environ.get("FIELDKIT_BENCH_S", "120"))
FRAMES = 400
DEVICES = "real recorder, drivers and session; instruments in another process"
SMALL_CPU = Row(
    "cpu-small", "recording 160x120 at 8.7 Hz with two meters: CPU", "< 10", "% of a core", DEVICES
)
SMALL_LOST = Row("lost-small", "the same: samples lost", "0", "samples", DEVICES)
SMALL_GROWN = Row("grown-small", "the same: memory grown after the first quarter", "< 20", "MB", DEVICES)
LARGE_CPU = Row("cpu-large", "recording 640x512 at 30 Hz: CPU", "", "% of a core", DEVICES)
LARGE_LOST = Row("lost-large", "the same, 640x512: frames lost", "0", "frames", DEVICES)
LARGE_GROWN = Row(
    "grown-large", "the same, 640x512: memory grown after the first quarter", "< 20", "MB", DEVICES
)
PLAIN = Row(
    "plain", "a 160x120 frame from bytes to where it survives, over decode, h5py append and flush", "",
    included="ours with flags, journal and checksums",
)  # fmt: skip


def run() -> list[Result]:
    """All of it; takes about two minutes for each camera."""
    return [*small_camera(), *large_camera(), *cost_of_a_frame()]


def lepton_frames(count: int) -> list[bytes]:
    """Pictures of the simulated sand slopes as a PureThermal sends them."""
    scene = sand_slopes(duration_s=600.0)
    with SimulatedClock(scene.start_ns) as clock:
        source = SimulatedLepton(scene, clock)
        buffers = [source.read(1.0) for _ in range(count)]
    return [buffer.data for buffer in buffers if buffer is not None]


def small_camera() -> list[Result]:
    """160x120 at 8.7 Hz with both serial instruments."""
    clock = HostClock()
    with meters() as (lux, thermometer), tempfile.TemporaryDirectory() as folder:
        source = PreparedCamera(lepton_frames(90), 8.7, clock)
        settings = (
            DeviceSettings("camera", "purethermal", source=source),
            DeviceSettings("lux", "lutron", port=lux),
            DeviceSettings("thermometer", "center-309", port=thermometer),
        )
        devices = [registry.open_device(setting, clock) for setting in settings]
        recording = _record(Path(folder) / "small.h5", devices, source, clock)
    return [
        SMALL_CPU.result(100.0 * recording.cpu_s / recording.wall_s, recording.appends()),
        SMALL_LOST.result(recording.lost + source.skipped),
        SMALL_GROWN.result(recording.grown_mb),
    ]


def large_camera() -> list[Result]:
    """640x512 at 30 Hz, counts in 10 mK."""
    clock = HostClock()
    random = np.random.default_rng(1)
    base = 29_500 + 50 * np.add.outer(np.arange(512), np.arange(640)) // 100
    raw_frames = [(base + random.normal(0, 5, base.shape)).astype("<u2").tobytes() for _ in range(60)]
    info = StreamInfo("camera", "brightness_temperature", "K", (512, 640), scale=0.01, rate_hz=30.0)
    source = PreparedCamera(raw_frames, 30.0, clock)
    camera = ThermalCamera(info, source, _decode_large, clock)
    with tempfile.TemporaryDirectory() as folder:
        recording = _record(Path(folder) / "large.h5", [camera], source, clock)
    lost, stored = recording.lost + source.skipped, recording.counts["camera"]
    return [
        LARGE_CPU.result(100.0 * recording.cpu_s / recording.wall_s, recording.appends()),
        LARGE_LOST.result(lost, f"of {stored + lost}"),
        LARGE_GROWN.result(recording.grown_mb),
    ]


def _decode_large(data: bytes) -> DecodedFrame:
    counts = np.frombuffer(data, "<u2").reshape(512, 640)
    return DecodedFrame(counts, scale=0.01)


class _Recording:
    """A recording of `SECONDS` and what it took."""

    def __init__(
        self, summary: Summary, wall_s: float, cpu_s: float, memory: Sequence[float], append_s: list[float]
    ):
        self.counts, self.wall_s, self.cpu_s, self.append_s = summary.counts, wall_s, cpu_s, append_s
        self.lost = sum(summary.dropped.values())
        self.grown_mb = memory[-1] - memory[len(memory) // 4]

    def appends(self) -> str:
        """How long the writer took a sample."""
        median, slowest = 1e3 * np.quantile(self.append_s, (0.5, 0.999))
        return f"append {median:.2g} ms, 99.9 % within {slowest:.2g} ms"


def _record(path: Path, devices: Sequence[Device], source: PreparedCamera, clock: HostClock) -> _Recording:
    scene = sand_slopes()
    streams = tuple(device.info for device in devices)
    writer = SessionWriter(path, SessionHeader("benchmark", scene.site, streams, scene.regions), clock)
    append_s = _time_appends(writer)
    recorder = Recorder(
        devices,
        lambda name: devices[0],
        writer,
        Estimator(scene.site, scene.regions, streams, EstimatorSettings()),
        clock,
        lambda: 10**12,
        end_ns=clock.mono_ns() + round(SECONDS * 1e9),
    )
    memory: list[float] = []
    watch = threading.Thread(target=_watch_memory, args=(memory, recorder), daemon=True)
    watch.start()
    source.begin()
    wall, cpu = time.monotonic(), time.process_time()
    summary = recorder.run()
    return _Recording(summary, time.monotonic() - wall, time.process_time() - cpu, memory, append_s)


def _time_appends(writer: SessionWriter) -> list[float]:
    """Note how long each append takes."""
    times: list[float] = []
    append = writer.append

    def append_in_time(sample: object) -> None:
        times.append(seconds(lambda: append(sample)))  # type: ignore[arg-type]

    writer.append = append_in_time  # type: ignore[method-assign]
    return times


def _watch_memory(memory: list[float], recorder: Recorder) -> None:
    page_mb = resource.getpagesize() / 1e6
    for _ in range(int(SECONDS)):
        memory.append(int(Path("/proc/self/statm").read_text().split()[1]) * page_mb)
        time.sleep(1.0)


def cost_of_a_frame() -> list[Result]:
    """From bytes to the disk: ours (decoded, flagged, journalled) against a plain loop with h5py."""
    raw_frames = lepton_frames(FRAMES)
    rounds = [(_per_frame(_ours, raw_frames), _per_frame(_plain, raw_frames)) for _ in range(3)]
    return [share(PLAIN, rounds)]


def _per_frame(work: Callable[[Sequence[bytes]], None], raw_frames: Sequence[bytes]) -> float:
    return seconds(lambda: work(raw_frames)) / len(raw_frames)


def _ours(raw_frames: Sequence[bytes]) -> None:
    clock = HostClock()
    source = PreparedCamera(raw_frames, 1e6, clock)
    source.kept = 10**9
    camera = registry.open_device(DeviceSettings("camera", "purethermal", source=source), clock)
    scene = sand_slopes()
    with tempfile.TemporaryDirectory() as folder:
        header = SessionHeader("benchmark", scene.site, (camera.info,), scene.regions)
        writer = SessionWriter(Path(folder) / "ours.h5", header, clock)
        for _ in raw_frames:
            frame = camera.read(1.0)
            assert frame is not None
            writer.append(frame)
        writer.abandon()


def _plain(raw_frames: Sequence[bytes]) -> None:
    """The loop that a user writes: view the buffer, cut the telemetry, append, flush so that it survives."""
    with tempfile.TemporaryDirectory() as folder, h5py.File(Path(folder) / "plain.h5", "w") as file:
        frames = file.create_dataset(
            "frames", (0, 120, 160), "<u2", maxshape=(None, 120, 160), chunks=(1, 120, 160)
        )
        times = file.create_dataset("time", (0,), "<f8", maxshape=(None,))
        for number, data in enumerate(raw_frames):
            pixels = np.frombuffer(data, "<u2").reshape(-1, 160)
            frames.resize(number + 1, 0)
            times.resize(number + 1, 0)
            frames[number] = pixels[:120]
            times[number] = time.time()
            file.flush()
