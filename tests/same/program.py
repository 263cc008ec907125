"""The command line of one checkout, run as a user runs it."""

from __future__ import annotations

import os
import subprocess
from dataclasses import dataclass
from pathlib import Path

LONGEST_S = 1800.0


@dataclass(frozen=True, slots=True)
class Program:
    """``fieldkit`` of a checkout with its own virtual environment."""

    checkout: Path

    def __post_init__(self) -> None:
        if not self._file.is_file():
            raise SystemExit(f"{self.checkout} has no .venv/bin/fieldkit; run make test there first")

    @property
    def _file(self) -> Path:
        return self.checkout / ".venv/bin/fieldkit"

    def run(self, *words: str | Path, cwd: Path) -> str:
        """What a command prints, its messages and its exit code if that is not 0 behind it.

        Results kept from an earlier run would hide a difference: each run has a cache of its own.
        """
        environment = {**os.environ, "XDG_CACHE_HOME": str(cwd / ".cache"), "NO_COLOR": "1", "COLUMNS": "200"}
        done = subprocess.run(
            [self._file, *map(str, words)],
            cwd=cwd,
            env=environment,
            capture_output=True,
            text=True,
            timeout=LONGEST_S,
        )
        return done.stdout + (f"exit code {done.returncode}\n{done.stderr}" if done.returncode else "")
