"""Gusts on top of a sky's wind: turbulence of von Karman's spectrum, a pure function of time and seed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fieldkit.model.arrays import FloatArray, IntArray
from fieldkit.model.site import Site
from fieldkit.model.units import SECOND_NS
from fieldkit.simulation.sky import Sky, SkyState

_EDGES_HZ = np.geomspace(1e-5, 0.05, 257)
"""From a day to the steps of a scene."""


def von_karman(frequency_hz: FloatArray, time_scale_s: float) -> FloatArray:
    """Spectrum of a wind component along the wind, one-sided, of unit variance, 1/Hz.

    At frequencies f above 0, any shape; the time scale is the length scale L over the mean wind U. T. von
    Karman, "Progress in the statistical theory of turbulence", PNAS 34, 530-539, 1948; in this form ESDU
    85020: f S / sigma² = 4 x / (1 + 70.8 x²)^(5/6), x = f L / U.
    """
    return np.asarray(4.0 * time_scale_s / (1.0 + 70.8 * (frequency_hz * time_scale_s) ** 2) ** (5.0 / 6.0))


@dataclass(frozen=True, slots=True)
class Gusts:
    """Turbulence of the wind.

    `intensity` is the standard deviation of a component over the mean wind; `convective_m_s` is that of the
    plumes above warm ground, which blow in calm air too. [-], [m/s]
    """

    seed: int
    intensity: float = 0.2
    convective_m_s: float = 0.5
    time_scale_s: float = 100.0

    def speed_m_s(self, time_ns: IntArray, mean_m_s: FloatArray) -> FloatArray:
        """Wind speed at times (n,) where the mean wind is `mean_m_s` (n,)."""
        spread = np.hypot(self.intensity * mean_m_s, self.convective_m_s)
        along, across = (self._component(time_ns, number) for number in range(2))
        return np.hypot(mean_m_s + spread * along, spread * across)

    def _component(self, time_ns: IntArray, number: int) -> FloatArray:
        """One component of unit variance: waves of the spectrum with random phases and frequencies."""
        random = np.random.default_rng([self.seed, number])
        frequency = _EDGES_HZ[:-1] + np.diff(_EDGES_HZ) * random.random(_EDGES_HZ.size - 1)
        amplitude = np.sqrt(2.0 * von_karman(frequency, self.time_scale_s) * np.diff(_EDGES_HZ))
        seconds = time_ns / SECOND_NS
        phase = random.uniform(0.0, 2.0 * np.pi, frequency.size)
        return np.asarray(np.cos(2.0 * np.pi * np.multiply.outer(seconds, frequency) + phase) @ amplitude)


@dataclass(frozen=True, slots=True)
class GustySky:
    """A sky whose wind has gusts."""

    sky: Sky
    gusts: Gusts

    def sky_state(self, time_ns: IntArray, cos_zenith: FloatArray, site: Site) -> SkyState:
        """See `Sky`."""
        state = self.sky.sky_state(time_ns, cos_zenith, site)
        return replace(state, wind_m_s=self.gusts.speed_m_s(time_ns, state.wind_m_s))
