"""``fieldkit --help`` in fresh processes: against a bare interpreter, and against importing every command."""

from __future__ import annotations

import resource
import subprocess
import sys

from benchmarks.result import Result

ROUNDS = 15
BARE = "pass"
LAZY = "from fieldkit.cli import main; main(['--help'], prog_name='fieldkit')"
EAGER = (
    "import importlib; from fieldkit.cli import main\n"
    "[importlib.import_module(entry.module) for entry in main.entries.values()]\n"
    "main(['--help'], prog_name='fieldkit')"
)


def _seconds(code: str) -> float:
    """Processor time of a fresh interpreter: what it waits for a busy computer does not count."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def run() -> list[Result]:
    """The quickest of fresh processes, taken in turn."""
    for code in (BARE, LAZY, EAGER):
        _seconds(code)  # warm: compiled files and disk cache
    rounds = [[_seconds(code) for code in (BARE, LAZY, EAGER)] for _ in range(ROUNDS)]
    bare, lazy, eager = (min(times) for times in zip(*rounds, strict=True))
    return [
        Result("fieldkit --help above python -c pass", 1e3 * (lazy - bare), "ms", "< 75",
               f"{1e3 * lazy:.0f} ms against {1e3 * bare:.0f} ms"),
        Result("every command imported over lazy", (eager - bare) / (lazy - bare), "x", ">= 3",
               f"{1e3 * eager:.0f} ms with every command imported"),
    ]  # fmt: skip
