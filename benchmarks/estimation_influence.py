"""How far one minute, one mark and one draw move a slope, in half-widths: none of them is evidence.

The larger half-width of before and after counts. Sessions of `benchmarks.drawn_worlds`: 40 min, or 60 with
a board over each bed in turn, ``FIELDKIT_WORLDS`` of each kind; minutes are taken at once. All minutes and
readings of two sessions are a slow test (``test_bounded_influence.py``).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import product
from unittest.mock import patch

import numpy as np
from scipy.stats import qmc

from benchmarks.drawn_worlds import BROKEN, BROKEN_CLOUD, CLEAR, World, drawn_world
from benchmarks.estimation_learned import FIRST_SEED
from benchmarks.result import Result
from fieldkit.estimation.bins import History
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.learned import hypotheses
from fieldkit.model.arrays import FloatArray
from fieldkit.model.samples import Quality
from fieldkit.model.slope import SlopeEstimate

WORLDS = int(os.environ.get("FIELDKIT_WORLDS", "2"))
MINUTES, BOARD_MINUTES = 40, 60
EMPTIED = ("minute", "dni_w_m2", "air_k", "temperature_k")
EVERY = 7
"""Every so many minutes are emptied, one at a time."""
DISPLACED_MIN = (-5, -2, 2, 5)
SCRAMBLES = (1, 2)
Slopes = tuple[SlopeEstimate, ...]
Mark = tuple[int, int, int]
"""Region, first row and end of a shade that is marked."""


def slopes_of(world: World, history: History | None = None) -> Slopes:
    """Slopes after all minutes of a world, or of another history of it."""
    settings = replace(world.settings, model="learned")
    return SlopeChain(world.regions, settings).at_once(world.history if history is None else history).slopes


def moved(before: Slopes, after: Slopes) -> float:
    """Largest change of a tilt over the larger of its two half-widths, which may be cut at 0."""
    return max(
        abs(one.tilt_deg - other.tilt_deg) / max(_half_deg(one), _half_deg(other))
        for one, other in zip(before, after, strict=True)
    )


def _half_deg(slope: SlopeEstimate) -> float:
    return 0.5 * (slope.tilt_high_deg - slope.tilt_low_deg)


def emptied(history: History, column: str, row: int, region: int = 0) -> History:
    """The history without one reading, or without the minute where `column` is "minute"."""
    if column == "minute":
        return history.at(np.delete(np.arange(len(history)), row))
    values = getattr(history, column).copy()
    values[(row, region) if values.ndim == 2 else row] = np.nan
    return replace(history, **{column: values})


def marked(history: History, *marks: Mark) -> History:
    """The history with shade marked in rows of regions, and nowhere else."""
    flags = np.zeros_like(history.region_flags)
    for region, first, end in marks:
        flags[max(first, 0) : end, region] |= int(Quality.SHADED)
    return replace(history, region_flags=flags)


def marks_of(history: History) -> list[Mark]:
    """The shade of a history as marks."""
    rows = [np.flatnonzero(column) for column in history.is_shaded().T]
    return [(region, int(at[0]), int(at[-1]) + 1) for region, at in enumerate(rows) if at.size]


def worlds(minutes: int, *, shade_test: bool = False) -> Iterator[World]:
    """Sessions under a clear sky, and under broken cloud where its file is."""
    days = (CLEAR, BROKEN_CLOUD) if BROKEN.exists() else (CLEAR,)
    for seed, day in product(range(FIRST_SEED, FIRST_SEED + WORLDS), days):
        yield drawn_world(seed, day, minutes=minutes, shade_test=shade_test)


def by_missing(world: World) -> Iterator[float]:
    """Moves by single minutes and readings that are not there."""
    before = slopes_of(world)
    for column, row in product(EMPTIED, range(EVERY // 2, MINUTES, EVERY)):
        yield moved(before, slopes_of(world, emptied(world.history, column, row, row % len(world.regions))))


def by_false_mark(world: World) -> Iterator[float]:
    """Moves by marks of 5 min where no board was."""
    before = slopes_of(world)
    for region, first in product(range(len(world.regions)), (5, 17, 33)):
        yield moved(before, slopes_of(world, marked(world.history, (region, first, first + 5))))


def by_displaced_mark(world: World) -> Iterator[float]:
    """Moves by marks of boards that are minutes off, one at a time."""
    marks = marks_of(world.history)
    before = slopes_of(world, marked(world.history, *marks))
    for (region, first, end), by in product(marks, DISPLACED_MIN):
        others = [mark for mark in marks if mark[0] != region]
        yield moved(before, slopes_of(world, marked(world.history, (region, first + by, end + by), *others)))


def by_draw(world: World) -> Iterator[float]:
    """Moves by other scrambles of the points, and from at once to minute by minute."""
    before, even_points = slopes_of(world), hypotheses.even_points
    for seed in SCRAMBLES:

        def scrambled(table: str, seed: int = seed) -> FloatArray:
            shape = even_points(table).shape
            return np.asarray(qmc.Sobol(shape[1], rng=np.random.default_rng(seed)).random(shape[0]))

        with patch.object(hypotheses, "even_points", scrambled):
            yield moved(before, slopes_of(world))
    settings = replace(world.settings, model="learned")
    yield moved(before, SlopeChain(world.regions, settings).at(world.history).slopes)


def _row(
    name: str, most: float, moves_of: Callable[[World], Iterator[float]], tried: Iterator[World]
) -> Result:
    moves = np.array([move for world in tried for move in moves_of(world)])
    note = f"99 % {np.quantile(moves, 0.99):.3f}, median {np.median(moves):.3f} of {moves.size}"
    return Result(f"{name}: largest move", float(moves.max()), "half-widths", f"≤ {most:g}", note)


def run() -> list[Result]:
    """All rows; ten minutes of processor time."""
    return [
        _row("one minute or reading missing", 0.5, by_missing, worlds(MINUTES)),
        _row("a mark of no shade", 0.5, by_false_mark, worlds(MINUTES)),
        _row("a mark 2 or 5 min off", 0.5, by_displaced_mark, worlds(BOARD_MINUTES, shade_test=True)),
        _row("another draw, or minute by minute", 0.1, by_draw, worlds(MINUTES)),
    ]
