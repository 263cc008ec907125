"""Slopes from a table of temperatures, without a session or a camera of fieldkit's.

Rows are averaged into minute bins. Temperatures are surface temperatures and used as they stand: emissivity
must be corrected before.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from fieldkit.estimation.bins import History, group_means
from fieldkit.estimation.chain import SlopeChain, rows_after_gaps
from fieldkit.estimation.computed_reference import require_measured_reference
from fieldkit.estimation.instruments import pyranometer
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.together import Part
from fieldkit.model.arrays import FloatArray, IntArray
from fieldkit.model.errors import ConfigError
from fieldkit.model.limits import Excess, bounds_by_name, excesses
from fieldkit.model.samples import is_usable
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.model.slope import SlopeEstimate
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.irradiance import IrradianceModel, direct_normal
from fieldkit.physics.sun import sun_vectors


@dataclass(frozen=True, slots=True)
class TemperatureTable:
    """Columns (n,) of a table in order of time: UTC nanoseconds, kelvin, W/m2, lux, m/s; NaN where missing.

    Either `irradiance_w_m2` (direct normal), `ghi_w_m2` (global horizontal) or `illuminance_lx` (as the
    irradiance model's mounting says) is given; the first available one is used.
    `flags` are `Quality` numbers; rows that are not usable (`fieldkit.model.samples.UNUSABLE`) are excluded.
    `lines` are those of a file that the rows stand in.
    """

    time_ns: IntArray
    reference_k: FloatArray
    targets_k: Mapping[str, FloatArray]
    irradiance_w_m2: FloatArray | None = None
    ghi_w_m2: FloatArray | None = None
    illuminance_lx: FloatArray | None = None
    diffuse_w_m2: FloatArray | None = None
    longwave_w_m2: FloatArray | None = None
    air_k: FloatArray | None = None
    wind_m_s: FloatArray | None = None
    flags: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    lines: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))


def slopes_of_part(part: Part) -> tuple[SlopeEstimate, ...]:
    """Slope of every target over a whole table, also of several days, or over the window at its end."""
    chain = SlopeChain(part.regions, part.settings)
    if part.settings.model == "learned":
        if part.settings.reference == "region":
            require_measured_reference(part.name, part.history, part.regions)
        if rows_after_gaps(part.history):
            return chain.together([part.history]).slopes
    return chain.at(part.history).slopes


def as_part(
    name: str,
    table: TemperatureTable,
    site: Site,
    settings: EstimatorSettings,
    reference_slope_deg: tuple[float, float] = (0.0, 0.0),
    azimuths_deg: Mapping[str, float] = MappingProxyType({}),
) -> Part:
    """The minute bins of a table, up to its last minute of sun, and its regions.

    Three bins are enough for a slope: a table of a few hours may well have hourly rows. Tilt and azimuth of
    the reference, and azimuths of targets for ``settings.azimuth == "known"``, are in degrees. Raises
    `ConfigError` if the columns of sunlight do not fit the irradiance model.
    """
    none = ((0.0, 0.0),)
    regions = [Region("reference", RegionKind.REFERENCE, none, *reference_slope_deg)] + [
        Region(target, RegionKind.TARGET, none, azimuth_deg=azimuths_deg.get(target, float("nan")))
        for target in table.targets_k
    ]
    settings = replace(settings, irradiance=_light_model(table, settings.irradiance))
    history = _history(possible(table, site, settings)[0], site, settings)
    sunlit = np.flatnonzero(history.sun[:, 2] >= np.sin(np.radians(settings.low_sun_deg)))
    day = history.until(int(sunlit[-1]) + 1) if sunlit.size else history
    return Part(name, site, tuple(regions), day, replace(settings, min_minutes=3))


_LIMITS = {
    "irradiance_w_m2": "dni",
    "ghi_w_m2": "ghi",
    "illuminance_lx": "illuminance",
    "diffuse_w_m2": "dhi",
    "longwave_w_m2": "longwave_down",
    "air_k": "air_temperature",
    "wind_m_s": "wind_speed",
}
"""Columns beside those of surfaces, and their rows of the table of limits (`fieldkit.model.limits`)."""


def possible(
    table: TemperatureTable, site: Site, settings: EstimatorSettings
) -> tuple[TemperatureTable, list[Excess]]:
    """The table without the values that cannot be, NaN in their place, and what was excluded by column."""
    columns = {name: getattr(table, name) for name in _LIMITS if getattr(table, name) is not None}
    surfaces = {"reference": table.reference_k, **table.targets_k}
    bounds = bounds_by_name(
        ["surface_temperature"] * len(surfaces) + [_LIMITS[name] for name in columns], settings.limits
    )
    values = np.column_stack([*surfaces.values(), *columns.values()])
    sun = sun_vectors(table.time_ns, site, refraction=settings.refraction).reshape(-1, 3)
    exceeded = bounds.is_exceeded(values, sun[:, 2])
    reference, *others = np.where(exceeded, np.nan, values).T
    targets = dict(zip(table.targets_k, others, strict=False))
    kept = dict(zip(columns, others[len(targets) :], strict=True))
    labels = [(f"{name}_k", "K") for name in surfaces] + [(name, "") for name in columns]
    exceeding = excesses(labels, bounds, values, exceeded)
    return replace(table, reference_k=reference, targets_k=targets, **kept), exceeding


def _history(table: TemperatureTable, site: Site, settings: EstimatorSettings) -> History:
    time_ns, rows = table.time_ns, table.time_ns.size
    flags = table.flags if table.flags.size else np.zeros(rows, np.int64)
    sun = sun_vectors(time_ns, site, refraction=settings.refraction).reshape(-1, 3)
    weather = {
        "dni_w_m2": _direct(table, sun, settings),
        "dhi_w_m2": table.diffuse_w_m2,
        "longwave_down_w_m2": table.longwave_w_m2,
        "air_k": table.air_k,
        "wind_m_s": table.wind_m_s,
    }
    logged = {name: column for name, column in weather.items() if column is not None}
    values = np.column_stack([*logged.values(), table.reference_k, *table.targets_k.values()])
    values[~is_usable(flags)] = np.nan
    minutes, start = np.unique(time_ns // MINUTE_NS, return_index=True)
    means = group_means(values, start)
    counts = np.diff(np.append(start, rows))
    middle = np.add.reduceat(time_ns - minutes[0] * MINUTE_NS, start) // counts + minutes[0] * MINUTE_NS
    return History(
        minute=minutes,
        time_ns=middle,
        sun=sun_vectors(middle, site, refraction=settings.refraction).reshape(-1, 3),
        temperature_k=means[:, len(logged) :],
        flags=np.bitwise_or.reduceat(flags, start),
        **dict(zip(logged, means.T, strict=False)),
    )


def _light_model(table: TemperatureTable, model: IrradianceModel) -> IrradianceModel:
    """The model of the column from which direct light needs the fewest assumptions."""
    if table.irradiance_w_m2 is not None:
        return IrradianceModel(kind="file")
    if table.ghi_w_m2 is not None:
        return pyranometer(replace(model, mounting="horizontal"), "ghi_w_m2 is global light")
    if model.is_direct:
        problem = f'"{model.kind}" takes direct light, but the table has lux'
        fix = "omit irradiance.model, or give a column irradiance_w_m2 (direct normal)"
        raise ConfigError(problem, place="irradiance.model", fix=fix)
    return model


def _direct(table: TemperatureTable, sun: FloatArray, settings: EstimatorSettings) -> FloatArray:
    """Direct normal irradiance (n,)."""
    nothing = np.full(table.time_ns.size, np.nan)
    columns = (table.irradiance_w_m2, table.ghi_w_m2, table.illuminance_lx)
    reading = next((column for column in columns if column is not None), nothing)
    diffuse = nothing if table.diffuse_w_m2 is None else table.diffuse_w_m2
    return direct_normal(settings.irradiance, reading, sun, table.time_ns, diffuse)
