"""Heat conduction in a layer of sand over an insulating sheet: one-dimensional, no flux through the bottom.

The scene knows the fluxes at the surface and needs its temperature: `warm_slab` couples the layer to the
surface balance by implicit finite volumes, with a node on the surface and thinner layers near it. The full
surface model knows the measured surface temperature and needs the flux into the ground: `conducted_flux` is
exact for a surface temperature that is linear between readings. A thick slab stands for deep sand.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.fft import irfft, next_fast_len, rfft
from scipy.linalg import solve_banded

from fieldkit.physics.energy_balance import balance_temperature
from fieldkit.physics.facet import FloatArray

_DEEP = 0.01
"""Fourier number below which the bottom has no influence: its echo is exp(-1 / 0.01) of the step."""
_TERMS = 24
"""Terms of the series at that number: the next one is below 1e-18."""


@dataclass(frozen=True, slots=True)
class Slab:
    """A conducting layer; the defaults are 3 cm of dry loose silica sand.

    `layers` and `growth` are the grid of `warm_slab`: the number of layers, and the ratio of each one's
    thickness to that of the layer above.
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
    """Node temperatures after one step, with the surface in balance with sky and air.

    Parameters
    ----------
    slab
        The layer.
    temperature_k
        Node temperatures, shape (layers + 1,) or (layers + 1, m) for m beds on equal layers. [K]
    step_s
        Length of the step; backward Euler, stable at any length, accurate to about 30 s. [s]
    absorbed_w_m2
        Sunlight and longwave that the surface absorbs, scalar or (m,). [W/m2]
    exchange_w_m2_k
        Coefficient of heat exchange with the air. [W m-2 K-1]
    air_temperature_k
        Air temperature. [K]
    emissivity
        Broadband emissivity, in (0, 1]. [-]

    Returns
    -------
    Shape of `temperature_k`. [K]

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


def conducted_flux(slab: Slab, surface_k: ArrayLike, step_s: float) -> FloatArray:
    """Heat flux into a layer with a given surface temperature.

    Parameters
    ----------
    slab
        The layer.
    surface_k
        Surface temperatures, shape (n,) or (n, m), at equal steps without gaps; linear in between. Only
        differences matter, so T - T_reference may be given as well: the operator is linear. [K]
    step_s
        The step. [s]

    Returns
    -------
    Shape of `surface_k`. The layer starts at the first temperature throughout, so the first value is 0 and
    early values carry that assumption: start well before use (an hour for 3 cm, two days for 30 cm). [W/m2]
    """
    surface = np.asarray(surface_k, np.float64)
    flux = np.zeros_like(surface)
    steps = len(surface) - 1
    if steps < 1:
        return flux
    response = np.diff(heat_of_step(slab, step_s * np.arange(steps + 1))) / step_s
    size = next_fast_len(2 * steps, real=True)
    warming = rfft(np.diff(surface, axis=0), size, axis=0)
    responses = rfft(response, size).reshape(-1, *(1,) * (surface.ndim - 1))
    flux[1:] = irfft(warming * responses, size, axis=0)[:steps]
    return flux


def heat_of_step(slab: Slab, time_s: ArrayLike) -> FloatArray:
    """Heat absorbed by a layer since its surface warmed by one kelvin at time 0.

    Parameters
    ----------
    slab
        The layer.
    time_s
        Time since the step, at least 0, any shape. [s]

    Returns
    -------
    Same shape. [J m-2 K-1]

    Notes
    -----
    As into an infinitely deep layer until the bottom matters, then the Fourier series of the layer; they
    agree to 1e-15 where they meet.

    References
    ----------
    .. [1] H. S. Carslaw and J. C. Jaeger, Conduction of Heat in Solids, 2nd ed., Oxford, 1959, 2.5 and 3.4.
    """
    time = np.asarray(time_s, np.float64)
    whole = slab.heat_capacity_j_m3_k * slab.depth_m
    fourier_number = slab.conductivity_w_m_k * time / (whole * slab.depth_m)
    odd = np.pi * (np.arange(_TERMS) + 0.5)
    left = np.exp(-np.multiply.outer(fourier_number, odd**2)) @ (2.0 / odd**2)
    deep = 2.0 * slab.thermal_inertia * np.sqrt(time / np.pi)
    return np.where(fourier_number < _DEEP, deep, whole * (1.0 - left))
