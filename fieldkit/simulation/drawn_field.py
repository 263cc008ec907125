"""A field drawn by a seed: sand, air, sky and meters vary as on measured ground, beyond what is configured.

Fits of one-dimensional conduction to radiometers over cinder and clay find a heat exchange of 3 + 1.8 U and
4 + 1.7 U W m-2 K-1 (U wind in m/s) and a thermal inertia of 380 to 590 J m-2 K-1 s-1/2: `Spread` covers both.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any
from zlib import crc32

import numpy as np

from fieldkit.physics.slab import Slab, Stack
from fieldkit.simulation.facets import Facet
from fieldkit.simulation.gusts import Gusts, GustySky
from fieldkit.simulation.scene import Scene
from fieldkit.simulation.scene_series import Exchange
from fieldkit.simulation.sky import ClearSky, Sky

Range = tuple[float, float]

BOTTOMLESS: Mapping[str, Any] = {"depth_m": 0.35, "layers": 8, "growth": 1.5}
"""More sand below, which heat does not cross within a session."""


@dataclass(frozen=True, slots=True)
class Spread:
    """Distributions of a drawn field: ranges are uniform in the logarithm, shares are probabilities.

    `inertia` and `damp_conductivity` are ratios to the dry `sand`, `depth_m` is uniform. A damp bed is dry
    sand of `crust_m` over damp sand, which holds `DAMP_CAPACITY` as much heat, and darker by `damp_albedo`.
    Each bed differs from the common albedo and emissivity by `own_albedo_sd` and `own_emissivity_sd`.
    """

    sand: Slab = field(default_factory=Slab)
    depth_m: Range = (0.02, 0.06)
    deep_share: float = 0.2
    inertia: Range = (0.65, 1.4)
    damp_share: float = 0.15
    damp_conductivity: Range = (2.0, 5.0)
    crust_m: Range = (0.003, 0.015)
    damp_albedo: float = 0.03
    albedo_sd: float = 0.03
    own_albedo_sd: float = 0.005
    own_emissivity_sd: float = 0.005
    still_w_m2_k: Range = (3.0, 25.0)
    per_wind: Range = (1.5, 2.1)
    intensity: Range = (0.15, 0.35)
    convective_m_s: Range = (0.2, 0.8)
    gust_time_scale_s: Range = (30.0, 200.0)
    linke_turbidity: Range = (2.0, 5.0)
    light_sd: float = 0.08
    longwave_sd_w_m2: float = 30.0
    air_sd_k: float = 0.5


DAMP_CAPACITY = 1.4
"""Heat capacity of damp over dry sand: a tenth of its volume is water."""


@dataclass(frozen=True, slots=True)
class DrawnField:
    """Truths of a field that are not configured.

    `sand` is the dry sand of all beds; `circumsolar_share` 0 for a uniform sky to 1 for that of Hay and
    Davies. `light_factor` is the reading of the light meters over the truth; the errors of longwave and air
    temperature are added to theirs. [-], [W/m2], [K]
    """

    seed: int
    spread: Spread
    sand: Stack
    albedo_error: float
    exchange: Exchange
    gusts: Gusts | None
    circumsolar_share: float
    linke_turbidity: float
    light_factor: float
    longwave_error_w_m2: float
    air_error_k: float

    def bed(self, facet: Facet) -> Facet:
        """The facet with this field's sand; what is its own follows from its name."""
        random = np.random.default_rng([self.seed, crc32(facet.name.encode())])
        is_damp = random.random() < self.spread.damp_share
        albedo, grey = random.standard_normal(2) * (self.spread.own_albedo_sd, self.spread.own_emissivity_sd)
        stack = self._damp(random) if is_damp else self.sand
        albedo += facet.albedo + self.albedo_error - is_damp * self.spread.damp_albedo
        return replace(
            with_stack(facet, stack),
            albedo=float(np.clip(albedo, 0.02, 0.95)),
            emissivity=float(np.clip(facet.emissivity + grey, 0.02, 1.0)),
            emissivity_broadband=float(np.clip(facet.emissivity_broadband + grey, 0.02, 1.0)),
        )

    def sky(self, sky: Sky) -> Sky:
        """The sky with gusts, and with this field's haze where a formula makes it."""
        if isinstance(sky, ClearSky):
            sky = replace(sky, linke_turbidity=self.linke_turbidity)
        return sky if self.gusts is None else GustySky(sky, self.gusts)

    def _damp(self, random: np.random.Generator) -> Stack:
        dry, *below = self.sand
        spread = self.spread
        crust_m, wetter = (_between(random, limits) for limits in (spread.crust_m, spread.damp_conductivity))
        damp = [
            replace(
                slab,
                conductivity_w_m_k=slab.conductivity_w_m_k * wetter,
                heat_capacity_j_m3_k=slab.heat_capacity_j_m3_k * DAMP_CAPACITY,
            )
            for slab in (replace(dry, depth_m=dry.depth_m - crust_m), *below)
        ]
        return (replace(dry, depth_m=crust_m), *damp)


def drawn_field(seed: int, spread: Spread | None = None) -> DrawnField:
    """The field of that seed."""
    wide, random = spread or Spread(), np.random.default_rng([seed, 7])
    inertia = _between(random, wide.inertia)
    # dry sand differs far more in conductivity than in heat capacity
    top = replace(
        wide.sand,
        depth_m=float(random.uniform(*wide.depth_m)),
        conductivity_w_m_k=wide.sand.conductivity_w_m_k * inertia**2,
    )
    return DrawnField(
        seed=seed,
        spread=wide,
        sand=(top, replace(top, **BOTTOMLESS)) if random.random() < wide.deep_share else (top,),
        albedo_error=wide.albedo_sd * random.standard_normal(),
        exchange=Exchange(_between(random, wide.still_w_m2_k), _between(random, wide.per_wind)),
        gusts=Gusts(
            seed,
            _between(random, wide.intensity),
            _between(random, wide.convective_m_s),
            _between(random, wide.gust_time_scale_s),
        ),
        circumsolar_share=float(random.uniform()),
        linke_turbidity=_between(random, wide.linke_turbidity),
        light_factor=1.0 + wide.light_sd * random.standard_normal(),
        longwave_error_w_m2=wide.longwave_sd_w_m2 * random.standard_normal(),
        air_error_k=wide.air_sd_k * random.standard_normal(),
    )


def drawn_scene(scene: Scene) -> Scene:
    """The same beds, ground, day and faults in the field of the scene's seed."""
    field = drawn_field(scene.seed)
    return replace(
        scene,
        sky=field.sky(scene.sky),
        facets=tuple(field.bed(facet) for facet in scene.facets),
        ground=scene.ground if scene.terrain is None else field.bed(scene.ground),
        exchange=field.exchange,
        circumsolar_share=field.circumsolar_share,
        light_factor=field.light_factor,
    )


def with_stack(facet: Facet, stack: Stack) -> Facet:
    """The facet on these layers."""
    top, *below = stack
    return replace(
        facet,
        depth_m=top.depth_m,
        conductivity_w_m_k=top.conductivity_w_m_k,
        heat_capacity_j_m3_k=top.heat_capacity_j_m3_k,
        below=tuple(below),
    )


def _between(random: np.random.Generator, limits: Range) -> float:
    low, high = np.log(limits)
    return float(np.exp(random.uniform(low, high)))
