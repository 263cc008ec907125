"""Recorded files of others, read where a `shared` folder stands beside the project."""

from pathlib import Path

import pytest

NO_SHARED_DATA = "no shared data beside the project"
SHARED = Path(__file__).parents[2] / "shared"


def shared(path: str) -> Path:
    """A file of the shared folder; skips the test where there is no such folder."""
    if not SHARED.exists():
        pytest.skip(NO_SHARED_DATA)
    return SHARED / path
