"""Recorded files of others, read where a `shared` folder stands beside the project."""

from pathlib import Path

import pytest

SHARED = Path(__file__).parents[2] / "shared"


def shared(path: str) -> Path:
    """A file of the shared folder; skips the test where it is not there."""
    found = SHARED / path
    if not found.exists():
        pytest.skip(f"no shared/{path} beside the project")
    return found
