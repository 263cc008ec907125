"""Eq. (7) and the full surface model against a flat site whose own upwelling longwave was measured.

The measured surface temperature follows from ``L_up = e sigma T^4 + (1 - e) L_down``. Models
are the paper's as it stands, with diffuse irradiance, with fitted exchange, and with conduction
into deep soil (`fieldkit.physics.slab`). Pure: arrays by the minute (n,), W/m2 and kelvin.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.optimize import least_squares

from fieldkit.model.arrays import BoolArray, FloatArray
from fieldkit.physics.constants import STEFAN_BOLTZMANN
from fieldkit.physics.energy_balance import SurfaceParameters, balance_temperature
from fieldkit.physics.slab import Slab, surface_series

TABLE_1 = SurfaceParameters()
MIDDAY_S = 3 * 3600.0
LOWEST_SUN_DEG = 5.0
HEAT_CAPACITY_J_M3_K = 1.3e6
DEEP = Slab(depth_m=0.6, heat_capacity_j_m3_k=HEAT_CAPACITY_J_M3_K, layers=24, growth=1.25)
"""Soil without a bottom for two days; only its thermal inertia counts, the depth scale is arbitrary."""


@dataclass(frozen=True, slots=True)
class Station:
    """Measured minutes of a flat site, arrays (n,). `albedo` is reflected over incoming irradiance."""

    time_s: FloatArray
    cos_zenith: FloatArray
    dni_w_m2: FloatArray
    diffuse_w_m2: FloatArray
    longwave_down_w_m2: FloatArray
    longwave_up_w_m2: FloatArray
    air_k: FloatArray
    wind_m_s: FloatArray
    albedo: FloatArray

    @property
    def beam_w_m2(self) -> FloatArray:
        """Direct irradiance of the flat ground, W/m2."""
        return self.dni_w_m2 * np.maximum(self.cos_zenith, 0.0)

    @property
    def global_w_m2(self) -> FloatArray:
        """Global irradiance of the flat ground, W/m2."""
        return self.beam_w_m2 + np.maximum(self.diffuse_w_m2, 0.0)

    @property
    def daylight(self) -> BoolArray:
        """Minutes with the sun at least five degrees high."""
        return np.asarray(self.cos_zenith > np.sin(np.radians(LOWEST_SUN_DEG)))

    def midday(self, of: BoolArray) -> BoolArray:
        """Minutes within three hours of the highest sun among the chosen ones."""
        noon = self.time_s[np.argmax(np.where(of, self.cos_zenith, -2.0))]
        return np.asarray(np.abs(self.time_s - noon) <= MIDDAY_S)

    def surface_k(self, emissivity: float) -> FloatArray:
        """Temperature of the ground from the measured longwave."""
        emitted = self.longwave_up_w_m2 - (1.0 - emissivity) * self.longwave_down_w_m2
        return np.asarray((emitted / (emissivity * STEFAN_BOLTZMANN)) ** 0.25)


@dataclass(frozen=True, slots=True)
class Score:
    """Root mean square and mean error of a model on some minutes, kelvin."""

    rmse_k: float
    bias_k: float

    @classmethod
    def of(cls, modelled_k: FloatArray, measured_k: FloatArray, chosen: BoolArray) -> Score:
        """Errors where both are known."""
        error = (modelled_k - measured_k)[chosen]
        error = error[np.isfinite(error)]
        return cls(float(np.sqrt(np.mean(error**2))), float(np.mean(error)))


@dataclass(frozen=True, slots=True)
class Ground:
    """Parameters of one model of the ground.

    `albedo` None is the measured one, minute by minute. Exchange with the air is ``still +
    per_wind * wind``. `inertia` 0 stores no heat [J m-2 K-1 s-1/2]; otherwise the soil begins
    the record at `start_k` throughout, which stands for the days before.
    """

    emissivity: float
    albedo: float | None
    still_w_m2_k: float
    per_wind: float = 0.0
    inertia: float = 0.0
    start_k: float = 280.0
    with_diffuse: bool = True

    def temperature_k(self, station: Station) -> FloatArray:
        """Surface temperature at every minute."""
        shortwave = station.global_w_m2 if self.with_diffuse else station.beam_w_m2
        albedo = station.albedo if self.albedo is None else self.albedo
        absorbed = (1.0 - albedo) * shortwave + self.emissivity * station.longwave_down_w_m2
        exchange = self.still_w_m2_k + self.per_wind * station.wind_m_s
        if self.inertia == 0.0:
            return balance_temperature(absorbed + exchange * station.air_k, exchange, self.emissivity)
        return self._stored(station, absorbed, exchange)

    def _stored(self, station: Station, absorbed: FloatArray, exchange: FloatArray) -> FloatArray:
        slab = replace(DEEP, conductivity_w_m_k=self.inertia**2 / HEAT_CAPACITY_J_M3_K)
        step_s = np.round(np.diff(station.time_s), 3)
        return surface_series(
            (slab,), self.start_k, step_s, absorbed, exchange, station.air_k, self.emissivity
        )


def as_printed(emissivity: float, *, with_diffuse: bool) -> Ground:
    """Eq. (7) with Table 1; diffuse irradiance is not in the paper."""
    return Ground(emissivity, TABLE_1.albedo, TABLE_1.exchange_w_m2_k, with_diffuse=with_diffuse)


Range = tuple[float, float, float]
"""Lowest value of a parameter, the one to begin with, and the highest."""


@dataclass(frozen=True, slots=True)
class Family:
    """A model with free parameters: how to make it, and the range of each."""

    name: str
    make: Callable[..., Ground]
    ranges: tuple[Range, ...]
    whole_day: bool = False  # transient models learn from the night as well

    def fitted(self, station: Station, chosen: BoolArray) -> Ground:
        """The ground whose parameters leave the least squares on the chosen minutes."""
        low, start, high = zip(*self.ranges, strict=True)
        measured = station.surface_k(self.make(*start).emissivity)
        known = chosen & np.isfinite(measured)

        def residuals(values: FloatArray) -> FloatArray:
            return np.asarray((self.make(*values).temperature_k(station) - measured)[known])

        found = least_squares(
            residuals,
            start,
            bounds=(low, high),
            x_scale=np.subtract(high, low),
            diff_step=[1e-3] * len(start),
            max_nfev=15,
        )
        return self.make(*found.x.tolist())


def families(emissivity: float) -> tuple[Family, ...]:
    """The fitted models: steady ones first, then those that store heat."""

    def ground(albedo: float | None, still: float, **more: float | bool) -> Ground:
        return Ground(emissivity, albedo, still, **more)  # type: ignore[arg-type]

    def stored(still: float, inertia: float, start_k: float, per_wind: float = 0.0) -> Ground:
        return ground(None, still, inertia=inertia, start_k=start_k, per_wind=per_wind)

    albedo, exchange, wind = (0.0, 0.2, 0.6), (1.0, 25.0, 100.0), (0.0, 2.0, 30.0)
    of_store = (exchange, (100.0, 600.0, 2500.0), (240.0, 280.0, 290.0))
    direct, measured = partial(ground, with_diffuse=False), partial(ground, None)
    return (
        Family("steady, A and C_HU fitted, direct only", direct, (albedo, exchange)),
        Family("steady, A and C_HU fitted", ground, (albedo, exchange)),
        Family("steady, A measured, C_HU fitted", measured, (exchange,)),
        Family("steady, A measured, h = a + bU", lambda h, b: measured(h, per_wind=b), (exchange, wind)),
        Family("conduction, A measured, h fitted", stored, of_store, whole_day=True),
        Family("conduction, A measured, h = a + bU", stored, (*of_store, wind), whole_day=True),
    )
