"""Two sides of a comparison in alternating rounds of one run, and what the machine did meanwhile."""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from benchmarks.result import Result, Row, Sides

Measure = TypeVar("Measure")
BUSY_STEAL = 0.05
"""Share of the processors that a host may take away before a row says so."""


def compare(
    row: Row,
    ours: Callable[[], object],
    theirs: Callable[[], object],
    rounds: int = 5,
    clock: Callable[[], float] = time.perf_counter,
) -> Result:
    """How many times as long the other side takes: the median over rounds, with its range.

    Parameters
    ----------
    row
        What is compared.
    ours, theirs
        The same work on both sides.
    rounds
        How often each side works; each round gives one ratio.
    clock
        Seconds: those of the clock, or of the processor (`time.process_time`) for work without waiting.
    """
    steal = Steal()
    pairs = [(seconds(ours, clock), seconds(theirs, clock)) for _ in range(rounds)]
    return replace(times_as_fast(row, pairs), steal=steal.share())


def times_as_fast(row: Row, rounds: Sequence[tuple[float, float]], note: str = "") -> Result:
    """How many times as many seconds the other side took: the median of rounds (ours, theirs)."""
    return _of_rounds(row, rounds, [theirs / ours for ours, theirs in rounds], "s", note)


def share(row: Row, rounds: Sequence[tuple[float, float]], unit: str = "s", note: str = "") -> Result:
    """Ours over the other side's, in any unit: the median of rounds (ours, theirs)."""
    return _of_rounds(row, rounds, [ours / theirs for ours, theirs in rounds], unit, note)


def _of_rounds(
    row: Row, rounds: Sequence[tuple[float, float]], ratios: Sequence[float], unit: str, note: str
) -> Result:
    ours, theirs = (statistics.median(side) for side in zip(*rounds, strict=True))
    sides = Sides(ours, theirs, unit, min(ratios), max(ratios), len(ratios))
    return replace(row.result(statistics.median(ratios), note), sides=sides)


class Steal:
    """Processor time that the host takes away from this machine from now on."""

    def __init__(self) -> None:
        self._stolen_s, self._began_s = _stolen_s(), time.perf_counter()

    def share(self) -> float:
        """Share of all processors so far, in [0, 1]; 0 where the system does not tell."""
        passed_s = (time.perf_counter() - self._began_s) * (os.cpu_count() or 1)
        return (_stolen_s() - self._stolen_s) / passed_s


def in_rounds(sides: Mapping[str, Callable[[], Measure]], rounds: int) -> dict[str, list[Measure]]:
    """Measures of each side, round by round: a moment when the machine is slow is then slow for all."""
    measures = [{name: side() for name, side in sides.items()} for _ in range(rounds)]
    return {name: [measure[name] for measure in measures] for name in sides}


def python_process(*words: object, cache: Path | None = None) -> tuple[float, float]:
    """Processor and wall time of a fresh interpreter, interpreter included, seconds.

    Processor time does not count what it waits for a busy computer.
    """
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache)} if cache else None
    subprocess.run([sys.executable, *map(str, words)], check=True, capture_output=True, env=environment)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return cpu_s, time.perf_counter() - began


def seconds(work: Callable[[], object], clock: Callable[[], float] = time.perf_counter) -> float:
    """How long some work takes, by a clock as of `compare`."""
    began = clock()
    work()
    return clock() - began


def _stolen_s() -> float:
    statistic = Path("/proc/stat")
    if not statistic.exists():
        return 0.0
    return int(statistic.read_text().split(maxsplit=10)[8]) / os.sysconf("SC_CLK_TCK")
