"""Cost of the live estimator: a minute, a map; and live against batch.

The contour scoring and least squares of the whole study are measured in `benchmarks.study`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from benchmarks.result import Result, Row
from benchmarks.sides import seconds
from fieldkit.estimation.estimator import Estimator, EstimatorSettings, Minute
from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import Frame, Reading, Sample
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.energy_balance import SurfaceParameters, surface_temperature
from fieldkit.physics.facet import VERTICAL, normal
from fieldkit.physics.radiance import brightness_temperature_k
from fieldkit.physics.sun import sun_vectors
from tests.harness.papers_field import temperatures_k
from tests.harness.pixels import sums_of_frames

SITE = Site(35.558675, 139.395232, 9.0)
START_NS = int(np.datetime64("2017-08-30T03:00", "ns").astype(np.int64))
SHAPE = (120, 160)
PAPER = SurfaceParameters()
BURSTS = Row(
    "bursts",
    "live estimator on 3 h of bursts of three beds",
    "<= 1",
    "s",
    "samples to slopes, paper model; processor time",
)
BURSTS_FULL = Row("bursts-full", "the same, full model", "", "s")
BURSTS_LEARNED = Row("bursts-learned", "the same, learned model", "", "s")
ORDER = Row("order", "live in another order of arrival against batch, worst", "<= 1e-9", "°")
ONE_MAP = "20 mean frames summed and solved; processor time"
MAP = Row("map", "a slope map of 640x512", "<= 1", "s", ONE_MAP)
STREAMS = (
    StreamInfo("camera", "brightness_temperature", "K", SHAPE, scale=0.01),
    StreamInfo("lux", "illuminance", "lx", (1,)),
)


def _box(x: int, y: int) -> tuple[tuple[float, float], ...]:
    return ((x, y), (x + 60, y), (x + 60, y + 45), (x, y + 45))


BEDS = (
    Region("flat", RegionKind.REFERENCE, _box(10, 8)),
    Region("b07", RegionKind.TARGET, _box(85, 8), 7.3, 140.0),
    Region("b13", RegionKind.TARGET, _box(10, 65), 13.1, 220.0),
    Region("b24", RegionKind.TARGET, _box(85, 65), 24.2, 355.0),
)


def session(minutes: int) -> list[Sample]:
    """A burst of three noisy frames a minute and lux every 2 s."""
    random = np.random.default_rng(1)
    masks = [bed.mask(SHAPE) for bed in BEDS]
    none = np.zeros((0, SHAPE[1]), np.uint16)
    samples: list[Sample] = []
    for begin in START_NS + np.arange(minutes) * MINUTE_NS:
        sun = sun_vectors(begin, SITE)
        kelvin = np.full(SHAPE, 300.0)
        for bed, mask in zip(BEDS, masks, strict=True):
            facet = normal(np.nan_to_num(bed.tilt_deg), np.nan_to_num(bed.azimuth_deg))
            surface = surface_temperature(800.0 * max(float(facet @ sun), 0.0), 400.0, 303.15, PAPER)
            kelvin[mask] = brightness_temperature_k(surface, 0.9, 233.15)
        for second in range(3):
            at = int(begin) + second * 10**9
            counts = np.round((kelvin + 0.05 * random.standard_normal(SHAPE)) * 100).astype(np.uint16)
            samples.append(Frame("camera", at, at, counts, none))
        for second in range(0, 60, 2):
            at = int(begin) + second * 10**9 + 5
            samples.append(Reading("lux", at, at, (800.0 * float(sun[2]) / 0.85 * 0.44 * 246.78,)))
    return sorted(samples, key=lambda sample: sample.time_ns)


def estimate(samples: Sequence[Sample], settings: EstimatorSettings) -> list[Minute]:
    """All minutes of a session."""
    estimator = Estimator(SITE, BEDS, STREAMS, settings)
    closed = [minute for sample in samples for minute in estimator.add(sample)]
    return closed + estimator.finish()


def sessions() -> list[Result]:
    """Three hours of bursts from samples to slopes, and in another order of arrival."""
    samples = session(180)
    paper = EstimatorSettings(model="paper")
    rows = (
        (BURSTS, paper),
        (BURSTS_FULL, EstimatorSettings(model="full")),
        (BURSTS_LEARNED, EstimatorSettings(model="learned")),
    )
    works = [(row, partial(estimate, samples, settings)) for row, settings in rows]
    results = [row.result(min(seconds(work, time.process_time) for _ in range(2))) for row, work in works]
    random = np.random.default_rng(2)
    late = np.array([sample.time_ns for sample in samples]) + random.uniform(0, 0.99e9, len(samples))
    shuffled = [samples[index] for index in np.argsort(late, kind="stable")]
    worst = max(
        max(abs(a.tilt_deg - b.tilt_deg), abs(a.azimuth_deg - b.azimuth_deg))
        for minute, other in zip(estimate(samples, paper), estimate(shuffled, paper), strict=True)
        for a, b in zip(minute.estimates, other.estimates, strict=True)
        if not np.isnan(a.tilt_deg)
    )
    return [*results, ORDER.result(worst)]


def mapping(shape: tuple[int, int]) -> Callable[[], object]:
    """Work that makes a map as `fieldkit map` does, from its mean frames on."""
    random = np.random.default_rng(3)
    facets = normal(random.uniform(0, 30, shape), random.uniform(0, 360, shape))
    suns = sun_vectors(START_NS + np.arange(20) * MINUTE_NS, SITE)
    frames_k, level_k = ([temperatures_k(normals, sun) for sun in suns] for normals in (facets, VERTICAL))
    settings, reference_k = EstimatorSettings(model="paper"), [float(kelvin) for kelvin in level_k]
    return lambda: sums_of_frames(frames_k, reference_k, suns, 0.05).solve(settings)


def one_map() -> Result:
    """A map of the largest camera."""
    work = mapping((512, 640))
    note = "a general optimiser takes 0.45 ms a pixel, 150 s a map"
    return MAP.result(min(seconds(work, time.process_time) for _ in range(2)), note)


def run() -> list[Result]:
    """All rows; about half a minute."""
    return [*sessions(), one_map()]
