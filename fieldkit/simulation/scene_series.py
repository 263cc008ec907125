"""Everything that varies in a scene, computed once on fine times and then read off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fieldkit.model.site import Site
from fieldkit.model.units import SECOND_NS
from fieldkit.physics import daylight as skylight
from fieldkit.physics.energy_balance import STEFAN_BOLTZMANN, balance_temperature
from fieldkit.physics.facet import FloatArray, cos_incidence, normal
from fieldkit.physics.radiance import band_radiance, band_temperature
from fieldkit.physics.slab import Slab, warm_slab
from fieldkit.physics.sun import sun_vectors
from fieldkit.simulation.facets import Facet
from fieldkit.simulation.faults import CloudTransmission
from fieldkit.simulation.sky import Sky, SkyState

STEP_S = 10.0
# after a break of the light even a thin foil is followed: steps of 20 ms, each a tenth longer
_AFTER_BREAK_S = np.append(0.0, np.cumsum(0.02 * 1.1 ** np.arange(60)))


BEAM_LM_W = 108.0
"""Luminous efficacy of direct light, from the ASTM G173 direct spectrum; Perez 1990 gives 87-108."""
SKY_LM_W = 130.0
"""Luminous efficacy of the light of a clear sky (Littlefair 1985: about 130)."""
_COSINE_LOSS = 0.0033  # times tan² of the zenith angle: 1 % of the beam at 60 degrees, 4 % at 74


@dataclass(frozen=True, slots=True)
class Exchange:
    """Heat exchange with the air, ``still + per_wind * wind`` in W m-2 K-1, wind in m/s at 10 m.

    The defaults are near the paper's effective 18.15, and follow the gusts.
    """

    still_w_m2_k: float = 19.0
    per_wind: float = 1.5

    def at(self, wind_m_s: FloatArray) -> FloatArray:
        """Coefficient for these winds, same shape."""
        return self.still_w_m2_k + self.per_wind * wind_m_s


EXCHANGE = Exchange()
"""Sand in the open on a calm day."""


class SceneState(NamedTuple):
    """Everything about one time, in W/m², K, m/s and lx; arrays have a place per facet, the ground last."""

    dni_w_m2: float
    dhi_w_m2: float
    longwave_down_w_m2: float
    air_temperature_k: float
    wind_m_s: float
    illuminance_lx: float
    surface_k: FloatArray
    brightness_k: FloatArray
    contact_k: FloatArray


@dataclass(frozen=True, slots=True)
class SceneSeries:
    """Rows (6 + 3 k, m) in the order of `SceneState`, at times (m,) in seconds after `origin_ns`."""

    origin_ns: int
    time_s: FloatArray
    rows: FloatArray

    def at(self, time_ns: int) -> SceneState:
        """Straight lines between the times; the ends are held."""
        time_s = min(max((time_ns - self.origin_ns) / SECOND_NS, self.time_s[0]), self.time_s[-1])
        after = min(max(int(self.time_s.searchsorted(time_s)), 1), self.time_s.size - 1)
        before_s, after_s = self.time_s[after - 1], self.time_s[after]
        share = (time_s - before_s) / (after_s - before_s)
        column = (1.0 - share) * self.rows[:, after - 1] + share * self.rows[:, after]
        surface, brightness, contact = column[6:].reshape(3, -1)
        dni_w_m2, dhi_w_m2, longwave, air, wind, lux = column[:6].tolist()
        return SceneState(dni_w_m2, dhi_w_m2, longwave, air, wind, lux, surface, brightness, contact)


@dataclass(frozen=True, slots=True)
class SceneModel:
    """What the curves are computed from; see `fieldkit.simulation.Scene`."""

    site: Site
    sky: Sky
    beds: tuple[Facet, ...]
    ground: Facet
    exchange: Exchange
    transmissions: Sequence[CloudTransmission]
    response_s: float

    def series(self, origin_ns: int, length_s: float) -> SceneSeries:
        """All curves from `origin_ns` (UTC) on, every `STEP_S` and denser after each change of light."""
        breaks = np.concatenate([np.empty(0), *(transmission.time_s for transmission in self.transmissions)])
        time_s = fine_times(0.0, length_s, breaks)
        time_ns = origin_ns + np.round(time_s * SECOND_NS).astype(np.int64)
        sun = sun_vectors(time_ns, self.site, refraction=True)
        sky_state = self._behind_clouds(self.sky.sky_state(time_ns, sun[:, 2], self.site), time_s)
        surface = self._surfaces(time_s, time_ns, sun, sky_state)
        brightness = self._brightness(surface, sky_state)
        contact = lagged(surface, time_s, self.response_s)
        scalars = (
            sky_state.dni_w_m2,
            sky_state.dhi_w_m2,
            sky_state.longwave_down_w_m2,
            sky_state.air_temperature_k,
            sky_state.wind_m_s,
        )
        lux = illuminance_lx(sky_state, sun[:, 2])
        return SceneSeries(origin_ns, time_s, np.vstack([*scalars, lux, surface, brightness, contact]))

    def _behind_clouds(self, sky_state: SkyState, time_s: FloatArray) -> SkyState:
        """Sky and air behind the clouds and steps of the scene."""
        dni_w_m2, dhi_w_m2, longwave = sky_state.dni_w_m2, sky_state.dhi_w_m2, sky_state.longwave_down_w_m2
        for transmission in self.transmissions:
            direct, diffuse, added = transmission.at(time_s)
            dni_w_m2, dhi_w_m2, longwave = dni_w_m2 * direct, dhi_w_m2 * diffuse, longwave + added
        return SkyState(dni_w_m2, dhi_w_m2, longwave, sky_state.air_temperature_k, sky_state.wind_m_s)

    def _surfaces(
        self, time_s: FloatArray, time_ns: NDArray[np.int64], sun: FloatArray, sky_state: SkyState
    ) -> FloatArray:
        """Surface temperatures (beds + 1, m), the ground last: it warms the beds, they do not warm it."""
        exchange, air = self.exchange.at(sky_state.wind_m_s), sky_state.air_temperature_k
        light = FacetRadiation(sky_state, sun, skylight.extraterrestrial(time_ns), self.ground.albedo)
        alone = light.absorbed_w_m2(self.ground, np.zeros_like(time_s))[np.newaxis]
        ground = surface_temperatures([self.ground], time_s, alone, exchange, air)
        around = longwave_leaving_ground(ground[0], self.ground, sky_state)
        taken = np.array([light.absorbed_w_m2(bed, around) for bed in self.beds]).reshape(-1, time_s.size)
        return np.vstack([surface_temperatures(self.beds, time_s, taken, exchange, air), ground])

    def _brightness(self, surface: FloatArray, sky_state: SkyState) -> FloatArray:
        """What the camera reads, (beds + 1, m): own radiance, and that of sky and ground mirrored."""
        sky = band_radiance(sky_state.window_temperature_k())
        grey = self.ground.emissivity
        ground = grey * band_radiance(surface[-1]) + (1.0 - grey) * sky
        seen = []
        for facet, temperature in zip((*self.beds, self.ground), surface, strict=True):
            cos_tilt = float(normal(facet.tilt_deg, facet.azimuth_deg)[2])
            mirrored = skylight.sky_view(cos_tilt) * sky + skylight.ground_view(cos_tilt) * ground
            own = facet.emissivity * band_radiance(temperature)
            seen.append(band_temperature(own + (1.0 - facet.emissivity) * mirrored))
        return np.array(seen)


def fine_times(begin_s: float, end_s: float, breaks_s: FloatArray) -> FloatArray:
    """Times every `STEP_S`, denser after each break of the light, shape (m,)."""
    regular = np.arange(begin_s, end_s + STEP_S, STEP_S)
    after = (breaks_s[:, np.newaxis] + _AFTER_BREAK_S).ravel()
    times = np.unique(np.round(np.concatenate([regular, after]), 6))
    return times[(times >= begin_s) & (times <= end_s)]


@dataclass(frozen=True, slots=True)
class FacetRadiation:
    """Everything that shines, at times (m,): sky and air, sun vectors (m, 3), and bright ground."""

    sky_state: SkyState
    sun: FloatArray
    extraterrestrial_w_m2: FloatArray
    ground_albedo: float

    def absorbed_w_m2(self, facet: Facet, ground_longwave_w_m2: FloatArray) -> FloatArray:
        """What a facet takes in of sun, sky and ground, short wave and long, (m,)."""
        up = normal(facet.tilt_deg, facet.azimuth_deg)
        cos_i, cos_z, cos_tilt = cos_incidence(up, self.sun), self.sun[:, 2], float(up[2])
        dni_w_m2, dhi_w_m2 = np.where(cos_z > 0.0, self.sky_state.dni_w_m2, 0.0), self.sky_state.dhi_w_m2
        direct = dni_w_m2 * np.maximum(cos_i, 0.0)
        diffuse = skylight.hay_davies_diffuse(
            dhi_w_m2, dni_w_m2, self.extraterrestrial_w_m2, cos_i, cos_z, cos_tilt
        )
        total = dni_w_m2 * np.maximum(cos_z, 0.0) + dhi_w_m2
        reflected = skylight.ground_reflected(total, self.ground_albedo, cos_tilt)
        longwave = skylight.longwave_on_facet(
            self.sky_state.longwave_down_w_m2, ground_longwave_w_m2, cos_tilt
        )
        return (1.0 - facet.albedo) * (direct + diffuse + reflected) + facet.emissivity_broadband * longwave


def surface_temperatures(
    facets: Sequence[Facet], time_s: FloatArray, absorbed: FloatArray, exchange: FloatArray, air_k: FloatArray
) -> FloatArray:
    """Surface temperatures (k, m) of k facets at times (m,), from what they absorb (k, m).

    Each starts in balance with the first moment, its whole layer at that temperature. Kelvin and W/m².
    """
    series = np.empty_like(absorbed)
    rows_of: dict[Slab, list[int]] = {}
    for row, facet in enumerate(facets):
        rows_of.setdefault(facet.slab, []).append(row)
    for slab, rows in rows_of.items():
        grey = np.array([facets[row].emissivity_broadband for row in rows])
        series[rows] = _one_layer(slab, time_s, absorbed[rows], exchange, air_k, grey)
    return series


def _one_layer(
    slab: Slab,
    time_s: FloatArray,
    absorbed: FloatArray,
    exchange: FloatArray,
    air_k: FloatArray,
    grey: FloatArray,
) -> FloatArray:
    """Curves of the beds that lie on equal layers, stepped together."""
    surface = np.empty_like(absorbed)
    surface[:, 0] = balance_temperature(absorbed[:, 0] + exchange[0] * air_k[0], exchange[0], grey)
    layer = np.tile(surface[:, 0], (slab.layers + 1, 1))
    for row, step_s in enumerate(np.round(np.diff(time_s), 6), start=1):
        layer = warm_slab(slab, layer, float(step_s), absorbed[:, row], exchange[row], air_k[row], grey)
        surface[:, row] = layer[0]
    return surface


def longwave_leaving_ground(surface_k: FloatArray, ground: Facet, sky_state: SkyState) -> FloatArray:
    """Long wave that leaves flat ground, its own and what it mirrors of the sky, W/m²."""
    grey = ground.emissivity_broadband
    return grey * STEFAN_BOLTZMANN * surface_k**4 + (1.0 - grey) * sky_state.longwave_down_w_m2


def lagged(value: FloatArray, time_s: FloatArray, response_s: float) -> FloatArray:
    """A first-order sensor's answer to values (k, m) with straight lines between times (m,)."""
    answer = np.empty_like(value)
    answer[:, 0] = value[:, 0]
    steps = np.diff(time_s)
    slopes = np.diff(value, axis=1) / steps
    decays = np.exp(-steps / response_s)
    for row in range(steps.size):
        behind = response_s * slopes[:, row]
        answer[:, row + 1] = (
            value[:, row + 1] - behind + (answer[:, row] - value[:, row] + behind) * decays[row]
        )
    return answer


def illuminance_lx(sky_state: SkyState, cos_zenith: FloatArray) -> FloatArray:
    """What a light meter lying flat receives, (m,), with the loss of its diffuser at low sun.

    Beam and sky differ in lumens per watt, so no single factor turns the reading into W/m².
    """
    cosine = np.maximum(cos_zenith, 0.0)
    tan2 = 1.0 / np.maximum(cosine, 0.05) ** 2 - 1.0
    beam = sky_state.dni_w_m2 * cosine * np.maximum(1.0 - _COSINE_LOSS * tan2, 0.0)
    return BEAM_LM_W * beam + SKY_LM_W * sky_state.dhi_w_m2
