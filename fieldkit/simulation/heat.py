"""How warm the beds get: radiation on each facet, exchange with the air, heat stored in the sand.

More than the paper's eqs. (1) to (7) know of: light of the sky and the ground, the long wave
of both, wind, and conduction into the layer, stepped finely and once per scene.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fieldkit.physics import sky as skylight
from fieldkit.physics.facet import FloatArray, cos_incidence, normal
from fieldkit.physics.slab import Slab, warm_slab
from fieldkit.physics.surface import STEFAN_BOLTZMANN, balance_temperature
from fieldkit.simulation.facets import Facet
from fieldkit.simulation.sky import Above

STEP_S = 10.0
# after a break of the light even a thin foil is followed: steps of 20 ms, each a tenth longer
_AFTER_BREAK_S = np.append(0.0, np.cumsum(0.02 * 1.1 ** np.arange(60)))


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


def fine_times(begin_s: float, end_s: float, breaks_s: FloatArray) -> FloatArray:
    """Times every `STEP_S`, denser after each break of the light, shape (m,)."""
    regular = np.arange(begin_s, end_s + STEP_S, STEP_S)
    after = (breaks_s[:, np.newaxis] + _AFTER_BREAK_S).ravel()
    times = np.unique(np.round(np.concatenate([regular, after]), 6))
    return times[(times >= begin_s) & (times <= end_s)]


@dataclass(frozen=True, slots=True)
class Light:
    """Everything that shines, at times (m,): sky and air, sun vectors (m, 3), and bright ground."""

    above: Above
    sun: FloatArray
    extraterrestrial_w_m2: FloatArray
    ground_albedo: float

    def absorbed_w_m2(self, facet: Facet, ground_longwave_w_m2: FloatArray) -> FloatArray:
        """What a facet takes in of sun, sky and ground, short wave and long, (m,)."""
        up = normal(facet.tilt_deg, facet.azimuth_deg)
        cos_i, cos_z, cos_tilt = cos_incidence(up, self.sun), self.sun[:, 2], float(up[2])
        dni, dhi = np.where(cos_z > 0.0, self.above.dni, 0.0), self.above.dhi
        direct = dni * np.maximum(cos_i, 0.0)
        diffuse = skylight.hay_davies_diffuse(dhi, dni, self.extraterrestrial_w_m2, cos_i, cos_z, cos_tilt)
        total = dni * np.maximum(cos_z, 0.0) + dhi
        reflected = skylight.ground_reflected(total, self.ground_albedo, cos_tilt)
        longwave = skylight.longwave_on_facet(self.above.longwave_down_w_m2, ground_longwave_w_m2, cos_tilt)
        return (1.0 - facet.albedo) * (direct + diffuse + reflected) + facet.emissivity_broadband * longwave


def surface_curves(
    facets: Sequence[Facet], time_s: FloatArray, absorbed: FloatArray, exchange: FloatArray, air_k: FloatArray
) -> FloatArray:
    """Surface temperatures (k, m) of k facets at times (m,), from what they absorb (k, m).

    Each starts in balance with the first moment, its whole layer at that temperature. Kelvin and W/m².
    """
    curves = np.empty_like(absorbed)
    rows_of: dict[Slab, list[int]] = {}
    for row, facet in enumerate(facets):
        rows_of.setdefault(facet.slab, []).append(row)
    for slab, rows in rows_of.items():
        grey = np.array([facets[row].emissivity_broadband for row in rows])
        curves[rows] = _one_layer(slab, time_s, absorbed[rows], exchange, air_k, grey)
    return curves


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


def longwave_out(surface_k: FloatArray, ground: Facet, above: Above) -> FloatArray:
    """Long wave that leaves flat ground, its own and what it mirrors of the sky, W/m²."""
    grey = ground.emissivity_broadband
    return grey * STEFAN_BOLTZMANN * surface_k**4 + (1.0 - grey) * above.longwave_down_w_m2


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
