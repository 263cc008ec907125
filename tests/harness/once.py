"""What tests of several workers read is made once in a run."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from fieldkit.disk import one_at_a_time


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], None]) -> Path:
    """A folder that `make` fills, called by the worker that comes first; tests change only copies of it."""
    run = factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        run = run.parent  # which all workers share
    made, is_complete = run / name, run / f"{name}.complete"
    with one_at_a_time(run):
        if not is_complete.exists():
            make(made)
            is_complete.touch()
    return made
