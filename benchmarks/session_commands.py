"""Whole commands: the demo; ``check`` and ``report`` of three hours and ``plan``, first and again."""

from __future__ import annotations

import statistics
import tempfile
from functools import partial
from pathlib import Path

from benchmarks.result import Result, Row
from benchmarks.sides import python_process

ROUNDS = 3
WHOLE = "whole command, three beds, learned model: interpreter, reading, slopes; processor time"
CHECK = Row("check", "`fieldkit check` of 3 h, nothing cached", "<= 2", "s", WHOLE)
CHECK_AGAIN = Row("check-again", "the same of a session that was estimated before", "<= 2", "s", WHOLE)
REPORT = Row("report", "`fieldkit report` of 3 h, nothing cached", "<= 6", "s", f"{WHOLE}; figures")
REPORT_AGAIN = Row(
    "report-again", "the same of a session that was estimated before", "<= 4", "s", f"{WHOLE}; figures"
)
PLAN = Row("plan", "`fieldkit plan` of today, nothing cached", "<= 6", "s", "whole command; processor time")
PLAN_AGAIN = Row("plan-again", "the same again", "<= 1", "s", "whole command; processor time")
DEMO = Row(
    "demo", "`fieldkit demo`, 3 h of field", "<= 20", "s",
    "whole command: recording, live slopes, report; on the clock",
)  # fmt: skip


_fieldkit = partial(python_process, "-m", "fieldkit")


def _record(folder: Path) -> Path:
    """Three hours on simulated instruments."""
    _fieldkit("init", "--simulated", folder, cache=folder)
    _fieldkit("record", "-C", folder, "--for", "3h", "-q", "--set", "simulation.speed=max", cache=folder)
    (path,) = (folder / "recordings").glob("*.h5")
    return path


def _rows(first: Row, again: Row, *words: str) -> list[Result]:
    rounds = []
    for _ in range(ROUNDS):
        with tempfile.TemporaryDirectory() as cache:
            rounds.append([_fieldkit(*words, cache=Path(cache)) for _ in range(2)])
    results = []
    for row, times in zip((first, again), zip(*rounds, strict=True), strict=True):
        cpu, wall = zip(*times, strict=True)
        clock = f"{statistics.median(wall):.2f} s on the clock"
        note = f"{min(cpu):.2f} to {max(cpu):.2f} in {ROUNDS} rounds; {clock}"
        results.append(row.result(statistics.median(cpu), note))
    return results


def _demo(folder: Path) -> Result:
    times = [_fieldkit("demo", "--out", folder / str(at), cache=folder) for at in range(ROUNDS)]
    cpu, wall = zip(*times, strict=True)
    clock = f"{min(wall):.1f} to {max(wall):.1f} in {ROUNDS} rounds"
    note = f"{clock}; {statistics.median(cpu):.1f} s of processor"
    return DEMO.result(statistics.median(wall), note)


def run() -> list[Result]:
    """All rows; three minutes."""
    with tempfile.TemporaryDirectory() as folder:
        path = str(_record(Path(folder) / "campaign"))
        report = ("report", path, "-o", str(Path(folder) / "report.html"))
        plan = ("plan", "-C", str(Path(folder) / "campaign"))
        commands = _rows(CHECK, CHECK_AGAIN, "check", path) + _rows(REPORT, REPORT_AGAIN, *report)
        return [_demo(Path(folder)), *commands, *_rows(PLAN, PLAN_AGAIN, *plan)]
