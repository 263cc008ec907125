"""When a loss proves nothing: the emulator loses pictures itself where it gets no processor."""

from __future__ import annotations

import os

import pytest


def nothing_lost(lost: int) -> None:
    """Assert that nothing was lost; on an overloaded computer, skip instead of accusing fieldkit.

    The lab alone keeps the load below two.
    """
    load, cores = os.getloadavg()[0], os.cpu_count() or 1
    if lost and load > cores + 1:
        pytest.skip(f"{lost} lost, but the load of this computer is {load:.1f} on {cores} cores")
    assert lost == 0
