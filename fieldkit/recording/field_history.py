"""Minute bins of a simulated field without its instruments: for plans and benchmarks of estimators."""

from __future__ import annotations

import numpy as np

from fieldkit.estimation.bins import History
from fieldkit.model.samples import Quality
from fieldkit.model.site import Site
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.sun import sun_vectors
from fieldkit.simulation.field_minutes import FieldMinutes, field_minutes
from fieldkit.simulation.scene_series import SceneModel


def history_of(field: FieldMinutes, site: Site) -> History:
    """Minute bins as instruments without errors would measure this field, shade under boards marked.

    Parameters
    ----------
    field
        What `fieldkit.predict` returns.
    site
        Where, for the sun.

    Examples
    --------
    >>> import fieldkit.weather
    >>> day = fieldkit.weather.packaged_day()
    >>> found = fieldkit.predict([(0, 180), (15, 180)], day, start="2016-01-01T09:00-07:00", minutes=240)
    >>> noon = fieldkit.recording.field_history.history_of(found, day.site).since(180)
    >>> reference, target = fieldkit.model.site.RegionKind
    >>> beds = [fieldkit.Region("flat", reference, (), 0.0, 0.0), fieldkit.Region("b15", target, ())]
    >>> settings = fieldkit.estimation.settings.EstimatorSettings(model="full")
    >>> fieldkit.estimation.chain.SlopeChain(beds, settings).at(noon).slopes
    (<b15: tilt 16.6° (11.4 to 24.0), azimuth 183°, uncertain>,)
    """
    return History(
        minute=field.time_ns // MINUTE_NS,
        time_ns=field.time_ns,
        sun=sun_vectors(field.time_ns, site),
        temperature_k=field.surface_k,
        dni_w_m2=field.dni_w_m2,
        dhi_w_m2=field.dhi_w_m2,
        longwave_down_w_m2=field.longwave_down_w_m2,
        region_flags=np.where(field.is_shaded, int(Quality.SHADED), 0),
        air_k=field.air_k,
        wind_m_s=field.wind_m_s,
    )


def field_history(model: SceneModel, start_ns: int, minutes: int) -> History:
    """The first minute bins of a scene, see `history_of`.

    Parameters
    ----------
    model
        Beds under a sky; the beds are the regions.
    start_ns
        Start, UTC nanoseconds since 1970, at a whole minute; the sand begins to store heat then.
    minutes
        How many.
    """
    return history_of(field_minutes(model, start_ns, minutes), model.site)
