"""The paper's energy balance of a surface, eqs. (1) to (7), one function per equation.

The source of every equation is Watanabe et al., "A Terrain Slope Estimation Scheme using Infrared Camera for
Planetary Exploration Rovers". Fluxes in W/m2, positive in the direction of the symbol's arrow; temperatures
in kelvin; arrays broadcast. Diffuse light is in `daylight`, heat storage and conduction are in `slab`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.model.arrays import FloatArray
from fieldkit.physics.constants import STEFAN_BOLTZMANN


@dataclass(frozen=True, slots=True)
class SurfaceParameters:
    """Properties of a surface that its energy balance needs; the defaults are the paper's Table 1.

    `albedo` in [0, 1). `emissivity` is that of the camera's band, `emissivity_broadband` that of eqs. (4),
    (6), (7), both in (0, 1]; for quartz sand they differ. `exchange_m_s` is C_H U.
    """

    albedo: float = 0.20
    emissivity: float = 0.90
    emissivity_broadband: float = 0.90
    heat_capacity_j_kg_k: float = 1000.0
    air_density_kg_m3: float = 1.21
    exchange_m_s: float = 0.015

    def __post_init__(self) -> None:
        if not 0.0 <= self.albedo < 1.0:
            raise ValueError(f"albedo must lie in [0, 1), not {self.albedo}")
        for name in ("emissivity", "emissivity_broadband"):
            if not 0.0 < getattr(self, name) <= 1.0:
                raise ValueError(f"{name} must lie in (0, 1], not {getattr(self, name)}")

    @property
    def exchange_w_m2_k(self) -> float:
        """Coefficient of heat exchange with the air, C_p rho C_H U, W m-2 K-1."""
        return self.heat_capacity_j_kg_k * self.air_density_kg_m3 * self.exchange_m_s

    @property
    def alpha(self) -> float:
        """The paper's alpha of eq. (6), W m-2 K-4."""
        return self.emissivity_broadband * STEFAN_BOLTZMANN / (1.0 - self.albedo)

    @property
    def beta(self) -> float:
        """The paper's beta of eq. (6), W m-2 K-1."""
        return self.exchange_w_m2_k / (1.0 - self.albedo)


def balance(
    shortwave_down: ArrayLike,
    longwave_down: ArrayLike,
    longwave_emitted: ArrayLike,
    shortwave_reflected: ArrayLike,
    longwave_reflected: ArrayLike,
    sensible_heat: ArrayLike,
    latent_heat: ArrayLike = 0.0,
    ground_flux: ArrayLike = 0.0,
) -> FloatArray:
    """Eq. (1): residual of the energy balance, inputs less outputs.

    Parameters
    ----------
    shortwave_down, longwave_down
        Irradiance that reaches the surface. [W/m2]
    longwave_emitted, shortwave_reflected, longwave_reflected
        Radiation that leaves it. [W/m2]
    sensible_heat, latent_heat
        Turbulent fluxes into the air. [W/m2]
    ground_flux
        Heat flux into the ground. [W/m2]

    Returns
    -------
    Shape of the arguments, broadcast; zero in balance. [W/m2]
    """
    gained = np.add(shortwave_down, longwave_down)
    radiated = np.add(longwave_emitted, shortwave_reflected) + np.asarray(longwave_reflected)
    carried = np.add(sensible_heat, latent_heat) + np.asarray(ground_flux)
    return np.asarray(gained - radiated - carried)


def direct_irradiance(dni_w_m2: ArrayLike, cos_incidence: ArrayLike) -> FloatArray:
    """Eq. (2): direct irradiance on a facet, S cos(theta); zero on one that faces away from the sun, W/m2."""
    return np.asarray(np.multiply(dni_w_m2, np.maximum(cos_incidence, 0.0)))


def emitted_longwave(temperature_k: ArrayLike, emissivity: ArrayLike) -> FloatArray:
    """Eq. (4): longwave exitance by a broadband emissivity in (0, 1], epsilon sigma T^4, W/m2."""
    return np.asarray(np.multiply(emissivity, STEFAN_BOLTZMANN * np.asarray(temperature_k, np.float64) ** 4))


def sensible_heat(
    temperature_k: ArrayLike, air_temperature_k: ArrayLike, parameters: SurfaceParameters
) -> FloatArray:
    """Eq. (5): sensible heat flux into the air, C_p rho C_H U (T - T_a), W/m2."""
    return np.asarray(parameters.exchange_w_m2_k * np.subtract(temperature_k, air_temperature_k))


def irradiance_difference(
    temperature_k: ArrayLike, reference_k: ArrayLike, parameters: SurfaceParameters
) -> FloatArray:
    """Eq. (6): direct irradiance of the target less that of the reference, from their temperatures, W/m2.

    `parameters` are those that both surfaces share.
    """
    target, reference = np.asarray(temperature_k, np.float64), np.asarray(reference_k, np.float64)
    return np.asarray(parameters.alpha * (target**4 - reference**4) + parameters.beta * (target - reference))


def irradiance_per_kelvin(temperature_k: ArrayLike, parameters: SurfaceParameters) -> FloatArray:
    """Derivative of eq. (6) by the target's temperature, D = 4 alpha T^3 + beta, W m-2 K-1.

    About 30 for dry sand in the sun.
    """
    return np.asarray(4.0 * parameters.alpha * np.asarray(temperature_k, np.float64) ** 3 + parameters.beta)


def surface_temperature(
    shortwave_down_w_m2: ArrayLike,
    longwave_down_w_m2: ArrayLike,
    air_temperature_k: ArrayLike,
    parameters: SurfaceParameters,
) -> FloatArray:
    """Eq. (7): temperature of a dry surface without heat storage.

    Parameters
    ----------
    shortwave_down_w_m2
        S_w of eq. (2), before reflection. [W/m2]
    longwave_down_w_m2
        Longwave irradiance of the sky. [W/m2]
    air_temperature_k
        Air temperature. [K]
    parameters
        Properties of surface and air.

    Returns
    -------
    Shape of the arguments, broadcast; NaN where no temperature balances. [K]
    """
    exchange = parameters.exchange_w_m2_k
    absorbed = (1.0 - parameters.albedo) * np.asarray(shortwave_down_w_m2, np.float64)
    absorbed = absorbed + parameters.emissivity_broadband * np.asarray(longwave_down_w_m2, np.float64)
    supply = absorbed + np.multiply(exchange, air_temperature_k)
    return balance_temperature(supply, exchange, parameters.emissivity_broadband)


def balance_temperature(
    supply_w_m2: ArrayLike,
    linear_loss_w_m2_k: ArrayLike,
    emissivity: ArrayLike,
    *,
    guess_k: ArrayLike | None = None,
) -> FloatArray:
    """Solve ``emissivity sigma T^4 + linear_loss T = supply`` for T >= 0.

    By Newton's method from above, where a convex function cannot overshoot; a guess below is overshot once.

    Parameters
    ----------
    supply_w_m2
        What the surface has to give off at T. [W/m2]
    linear_loss_w_m2_k
        Loss in proportion to T, at least 0. [W m-2 K-1]
    emissivity
        Broadband emissivity, in (0, 1]. [-]
    guess_k
        Where to begin, above 0; saves time, does not change the result. [K]

    Returns
    -------
    Shape of the arguments, broadcast; NaN for a supply that is NaN or below zero. [K]
    """
    supply = np.asarray(supply_w_m2, np.float64)
    supply = np.where(supply >= 0.0, supply, np.nan)
    linear, quartic = np.asarray(linear_loss_w_m2_k, np.float64), np.multiply(emissivity, STEFAN_BOLTZMANN)
    if guess_k is None:
        # the temperature at which either loss alone would give off as much
        begin = np.minimum((supply / quartic) ** 0.25, supply / np.maximum(linear, 1e-200))
    else:
        begin = np.where(supply >= 0.0, guess_k, np.nan)
    temperature = begin + np.zeros_like(linear)
    for _ in range(60):  # three are enough near the answer, sixty from anywhere
        cubic = quartic * temperature * temperature * temperature  # a power takes ten times as long
        slope = 4.0 * cubic + linear
        step = ((cubic + linear) * temperature - supply) / np.where(slope > 0, slope, 1.0)
        temperature = temperature - step
        if not np.any(np.abs(step) > 1e-10):
            break
    return np.asarray(temperature)
