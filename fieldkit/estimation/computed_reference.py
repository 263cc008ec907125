"""A reference that was computed from the weather is recognised by what it lacks: scatter.

Gusts, and errors of the weather's instruments, reach every surface on the spot and stand in no column. A
temperature that was computed from the columns follows them without a remainder, and an estimate would take
it for an exact meter of gain and exchange.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fieldkit.estimation.bins import History, RegionColumns
from fieldkit.model.arrays import BoolArray, FloatArray
from fieldkit.model.errors import ConfigError
from fieldkit.model.site import Region, RegionKind

LEAST_SCATTER = 0.04
"""Remainder of a measured reference over the least of the targets, at least.

Judged: because computed plates have at most a thirty-seventh of a measured module's, and of all measured
pairs the least, soil under grass beside a wall, has an eighteenth.
"""
LEAST_ROWS = 20
"""Rows beyond the numbers that are fitted, with fewer of which nothing is judged."""


def require_measured_reference(name: str, history: History, regions: Sequence[Region]) -> None:
    """Raise `ConfigError` if a reference of the minutes `name` has no scatter, and all targets have."""
    columns, remainders_k = RegionColumns(tuple(regions)), remainder_k(history)
    targets_k = remainders_k[columns.targets]
    least_k = float(targets_k.min()) if targets_k.size and np.isfinite(targets_k).all() else 0.0
    for region, own_k in zip(regions, remainders_k.tolist(), strict=True):
        if region.kind is RegionKind.REFERENCE and own_k < LEAST_SCATTER * least_k:
            raise ConfigError(
                f"region {region.name} follows light, air and wind to {own_k:.3f} K, where the targets "
                f"scatter by {least_k:.2f} K or more: it is computed, not measured",
                place=name,
                fix='give temperatures of a measured reference, or set estimator.reference = "weather"',
            )


def remainder_k(history: History) -> FloatArray:
    """Standard deviation (regions,) of what weather and the row before do not explain in sunlit rows, K."""
    columns = (history.air_k, history.dhi_w_m2, history.longwave_down_w_m2, history.wind_m_s)
    logged = [column for column in columns if np.isfinite(column).any()]
    weather = np.column_stack([history.dni_w_m2 * history.sun[:, 2], history.dni_w_m2, *logged])
    step = np.diff(history.minute, prepend=history.minute[:1] - 1_000_000)
    rows = (history.dni_w_m2 > 0.0) & np.isfinite(weather).all(axis=1) & (step == np.median(step))
    return np.array([_unexplained_k(kelvin, weather, rows) for kelvin in history.temperature_k.T])


def _unexplained_k(kelvin: FloatArray, weather: FloatArray, rows: BoolArray) -> float:
    before = np.roll(np.column_stack([weather, kelvin]), 1, axis=0)
    explaining = np.column_stack([weather, before])
    used = rows & np.isfinite(kelvin) & np.isfinite(explaining).all(axis=1)
    free = int(used.sum()) - explaining.shape[1] - 1
    if free < LEAST_ROWS:
        return np.nan
    centred = explaining[used] - explaining[used].mean(axis=0)
    off = kelvin[used] - kelvin[used].mean()
    rest = off - centred @ np.linalg.lstsq(centred, off)[0]
    return float(np.sqrt(rest @ rest / free))
