"""A simulated field by the minute: means of what instruments without errors would measure, and the shade."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fieldkit.model.arrays import BoolArray, FloatArray, IntArray
from fieldkit.model.units import MINUTE_NS
from fieldkit.simulation.scene_series import SceneModel


@dataclass(frozen=True, slots=True)
class FieldMinutes:
    """Means over minutes (n,) and beds (n, beds); `time_ns` is the middle of each minute, UTC.

    `is_shaded` (n, beds) is true where a board lies over a bed for a part of the minute at least.
    Temperatures are true ones of the surfaces. [K], [W/m2], [m/s]
    """

    time_ns: IntArray
    surface_k: FloatArray
    dni_w_m2: FloatArray
    dhi_w_m2: FloatArray
    longwave_down_w_m2: FloatArray
    air_k: FloatArray
    wind_m_s: FloatArray
    is_shaded: BoolArray


def field_minutes(model: SceneModel, start_ns: int, minutes: int) -> FieldMinutes:
    """The first minutes of a scene that starts at a whole minute, UTC; the sand begins to store heat then."""
    series = model.series(start_ns, minutes * 60.0)
    edges_s = np.arange(0.0, 60.0 * minutes + 1.0, 60.0)
    below = np.cumsum(0.5 * (series.rows[:, 1:] + series.rows[:, :-1]) * np.diff(series.time_s), axis=1)
    below = np.hstack([np.zeros((len(below), 1)), below])
    columns = np.diff(below[:, np.searchsorted(series.time_s, edges_s)], axis=1) / 60.0
    dni_w_m2, dhi_w_m2, longwave, air_k, wind_m_s = columns[:5]
    time_ns = start_ns + np.arange(minutes) * MINUTE_NS + MINUTE_NS // 2
    surface_k = columns[6 : 6 + len(model.beds)].T
    shaded = _is_shaded(model, edges_s)
    return FieldMinutes(time_ns, surface_k, dni_w_m2, dhi_w_m2, longwave, air_k, wind_m_s, shaded)


def _is_shaded(model: SceneModel, edges_s: FloatArray) -> BoolArray:
    shaded = np.zeros((edges_s.size - 1, len(model.beds)), np.bool_)
    names = [bed.name for bed in model.beds]
    for board in model.boards:
        shaded[:, names.index(board.bed)] |= (edges_s[1:] > board.begin_s) & (edges_s[:-1] < board.end_s)
    return shaded
