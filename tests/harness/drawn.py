"""Drawn worlds of the benchmarks, skipped without the file of a measured sky; later days, tables of them."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import drawn_worlds
from benchmarks.drawn_worlds import BROKEN_CLOUD
from fieldkit.estimation.bins import History
from fieldkit.model.arrays import FloatArray
from fieldkit.model.units import DAY_S, MINUTE_NS
from tests.shared_data import shared


def drawn_world(seed: int, day: str, **options: Any) -> drawn_worlds.World:
    """As `benchmarks.drawn_worlds.drawn_world`."""
    if day == BROKEN_CLOUD:
        shared("data/weather/slv15365.dat")
    return drawn_worlds.drawn_world(seed, day, **options)


def later(history: History, days: int = 1) -> History:
    """The same minutes some days later, under the same sun."""
    minutes = days * DAY_S // 60
    return replace(history, minute=history.minute + minutes, time_ns=history.time_ns + minutes * MINUTE_NS)


def write_table(path: Path, history: History, **columns: FloatArray) -> Path:
    """A table of temperatures with the air and the light of a history."""
    columns |= {
        "air_k": history.air_k,
        "irradiance_w_m2": history.dni_w_m2,
        "diffuse_w_m2": history.dhi_w_m2,
    }
    times = np.datetime_as_string(history.time_ns.astype("datetime64[ns]"), unit="s")
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["time", *columns])
        writer.writerows(zip(np.char.add(times, "Z"), *columns.values(), strict=True))
    return path
