"""The recorder on two cores: CPU, losses, memory, latency.

Real recorder, real drivers, real session; prepared frames and meters in another process
(`benchmarks.replayed`). Set FIELDKIT_BENCH_S to change how long each recording lasts.
"""

from __future__ import annotations

import os
import resource
import tempfile
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.replayed import PreparedCamera, meters
from benchmarks.result import Result, Row
from benchmarks.sides import seconds
from fieldkit.drivers import registry
from fieldkit.drivers.simulated.lepton import SimulatedLepton
from fieldkit.estimation.estimator import Estimator, EstimatorSettings
from fieldkit.model.clock import HostClock
from fieldkit.model.device import Device, DeviceSettings
from fieldkit.recorder import Recorder, Summary
from fieldkit.sessions.layout import SessionHeader
from fieldkit.sessions.writer import SessionWriter
from fieldkit.simulation import sand_slopes
from fieldkit.simulation.simulated_clock import SimulatedClock

SECONDS = float(os.environ.get("FIELDKIT_BENCH_S", "120"))
DEVICES = "real recorder, drivers and session; instruments in another process"
SMALL_CPU = Row(
    "cpu-small", "recording 160x120 at 8.7 Hz with two meters: CPU", "< 10", "% of a core", DEVICES
)
SMALL_LOST = Row("lost-small", "the same: samples lost", "0", "samples", DEVICES)
SMALL_GROWN = Row("grown-small", "the same: memory grown after the first quarter", "< 20", "MB", DEVICES)


def run() -> list[Result]:
    """160x120 at 8.7 Hz with both serial instruments; takes about two minutes."""
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


def lepton_frames(count: int) -> list[bytes]:
    """Pictures of the simulated sand slopes as a PureThermal sends them."""
    scene = sand_slopes(duration_s=600.0)
    with SimulatedClock(scene.start_ns) as clock:
        source = SimulatedLepton(scene, clock)
        buffers = [source.read(1.0) for _ in range(count)]
    return [buffer.data for buffer in buffers if buffer is not None]


class _Recording:
    """A recording of `SECONDS` and what it took."""

    def __init__(
        self, summary: Summary, wall_s: float, cpu_s: float, memory: Sequence[float], append_s: list[float]
    ):
        self.wall_s, self.cpu_s, self.append_s = wall_s, cpu_s, append_s
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
