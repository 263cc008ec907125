"""Harsh worlds, drawn by a seed: beds that are not alike, another sky, a camera and an air log with errors.

Everything that the estimator has no exact term for, at the sizes of `Harm`; each alone is a row too. The
surfaces are those of `fieldkit.simulation.scene_series`, with a heat exchange of each bed's own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.drawn_worlds import (
    BEDS_SOUTH,
    DRIFT_SD_K_PER_H,
    GUESSED,
    LEAD_MIN,
    NOISE_K,
    SESSION_MIN,
    SOUTH,
    BedErrors,
    World,
    day_of,
    random_beds,
    regions,
    settings_of,
    weather_readings,
)
from fieldkit.estimation.bins import History
from fieldkit.model.arrays import FloatArray
from fieldkit.model.site import Site
from fieldkit.model.units import MINUTE_NS, SECOND_NS
from fieldkit.physics import daylight
from fieldkit.physics.bodies import body_of
from fieldkit.physics.constants import STEFAN_BOLTZMANN
from fieldkit.physics.facet import cos_incidence, normal
from fieldkit.physics.sun import sun_vectors
from fieldkit.simulation import Facet, Sky
from fieldkit.simulation.drawn_field import DrawnField, Range, drawn_field, with_stack
from fieldkit.simulation.scene_series import (
    STEP_S,
    FacetRadiation,
    longwave_leaving_ground,
    surface_temperatures,
)
from fieldkit.simulation.sky import SkyState

PER_MINUTE = round(60.0 / STEP_S)
FAST_MIN, SLOW_MIN = 4.0, 120.0
SHUTTER_MIN = 4
WARM_UP_MIN = 20.0
FORWARDS = 0.7
DRYING_W_M2 = (40.0, 150.0)
VEIL_MIN = 60.0
WALL_WARMER_K, WALL_ALBEDO = 15.0, 0.3
HAY_DAVIES, PEREZ, ISOTROPIC = "hay-davies", "perez", "isotropic"
LOWEST_PEREZ_COS = 0.0872
"""5 degrees of elevation."""


@dataclass(frozen=True, slots=True)
class Harm:
    """Sizes of what differs from the estimator's world.

    Attributes
    ----------
    exchange_fast, exchange_slow
        Exchange of each bed over the common one, standard deviations over `FAST_MIN` and `SLOW_MIN`. [-]
    albedo_sd, emissivity_sd
        Of each bed against the common ones. [-]
    inertia_sd, depth_sd
        Of each bed's thermal inertia and depth, of the logarithm. [-]
    per_wind
        Range of the exchange's change with the wind. [W m-2 K-1 per m/s]
    gusts
        Whether the wind has gusts.
    skies
        Distributions of diffuse light, of which one is drawn.
    shutter_k, common_k, warm_up_k, vignetting_k
        Steps of each region every `SHUTTER_MIN`, noise of all regions by the minute, drift of each as the
        housing warms up, and a wave over an hour. [K]
    air_noise_k, air_sun_k
        Of the logged air temperature: noise, and most of what 1000 W/m2 warms it. [K]
    shadows_per_h
        Shadows of a person over one bed, 10 to 40 s long, that nobody marks.
    veil
        Share of the direct light that a thin high cloud takes within the first hour; `FORWARDS` of it comes
        back from around the sun. [-]
    drying_min
        One bed dries: a loss of `DRYING_W_M2` at the first minute, which falls to 1/e in so long; 0 is none.
        [min]
    level_deg
        The reference leans so far to the north or south. [degrees]
    wall_deg
        A long sunlit wall north of the beds, `WALL_WARMER_K` over the air and of `WALL_ALBEDO`, hides so much
        of the sky above the horizon. [degrees]
    """

    exchange_fast: float = 0.03
    exchange_slow: float = 0.05
    albedo_sd: float = 0.02
    emissivity_sd: float = 0.01
    inertia_sd: float = 0.10
    depth_sd: float = 0.15
    per_wind: Range = (1.0, 4.0)
    gusts: bool = True
    skies: tuple[str, ...] = (ISOTROPIC, HAY_DAVIES, PEREZ)
    shutter_k: float = 0.05
    common_k: float = 0.1
    warm_up_k: float = 0.25
    vignetting_k: float = 0.0
    air_noise_k: float = 0.1
    air_sun_k: float = 1.0
    shadows_per_h: float = 1.0
    veil: float = 0.0
    drying_min: float = 0.0
    level_deg: float = 0.0
    wall_deg: float = 0.0

    def sizes(self) -> str:
        """What is not harmless, as name and size."""
        if self == HARSH:
            return "everything at the sizes of `benchmarks.harsh_worlds.Harm`"
        sizes = {name: getattr(self, name) for name in self.__slots__}
        return ", ".join(
            f"{name} {value}" for name, value in sizes.items() if value != getattr(HARMLESS, name)
        )


HARSH = Harm()
HARMLESS = Harm(0, 0, 0, 0, 0, 0, (1.5, 1.5), False, (HAY_DAVIES,), 0, 0, 0, 0, 0, 0, 0)
"""The kind of `drawn_world`: to it one mechanism is added at a time."""


class _Light(NamedTuple):
    """Sky of each bed over time, the sun, and what else the radiation on a facet needs."""

    skies: tuple[SkyState, ...]
    sun: FloatArray
    top_w_m2: FloatArray
    shape: str
    circumsolar_share: float


def harsh_world(
    seed: int, day: str, beds: str = SOUTH, *, harm: Harm = HARSH, minutes: int = SESSION_MIN
) -> World:
    """One world: as `benchmarks.drawn_worlds.drawn_world`, with harm."""
    random = np.random.default_rng(seed)
    slopes = BEDS_SOUTH if beds == SOUTH else random_beds(random)
    field = drawn_field(seed, replace(GUESSED, per_wind=harm.per_wind))
    field = field if harm.gusts else replace(field, gusts=None)
    outline = regions(slopes)
    own = np.random.default_rng([seed, 11])
    alike = (Facet(region.name, (), region.tilt_deg, region.azimuth_deg) for region in outline)
    facets = [_own(field, facet, harm, own) for facet in alike]
    facets[0] = replace(facets[0], tilt_deg=harm.level_deg, azimuth_deg=180.0 * (seed % 2))
    site, sky, noon_ns = day_of(day)
    true = _history(site, sky, noon_ns - LEAD_MIN * MINUTE_NS, minutes, facets, field, harm, own)
    drifts = DRIFT_SD_K_PER_H * random.standard_normal(len(facets) - 1)
    errors = BedErrors(0.25 * random.standard_normal(len(facets) - 1), drifts)
    return World(_readings(true, field, errors, harm, own), outline, settings_of(beds, site), field, errors)


def _own(field: DrawnField, facet: Facet, harm: Harm, random: np.random.Generator) -> Facet:
    """A bed with sand of its own."""
    top, *below = field.bed(facet).stack
    albedo, grey, inertia, depth = random.standard_normal(4)
    top = replace(
        top,
        depth_m=top.depth_m * float(np.exp(harm.depth_sd * depth)),
        conductivity_w_m_k=top.conductivity_w_m_k * float(np.exp(2.0 * harm.inertia_sd * inertia)),
    )
    return replace(
        with_stack(facet, (top, *below)),
        albedo=facet.albedo + field.albedo_error + harm.albedo_sd * float(albedo),
        emissivity_broadband=min(facet.emissivity_broadband + harm.emissivity_sd * float(grey), 1.0),
    )


def _history(
    site: Site,
    sky: Sky,
    begin_ns: int,
    minutes: int,
    facets: list[Facet],
    field: DrawnField,
    harm: Harm,
    random: np.random.Generator,
) -> History:
    """True minutes of the session, which the beds have been warming up to for `LEAD_MIN`."""
    steps = PER_MINUTE * (LEAD_MIN + minutes) + 1
    time_s = np.arange(steps, dtype=np.float64) * STEP_S
    time_ns = begin_ns + np.round(time_s * SECOND_NS).astype(np.int64)
    sun = sun_vectors(time_ns, site, refraction=True)
    state = field.sky(sky).sky_state(time_ns, sun[:, 2], site)
    top = daylight.extraterrestrial(time_ns, body_of(site))
    shape = harm.skies[random.integers(len(harm.skies))]
    dimmed = (
        harm.veil * 0.5 * (1.0 - np.cos(np.pi * np.clip((time_s / 60.0 - LEAD_MIN) / VEIL_MIN, 0.0, 1.0)))
    )
    # what thin cloud scatters forwards reaches the beds as if from the sun, and a shaded meter from the sky
    onto_beds = replace(state, dni_w_m2=(1.0 - (1.0 - FORWARDS) * dimmed) * state.dni_w_m2)
    scattered = FORWARDS * dimmed * state.dni_w_m2 * np.maximum(sun[:, 2], 0.0)
    light = _Light(
        _under_people(onto_beds, len(facets), harm, random),
        sun,
        np.asarray(top),
        shape,
        0.0 if shape == ISOTROPIC else 1.0 if shape == PEREZ else field.circumsolar_share,
    )
    own_share = 1.0 + _own_exchange(len(facets), steps, harm, random)
    exchange = field.exchange.at(state.wind_m_s) * own_share
    lost = _drying(field, len(facets), time_s, harm) - _from_wall(facets, state, sun, harm)
    surface = _surfaces(facets, field, light, time_s, exchange, lost)
    minute_ns = begin_ns + np.arange(LEAD_MIN + minutes) * MINUTE_NS + MINUTE_NS // 2
    whole = History(
        minute=minute_ns // MINUTE_NS,
        time_ns=minute_ns,
        sun=sun_vectors(minute_ns, site),
        temperature_k=_by_minute(surface).T,
        dni_w_m2=_by_minute((1.0 - dimmed) * state.dni_w_m2),
        dhi_w_m2=_by_minute(state.dhi_w_m2 + scattered),
        longwave_down_w_m2=_by_minute(state.longwave_down_w_m2),
        air_k=_by_minute(state.air_temperature_k),
        wind_m_s=_by_minute(state.wind_m_s),
    )
    return whole.since(LEAD_MIN)


def _by_minute(values: FloatArray) -> FloatArray:
    """Means over minutes of values (..., steps)."""
    middle = 0.5 * (values[..., 1:] + values[..., :-1])
    return np.asarray(middle.reshape(*values.shape[:-1], -1, PER_MINUTE).mean(axis=-1))


def _under_people(sky: SkyState, beds: int, harm: Harm, random: np.random.Generator) -> tuple[SkyState, ...]:
    """The sky over each bed, with a person's shadow now and then."""
    lit = np.ones((beds, sky.dni_w_m2.size))
    for _ in range(random.poisson(harm.shadows_per_h * sky.dni_w_m2.size * STEP_S / 3600.0)):
        first = random.integers(sky.dni_w_m2.size)
        lit[random.integers(beds), first : first + random.integers(1, 5)] = 0.0
    return tuple(replace(sky, dni_w_m2=sky.dni_w_m2 * share) for share in lit)


def _own_exchange(beds: int, steps: int, harm: Harm, random: np.random.Generator) -> FloatArray:
    """Exchange of beds over the common one, less 1 (beds, steps)."""
    fast = _wandering(beds, steps, FAST_MIN, random)
    return harm.exchange_fast * fast + harm.exchange_slow * _wandering(beds, steps, SLOW_MIN, random)


def _wandering(beds: int, steps: int, minutes: float, random: np.random.Generator) -> FloatArray:
    """Ornstein-Uhlenbeck processes of unit variance (beds, steps)."""
    decay = np.exp(-STEP_S / (60.0 * minutes))
    values = random.standard_normal((beds, steps))
    for step in range(1, steps):
        values[:, step] = decay * values[:, step - 1] + np.sqrt(1.0 - decay**2) * values[:, step]
    return values


def _drying(field: DrawnField, beds: int, time_s: FloatArray, harm: Harm) -> FloatArray:
    """What each bed loses by drying from the first minute on, W/m2 (beds, steps): one of them, if any."""
    lost, random = np.zeros((beds, time_s.size)), np.random.default_rng([field.seed, 13])
    if harm.drying_min:
        minutes = time_s / 60.0 - LEAD_MIN
        fading = np.where(minutes >= 0.0, np.exp(-np.maximum(minutes, 0.0) / harm.drying_min), 0.0)
        lost[random.integers(1, beds)] = random.uniform(*DRYING_W_M2) * fading
    return lost


def _from_wall(facets: list[Facet], sky: SkyState, sun: FloatArray, harm: Harm) -> FloatArray:
    """What each bed absorbs from the wall over what it would from the sky behind, W/m2 (beds, steps)."""
    height = np.radians(harm.wall_deg)
    warm = STEFAN_BOLTZMANN * (sky.air_temperature_k + WALL_WARMER_K) ** 4 - sky.longwave_down_w_m2
    lit = WALL_ALBEDO * (sky.dni_w_m2 * np.maximum(-sun[:, 1], 0.0) + 0.5 * sky.dhi_w_m2) - sky.dhi_w_m2
    rows = []
    for facet in facets:
        _, north, up = normal(facet.tilt_deg, facet.azimuth_deg)
        away = np.arctan2(-north, up)
        # of a strip without end, by crossed strings (H. C. Hottel): what rises above the bed's own horizon
        seen = 0.5 * (np.cos(min(away, 0.0)) - np.cos(height - min(away, height))) * np.hypot(north, up)
        rows.append(seen * ((1.0 - facet.albedo) * lit + facet.emissivity_broadband * warm))
    return np.array(rows)


def _surfaces(
    facets: list[Facet],
    field: DrawnField,
    light: _Light,
    time_s: FloatArray,
    exchange: FloatArray,
    lost_w_m2: FloatArray,
) -> FloatArray:
    """Surface temperatures (beds, steps); the ground around is a flat bed's sand."""
    ground, air_k = field.bed(Facet("ground", ())), light.skies[0].air_temperature_k
    level = _absorption(ground, ground, light.skies[0], light, np.zeros_like(time_s))
    ground_k = surface_temperatures([ground], time_s, level[np.newaxis], exchange.mean(axis=0), air_k)[0]
    upwards = longwave_leaving_ground(ground_k, ground, light.skies[0])
    absorbed = [
        _absorption(facet, ground, sky, light, upwards)
        for facet, sky in zip(facets, light.skies, strict=True)
    ]
    return surface_temperatures(facets, time_s, np.array(absorbed) - lost_w_m2, exchange, air_k)


def perez_diffuse(
    dhi_w_m2: ArrayLike,
    dni_w_m2: ArrayLike,
    extraterrestrial_w_m2: ArrayLike,
    cos_incidence: ArrayLike,
    cos_zenith: ArrayLike,
    cos_tilt: ArrayLike,
) -> FloatArray:
    """Diffuse irradiance on a facet by `perez_brightening`; arguments as of `hay_davies_diffuse`, [W/m2]."""
    around_sun, horizon = daylight.perez_brightening(dhi_w_m2, dni_w_m2, extraterrestrial_w_m2, cos_zenith)
    beam_ratio = np.maximum(cos_incidence, 0.0) / np.maximum(cos_zenith, LOWEST_PEREZ_COS)
    sine = np.sqrt(np.clip(1.0 - np.square(cos_tilt), 0.0, 1.0))
    share = (1.0 - around_sun) * daylight.sky_view(cos_tilt) + around_sun * beam_ratio + horizon * sine
    return np.asarray(np.maximum(np.multiply(dhi_w_m2, share), 0.0))


def _absorption(
    facet: Facet, ground: Facet, sky: SkyState, light: _Light, upwards_w_m2: FloatArray
) -> FloatArray:
    radiation = FacetRadiation(sky, light.sun, light.top_w_m2, ground.albedo, light.circumsolar_share)
    absorbed = radiation.absorbed_w_m2(facet, upwards_w_m2)
    if light.shape != PEREZ:
        return absorbed
    up = normal(facet.tilt_deg, facet.azimuth_deg)
    towards = cos_incidence(up, light.sun)
    others = (sky.dhi_w_m2, sky.dni_w_m2, light.top_w_m2, towards, light.sun[:, 2], up[2])
    instead = perez_diffuse(*others) - daylight.hay_davies_diffuse(*others)
    return absorbed + (1.0 - facet.albedo) * instead


def _readings(
    true: History, field: DrawnField, errors: BedErrors, harm: Harm, random: np.random.Generator
) -> History:
    """The true minutes as the instruments read them."""
    minutes, beds = true.temperature_k.shape
    hours = np.arange(minutes)[:, np.newaxis] / 60.0
    kelvin = true.temperature_k + NOISE_K * random.standard_normal((minutes, beds))
    kelvin[:, 1:] += errors.offsets_k + errors.drifts_k_per_h * hours
    kelvin += harm.common_k * random.standard_normal((minutes, 1))
    kelvin += harm.warm_up_k * random.standard_normal(beds) * (1.0 - np.exp(-60.0 * hours / WARM_UP_MIN))
    steps = harm.shutter_k * random.standard_normal((minutes // SHUTTER_MIN + 1, beds))
    kelvin += np.repeat(steps, SHUTTER_MIN, axis=0)[:minutes]
    kelvin += harm.vignetting_k * np.sin(2.0 * np.pi * (hours + random.random(beds)))
    in_the_sun = harm.air_sun_k * random.random() * true.dni_w_m2 / 1000.0
    readings = weather_readings(true, field)
    air_k = readings.air_k + in_the_sun + harm.air_noise_k * random.standard_normal(minutes)
    return replace(readings, temperature_k=kelvin, air_k=air_k)
