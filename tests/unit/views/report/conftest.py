"""A recorded session in the paper's own world: eq. (7) on its beds, eq. (10) in its light meter."""

import sys

import numpy as np
import pytest

from fieldkit.estimation.estimator import Estimator, EstimatorSettings
from fieldkit.model.clock import ClockCheck, HostClock
from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import Event, EventKind, Frame, Health, Reading, Severity, StreamHealth
from fieldkit.physics.energy_balance import SurfaceParameters, surface_temperature
from fieldkit.physics.facet import cos_incidence, normal
from fieldkit.physics.irradiance import IrradianceModel
from fieldkit.physics.radiance import brightness_temperature_k
from fieldkit.physics.sun import sun_vectors
from fieldkit.sessions.layout import SessionHeader
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.writer import SessionWriter

SECOND_NS = 10**9
ANCHOR_NS = 1_512_961_200 * SECOND_NS  # 11 Dec 2017, 12:00 JST
MINUTES = 45
DIRECT_W_M2, AIR_K, DOWN_W_M2 = 800.0, 283.15, 250.0
CONFIG = """
[site]
latitude_deg = 35.558675
longitude_deg = 139.395232
elevation_m = 9.0
timezone = "Asia/Tokyo"
[irradiance]
diffuse = "none"
[estimator]
azimuth = "known"
"""


class AfternoonClock(HostClock):
    """Monotonic time that began at noon."""

    def mono_ns(self) -> int:
        return 0

    def to_utc_ns(self, mono_ns: int) -> int:
        return ANCHOR_NS + mono_ns


@pytest.fixture(scope="package")
def streams():
    return (
        StreamInfo("camera", "brightness_temperature", "K", (30, 40), scale=0.01, rate_hz=9.0, driver="y16"),
        StreamInfo("lux", "illuminance", "lx", (1,), channels=("lux",), rate_hz=0.1, driver="lutron"),
        StreamInfo("thermometer", "temperature", "K", (2,), channels=("T1", "T2"), rate_hz=0.1),
    )


@pytest.fixture(scope="package")
def settings():
    doubts = {"noise_k": 0.05, "offset_sd_k": 0.25, "scale_sd": 0.08, "exchange_sd": 0.15}
    return EstimatorSettings(
        model="paper", irradiance=IrradianceModel(diffuse="none"), azimuth="known", **doubts
    )


def direct_on(region, sun) -> float:
    return DIRECT_W_M2 * float(cos_incidence(normal(region.tilt_deg, region.azimuth_deg), sun))


def frame_of(regions, kelvin, mono_ns) -> Frame:
    counts = np.full((30, 40), 27_500, np.uint16)
    for region in regions:
        seen_k = brightness_temperature_k(kelvin[region.name], 0.90, 233.15)
        counts[region.mask((30, 40))] = round(float(seen_k) * 100)
    return Frame("camera", mono_ns, ANCHOR_NS + mono_ns, counts, np.empty((0, 0), np.uint16))


def samples(regions, site):
    """Every ten seconds a picture, lux by eq. (10) turned round, and two probes, one of them open."""
    for second in range(5, MINUTES * 60, 10):
        mono_ns = second * SECOND_NS
        stamps = (mono_ns, ANCHOR_NS + mono_ns)
        sun = sun_vectors(np.array([stamps[1]]), site)[0]
        kelvin = {
            region.name: float(
                surface_temperature(direct_on(region, sun), DOWN_W_M2, AIR_K, SurfaceParameters())
            )
            for region in regions
        }
        yield frame_of(regions, kelvin, mono_ns)
        yield Reading("lux", *stamps, (DIRECT_W_M2 * float(sun[2]) * 4.57 * 54 * 0.44,))
        yield Reading("thermometer", *stamps, (kelvin["flat"] + 0.3, float("nan")))


@pytest.fixture(scope="package")
def recorded(tmp_path_factory, site, regions, streams):
    """Path of a sealed session of 45 minutes with a gap, clock checks and health."""
    path = tmp_path_factory.mktemp("campaign") / "recordings" / "20171211T030000Z-paper.h5"
    path.parent.mkdir()
    told = ("fieldkit record --for 45m", "A. Nonymous")
    header = SessionHeader("sand <slopes>", site, streams, regions, config_toml(regions), *told)
    writer = SessionWriter(path, header, AfternoonClock())
    for sample in samples(regions, site):
        writer.append(sample)
    lost = Event(EventKind.LOST, 9, ANCHOR_NS + 9, "camera lost", "camera", Severity.WARNING)
    writer.put(lost)
    writer.put(Event(EventKind.GAP, 10, ANCHOR_NS + 10, "camera back after 14 s", "camera"))
    for minute in range(3):
        offset_ns = ANCHOR_NS + minute * 2_000_000
        writer.put(ClockCheck(minute * 60 * SECOND_NS, offset_ns, 50_000, "system"))
    counts = (StreamHealth("camera", 270, 3, 0), StreamHealth("lux", 270, 0, 0, rejected=2))
    writer.put(Health(60, ANCHOR_NS + 60, (*counts, StreamHealth("thermometer", 270, 0, 0)), 10**9))
    writer.close()
    return path


def config_toml(regions) -> str:
    tables = [
        f'[[region]]\nname = "{region.name}"\nkind = "{region.kind.name.lower()}"\n'
        f"points_px = {[list(point) for point in region.points_px]}\n"
        f"tilt_deg = {region.tilt_deg}\nazimuth_deg = {region.azimuth_deg}\n"
        for region in regions
    ]
    return CONFIG + "\n".join(tables)


@pytest.fixture(scope="package")
def session(recorded):
    with open_session(recorded) as session:
        yield session


@pytest.fixture(scope="package")
def minutes(session, settings):
    estimator = Estimator(session.site, session.regions, tuple(session.streams.values()), settings)
    closed = [minute for sample in session.samples() for minute in estimator.add(sample)]
    return [*closed, *estimator.finish()]


@pytest.fixture
def without_matplotlib(monkeypatch):
    """As where it is not installed, which takes an environment of its own."""
    monkeypatch.setitem(sys.modules, "matplotlib", None)
