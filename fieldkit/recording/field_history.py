"""Minute bins of a simulated field without its instruments: for plans and benchmarks of estimators."""

from __future__ import annotations

import numpy as np

from fieldkit.estimation.bins import History
from fieldkit.model.samples import Quality
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.sun import sun_vectors
from fieldkit.simulation.field_minutes import field_minutes
from fieldkit.simulation.scene_series import SceneModel


def field_history(model: SceneModel, start_ns: int, minutes: int) -> History:
    """Minute bins of a scene as instruments without errors would measure them, shade under boards marked.

    Parameters
    ----------
    model
        Beds under a sky; the beds are the regions.
    start_ns
        Start, UTC nanoseconds since 1970, at a whole minute; the sand begins to store heat then.
    minutes
        How many.
    """
    field = field_minutes(model, start_ns, minutes)
    return History(
        minute=field.time_ns // MINUTE_NS,
        time_ns=field.time_ns,
        sun=sun_vectors(field.time_ns, model.site),
        temperature_k=field.surface_k,
        dni_w_m2=field.dni_w_m2,
        dhi_w_m2=field.dhi_w_m2,
        longwave_down_w_m2=field.longwave_down_w_m2,
        flags=np.zeros(minutes, np.int64),
        region_flags=np.where(field.is_shaded, int(Quality.SHADED), 0),
        air_k=field.air_k,
        wind_m_s=field.wind_m_s,
    )
