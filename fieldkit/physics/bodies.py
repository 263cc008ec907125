"""The worlds on which fieldkit works: what differs between Earth, Mars and Moon, in one object each.

A site names its body; physics, simulation and estimation ask `body_of` and never compare names.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from fieldkit.model.arrays import FloatArray
from fieldkit.model.errors import ConfigError
from fieldkit.model.site import Site
from fieldkit.model.spelling import did_you_mean
from fieldkit.physics.energy_balance import SurfaceParameters
from fieldkit.physics.subsolar import SOL_S, mars_subsolar, moon_subsolar

Subsolar = Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]]
"""Declination, subsolar longitude east and distance of the sun (degrees, degrees, au) at UTC seconds (n,)."""


SUNLIGHT_LM_W = 97.5
"""Luminous efficacy of sunlight above any air: ASTM G173's extraterrestrial spectrum has 133.2 klx in the
1366.1 W/m2 that it belongs to. [lm/W]"""


@dataclass(frozen=True, slots=True)
class Body:
    """Effects of a world on the sun's light and on a surface's heat.

    `day_s` is the mean solar day. `subsolar` gives the sun; None is the Earth, where it is topocentric.
    `dust_optical_depth` is that of a clear day; None is the Earth, whose sky has formulas of its own.
    `rising_deg` is the elevation of the sun's centre when its edge rises. `beam_lm_w` and `sky_lm_w` are the
    luminous efficacies of direct and diffuse light.
    `exchange_w_m2_k` is the exchange of heat with the air, of that heat capacity and density;
    `longwave_down_w_m2` what the sky radiates, `air_temperature_k` the daily mean near the ground. `albedo`,
    `emissivity`, `inertia` (J m-2 K-1 s-1/2) and `heat_capacity_j_m3_k` are those of its loose
    ground.
    """

    name: str
    day_s: float
    subsolar: Subsolar | None
    refracts: bool
    rising_deg: float
    dust_optical_depth: float | None
    beam_lm_w: float
    sky_lm_w: float
    exchange_w_m2_k: float
    air_heat_capacity_j_kg_k: float
    air_density_kg_m3: float
    longwave_down_w_m2: float
    air_temperature_k: float
    albedo: float
    emissivity: float
    inertia: float
    heat_capacity_j_m3_k: float

    @property
    def has_air_of_earth(self) -> bool:
        """True if formulas of the Earth's sky hold: turbidity, clearness, longwave over air, daylight."""
        return self.dust_optical_depth is None

    @property
    def surface(self) -> SurfaceParameters:
        """Parameters of the energy balance of its ground and air."""
        return SurfaceParameters(
            albedo=self.albedo,
            emissivity=self.emissivity,
            emissivity_broadband=self.emissivity,
            heat_capacity_j_kg_k=self.air_heat_capacity_j_kg_k,
            air_density_kg_m3=self.air_density_kg_m3,
            exchange_m_s=self.exchange_w_m2_k / (self.air_heat_capacity_j_kg_k * self.air_density_kg_m3),
        )

    @property
    def conductivity_w_m_k(self) -> float:
        """Thermal conductivity of the ground, from its inertia."""
        return self.inertia**2 / self.heat_capacity_j_m3_k


EARTH = Body(
    name="earth",
    day_s=86_400.0,
    subsolar=None,
    refracts=True,
    rising_deg=-0.833,  # half the sun's width and the refraction there
    dust_optical_depth=None,
    beam_lm_w=108.0,  # ASTM G173 direct spectrum; Perez et al. 1990 give 87-108
    sky_lm_w=130.0,  # of a clear sky: Littlefair, Lighting Research and Technology 17, 1985
    exchange_w_m2_k=18.15,  # the paper's Table 1
    air_heat_capacity_j_kg_k=1000.0,
    air_density_kg_m3=1.21,
    longwave_down_w_m2=400.0,
    air_temperature_k=303.15,
    albedo=0.20,
    emissivity=0.90,
    inertia=570.0,  # dry loose silica sand
    heat_capacity_j_m3_k=1.3e6,
)
MARS = Body(
    name="mars",
    day_s=SOL_S,
    subsolar=mars_subsolar,
    refracts=False,
    rising_deg=-0.175,  # half the sun's width at 1.52 au
    dust_optical_depth=0.5,  # clear season, Viking landers; Appelbaum and Flood, Solar Energy 45, 1990
    beam_lm_w=SUNLIGHT_LM_W,  # dust larger than the wavelength dims all colours alike
    sky_lm_w=SUNLIGHT_LM_W,
    exchange_w_m2_k=1.0,  # order of magnitude at 600-700 Pa; Martinez et al., Space Sci. Rev. 212, 2017
    air_heat_capacity_j_kg_k=740.0,  # carbon dioxide at 220 K
    air_density_kg_m3=0.015,  # at 630 Pa and 220 K
    longwave_down_w_m2=50.0,  # CO2 and dust, 20-80 by season and opacity; Martinez et al. 2017
    air_temperature_k=220.0,
    albedo=0.25,  # global mean; Christensen et al., J. Geophys. Res. 106, 2001
    emissivity=0.98,
    inertia=250.0,  # sand and dust, 200-400; Putzig and Mellon, Icarus 191, 2007
    heat_capacity_j_m3_k=1.0e6,  # 1300 kg/m3 of basaltic sand at 220 K
)
MOON = Body(
    name="moon",
    day_s=2_551_442.9,
    subsolar=moon_subsolar,
    refracts=False,
    rising_deg=-0.267,  # half the sun's width
    dust_optical_depth=0.0,
    beam_lm_w=SUNLIGHT_LM_W,
    sky_lm_w=SUNLIGHT_LM_W,
    exchange_w_m2_k=0.0,
    air_heat_capacity_j_kg_k=1000.0,  # without meaning: there is no exchange
    air_density_kg_m3=1.0,
    longwave_down_w_m2=0.0,
    air_temperature_k=250.0,  # no air: a thermometer in the shade of the beds
    albedo=0.12,  # normal incidence, highlands and maria; Vasavada et al., J. Geophys. Res. 117, 2012
    emissivity=0.95,  # Hayne et al., J. Geophys. Res. Planets 122, 2017
    inertia=55.0,  # at 273 K; Hayne et al. 2017
    heat_capacity_j_m3_k=6.6e5,  # 1100 kg/m3 at the surface, 600 J/(kg K); Hayne et al. 2017
)
BODIES = {body.name: body for body in (EARTH, MARS, MOON)}


def body_of(site: Site) -> Body:
    """The body of a site; raises `ConfigError` where fieldkit has no model of it."""
    if (body := BODIES.get(site.body)) is None:
        fix = did_you_mean(site.body, BODIES)
        raise ConfigError(f"no model of the sun and the ground of {site.body!r}", place="site.body", fix=fix)
    return body
