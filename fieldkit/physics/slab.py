"""Heat in a layer of sand over an insulating sheet: one-dimensional conduction, implicit.

Two ways in, for two users. The scene knows what the surface receives and wants its
temperature: `warm_slab` couples the layer to the surface balance. The full surface model
knows the measured surface temperature and wants what went into the ground:
`conducted_flux`. Both use the same finite volumes: a node on the surface, nodes closer
together near it, no flux through the bottom. A thick slab stands for deep sand.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_banded

from fieldkit.physics.facet import FloatArray
from fieldkit.physics.surface import balance_temperature


@dataclass(frozen=True, slots=True)
class Slab:
    """A conducting layer; the defaults are 3 cm of dry loose silica sand.

    `growth` is the ratio of one layer's thickness to the one above it.
    """

    depth_m: float = 0.03
    conductivity_w_m_k: float = 0.25
    heat_capacity_j_m3_k: float = 1.3e6
    layers: int = 16
    growth: float = 1.15

    @property
    def thermal_inertia(self) -> float:
        """Gamma = sqrt(k rho c), J m-2 K-1 s-1/2; 450-700 for dry loose silica sand."""
        return float(np.sqrt(self.conductivity_w_m_k * self.heat_capacity_j_m3_k))

    def depths_m(self) -> FloatArray:
        """Depths of the nodes (layers + 1,), from 0 to `depth_m`."""
        thickness = self.growth ** np.arange(self.layers)
        return np.concatenate([[0.0], np.cumsum(thickness) / thickness.sum()]) * self.depth_m


@lru_cache(maxsize=256)
def _conduction(slab: Slab) -> tuple[FloatArray, FloatArray]:
    """Conductance between neighbouring nodes (layers,) and heat capacity of each (layers + 1,)."""
    thickness = np.diff(slab.depths_m())
    half = slab.heat_capacity_j_m3_k * thickness / 2.0
    return slab.conductivity_w_m_k / thickness, np.append(half, 0.0) + np.insert(half, 0, 0.0)


@lru_cache(maxsize=256)
def _implicit(slab: Slab, step_s: float) -> FloatArray:
    """Banded matrix of one backward Euler step, rows for `solve_banded` with (1, 1)."""
    between, capacity = _conduction(slab)
    bands = np.zeros((3, slab.layers + 1))
    bands[0, 1:] = bands[2, :-1] = -between
    bands[1] = capacity / step_s
    bands[1, :-1] += between
    bands[1, 1:] += between
    return bands


@lru_cache(maxsize=256)
def _response(slab: Slab, step_s: float) -> FloatArray:
    """Warming (layers + 1,) after one step by 1 W/m2 into the surface, K per W/m2."""
    unit = np.zeros(slab.layers + 1)
    unit[0] = 1.0
    return np.asarray(solve_banded((1, 1), _implicit(slab, step_s), unit))


def warm_slab(
    slab: Slab,
    temperature_k: FloatArray,
    step_s: float,
    absorbed_w_m2: ArrayLike,
    exchange_w_m2_k: ArrayLike,
    air_temperature_k: ArrayLike,
    emissivity: ArrayLike,
) -> FloatArray:
    """Node temperatures one step later, with the surface in balance with sky and air.

    Parameters
    ----------
    slab
        The layer.
    temperature_k
        Node temperatures, shape (layers + 1,) or (layers + 1, m) for m beds on the same layer. [K]
    step_s
        Length of the step; backward Euler, stable at any length, accurate to about 30 s. [s]
    absorbed_w_m2
        Sunlight and long wave the surface takes in, scalar or (m,). [W/m2]
    exchange_w_m2_k, air_temperature_k, emissivity
        Heat exchange with the air, its temperature, and the broadband emissivity.

    Notes
    -----
    The layer is linear: its surface ends at ``a + r q`` when q flows in. With
    ``q = absorbed - e sigma T^4 - h (T - T_a)`` one Newton search of a scalar is exact.
    """
    _, capacity = _conduction(slab)
    stored = (capacity / step_s * temperature_k.T).T
    coasting = solve_banded((1, 1), _implicit(slab, step_s), stored)
    response = _response(slab, step_s)
    supply = np.add(absorbed_w_m2, np.multiply(exchange_w_m2_k, air_temperature_k))
    surface = balance_temperature(
        supply + coasting[0] / response[0], exchange_w_m2_k + 1.0 / response[0], emissivity
    )
    inflow = (surface - coasting[0]) / response[0]
    return np.asarray(coasting + np.multiply.outer(response, inflow))


def conducted_flux(slab: Slab, surface_k: ArrayLike, time_s: ArrayLike) -> FloatArray:
    """Heat flux into the layer whose surface has these temperatures, W/m2, shape of `surface_k`.

    Parameters
    ----------
    slab
        The layer.
    surface_k
        Surface temperatures (n,) or (n, m), without gaps. Only differences count, so T - T_reference
        may be given as well: the operator is linear. [K]
    time_s
        Their times (n,), increasing; steps up to a few minutes. [s]

    Returns
    -------
    Mean flux over the step that ends at each time. The layer starts at the first
    temperature throughout, so the first value is 0 and the early ones carry that guess:
    start well before use (an hour for 3 cm). [W/m2]
    """
    surface = np.asarray(surface_k, np.float64)
    steps = np.diff(np.asarray(time_s, np.float64))
    between, capacity = _conduction(slab)
    below = np.broadcast_to(surface[0], (slab.layers, *surface.shape[1:])).copy()
    flux = np.zeros_like(surface)
    for row, step_s in enumerate(steps, start=1):
        stored = (capacity[1:] / step_s * below.T).T
        stored[0] += between[0] * surface[row]
        below = solve_banded((1, 1), _implicit(slab, float(step_s))[:, 1:], stored)
        warming = capacity[0] * (surface[row] - surface[row - 1]) / step_s
        flux[row] = between[0] * (surface[row] - below[0]) + warming
    return flux
