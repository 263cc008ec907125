"""Learnt parameters as settings of the full model: for slope maps, solved pixel by pixel in closed form."""

from __future__ import annotations

import math
from dataclasses import replace

from fieldkit.estimation.learned.inputs import sky_longwave
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.learnt import Learnt


def learnt_settings(
    settings: EstimatorSettings, learnt: Learnt, air_k: float = math.nan
) -> EstimatorSettings:
    """Settings of the full model with the medians learnt.

    Gain becomes the scale with its uncertainty; exchange, thermal inertia and depth, diffuse light and
    longwave are replaced. `air_k` is the logged air temperature, NaN without one. [K]
    """
    found = {one.name: one for one in learnt.parameters}
    surface, gain = settings.surface, found["gain"]
    per_m_s = surface.heat_capacity_j_kg_k * surface.air_density_kg_m3
    share = settings.diffuse_fraction / (1.0 - settings.diffuse_fraction) * (1.0 + found["diffuse"].value)
    capacity = settings.slab.heat_capacity_j_m3_k
    return replace(
        settings,
        model="full",
        scale=gain.value,
        scale_sd=gain.sd,
        surface=replace(surface, exchange_m_s=found["exchange"].value / per_m_s),
        slab=replace(
            settings.slab,
            depth_m=found["depth"].value / 100.0,
            conductivity_w_m_k=found["thermal_inertia"].value ** 2 / capacity,
        ),
        diffuse_fraction=share / (1.0 + share),
        longwave_down_w_m2=sky_longwave(air_k, settings) + found["longwave"].value,
    )
