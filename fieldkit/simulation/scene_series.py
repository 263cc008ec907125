"""Time series of a scene, computed once: sky below the clouds, surface temperatures, illuminance.

More than the paper's eqs. (1) to (7): diffuse and reflected light, longwave of sky and ground, wind, and
conduction into the layer, in fine time steps. A moment of the scene is interpolated from the series.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from fieldkit.model.arrays import FloatArray
from fieldkit.model.site import Site
from fieldkit.model.units import SECOND_NS
from fieldkit.physics import daylight
from fieldkit.physics.bodies import Body, body_of
from fieldkit.physics.constants import STEFAN_BOLTZMANN
from fieldkit.physics.energy_balance import balance_temperature
from fieldkit.physics.facet import cos_incidence, normal
from fieldkit.physics.horizon import sky_view_factor, sunlit_share
from fieldkit.physics.radiance import band_radiance, band_temperature
from fieldkit.physics.slab import SlabStep, surface_series
from fieldkit.physics.sun import sun_vectors
from fieldkit.simulation.boards import Board
from fieldkit.simulation.facets import Facet
from fieldkit.simulation.faults import CloudTransmission
from fieldkit.simulation.sky import Sky, SkyState
from fieldkit.simulation.terrain import Terrain, TerrainSeries

STEP_S = 10.0
TERRAIN_STEP_S = 30.0
"""Step of terrain, which has a surface in every pixel; `SlabStep` is accurate to about that."""
# dense enough to resolve the response of a thin foil to a step of the light: 20 ms, each step 10 % longer
_AFTER_BREAK_S = np.append(0.0, np.cumsum(0.02 * 1.1 ** np.arange(60)))

_COSINE_LOSS = 0.0033  # times tan² of the zenith angle: 1 % of the beam at 60 degrees, 4 % at 74


@dataclass(frozen=True, slots=True)
class Exchange:
    """Heat exchange with the air, ``still + per_wind * wind`` in W m-2 K-1, wind in m/s at 10 m.

    The defaults are near the paper's effective 18.15, and follow the gusts.
    """

    still_w_m2_k: float = 19.0
    per_wind: float = 1.5

    def at(self, wind_m_s: FloatArray) -> FloatArray:
        """Coefficient at these wind speeds, same shape."""
        return self.still_w_m2_k + self.per_wind * wind_m_s


EXCHANGE = Exchange()
"""Sand in the open on a calm day."""


class SceneState(NamedTuple):
    """State of the scene at one time, in W/m², K, m/s and lx; arrays have a place per facet, ground last."""

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
        """State at one time by linear interpolation; constant beyond the ends."""
        time_s = min(max((time_ns - self.origin_ns) / SECOND_NS, self.time_s[0]), self.time_s[-1])
        after = min(max(int(self.time_s.searchsorted(time_s)), 1), self.time_s.size - 1)
        before_s, after_s = self.time_s[after - 1], self.time_s[after]
        share = (time_s - before_s) / (after_s - before_s)
        column = (1.0 - share) * self.rows[:, after - 1] + share * self.rows[:, after]
        return SceneState(*column[:6].tolist(), *column[6:].reshape(3, -1))


@dataclass(frozen=True, slots=True)
class SceneModel:
    """Inputs from which the time series are computed; see `fieldkit.simulation.Scene`.

    `circumsolar_share` scales the circumsolar light: 1 for the sky of Hay and Davies, 0 for one of uniform
    radiance. `boards` shade single beds.
    """

    site: Site
    sky: Sky
    beds: tuple[Facet, ...]
    ground: Facet
    exchange: Exchange
    transmissions: Sequence[CloudTransmission]
    response_s: float
    circumsolar_share: float = 1.0
    boards: tuple[Board, ...] = ()

    def series(self, origin_ns: int, length_s: float) -> SceneSeries:
        """All time series of a scene in steps of `STEP_S`, denser after each step of the light."""
        steps = [transmission.time_s for transmission in self.transmissions]
        edges = [np.array([board.begin_s, board.end_s]) for board in self.boards]
        time_s = fine_times(0.0, length_s, np.concatenate([np.empty(0), *steps, *edges]))
        radiation = self._radiation(origin_ns, time_s)
        sun, sky = radiation.sun, radiation.sky
        surface = self._surfaces(time_s, radiation)
        brightness = self._brightness(surface, sky)
        contact = lag(surface, time_s, self.response_s)
        scalars = (sky.dni_w_m2, sky.dhi_w_m2, sky.longwave_down_w_m2, sky.air_temperature_k, sky.wind_m_s)
        lux = illuminance_lx(sky, sun[:, 2], body_of(self.site))
        return SceneSeries(origin_ns, time_s, np.vstack([*scalars, lux, surface, brightness, contact]))

    def terrain_series(self, terrain: Terrain, origin_ns: int, length_s: float) -> TerrainSeries:
        """Temperatures of terrain of the ground's material, lit and shaded by its own relief."""
        time_s = np.arange(0.0, length_s + TERRAIN_STEP_S, TERRAIN_STEP_S)
        radiation = self._radiation(origin_ns, time_s)
        level_k, longwave_up = self._ground(time_s, radiation)
        exchange, air = self.exchange.at(radiation.sky.wind_m_s), radiation.sky.air_temperature_k
        from_sky, from_ground = self._incident(level_k, radiation.sky)
        brightness = np.empty((time_s.size, len(terrain.normals)), np.float32)
        for piece in terrain.pieces():
            lit, view = terrain.sunlit_share(radiation.sun, piece), terrain.sky_view[piece, np.newaxis]
            normals = terrain.normals[piece]
            absorbed = radiation.absorbed_by_w_m2(self.ground, normals, lit, view, longwave_up)
            surface = _of_one_material(self.ground, time_s, absorbed, exchange, air)
            piece_k = _brightness_k(self.ground.emissivity, surface, normals[:, 2:], from_sky, from_ground)
            brightness[:, piece] = piece_k.T
        return TerrainSeries(origin_ns, time_s, brightness)

    def _radiation(self, origin_ns: int, time_s: FloatArray) -> FacetRadiation:
        time_ns = origin_ns + np.round(time_s * SECOND_NS).astype(np.int64)
        sun = sun_vectors(time_ns, self.site, refraction=True)
        sky = self._behind_clouds(self.sky.sky_state(time_ns, sun[:, 2], self.site), time_s)
        outside = daylight.extraterrestrial(time_ns, body_of(self.site))
        return FacetRadiation(sky, sun, outside, self.ground.albedo, self.circumsolar_share)

    def _behind_clouds(self, sky: SkyState, time_s: FloatArray) -> SkyState:
        """Sky and air below the clouds and light steps of the scene."""
        dni, dhi, longwave = sky.dni_w_m2, sky.dhi_w_m2, sky.longwave_down_w_m2
        for transmission in self.transmissions:
            direct, diffuse, added = transmission.at(time_s)
            dni, dhi, longwave = dni * direct, dhi * diffuse, longwave + added
        return SkyState(dni, dhi, longwave, sky.air_temperature_k, sky.wind_m_s)

    def _under_boards(self, bed: Facet, sky: SkyState, time_s: FloatArray) -> SkyState:
        """Sky and air as one bed sees them."""
        for board in self.boards:
            if board.bed == bed.name:
                sky = board.over(sky, time_s)
        return sky

    def _surfaces(self, time_s: FloatArray, radiation: FacetRadiation) -> FloatArray:
        """Surface temperatures (beds + 1, m), the ground last: it heats the beds, they do not heat it."""
        sky = radiation.sky
        ground, longwave_up = self._ground(time_s, radiation)
        on_beds = [
            replace(radiation, sky=self._under_boards(bed, sky, time_s)).absorbed_w_m2(bed, longwave_up)
            for bed in self.beds
        ]
        absorbed = np.array(on_beds).reshape(-1, time_s.size)
        exchange, air = self.exchange.at(sky.wind_m_s), sky.air_temperature_k
        return np.vstack([surface_temperatures(self.beds, time_s, absorbed, exchange, air), ground])

    def _ground(self, time_s: FloatArray, radiation: FacetRadiation) -> tuple[FloatArray, FloatArray]:
        """Surface temperature of the level ground (1, m), and the longwave that leaves it (m,)."""
        sky = radiation.sky
        absorbed = radiation.absorbed_w_m2(self.ground, np.zeros_like(time_s))[np.newaxis]
        exchange, air = self.exchange.at(sky.wind_m_s), sky.air_temperature_k
        ground = surface_temperatures([self.ground], time_s, absorbed, exchange, air)
        return ground, longwave_leaving_ground(ground[0], self.ground, sky)

    def _incident(self, ground_k: FloatArray, sky: SkyState) -> tuple[FloatArray, FloatArray]:
        """Exitances of sky and level ground in the camera's band, (m,) each."""
        from_sky = band_radiance(sky.window_temperature_k())
        grey = self.ground.emissivity
        return from_sky, grey * band_radiance(ground_k.reshape(-1)) + (1.0 - grey) * from_sky

    def _brightness(self, surface: FloatArray, sky: SkyState) -> FloatArray:
        """Brightness temperatures (beds + 1, m): emitted radiance, and reflected from sky and ground."""
        incident = self._incident(surface[-1], sky)
        rows = [
            _brightness_k(facet.emissivity, kelvin, normal(facet.tilt_deg, facet.azimuth_deg)[2:], *incident)
            for facet, kelvin in zip((*self.beds, self.ground), surface, strict=True)
        ]
        return np.array(rows)


def _brightness_k(
    grey: float, surface_k: FloatArray, cos_tilt: FloatArray, from_sky: FloatArray, from_ground: FloatArray
) -> FloatArray:
    incident = daylight.sky_view(cos_tilt) * from_sky + daylight.ground_view(cos_tilt) * from_ground
    return band_temperature(grey * band_radiance(surface_k) + (1.0 - grey) * incident)


def fine_times(begin_s: float, end_s: float, breaks_s: FloatArray) -> FloatArray:
    """Times (m,) from begin to end every `STEP_S`, denser after each step of the light (n,), in seconds."""
    regular = np.arange(begin_s, end_s + STEP_S, STEP_S)
    after = (breaks_s[:, np.newaxis] + _AFTER_BREAK_S).ravel()
    times = np.unique(np.round(np.concatenate([regular, after]), 6))
    return times[(times >= begin_s) & (times <= end_s)]


@dataclass(frozen=True, slots=True)
class FacetRadiation:
    """Radiation on facets at times (m,), from sky and air, sun vectors (m, 3) and bright ground."""

    sky: SkyState
    sun: FloatArray
    extraterrestrial_w_m2: FloatArray
    ground_albedo: float
    circumsolar_share: float = 1.0

    def absorbed_w_m2(self, facet: Facet, ground_longwave_w_m2: FloatArray) -> FloatArray:
        """Short- and longwave (m,) that a facet absorbs, W/m2, given the ground's longwave exitance (m,)."""
        up = normal(facet.tilt_deg, facet.azimuth_deg)
        lit, view = sunlit_share(facet.horizon, self.sun), sky_view_factor(facet.horizon)
        return self.absorbed_by_w_m2(facet, up, lit, np.asarray(view), ground_longwave_w_m2)

    def absorbed_by_w_m2(
        self,
        facet: Facet,
        normals: FloatArray,
        lit: FloatArray,
        view: FloatArray,
        ground_longwave_w_m2: FloatArray,
    ) -> FloatArray:
        """Radiation (..., m) absorbed by surfaces of a facet's material with unit normals (..., 3), W/m2.

        `lit` and `view` are the shares of the sun, (..., m), and of the sky, (..., 1) or a scalar, that the
        horizon leaves; the ground's longwave exitance is (m,).
        """
        cos_i, cos_z, cos_tilt = cos_incidence(normals, self.sun), self.sun[:, 2], normals[..., 2:]
        dni, dhi = np.where(cos_z > 0.0, self.sky.dni_w_m2, 0.0), self.sky.dhi_w_m2
        direct = lit * dni * np.maximum(cos_i, 0.0)
        # the circumsolar part of that sky is proportional to the beam that it is given
        around_sun = self.circumsolar_share * dni
        circumsolar = np.clip(around_sun / self.extraterrestrial_w_m2, 0.0, 1.0)
        diffuse = daylight.hay_davies_diffuse(
            dhi, around_sun, self.extraterrestrial_w_m2, cos_i, cos_z, cos_tilt
        )
        dome = (1.0 - circumsolar) * daylight.isotropic_diffuse(dhi, cos_tilt)
        diffuse = lit * (diffuse - dome) + view * dome
        # the ground around a facet is in the same shadow
        ghi = lit * dni * np.maximum(cos_z, 0.0) + view * dhi
        reflected = daylight.ground_reflected(ghi, self.ground_albedo, cos_tilt)
        # what hides the sky is as warm as the ground
        down = view * self.sky.longwave_down_w_m2 + (1.0 - view) * ground_longwave_w_m2
        longwave = daylight.longwave_on_facet(down, ground_longwave_w_m2, cos_tilt)
        return (1.0 - facet.albedo) * (direct + diffuse + reflected) + facet.emissivity_broadband * longwave


def surface_temperatures(
    facets: Sequence[Facet], time_s: FloatArray, absorbed: FloatArray, exchange: FloatArray, air_k: FloatArray
) -> FloatArray:
    """Surface temperatures (k, m) of k facets from the radiation (k, m) they absorb at times (m,).

    Kelvin, W/m2 and seconds. Each starts in balance with the first time, its whole layer at that temperature.
    The coefficient `exchange` with the air of `air_k` (m,) is (m,), or (k, m) of each facet, in W m-2 K-1.
    """
    exchanges = np.broadcast_to(exchange, absorbed.shape)
    start, step_s = _in_balance(facets, absorbed, exchanges, air_k), np.round(np.diff(time_s), 6)
    rows = [
        surface_series(facet.stack, begin, step_s, own, exchanged, air_k, facet.emissivity_broadband)
        for facet, begin, own, exchanged in zip(facets, start.tolist(), absorbed, exchanges, strict=True)
    ]
    return np.array(rows).reshape(absorbed.shape)


def _in_balance(
    facets: Sequence[Facet], absorbed: FloatArray, exchange: FloatArray, air_k: FloatArray
) -> FloatArray:
    """Surface temperatures (k,) of facets that store no heat, at the first time."""
    grey = np.array([facet.emissivity_broadband for facet in facets])
    return balance_temperature(absorbed[:, 0] + exchange[:, 0] * air_k[0], exchange[:, 0], grey)


def _of_one_material(
    facet: Facet, time_s: FloatArray, absorbed: FloatArray, exchange: FloatArray, air_k: FloatArray
) -> FloatArray:
    """Surface temperatures of thousands of surfaces of a facet's material, stepped together."""
    step = SlabStep.of([facet.stack], float(time_s[1] - time_s[0]))
    surface = np.empty_like(absorbed)
    surface[:, 0] = _in_balance([facet], absorbed, np.broadcast_to(exchange, absorbed.shape), air_k)
    layer = np.tile(surface[:, :1], (1, step.response.shape[1]))
    for row in range(1, time_s.size):
        supplied = absorbed[:, row], exchange[row], air_k[row]
        layer = step.after(layer, *supplied, facet.emissivity_broadband)
        surface[:, row] = layer[:, 0]
    return surface


def longwave_leaving_ground(surface_k: FloatArray, ground: Facet, sky: SkyState) -> FloatArray:
    """Longwave that leaves flat ground, emitted and reflected from the sky, W/m²."""
    grey = ground.emissivity_broadband
    return grey * STEFAN_BOLTZMANN * surface_k**4 + (1.0 - grey) * sky.longwave_down_w_m2


def lag(value: FloatArray, time_s: FloatArray, response_s: float) -> FloatArray:
    """Response of a first-order sensor to values (k, m) that are linear between times (m,); same shape.

    `response_s` is its time constant, above 0; the sensor starts at the first value.
    """
    sensed = np.empty_like(value)
    sensed[:, 0] = value[:, 0]
    steps = np.diff(time_s)
    slopes = np.diff(value, axis=1) / steps
    decays = np.exp(-steps / response_s)
    for row in range(steps.size):
        lag = response_s * slopes[:, row]
        sensed[:, row + 1] = value[:, row + 1] - lag + (sensed[:, row] - value[:, row] + lag) * decays[row]
    return sensed


def illuminance_lx(sky: SkyState, cos_zenith: FloatArray, body: Body) -> FloatArray:
    """Illuminance (n,) on a horizontal light meter, with the cosine error of its diffuser at low sun.

    From sky and cosines of the sun's zenith angle (n,). Beam and skylight differ in lumens per watt, which
    are the body's, so no single factor converts the reading to W/m².
    """
    cosine = np.maximum(cos_zenith, 0.0)
    tan2 = 1.0 / np.maximum(cosine, 0.05) ** 2 - 1.0
    beam = sky.dni_w_m2 * cosine * np.maximum(1.0 - _COSINE_LOSS * tan2, 0.0)
    return body.beam_lm_w * beam + body.sky_lm_w * sky.dhi_w_m2
