"""Two sides of a comparison in alternating rounds of one run, beside what the machine did meanwhile."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable
from pathlib import Path

from benchmarks.result import Result

BUSY_STEAL = 0.05
"""Share of the time that a host may take away before a row says so."""


def compared(
    name: str,
    ours: Callable[[], object],
    theirs: Callable[[], object],
    must: str,
    included: str = "",
    rounds: int = 5,
) -> Result:
    """How many times as long the other side takes: the median over rounds, with its range.

    Parameters
    ----------
    name, must
        As of a `Result`; `must` is the original goal.
    ours, theirs
        The same work on both sides.
    included
        What the times include.
    rounds
        How often each side works; each round gives one ratio.
    """
    stolen, began = _stolen_s(), time.perf_counter()
    pairs = [(_seconds(ours), _seconds(theirs)) for _ in range(rounds)]
    steal = (_stolen_s() - stolen) / (time.perf_counter() - began)
    ratios = sorted(other / own for own, other in pairs)
    words = [
        included,
        f"{_words(own for own, _ in pairs)} against {_words(other for _, other in pairs)}",
        f"{ratios[0]:.3g} to {ratios[-1]:.3g} in {rounds} rounds",
        f"busy machine: {100 * steal:.0f} % taken by its host" if steal > BUSY_STEAL else "",
    ]
    return Result(name, statistics.median(ratios), "x", must, "; ".join(word for word in words if word))


def _seconds(work: Callable[[], object]) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def _stolen_s() -> float:
    """Processor time that the host has taken away so far, in seconds; 0 where it is not known."""
    statistic = Path("/proc/stat")
    return int(statistic.read_text().split(maxsplit=10)[8]) / 100.0 if statistic.exists() else 0.0


def _words(seconds: Iterable[float]) -> str:
    median = statistics.median(seconds)
    return f"{median:.2f} s" if median >= 1.0 else f"{1e3 * median:.3g} ms"
