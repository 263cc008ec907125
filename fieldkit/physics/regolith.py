"""Heat in loose ground of the Moon and of Mars: denser with depth, with radiation between grains as T³.

Finite volumes and implicit steps, so a day of the Moon needs hundreds of steps, not the many that an explicit
scheme is held to.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.model.arrays import FloatArray
from fieldkit.physics.constants import STEFAN_BOLTZMANN

CONVERGED_K = 1e-3
_AT_350_K = 350.0**3


@dataclass(frozen=True, slots=True)
class Regolith:
    """Loose ground; the defaults are the Moon's.

    Conductivity k and density rho go from their values at the surface to those at depth as
    ``exp(-z / scale_height_m)``; k grows by ``radiative (T / 350 K)³``. `heat_capacity` are the coefficients
    of a polynomial in T, J/(kg K), highest power first.

    References
    ----------
    .. [1] P. O. Hayne et al., "Global regolith thermophysical properties of the Moon from the Diviner Lunar
       Radiometer Experiment", J. Geophys. Res. Planets 122, 2371-2400, 2017, table A1,
       doi:10.1002/2017JE005387.
    """

    surface_conductivity_w_m_k: float = 7.4e-4
    deep_conductivity_w_m_k: float = 3.4e-3
    surface_density_kg_m3: float = 1100.0
    deep_density_kg_m3: float = 1800.0
    scale_height_m: float = 0.07
    radiative: float = 2.7
    heat_capacity: tuple[float, ...] = (8.9093e-9, -1.234e-5, 2.3616e-3, 2.7431, -3.6125)
    emissivity: float = 0.95
    flux_from_below_w_m2: float = 0.018

    def conductivity_w_m_k(self, depth_m: ArrayLike, temperature_k: ArrayLike) -> FloatArray:
        """Conductivity at a depth and temperature, shapes broadcast."""
        contact = self._at(depth_m, self.surface_conductivity_w_m_k, self.deep_conductivity_w_m_k)
        return contact * (1.0 + self.radiative * np.asarray(temperature_k) ** 3 / _AT_350_K)

    def capacity_j_m3_k(self, depth_m: ArrayLike, temperature_k: ArrayLike) -> FloatArray:
        """Heat capacity by volume at a depth and temperature, shapes broadcast."""
        density = self._at(depth_m, self.surface_density_kg_m3, self.deep_density_kg_m3)
        return density * np.polyval(self.heat_capacity, np.asarray(temperature_k, np.float64))

    def _at(self, depth_m: ArrayLike, surface: float, deep: float) -> FloatArray:
        return np.asarray(deep - (deep - surface) * np.exp(-np.asarray(depth_m) / self.scale_height_m))


def day_temperatures(
    regolith: Regolith,
    absorbed_w_m2: FloatArray,
    day_s: float,
    *,
    exchange_w_m2_k: float = 0.0,
    air_temperature_k: float = 0.0,
    days: int = 20,
    start_k: float = 250.0,
) -> FloatArray:
    """Surface temperature over a day that repeats, once the ground has settled.

    Parameters
    ----------
    regolith
        The ground.
    absorbed_w_m2
        Absorbed light and longwave at equal steps of one day, shape (n,). [W/m2]
    day_s
        Length of the day. [s]
    exchange_w_m2_k, air_temperature_k
        Exchange of heat with the air, if there is any. [W m-2 K-1], [K]
    days
        How many days the ground settles.
    start_k
        Temperature of the whole ground at the start: near its mean below the surface. [K]

    Returns
    -------
    At the end of each step of the last day, shape (n,). [K]
    """
    depth = depths_m(regolith, day_s)
    step_s = day_s / absorbed_w_m2.size
    layers, surface = np.full(depth.size, start_k), np.empty(absorbed_w_m2.size)
    for _ in range(days):
        for index, absorbed in enumerate((absorbed_w_m2 + exchange_w_m2_k * air_temperature_k).tolist()):
            layers = _after(regolith, depth, layers, absorbed, exchange_w_m2_k, step_s)
            surface[index] = layers[0]
    return surface


def depths_m(regolith: Regolith, day_s: float, *, per_skin: int = 20, skins: float = 20.0) -> FloatArray:
    """Depths of the nodes: `per_skin` of them in the first skin depth of a day, each step a tenth longer."""
    diffusivity = regolith.conductivity_w_m_k(0.0, 250.0) / regolith.capacity_j_m3_k(0.0, 250.0)
    skin_m = float(np.sqrt(diffusivity * day_s / np.pi))
    count = int(np.ceil(np.log(1.0 + skins * per_skin * 0.1) / np.log(1.1)))
    return np.append(0.0, np.cumsum(skin_m / per_skin * 1.1 ** np.arange(count)))


def _after(
    regolith: Regolith,
    depth_m: FloatArray,
    layers_k: FloatArray,
    supply_w_m2: float,
    exchange_w_m2_k: float,
    step_s: float,
) -> FloatArray:
    """Node temperatures after one implicit step; emission is found by Newton's method."""
    thick = np.diff(depth_m)
    between = regolith.conductivity_w_m_k(
        (depth_m[1:] + depth_m[:-1]) / 2.0, (layers_k[1:] + layers_k[:-1]) / 2.0
    )
    between = between / thick
    below, above = _around_nodes(thick)
    cells = (below + above) / 2.0
    stored = regolith.capacity_j_m3_k(depth_m, layers_k) * cells / step_s
    bands = np.zeros((3, depth_m.size))
    bands[0, 1:] = bands[2, :-1] = -between
    below, above = _around_nodes(between)
    bands[1] = stored + below + above
    heat = stored * layers_k
    bands[1, 0] += exchange_w_m2_k
    heat[0] += supply_w_m2
    heat[-1] += regolith.flux_from_below_w_m2
    return _with_emission(bands, heat, layers_k[0], regolith.emissivity * STEFAN_BOLTZMANN)


def _around_nodes(between: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Of what lies between nodes (n - 1,), what is below and above each node (n,), 0 beyond the ends."""
    padded = np.concatenate([[0.0], between, [0.0]])
    return padded[1:], padded[:-1]


def _with_emission(bands: FloatArray, heat: FloatArray, guess_k: float, quartic: float) -> FloatArray:
    # as `solve_banded`, which takes longer to check its input; slow to import, and every reader imports this
    from scipy.linalg.lapack import dgtsv

    while True:
        system, supply = bands.copy(), heat.copy()
        system[1, 0] += 4.0 * quartic * guess_k**3
        supply[0] += 3.0 * quartic * guess_k**4
        *_, solved, _ = dgtsv(system[2, :-1], system[1], system[0, 1:], supply)
        found = np.asarray(solved)
        if abs(found[0] - guess_k) < CONVERGED_K:
            return found
        guess_k = float(found[0])
