"""The paper's whole study, 22 021 slopes, 21 minutes, 9, 12 and 15 h: fieldkit against a plain numpy loop.

The loop is what one writes first: the table is stored, and for every slope a mask over all
of it says which cells lie on the contours. It is timed on every twentieth slope and
multiplied; on those slopes winners, scores and ties must be the same.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from benchmarks.result import Result, Row
from benchmarks.sides import times_as_fast
from fieldkit.estimation.contours import ContourWinners, RadiationTable, slope_grid
from fieldkit.model.arrays import FloatArray, IntArray
from fieldkit.model.site import Site
from fieldkit.physics.daylight import clear_sky
from fieldkit.physics.energy_balance import SurfaceParameters, irradiance_difference
from fieldkit.physics.facet import VERTICAL
from fieldkit.physics.sun import sun_vectors
from fieldkit.study.estimators import (
    Conditions,
    StudySettings,
    paper_slopes,
    run_study,
    simulated_temperatures,
    summarise,
)

Answer = TypeVar("Answer")
SITE = Site(35.558675, 139.395232, 9.0)
STARTS = ("2017-08-30T00:00", "2017-08-30T03:00", "2017-08-30T06:00")
TOLERANCE_W_M2 = 0.5
EVERY = 20
ROUNDS = 5
SCORED = f"table and scores from temperature differences; theirs on every {EVERY}th slope, multiplied"
CONTOURS = Row("contours", "study, contour scoring, a numpy mask over ours", ">= 30", included=SCORED)
SAME = Row("same", "winners, scores and ties that are not the same", "0", "slopes")
SQUARES = Row(
    "squares", "study, least squares, a numpy mask over ours", ">= 300",
    included="the whole run, temperatures simulated on both sides; theirs scores as above",
)  # fmt: skip
EXACT = Row("exact", "least squares: 90 % of angles between normals within", "<= 0.01", "°", "noiseless")


def _conditions(start: str) -> Conditions:
    first = np.datetime64(start, "ns").astype(np.int64)
    times = first + np.arange(21, dtype=np.int64) * 60_000_000_000
    sun = sun_vectors(times, SITE)
    light, _ = clear_sky(sun[:, 2], times, SITE.elevation_m, 4.16)
    return Conditions(sun, light, np.full(21, 400.0), np.full(21, 303.15))


def _plain_loop(
    cells: FloatArray, table: FloatArray, differences: FloatArray
) -> tuple[FloatArray, IntArray, IntArray]:
    normals, best, tied = np.empty((len(differences), 3)), [], []
    for row, difference in enumerate(differences):
        score = (np.abs(table - difference[:, np.newaxis]) <= TOLERANCE_W_M2).sum(axis=0)
        winners = score == score.max()
        mean = cells[winners].mean(axis=0)
        normals[row] = mean / np.linalg.norm(mean)
        best.append(score.max())
        tied.append(winners.sum())
    return normals, np.array(best), np.array(tied)


def _cpu_s(work: Callable[[], Answer]) -> tuple[float, Answer]:
    """Processor time, which neighbours on the machine disturb least."""
    started = time.process_time()
    result = work()
    return time.process_time() - started, result


@dataclass(frozen=True)
class Start:
    """One start of the study: processor seconds of each part of both sides."""

    simulated_s: float
    plain_s: float
    ours_s: float
    squares_s: float
    different: int
    p90_deg: float

    @classmethod
    def at(cls, start: str) -> Start:
        """Time all of it at one start of the 20 minutes."""
        slopes, cells, conditions = paper_slopes(), slope_grid(), _conditions(start)
        simulated_s, differences = _cpu_s(lambda: _differences(slopes, conditions))
        design = conditions.sun * conditions.dni_w_m2[:, np.newaxis]
        table, some = design @ (cells - VERTICAL).T, differences[::EVERY]
        plain_s, plain = _cpu_s(lambda: _plain_loop(cells, table, some))
        ours_s, ours = _cpu_s(
            lambda: RadiationTable(cells, design, VERTICAL).winners(differences, TOLERANCE_W_M2)
        )
        squares_s, outcome = _cpu_s(lambda: run_study(slopes, conditions, StudySettings(method="unit-norm")))
        p90 = summarise(outcome.normal_error_deg).p90
        return cls(simulated_s, plain_s * EVERY, ours_s, squares_s, _different(ours, *plain), p90)


def _differences(slopes: FloatArray, conditions: Conditions) -> FloatArray:
    target, reference = simulated_temperatures(slopes, conditions, StudySettings())
    return irradiance_difference(target, reference, SurfaceParameters())


def run() -> list[Result]:
    """All three starts in each round."""
    Start.at(STARTS[0])  # warm: the day's sun, the libraries' first calls
    rounds = [[Start.at(start) for start in STARTS] for _ in range(ROUNDS)]
    every = [start for round in rounds for start in round]

    def seconds(name: str) -> list[float]:
        return [sum(getattr(start, name) for start in round) for round in rounds]

    plain, simulated = seconds("plain_s"), seconds("simulated_s")
    whole = [plain_s + other for plain_s, other in zip(plain, simulated, strict=True)]
    return [
        times_as_fast(CONTOURS, list(zip(seconds("ours_s"), plain, strict=True))),
        SAME.result(sum(start.different for start in every), f"of every {EVERY}th"),
        times_as_fast(SQUARES, list(zip(seconds("squares_s"), whole, strict=True))),
        EXACT.result(max(start.p90_deg for start in every), "worst start"),
    ]


def _different(ours: ContourWinners, normals: FloatArray, best: IntArray, tied: IntArray) -> int:
    alike = np.abs(ours.normals[::EVERY] - normals).max(axis=1) < 1e-12
    return int(np.sum(~(alike & (ours.best[::EVERY] == best) & (ours.tied[::EVERY] == tied))))
