"""Predicted temperatures of facets under given weather: the field that plans and benchmarks are made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime

import numpy as np

from fieldkit.estimation.bins import History
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.clock import as_moment, utc_ns
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.model.samples import Quality
from fieldkit.model.site import Site
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.sun import sun_vectors
from fieldkit.results.sun_angles import checked_facets
from fieldkit.simulation.facets import Facet
from fieldkit.simulation.field_minutes import FieldMinutes, field_minutes
from fieldkit.simulation.scene_series import Exchange, SceneModel
from fieldkit.simulation.sky import MeasuredSky, Sky
from fieldkit.weather import Weather


def predict(
    facets: Sequence[tuple[float, float]],
    weather: Weather,
    *,
    start: datetime | str | None = None,
    minutes: int | None = None,
    settings: EstimatorSettings | None = None,
    exchange: Exchange | float | None = None,
) -> FieldMinutes:
    """Surface temperatures of facets under given weather, by the minute: the forward model of plans.

    Sun, diffuse and reflected light, longwave of sky and ground, exchange with the air, and conduction into
    the layer. A facet starts in balance with the first minute, its whole layer at that temperature: begin
    some hours before the minutes that matter.

    Parameters
    ----------
    facets
        Tilt and azimuth of each, (k, 2). [degrees]
    weather
        Sky and air, also of your own arrays; linear between its times.
    start
        Begin, with its zone or as ISO 8601; by default with the weather.
    minutes
        How many; by default to the end of the weather.
    settings
        Surface, slab, priors, horizon and the ground's albedo, such as
        ``campaign.config.estimator_settings()``; by default those of dry sand.
    exchange
        With the air: a number [W m-2 K-1] or an `Exchange` by wind; by default the median of the prior.

    Returns
    -------
    FieldMinutes
        Times (n,) in the middle of each minute, temperatures (n, k) in kelvin, and the weather's means (n,).
        `fieldkit.recording.predict.history_of` makes of it what estimators take.

    Raises
    ------
    ConfigError
        As `checked_facets`; for an exchange below 0 or NaN; if the weather lacks a quantity, is of another
        day or ends before.

    Examples
    --------
    >>> import fieldkit.weather
    >>> day = fieldkit.weather.packaged_day()
    >>> found = fieldkit.predict([(0, 180), (15, 180)], day, start="2016-01-01T09:00-07:00", minutes=240)
    >>> found.surface_k[-1].round(1).tolist()
    [285.5, 294.8]
    """
    facets = checked_facets(facets)
    estimator = settings or EstimatorSettings()
    first_ns, last_ns = (int(weather.time_ns[end]) for end in (0, -1))
    start_ns = utc_ns(as_moment(start)) if start else first_ns
    start_ns = -(-start_ns // MINUTE_NS) * MINUTE_NS
    most = (last_ns - start_ns) // MINUTE_NS
    if minutes is not None and most > 0 and not 1 <= minutes <= most:
        raise ConfigError(
            f"the weather gives 1 to {most} from the start on, not {minutes}",
            place=Argument("minutes"),
            fix="give fewer minutes, or an earlier start",
        )
    with_air = estimator.prior.exchange_w_m2_k if exchange is None else exchange
    by_wind = with_air if isinstance(with_air, Exchange) else Exchange(with_air, 0.0)
    if not (by_wind.still_w_m2_k >= 0.0 and by_wind.per_wind >= 0.0):
        raise ConfigError(
            f"{by_wind} is not an exchange with the air",
            place=Argument("exchange"),
            fix="give numbers of 0 or more",
        )
    model = expected_field(weather.site, MeasuredSky(weather), facets, estimator, by_wind)
    return field_minutes(model, start_ns, minutes or max(most, 1))


def expected_field(
    site: Site,
    sky: Sky,
    facets: Sequence[tuple[float, float]],
    settings: EstimatorSettings,
    exchange: Exchange,
) -> SceneModel:
    """The field that the settings expect: beds ``region 1`` ... of their material, around them level ground.

    Parameters
    ----------
    site, sky
        Place, light and air.
    facets
        Tilt and azimuth of each bed. [degrees]
    settings
        Surface, slab, horizon, the ground's albedo and the circumsolar share.
    exchange
        With the air, by wind.
    """
    beds = tuple(_bed(f"region {number}", *facet, settings) for number, facet in enumerate(facets, start=1))
    ground = replace(beds[0], tilt_deg=0.0, albedo=settings.ground_albedo)
    share = settings.prior.circumsolar_share
    return SceneModel(site, sky, beds, ground, exchange, (), 1.0, circumsolar_share=share)


def _bed(name: str, tilt_deg: float, azimuth_deg: float, settings: EstimatorSettings) -> Facet:
    surface, slab = settings.surface, settings.slab
    return Facet(
        name,
        (),
        tilt_deg,
        azimuth_deg,
        albedo=surface.albedo,
        emissivity=surface.emissivity,
        emissivity_broadband=surface.emissivity_broadband,
        depth_m=slab.depth_m,
        conductivity_w_m_k=slab.conductivity_w_m_k,
        heat_capacity_j_m3_k=slab.heat_capacity_j_m3_k,
        horizon=settings.horizon,
    )


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
    >>> noon = fieldkit.recording.predict.history_of(found, day.site).since(180)
    >>> reference, target, *_ = fieldkit.model.site.RegionKind
    >>> beds = [fieldkit.Region("flat", reference, (), 0.0, 0.0), fieldkit.Region("b15", target, ())]
    >>> settings = fieldkit.estimation.settings.EstimatorSettings(model="full")
    >>> fieldkit.estimation.chain.SlopeChain(beds, settings).at(noon).slopes
    (<b15: tilt 16.6° (11.4 to 24.0), azimuth 183°, wide>,)
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
