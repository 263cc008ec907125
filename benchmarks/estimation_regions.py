"""Many regions in one picture: a minute of all of them, and how much that is less than one after the other.

Each region has a slope and noise of its own; three hours of minutes around noon.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.estimation_speed import PAPER, SITE, START_NS
from benchmarks.result import Result, Row
from benchmarks.sides import compare, seconds
from fieldkit.estimation.bins import History
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.slopes import slopes
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.energy_balance import surface_temperature
from fieldkit.physics.facet import normal
from fieldkit.physics.sun import sun_vectors

MINUTES = 180
MANY = 100
LEARNED_REGIONS = 30
NOISE_K = 0.05
ROUNDS = 5
TRIANGLE = ((0.0, 0.0), (4.0, 0.0), (0.0, 4.0))


INCLUDED = "least squares and both 90 % regions of every target, window of 20 min; processor time"
FREE = Row("free", "a minute of 100 regions, full model", "<= 40", "ms", INCLUDED)
FREE_LOOP = Row("free-loop", "a loop over 100 regions over all at once", ">= 5", included=INCLUDED)
KNOWN = Row("known", "a minute of 100 regions, full model, azimuths known", "<= 40", "ms", INCLUDED)
KNOWN_LOOP = Row("known-loop", "the same, a loop over all at once", ">= 5", included=INCLUDED)
LEARNED = Row(
    "learned",
    "a minute of 30 regions, learned model",
    "<= 60",
    "ms",
    "8 groups of 64 hypotheses; processor time",
)


def scene(targets: int) -> tuple[History, tuple[Region, ...]]:
    """A level reference and targets of random slopes up to 30 degrees."""
    random = np.random.default_rng(1)
    tilts, azimuths = random.uniform(2.0, 30.0, targets), random.uniform(0.0, 360.0, targets)
    beds = [
        Region(f"b{number:03}", RegionKind.TARGET, TRIANGLE, tilt, azimuth)
        for number, (tilt, azimuth) in enumerate(zip(tilts.tolist(), azimuths.tolist(), strict=True))
    ]
    time_ns = START_NS + np.arange(MINUTES) * MINUTE_NS
    sun = sun_vectors(time_ns, SITE)
    facets = np.vstack([normal(0.0, 0.0), normal(tilts, azimuths)])
    kelvin = surface_temperature(800.0 * np.maximum(sun @ facets.T, 0.0), 400.0, 303.15, PAPER)
    kelvin = kelvin + NOISE_K * random.standard_normal(kelvin.shape)
    history = History(time_ns // MINUTE_NS, time_ns, sun, kelvin, np.full(MINUTES, 800.0))
    return history, (Region("flat", RegionKind.REFERENCE, TRIANGLE), *beds)


def _cpu_ms(row: Row, work: Callable[[], object]) -> Result:
    """Processor time: the median of rounds, with their range."""
    took = [1e3 * seconds(work, time.process_time) for _ in range(ROUNDS)]
    return row.result(statistics.median(took), f"{min(took):.3g} to {max(took):.3g} in {ROUNDS} rounds")


def _of_all(settings: EstimatorSettings, together_row: Row, loop_row: Row) -> list[Result]:
    """The last minute of all regions at once, and a loop over them."""
    history, regions = scene(MANY)
    beds = [np.array([0, column]) for column in range(1, MANY + 1)]

    def together() -> object:
        return slopes(history, regions, settings)

    def one_by_one() -> object:
        return [slopes(history.only(two), [regions[column] for column in two], settings) for two in beds]

    ratio = compare(loop_row, together, one_by_one, ROUNDS, time.process_time)
    return [_cpu_ms(together_row, together), ratio]


def _learned_model() -> Result:
    """Minutes of the learned model between two draws of its hypotheses."""
    history, regions = scene(LEARNED_REGIONS)
    chain = SlopeChain(regions, EstimatorSettings(model="learned"))
    for last in range(1, 26):
        chain.at(history.until(last))
    later = iter(range(26, MINUTES))
    return _cpu_ms(LEARNED, lambda: chain.at(history.until(next(later))))


def run() -> list[Result]:
    """All rows; about half a minute."""
    free = EstimatorSettings(model="full", window_s=1200.0)
    along = replace(free, azimuth="known")
    return [*_of_all(free, FREE, FREE_LOOP), *_of_all(along, KNOWN, KNOWN_LOOP), _learned_model()]
