"""Writing what a damaged session still has: a part that cannot be read loses only itself."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from fieldkit.model.errors import IncompleteError, SessionError


def all_but_unreadable(parts: Iterable[tuple[str, Callable[[], Path]]]) -> list[Path]:
    """Write one part after the other, each of them a file.

    Raises `IncompleteError`, when all the others are written, with the names of those that cannot be read.
    """
    written, missing = [], []
    for name, write in parts:
        try:
            written.append(write())
        except (SessionError, OSError, RuntimeError) as error:
            if "errno" in str(error).lower():  # HDF5 names the system's error in its text: a full disk
                raise
            missing.append(f"{name}: {error}")
    if missing:
        raise IncompleteError("not exported: " + "; ".join(missing), written)
    return written
