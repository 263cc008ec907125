"""Many regions in one picture: a minute of all of them, and how much that is less than one after the other.

Each region has a slope and noise of its own; three hours of minutes around noon by the paper's surface model.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.estimation_speed import PAPER, SITE, START_NS
from benchmarks.result import Result
from benchmarks.sides import compared
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
    lit, unknown = np.full(MINUTES, 800.0), np.full(MINUTES, np.nan)
    none = np.zeros(kelvin.shape, np.int64)
    history = History(
        time_ns // MINUTE_NS, time_ns, sun, kelvin, lit, unknown, unknown, none[:, 0].copy(), none
    )
    return history, (Region("flat", RegionKind.REFERENCE, TRIANGLE), *beds)


def _cpu_ms(work: Callable[[], object]) -> list[float]:
    """Processor time of each round, in order of size."""
    found = []
    for _ in range(ROUNDS):
        began = time.process_time()
        work()
        found.append(1e3 * (time.process_time() - began))
    return sorted(found)


def _row(name: str, found: list[float], must: str, note: str) -> Result:
    span = f"{found[0]:.3g} to {found[-1]:.3g} in {ROUNDS} rounds; processor time; {note}"
    return Result(name, statistics.median(found), "ms", must, span)


def many() -> list[Result]:
    """The last minute of all regions at once, and against a loop over them."""
    history, regions = scene(MANY)
    rows = []
    for settings in (
        EstimatorSettings(model="paper", window_s=1200.0),
        EstimatorSettings(model="full", window_s=1200.0),
        EstimatorSettings(model="full", window_s=1200.0, azimuth="known"),
    ):

        def together(settings: EstimatorSettings = settings) -> object:
            return slopes(history, regions, settings)

        def one_by_one(settings: EstimatorSettings = settings) -> object:
            return [
                slopes(history.only(np.array([0, column])), (regions[0], regions[column]), settings)
                for column in range(1, MANY + 1)
            ]

        name = f"a minute of {MANY} regions, {settings.model}, azimuth {settings.azimuth}"
        included = "rows, least squares, both 90 % regions of every target"
        rows.append(_row(name, _cpu_ms(together), "≤ 40", included))
        rows.append(compared(f"{name}: a loop over regions over all at once", together, one_by_one, "≥ 5"))
    return rows


def learned() -> list[Result]:
    """A minute of the learned model between two draws of its hypotheses."""
    history, regions = scene(LEARNED_REGIONS)
    chain = SlopeChain(regions, replace(EstimatorSettings(), model="learned"))
    for last in range(1, 26):
        chain.at(history.until(last))
    ages = iter(range(26, MINUTES))
    found = _cpu_ms(lambda: chain.at(history.until(next(ages))))
    return [_row(f"a minute of {LEARNED_REGIONS} regions, learned", found, "≤ 60", "64 hypotheses a group")]


def run() -> list[Result]:
    """All rows; about half a minute."""
    return many() + learned()
