"""Draw the reliability diagram of the learned model: how often regions hold the truth, how often they say so.

    python docs/images/make_reliability.py [worlds]

Worlds are those of `benchmarks.estimation_learned`; a region for another probability than 90 % is taken to be
the 90 % region made wider or narrower as a normal distribution would be. The figure lies beside this file.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.special import ndtri

from benchmarks.drawn_worlds import drawn_world
from benchmarks.estimation_learned import FIRST_SEED, Scenario, scenarios
from fieldkit.estimation.chain import slope_series
from fieldkit.physics.facet import FloatArray
from fieldkit.views.plotting import colour, dashes, legend, panels, svg

SHOWN = ("clear, south, known", "broken, south, known", "clear, random beds, free")
MINUTES = (20, 60, 180)
PROBABILITIES: FloatArray = np.linspace(0.1, 0.98, 23)
NINETY = float(ndtri(0.95))


def scaled_errors(scenario: Scenario, seed: int) -> list[float]:
    """Errors of tilt over the half of the region towards the truth, for all beds and `MINUTES`."""
    world = drawn_world(seed, **scenario.world)
    truth = {region.name: region.tilt_deg for region in world.regions}
    settings = replace(world.settings, model="learned")
    series = list(slope_series(world.history.until(MINUTES[-1]), world.regions, settings))
    found = []
    for one in (estimate for minutes in MINUTES for estimate in series[minutes - 1].slopes):
        error = truth[one.region] - one.tilt_deg
        half = one.tilt_high_deg - one.tilt_deg if error > 0.0 else one.tilt_deg - one.tilt_low_deg
        found.append(abs(error) / max(half, 1e-6))
    return found


def reliability(worlds: int) -> Iterator[tuple[str, FloatArray]]:
    """For each kind of session the share of truths inside regions of all `PROBABILITIES`."""
    os.environ.update({"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"})
    seeds = range(FIRST_SEED, FIRST_SEED + worlds)
    with ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn")) as pool:
        for scenario in scenarios():
            if scenario.name in SHOWN:
                errors = np.concatenate(list(pool.map(scaled_errors, [scenario] * worlds, seeds)))
                limits = ndtri(0.5 * (1.0 + PROBABILITIES)) / NINETY
                yield scenario.name, np.mean(errors[:, np.newaxis] <= limits, axis=0)


def draw(found: list[tuple[str, FloatArray]]) -> Figure:
    """The diagram: on the diagonal regions are right, above it they are wider than they need be."""
    figure, (axes,) = panels(1, 3.6)
    axes.plot([0, 100], [0, 100], color="0.6", linewidth=1.0)
    for number, (name, shares) in enumerate(found):
        axes.plot(100.0 * PROBABILITIES, 100.0 * shares, color=colour(number), ls=dashes(number), label=name)
    axes.set(xlabel="stated probability of the region, %", ylabel="regions that hold the tilt, %")
    legend(axes)
    return figure


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 40
    Path(__file__).with_name("reliability.svg").write_text(
        svg(draw(list(reliability(count)))), encoding="utf-8"
    )
