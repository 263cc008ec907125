"""Simulation-based calibration of the learned estimator: where truths lie in what it states of them.

Worlds of `benchmarks.harsh_worlds` with beds of any azimuth, seeds from `FIRST_SEED` on; their number is
``FIELDKIT_WORLDS``, 500 by default. The rank of a truth is its probability integral transform: the share of
the posterior below it. Ranks of an estimator that is right are uniform; they pile up at both ends where its
regions are too narrow, in the middle where they are too wide, at one end where it is biased.

The posterior is taken to be normal on either side of the estimate, as its interval is wide there. Every bed
and parameter has a row of its own, so the ranks in it are independent.

References
----------
.. [1] S. Talts et al., "Validating Bayesian inference algorithms with simulation-based calibration",
   arXiv:1804.06788, 2018.
.. [2] A. P. Dawid, "Statistical theory: the prequential approach", J. R. Stat. Soc. A 147, 1984.
"""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Iterator, Mapping
from concurrent.futures import as_completed
from dataclasses import replace

import numpy as np
from rich.console import Console
from rich.progress import track
from scipy.special import ndtr
from scipy.stats import chisquare, kstest

from benchmarks.drawn_worlds import CLEAR, RANDOM, World
from benchmarks.estimation_learned import FIRST_SEED, processes, without_wind
from benchmarks.harsh_worlds import harsh_world
from benchmarks.result import Result
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.learned.readout import LOGARITHMS
from fieldkit.model.arrays import FloatArray
from fieldkit.model.confidence import interval_sds
from fieldkit.model.site import Region
from fieldkit.model.slope import SOLVED, SlopeEstimate

WORLDS = int(os.environ.get("FIELDKIT_WORLDS", "500"))
BINS = 10
LEAST_PROBABILITY = 0.01
"""Of ranks as uneven as these or more, of an estimator that is right."""
Ranks = Mapping[str, FloatArray]


def rank(truth: float, value: float, low: float, high: float, confidence: float) -> float:
    """Share of a posterior below the truth, from its median and its interval; NaN without one."""
    half = high - value if truth > value else value - low
    return float(ndtr(interval_sds(confidence) * (truth - value) / half)) if half > 0.0 else float("nan")


def world_ranks(seed: int) -> dict[str, float]:
    """Ranks of one world's truths after the whole session, by what they are of; a refused bed has none."""
    world = harsh_world(seed, CLEAR, RANDOM)
    settings = replace(world.settings, model="learned")
    estimated = SlopeChain(world.regions, settings).at(without_wind(world.history))
    beds = {region.name: region for region in world.regions}
    ranks: dict[str, float] = {}
    for slope in estimated.slopes:
        if slope.state in SOLVED:
            ranks |= _of_bed(slope, beds[slope.region])
    truths = _truths(world)
    for learnt in estimated.learnt.parameters if estimated.learnt else ():
        if learnt.name in truths:
            numbers = np.array([truths[learnt.name], learnt.value, learnt.low, learnt.high])
            numbers = np.log(numbers) if learnt.name in LOGARITHMS else numbers
            truth, value, low, high = numbers.tolist()
            ranks[learnt.name] = rank(truth, value, low, high, learnt.confidence)
    return ranks


def _of_bed(one: SlopeEstimate, bed: Region) -> Iterator[tuple[str, float]]:
    """Ranks of tilt and azimuth; a bed that may be flat has no azimuth."""
    tilts = (one.tilt_deg, one.tilt_low_deg, one.tilt_high_deg)
    yield f"tilt of {one.region}", rank(bed.tilt_deg, *tilts, one.confidence)
    if one.azimuth_high_deg - one.azimuth_low_deg < 360.0:
        near = one.azimuth_deg + (bed.azimuth_deg - one.azimuth_deg + 180.0) % 360.0 - 180.0
        azimuths = (one.azimuth_deg, one.azimuth_low_deg, one.azimuth_high_deg)
        yield f"azimuth of {one.region}", rank(near, *azimuths, one.confidence)


def _truths(world: World) -> dict[str, float]:
    """True values of the learnt parameters: of the reference's sand, and of errors the opposite."""
    field = world.field
    return {
        "gain": 1.0 / field.light_factor,
        "exchange": float(np.mean(field.exchange.at(world.history.wind_m_s))),
        "thermal_inertia": field.sand[0].thermal_inertia,
        "longwave": -field.longwave_error_w_m2,
    }


def ranks(worlds: int) -> Ranks:
    """Ranks of many worlds by what they are of, (worlds,) at most; progress on the error output."""
    seeds = range(FIRST_SEED, FIRST_SEED + worlds)
    with processes() as pool:
        finished = as_completed([pool.submit(world_ranks, seed) for seed in seeds])
        with_progress = track(finished, "worlds", total=worlds, console=Console(stderr=True))
        by_name = defaultdict[str, list[float]](list)
        for future in with_progress:
            for name, value in future.result().items():
                by_name[name].append(value)
    names = sorted(by_name, key=lambda name: (" of " not in name, name))
    return {name: np.sort([value for value in by_name[name] if np.isfinite(value)]) for name in names}


def evenness(values: FloatArray) -> tuple[float, float]:
    """Probabilities of ranks (n,) as uneven or more: Kolmogorov and Smirnov's, and chi-square's of `BINS`."""
    counts = np.histogram(values, BINS, (0.0, 1.0))[0]
    return float(kstest(values, "uniform").pvalue), float(chisquare(counts).pvalue)


def rows(found: Ranks) -> Iterator[Result]:
    """How uneven the ranks of each quantity are."""
    for name, values in found.items():
        smirnov, squares = evenness(values)
        note = (
            f"chi-square of {BINS} bins: {squares:.2g}; {values.size} ranks, mean {np.mean(values):.2f}, "
            f"sd {np.std(values):.2f} (uniform: 0.50, 0.29)"
        )
        yield Result(f"{name}: ranks are uniform (KS)", smirnov, "p", f">= {LEAST_PROBABILITY}", note)


def run() -> list[Result]:
    """All rows; ``FIELDKIT_WORLDS=16`` takes minutes, the default hours."""
    return list(rows(ranks(WORLDS)))
