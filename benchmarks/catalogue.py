"""``fieldkit ls`` of a thousand sessions, first and again, as a user types it.

Links to one session of 20 minutes, each of them a session: a disk that is not in memory adds its own time.
"""

from __future__ import annotations

import os
import statistics
import tempfile
from pathlib import Path

from benchmarks.result import Result, Row
from benchmarks.sides import python_process
from fieldkit.recording.simulate import simulate

SESSIONS, ROUNDS = 1000, 3
WHOLE = "whole command, a row for each session with its slopes; two processes where nothing is known"
FIRST = Row("first", "`fieldkit ls` of 1 000 sessions, nothing known", "<= 5", "s", WHOLE)
AGAIN = Row("again", "the same again", "<= 0.5", "s", WHOLE)


def run() -> list[Result]:
    """Both rows; half a minute."""
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent)
        with simulate(folder / "one", seed=1) as session:
            path = session.path
        (folder / "many").mkdir()
        for number in range(SESSIONS):
            os.link(path, folder / "many" / f"s{number:04}.h5")
        rounds = [_first_and_again(folder, number) for number in range(ROUNDS)]
    return [_result(row, times) for row, times in zip((FIRST, AGAIN), zip(*rounds, strict=True), strict=True)]


def _first_and_again(folder: Path, number: int) -> list[tuple[float, float]]:
    cache = folder / f"cache{number}"
    return [python_process("-m", "fieldkit", "ls", folder / "many", cache=cache) for _ in range(2)]


def _result(row: Row, times: tuple[tuple[float, float], ...]) -> Result:
    cpu, wall = zip(*times, strict=True)
    note = f"{min(wall):.2f} to {max(wall):.2f} in {ROUNDS} rounds; {statistics.median(cpu):.2f} s of CPU"
    return row.result(statistics.median(wall), note)
