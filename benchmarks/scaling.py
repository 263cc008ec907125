"""How costs grow with the size of the work: minutes and regions of a session, pixels of a map, sessions.

Processor time at four sizes, each twice the one before, in rounds; the exponent is the slope of the line of
least squares through the logarithms of the medians.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from unittest import mock

import numpy as np

from benchmarks.drawn_worlds import CLEAR, RANDOM, World, drawn_world
from benchmarks.estimation_learned import with_targets
from benchmarks.estimation_speed import ONE_MAP, mapping
from benchmarks.result import Result, Row
from benchmarks.sides import seconds
from fieldkit.estimation.chain import SlopeChain
from fieldkit.recording.simulate import simulate
from fieldkit.results.batch import estimate_sessions

ROUNDS = 3
LEARNED = "learned model, from minute bins to slopes"
BY_MINUTES = Row("minutes", "exponent over minutes of a session", "<= 1.1", "", f"{LEARNED}; three beds")
BY_REGIONS = Row("regions", "exponent over regions of a session", "<= 1.1", "", f"{LEARNED}; 20 minutes")
BY_PIXELS = Row("pixels", "exponent over pixels of a slope map", "<= 1.1", "", ONE_MAP)
BY_SESSIONS = Row(
    "sessions", "exponent over sessions estimated", "<= 1.1", "",
    "20 minutes each, from files to slopes, one process, nothing cached",
)  # fmt: skip
SEED, REGIONS_MIN = 1, 20


@dataclass(frozen=True, slots=True)
class Growth:
    """Sizes, and the processor time at each: the median of rounds, seconds."""

    row: Row
    sizes: tuple[int, ...]
    seconds: tuple[float, ...]

    @property
    def exponent(self) -> float:
        """By which power of the size the time grows."""
        return float(np.polyfit(np.log(self.sizes), np.log(self.seconds), 1)[0])


def growths() -> Iterator[Growth]:
    """All four; some minutes."""
    world = drawn_world(SEED, CLEAR, RANDOM, minutes=160)
    yield _growth(BY_MINUTES, (20, 40, 80, 160), lambda size: _estimating(world, size))
    yield _growth(
        BY_REGIONS, (4, 8, 16, 32), lambda size: _estimating(with_targets(world, size), REGIONS_MIN)
    )
    yield _growth(
        BY_PIXELS, (160 * 128, 320 * 128, 320 * 256, 640 * 256), lambda size: mapping((128, size // 128))
    )
    with tempfile.TemporaryDirectory() as folder:
        sessions = [_record(Path(folder) / f"{seed}", seed) for seed in range(8)]
        yield _growth(BY_SESSIONS, (1, 2, 4, 8), lambda size: lambda: _estimate(sessions[:size]))


def _growth(row: Row, sizes: tuple[int, ...], prepared: Callable[[int], Callable[[], object]]) -> Growth:
    works = [prepared(size) for size in sizes]
    works[0]()  # what is loaded with the first use
    rounds = [[seconds(work, time.process_time) for work in works] for _ in range(ROUNDS)]
    return Growth(row, sizes, tuple(statistics.median(column) for column in zip(*rounds, strict=True)))


def _estimating(world: World, minutes: int) -> Callable[[], object]:
    history, settings = world.history.until(minutes), replace(world.settings, model="learned")
    return lambda: list(SlopeChain(world.regions, settings).series(history))


def _record(folder: Path, seed: int) -> Path:
    with simulate(folder, seed=seed) as session:
        return session.path


def _estimate(sessions: list[Path]) -> None:
    with tempfile.TemporaryDirectory() as cache, mock.patch.dict(os.environ, XDG_CACHE_HOME=cache):
        estimate_sessions(sessions)


def run() -> list[Result]:
    """All rows."""
    return [_result(growth) for growth in growths()]


def _result(growth: Growth) -> Result:
    points = zip(growth.sizes, growth.seconds, strict=True)
    return growth.row.result(growth.exponent, ", ".join(f"{size}: {took:.2g} s" for size, took in points))
