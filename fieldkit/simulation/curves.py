"""Everything that varies in a scene, computed once on fine times and then read off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fieldkit.model.site import Site
from fieldkit.physics import sky as skylight
from fieldkit.physics.facet import FloatArray, normal
from fieldkit.physics.radiance import band_radiance, band_temperature
from fieldkit.physics.sun import sun_vectors
from fieldkit.simulation import heat
from fieldkit.simulation.facets import Facet
from fieldkit.simulation.faults import SECOND_NS, Veil
from fieldkit.simulation.sky import Above, Sky

BEAM_LM_W = 108.0
"""Luminous efficacy of direct light, from the ASTM G173 direct spectrum; Perez 1990 gives 87-108."""
SKY_LM_W = 130.0
"""Luminous efficacy of the light of a clear sky (Littlefair 1985: about 130)."""
_COSINE_LOSS = 0.0033  # times tan² of the zenith angle: 1 % of the beam at 60 degrees, 4 % at 74


class Moment(NamedTuple):
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
class Curves:
    """Rows (6 + 3 k, m) in the order of `Moment`, at times (m,) in seconds after `origin_ns`."""

    origin_ns: int
    time_s: FloatArray
    rows: FloatArray

    def at(self, time_ns: int) -> Moment:
        """Straight lines between the times; the ends are held."""
        time_s = min(max((time_ns - self.origin_ns) / SECOND_NS, self.time_s[0]), self.time_s[-1])
        after = min(max(int(self.time_s.searchsorted(time_s)), 1), self.time_s.size - 1)
        before_s, after_s = self.time_s[after - 1], self.time_s[after]
        share = (time_s - before_s) / (after_s - before_s)
        column = (1.0 - share) * self.rows[:, after - 1] + share * self.rows[:, after]
        surface, brightness, contact = column[6:].reshape(3, -1)
        dni, dhi, longwave, air, wind, lux = column[:6].tolist()
        return Moment(dni, dhi, longwave, air, wind, lux, surface, brightness, contact)


@dataclass(frozen=True, slots=True)
class World:
    """What the curves are computed from; see `fieldkit.simulation.Scene`."""

    site: Site
    sky: Sky
    beds: tuple[Facet, ...]
    ground: Facet
    exchange: heat.Exchange
    veils: Sequence[Veil]
    response_s: float

    def curves(self, origin_ns: int, length_s: float) -> Curves:
        """All curves from `origin_ns` (UTC) on, every `heat.STEP_S` and denser after each change of light."""
        breaks = np.concatenate([np.empty(0), *(veil.time_s for veil in self.veils)])
        time_s = heat.fine_times(0.0, length_s, breaks)
        time_ns = origin_ns + np.round(time_s * SECOND_NS).astype(np.int64)
        sun = sun_vectors(time_ns, self.site, refraction=True)
        above = self._veiled(self.sky.above(time_ns, sun[:, 2], self.site), time_s)
        surface = self._surfaces(time_s, time_ns, sun, above)
        brightness = self._brightness(surface, above)
        contact = heat.lagged(surface, time_s, self.response_s)
        scalars = (above.dni, above.dhi, above.longwave_down_w_m2, above.air_temperature_k, above.wind_m_s)
        lux = illuminance_lx(above, sun[:, 2])
        return Curves(origin_ns, time_s, np.vstack([*scalars, lux, surface, brightness, contact]))

    def _veiled(self, above: Above, time_s: FloatArray) -> Above:
        """Sky and air behind the clouds and steps of the scene."""
        dni, dhi, longwave = above.dni, above.dhi, above.longwave_down_w_m2
        for veil in self.veils:
            direct, diffuse, added = veil.at(time_s)
            dni, dhi, longwave = dni * direct, dhi * diffuse, longwave + added
        return Above(dni, dhi, longwave, above.air_temperature_k, above.wind_m_s)

    def _surfaces(
        self, time_s: FloatArray, time_ns: NDArray[np.int64], sun: FloatArray, above: Above
    ) -> FloatArray:
        """Surface temperatures (beds + 1, m), the ground last: it warms the beds, they do not warm it."""
        exchange, air = self.exchange.at(above.wind_m_s), above.air_temperature_k
        light = heat.Light(above, sun, skylight.extraterrestrial(time_ns), self.ground.albedo)
        alone = light.absorbed_w_m2(self.ground, np.zeros_like(time_s))[np.newaxis]
        ground = heat.surface_curves([self.ground], time_s, alone, exchange, air)
        around = heat.longwave_out(ground[0], self.ground, above)
        taken = np.array([light.absorbed_w_m2(bed, around) for bed in self.beds]).reshape(-1, time_s.size)
        return np.vstack([heat.surface_curves(self.beds, time_s, taken, exchange, air), ground])

    def _brightness(self, surface: FloatArray, above: Above) -> FloatArray:
        """What the camera reads, (beds + 1, m): own radiance, and that of sky and ground mirrored."""
        sky = band_radiance(above.window_temperature_k())
        grey = self.ground.emissivity
        ground = grey * band_radiance(surface[-1]) + (1.0 - grey) * sky
        seen = []
        for facet, temperature in zip((*self.beds, self.ground), surface, strict=True):
            cos_tilt = float(normal(facet.tilt_deg, facet.azimuth_deg)[2])
            mirrored = skylight.sky_view(cos_tilt) * sky + skylight.ground_view(cos_tilt) * ground
            own = facet.emissivity * band_radiance(temperature)
            seen.append(band_temperature(own + (1.0 - facet.emissivity) * mirrored))
        return np.array(seen)


def illuminance_lx(above: Above, cos_zenith: FloatArray) -> FloatArray:
    """What a light meter lying flat receives, (m,), with the loss of its diffuser at low sun.

    Beam and sky differ in lumens per watt, so no single factor turns the reading into W/m².
    """
    cosine = np.maximum(cos_zenith, 0.0)
    tan2 = 1.0 / np.maximum(cosine, 0.05) ** 2 - 1.0
    beam = above.dni * cosine * np.maximum(1.0 - _COSINE_LOSS * tan2, 0.0)
    return BEAM_LM_W * beam + SKY_LM_W * above.dhi
