"""``fieldkit --help`` in fresh processes, beside importing click alone and importing every command."""

from __future__ import annotations

import resource
import subprocess
import sys

from benchmarks.result import Result, Row
from benchmarks.sides import share, times_as_fast

ROUNDS = 15
BARE = "import click"
LAZY = "from fieldkit.cli import main; main(['--help'], prog_name='fieldkit')"
EAGER = (
    "import importlib; from fieldkit.cli import main\n"
    "[importlib.import_module(entry.module) for entry in main.entries.values()]\n"
    "main(['--help'], prog_name='fieldkit')"
)
PROCESS = "CPU of a fresh process, interpreter included"
OVER_CLICK = Row("help", "`fieldkit --help` over `python -c 'import click'`", "<= 1.3", included=PROCESS)
OVER_LAZY = Row("lazy", "importing every command over `fieldkit --help`", ">= 3", included=PROCESS)


def run() -> list[Result]:
    """Fresh processes, taken in turn."""
    for code in (BARE, LAZY, EAGER):
        _seconds(code)  # warm: compiled files and disk cache
    rounds = [[_seconds(code) for code in (BARE, LAZY, EAGER)] for _ in range(ROUNDS)]
    return [
        share(OVER_CLICK, [(lazy, bare) for bare, lazy, _ in rounds]),
        times_as_fast(OVER_LAZY, [(lazy, eager) for _, lazy, eager in rounds]),
    ]


def _seconds(code: str) -> float:
    """Processor time of a fresh interpreter: what it waits for a busy computer does not count."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
