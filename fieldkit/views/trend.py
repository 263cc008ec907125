"""Temperatures and tilts of a recording's regions minute by minute, for small charts beside the present."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fieldkit.estimation.estimator import Minute


@dataclass(frozen=True)
class Trend:
    """One value per minute and region, NaN where there is none; `times_ns` are UTC nanoseconds.

    `temperature_k` in kelvin and `tilt_deg` in degrees, by the region's name, as long as `times_ns`.
    """

    times_ns: list[int] = field(default_factory=list)
    temperature_k: dict[str, list[float]] = field(default_factory=dict)
    tilt_deg: dict[str, list[float]] = field(default_factory=dict)

    def plus(self, minute: Minute) -> Trend:
        """The same with a minute's values at its end; a minute that it has already changes nothing."""
        if minute.time_ns in self.times_ns[-1:]:
            return self
        tilts = {estimate.region: estimate.tilt_deg for estimate in minute.estimates}
        temperature_k = self._extend(self.temperature_k, minute.temperature_k)
        return Trend([*self.times_ns, minute.time_ns], temperature_k, self._extend(self.tilt_deg, tilts))

    def _extend(
        self, columns: Mapping[str, list[float]], values: Mapping[str, float]
    ) -> dict[str, list[float]]:
        """Columns with one value more; a region that is new has none for the minutes before."""
        names, unknown = {**columns, **values}, [math.nan] * len(self.times_ns)
        return {name: [*columns.get(name, unknown), values.get(name, math.nan)] for name in names}
