"""The drawn worlds of the benchmarks; those under a measured sky are skipped where its file is missing."""

from __future__ import annotations

from typing import Any

from benchmarks import drawn_worlds
from benchmarks.drawn_worlds import BROKEN_CLOUD
from tests.shared_data import shared


def drawn_world(seed: int, day: str, **options: Any) -> drawn_worlds.World:
    """As `benchmarks.drawn_worlds.drawn_world`."""
    if day == BROKEN_CLOUD:
        shared("data/weather/slv15365.dat")
    return drawn_worlds.drawn_world(seed, day, **options)
