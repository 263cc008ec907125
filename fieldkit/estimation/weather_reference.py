"""A level surface that is computed from the weather, as the reference of regions without one beside them.

An experiment: the models `paper` and `full` compare with it as with a measured region. It is as uncertain as
its kind of surface: gain and heat exchange by their priors, longwave that was not measured, the air. With one
declination of the sun the gain and the tilt along the meridian are one number; the estimate says so where the
priors decide.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from fieldkit.estimation.balance import MINUTE_S, MinuteLight
from fieldkit.estimation.bins import History, RegionColumns
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.arrays import FloatArray
from fieldkit.model.site import Region, RegionKind
from fieldkit.physics.daylight import clear_sky_longwave
from fieldkit.physics.slab import surface_series

NAME = "level surface by the weather"
INPUTS = ("level gain", "level exchange", "longwave", "air", "level inertia", "level model")
"""Uncertain inputs of the level surface."""
MODEL_SD_K = 1.83
"""Root mean square that the paper found between its model of sand and measured temperatures (Fig. 12)."""
EXACT: FloatArray = np.zeros(len(INPUTS))


def beside_level(
    history: History, regions: Sequence[Region], settings: EstimatorSettings
) -> tuple[History, tuple[Region, ...]]:
    """The targets alone, and after them the level surface as their reference."""
    targets = RegionColumns(tuple(regions)).targets
    emissivity = settings.surface.emissivity
    level = Region(NAME, RegionKind.REFERENCE, ((0.0, 0.0),), 0.0, 0.0, emissivity=emissivity)
    beside = history.only(targets).spread(range(targets.size), targets.size + 1)
    beside.temperature_k[:, -1] = level_k(history, settings)
    return beside, (*(regions[column] for column in targets), level)


def shifted_levels(history: History, settings: EstimatorSettings) -> Iterator[FloatArray]:
    """Temperatures (n, regions) with the last column by each of `INPUTS` a standard uncertainty off."""
    for shifts in np.eye(len(INPUTS)):
        shifted = history.temperature_k.copy()
        shifted[:, -1] = level_k(history, settings, shifts)
        yield shifted


def level_k(history: History, settings: EstimatorSettings, shifts: FloatArray = EXACT) -> FloatArray:
    """Temperature of the level surface in each minute bin (n,), K; NaN without any air temperature.

    It begins at the temperature of the air: give it some hours before those that matter. Light, longwave and
    air are linear between minutes that have them; longwave that was not measured is that of a clear sky.
    `settings` hold surface, layer and priors of its kind, `shifts` (6,) by how many standard uncertainties
    each of `INPUTS` is off.
    """
    if not np.isfinite(history.air_k).any():
        return np.full(len(history), np.nan)
    surface, prior, emissivity = settings.surface, settings.prior, settings.surface.emissivity_broadband
    sds = (prior.gain_sd, prior.exchange_log_sd, prior.longwave_sd_w_m2, prior.air_sd_k)
    gain, exchange, longwave, air, inertia, model = shifts * (*sds, prior.inertia_log_sd, MODEL_SD_K)
    # inertia is the root of conductivity times heat capacity
    conductivity = settings.slab.conductivity_w_m_k * math.exp(2.0 * inertia)
    slab = replace(settings.slab, conductivity_w_m_k=conductivity)
    air_k = _every_minute(history, history.air_k) + air
    down = _every_minute(history, history.longwave_down_w_m2)
    light = _every_minute(history, _global_light(history, settings))
    if not np.isfinite(history.longwave_down_w_m2).any():
        down = clear_sky_longwave(air_k) + longwave
    absorbed = (1.0 + gain) * (1.0 - surface.albedo) * light
    exchanged = np.full_like(air_k, surface.exchange_w_m2_k * math.exp(exchange))
    supplied = absorbed + emissivity * down
    kelvin = surface_series((slab,), air_k[0], MINUTE_S, supplied, exchanged, air_k, emissivity)
    return np.asarray(kelvin[history.minute - history.minute[0]] + model)


def _global_light(history: History, settings: EstimatorSettings) -> FloatArray:
    """Global horizontal light (n,), W/m2; NaN where it is day and was not measured."""
    diffuse = MinuteLight.of(history, settings).diffuse
    by_day = history.dni_w_m2 * history.sun[:, 2] + diffuse
    return np.where(history.sun[:, 2] > 0.0, by_day, np.nan_to_num(history.dhi_w_m2))


def _every_minute(history: History, values: FloatArray) -> FloatArray:
    """Values (n,) of minute bins at every minute from the first to the last, linear over gaps."""
    seen = np.isfinite(values)
    minutes = np.arange(history.minute[0], history.minute[-1] + 1)
    return np.interp(minutes, history.minute[seen], values[seen]) if seen.any() else np.zeros(minutes.size)
