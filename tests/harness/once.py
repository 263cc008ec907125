"""What tests of several workers read is made once in a run."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from fieldkit.disk import one_at_a_time


def folder_of_run(factory: pytest.TempPathFactory) -> Path:
    """The folder that all workers share."""
    folder = factory.getbasetemp()
    return folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], None]) -> Path:
    """A folder that `make` fills, called by the worker that comes first; tests change only copies of it."""
    run = folder_of_run(factory)
    made, is_complete = run / name, run / f"{name}.complete"
    with one_at_a_time(run):
        if not is_complete.exists():
            make(made)
            is_complete.touch()
    return made
