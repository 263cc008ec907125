"""Heat conduction in a layer of sand over an insulating sheet: one-dimensional, no flux through the bottom.

The scene knows the fluxes at the surface and needs its temperature: `SlabStep` couples the layer to the
surface balance by implicit finite volumes, with a node on the surface and thinner layers near it;
`surface_series` runs the same steps over a whole record of one bed. The full
surface model knows the measured surface temperature and needs the flux into the ground: `conducted_flux` is
exact for a surface temperature that is linear between readings. A thick slab stands for deep sand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.model.arrays import FloatArray
from fieldkit.physics.constants import STEFAN_BOLTZMANN
from fieldkit.physics.energy_balance import balance_temperature

_DEEP = 0.01
"""Fourier number below which the bottom has no influence: its echo is exp(-1 / 0.01) of the step."""
_TERMS = 24
"""Terms of the series at that number: the next one is below 1e-18."""


@dataclass(frozen=True, slots=True)
class Slab:
    """A conducting layer; the defaults are 3 cm of dry loose silica sand.

    `layers` and `growth` are the grid of `SlabStep`: the number of layers, and the ratio of each one's
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


Stack = tuple[Slab, ...]
"""Slabs in contact, from the surface down, over an insulating sheet."""


def _conduction(stack: Stack) -> tuple[FloatArray, FloatArray]:
    """Conductance between neighbouring nodes (n - 1,) and heat capacity of each (n,)."""
    thickness = [np.diff(slab.depths_m()) for slab in stack]
    between = [slab.conductivity_w_m_k / thick for slab, thick in zip(stack, thickness, strict=True)]
    capacities = [slab.heat_capacity_j_m3_k * thick for slab, thick in zip(stack, thickness, strict=True)]
    # a node has half of the layer above it and half of that below
    half = np.concatenate(capacities) / 2.0
    return np.concatenate(between), np.append(half, 0.0) + np.insert(half, 0, 0.0)


def _step_matrix(stack: Stack, step_s: float) -> FloatArray:
    """Node temperatures after one backward Euler step by the heat in each node before it, (n, n)."""
    from scipy.linalg import solve_banded  # slow to import, and every configuration imports this file

    between, capacity = _conduction(stack)
    # backward Euler: (C / dt + K) T' = C / dt T, with K tridiagonal
    bands = np.zeros((3, capacity.size))
    bands[0, 1:] = bands[2, :-1] = -between
    bands[1] = capacity / step_s
    bands[1, :-1] += between
    bands[1, 1:] += between
    return np.asarray(solve_banded((1, 1), bands, np.eye(capacity.size)))


@dataclass(frozen=True, slots=True)
class SlabStep:
    """One step of k stacks with equally many nodes n, each with its surface in balance with sky and air.

    Backward Euler: stable at any length, accurate to about 30 s. Stacks are linear: without heat through the
    surface their nodes pass to `coasting` (k, n, n) times the nodes before, and 1 W/m2 into it warms them by
    `response` (k, n) on top.
    """

    coasting: FloatArray
    response: FloatArray

    @classmethod
    def of(cls, stacks: Sequence[Stack], step_s: float) -> SlabStep:
        """The step of that length, s."""
        matrices = [_step_matrix(stack, step_s) for stack in stacks]
        capacities = [_conduction(stack)[1] / step_s for stack in stacks]
        coasting = [matrix * capacity for matrix, capacity in zip(matrices, capacities, strict=True)]
        return cls(np.array(coasting), np.array([matrix[:, 0] for matrix in matrices]))

    def after(
        self,
        temperature_k: FloatArray,
        absorbed_w_m2: ArrayLike,
        exchange_w_m2_k: ArrayLike,
        air_temperature_k: ArrayLike,
        emissivity: ArrayLike,
    ) -> FloatArray:
        """Node temperatures after the step, shape of those before it: (k, n), or (m, n) for m beds on a
        single stack.

        The surface absorbs light and longwave, exchanges heat with the air and emits with an emissivity in
        (0, 1]: each a scalar or (k,), units as of `surface_series`. It ends at ``a + r q`` when q flows in.
        With ``q = absorbed - e sigma T^4 - h (T - T_a)`` one Newton search of a scalar is exact.
        """
        coasting = np.matmul(self.coasting, temperature_k[:, :, np.newaxis])[:, :, 0]
        alone, stiffness = coasting[:, 0], 1.0 / self.response[:, 0]
        supply = np.add(absorbed_w_m2, np.multiply(exchange_w_m2_k, air_temperature_k))
        surface = balance_temperature(
            supply + alone * stiffness, np.add(exchange_w_m2_k, stiffness), emissivity, guess_k=alone
        )
        inflow = (surface - alone) * stiffness
        return np.asarray(coasting + self.response * inflow[:, np.newaxis])


def surface_series(
    stack: Stack,
    start_k: float,
    step_s: ArrayLike,
    absorbed_w_m2: FloatArray,
    exchange_w_m2_k: FloatArray,
    air_temperature_k: FloatArray,
    emissivity: float,
) -> FloatArray:
    """Surface temperatures of one bed over a record, by the steps of `SlabStep`.

    Parameters
    ----------
    stack
        Its layers, at `start_k` throughout in the first row.
    start_k
        Temperature in the first row. [K]
    step_s
        From each row to the next, scalar or (n - 1,). [s]
    absorbed_w_m2
        Sunlight and longwave that the surface absorbs, shape (n,). [W/m2]
    exchange_w_m2_k
        Coefficient of heat exchange with the air, (n,). [W m-2 K-1]
    air_temperature_k
        Air temperature, (n,). [K]
    emissivity
        Broadband emissivity, in (0, 1]. [-]

    Returns
    -------
    Shape (n,). [K]

    Notes
    -----
    Each step is one small matrix product and a Newton search in plain floats, 4 microseconds.
    """
    steps = np.broadcast_to(step_s, len(absorbed_w_m2) - 1).tolist()
    matrices = {step: SlabStep.of([stack], step) for step in set(steps)}
    supply = (absorbed_w_m2 + exchange_w_m2_k * air_temperature_k)[1:].tolist()
    layers, surface = np.full(1 + sum(slab.layers for slab in stack), start_k), [float(start_k)]
    for step, supplied, exchange in zip(steps, supply, exchange_w_m2_k[1:].tolist(), strict=True):
        response = matrices[step].response[0]
        coasting = matrices[step].coasting[0] @ layers
        top, per_flux = float(coasting[0]), float(response[0])
        # the layer takes (T - top) / per_flux: one more loss that is linear in T
        loss = exchange + 1.0 / per_flux
        surface.append(_balance(supplied + top / per_flux, loss, emissivity, surface[-1]))
        layers = coasting + response * ((surface[-1] - top) / per_flux)
    return np.array(surface)


def _balance(supply: float, loss: float, emissivity: float, guess: float) -> float:
    """`balance_temperature` of plain floats, from a guess nearby."""
    temperature, quartic = guess, emissivity * STEFAN_BOLTZMANN
    for _ in range(60):  # two or three are enough from one minute to the next
        excess = quartic * temperature**4 + loss * temperature - supply
        change = excess / (4.0 * quartic * temperature**3 + loss)
        temperature -= change
        if abs(change) < 1e-9:
            break
    return temperature


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
    from scipy.fft import irfft, next_fast_len, rfft

    surface = np.asarray(surface_k, np.float64)
    flux = np.zeros_like(surface)
    steps = len(surface) - 1
    if steps < 1:
        return flux
    # a ramp over one step is a step averaged over it (Duhamel), and flux is the change of heat
    response = np.diff(heat_of_step(slab, step_s * np.arange(steps + 1))) / step_s
    # twice as long, or the convolution would wrap around
    size = next_fast_len(2 * steps, real=True)
    warming = rfft(np.diff(surface, axis=0), size, axis=0)
    responses = rfft(response, size).reshape(-1, *(1,) * (surface.ndim - 1))
    flux[1:] = irfft(warming * responses, size, axis=0)[:steps]
    return flux


def heat_of_step(slab: Slab, time_s: ArrayLike) -> FloatArray:
    """Heat absorbed by a layer since its surface warmed by one kelvin, at times of any shape from then, J m-2
    K-1.

    As into an infinitely deep layer until the bottom matters, then the Fourier series of the layer; they
    agree to 1e-15 where they meet. H. S. Carslaw and J. C. Jaeger, Conduction of Heat in Solids, 2nd ed.,
    Oxford, 1959, 2.5 and 3.4.
    """
    time = np.asarray(time_s, np.float64)
    whole = slab.heat_capacity_j_m3_k * slab.depth_m
    fourier_number = slab.conductivity_w_m_k * time / (whole * slab.depth_m)
    odd = np.pi * (np.arange(_TERMS) + 0.5)
    remaining = np.exp(-np.multiply.outer(fourier_number, odd**2)) @ (2.0 / odd**2)
    deep = 2.0 * slab.thermal_inertia * np.sqrt(time / np.pi)
    return np.where(fourier_number < _DEEP, deep, whole * (1.0 - remaining))
