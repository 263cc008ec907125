"""Waiting for what another thread or process does."""

from __future__ import annotations

import time
from collections.abc import Callable

PATIENCE_S = 300.0
"""A busy computer is no failure; only what never comes is."""


def wait_until(
    is_true: Callable[[], object], what: str, seconds: float = PATIENCE_S, every_s: float = 0.01
) -> None:
    """Wait until a function returns something true; `what` failed if it does not."""
    deadline = time.monotonic() + seconds
    while not is_true():
        assert time.monotonic() < deadline, what
        time.sleep(every_s)  # what is awaited has no event that could be waited for
