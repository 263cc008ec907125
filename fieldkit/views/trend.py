"""Temperatures and tilts of a recording's regions minute by minute, for small charts beside the present."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fieldkit.estimation.estimator import Minute


@dataclass
class Trend:
    """One value per minute and region, NaN where there is none; `times_ns` are UTC nanoseconds.

    `temperature_k` in kelvin and `tilt_deg` in degrees, by the region's name, as long as `times_ns`.
    """

    times_ns: list[int] = field(default_factory=list)
    temperature_k: dict[str, list[float]] = field(default_factory=dict)
    tilt_deg: dict[str, list[float]] = field(default_factory=dict)

    def add(self, minute: Minute) -> None:
        """Append a minute's values; a region that is new has none for the minutes before."""
        tilts = {one.region: one.tilt_deg for one in minute.estimates}
        for columns, values in ((self.temperature_k, minute.temperature_k), (self.tilt_deg, tilts)):
            _append(columns, values, len(self.times_ns))
        self.times_ns.append(minute.time_ns)


def _append(columns: dict[str, list[float]], values: Mapping[str, float], count: int) -> None:
    for name in values.keys() - columns.keys():
        columns[name] = [math.nan] * count
    for name, column in columns.items():
        column.append(values.get(name, math.nan))
