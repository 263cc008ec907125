"""The full surface model against measured ground: five parameters fitted on one half, tried on the other.

One-dimensional conduction under the measured light, longwave, air temperature and wind. The model runs
open loop: it receives the weather of the whole record and the ground's temperature of the fitted half only.
Before its first minute it runs through the weather of the first day twice, from the temperature that
balances the mean of that day, so that no starting profile has to be fitted.
"""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter

from fieldkit.model.arrays import BoolArray, FloatArray
from fieldkit.model.confidence import CONFIDENCE, interval_sds
from fieldkit.model.errors import ConfigError, message_of
from fieldkit.model.learnt import LearntParameter
from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.physics.energy_balance import balance_temperature
from fieldkit.physics.slab import surface_series
from fieldkit.study.surface_models import DEEP, HEAT_CAPACITY_J_M3_K, Score

EMISSIVITY = 0.96
"""Of dry mineral ground, broadband: 0.966 and 0.96 are stated for the cinder and the clay of the docs."""
SPIN_UP_DAYS = 2
BLOCKS = 4
ERROR_K = 1.0
ERROR_LASTS_MIN = 30.0
"""Model errors last, 3 to 70 minutes in the residuals of cinder and clay: they count once per half hour."""
SDS = interval_sds(CONFIDENCE)


@dataclass(frozen=True, slots=True)
class Parameter:
    """A fitted parameter: its name and unit, prior mean and standard deviation, and its lower limit."""

    name: str
    unit: str
    mean: float
    sd: float
    at_least: float = -np.inf


PARAMETERS = (
    # plates outdoors: 2.8 + 3.0 U (Watmuff et al. 1977) to 5.7 + 3.8 U (McAdams 1954); a station's wind is
    # measured higher up, where it is stronger
    Parameter("exchange_still", "W m-2 K-1", 5.0, 4.0, 0.0),
    Parameter("exchange_per_wind", "W s m-3 K-1", 2.5, 2.0, 0.0),
    # loose dust to packed dry sand
    Parameter("thermal_inertia", "J m-2 K-1 s-1/2", 450.0, 200.0, 50.0),
    # the reflected light is measured over other ground, both meters to some percent
    Parameter("albedo_error", "", 0.0, 0.05),
    # of the radiometer and of grains that the conduction in a continuum does not have
    Parameter("response_time", "min", 2.0, 3.0, 0.0),
)
_MEAN, _SD, _LEAST = (
    np.array([getattr(parameter, name) for parameter in PARAMETERS]) for name in ("mean", "sd", "at_least")
)


@dataclass(frozen=True, slots=True)
class GroundScore:
    """Scores of the model on some minutes: RMSE and bias in kelvin, share inside the interval."""

    minutes: str
    span: str
    count: int
    rmse_k: float
    bias_k: float
    coverage: float


@dataclass(frozen=True)
class GroundFit:
    """The model fitted to the minutes in `chosen` (n,), the first or second half; the others are held out.

    `values` and `covariance` are those of `PARAMETERS`, (5,) and (5, 5); `modelled_k` and `half_width_k` (n,)
    are every minute's temperature and half its prediction interval, kelvin.
    """

    ground: MeasuredGround
    fitted: str
    chosen: BoolArray
    values: FloatArray
    covariance: FloatArray
    modelled_k: FloatArray
    half_width_k: FloatArray

    @property
    def parameters(self) -> tuple[LearntParameter, ...]:
        """Prior and posterior with intervals."""
        sds = np.sqrt(np.diag(self.covariance))
        return tuple(
            _learnt(one, value, sd)
            for one, value, sd in zip(PARAMETERS, self.values.tolist(), sds.tolist(), strict=True)
        )

    @property
    def exchange(self) -> str:
        """The exchange with the air by the wind U in m/s, intervals in brackets; W m-2 K-1."""
        still, wind = self.parameters[:2]
        return (
            f"{still.value:.1f} + {wind.value:.1f} U "
            f"({still.low:.1f} to {still.high:.1f}, {wind.low:.1f} to {wind.high:.1f})"
        )

    @property
    def mean_exchange_w_m2_k(self) -> float:
        """The exchange at the mean wind of the record, W m-2 K-1."""
        return float(self.values[0] + self.values[1] * self.ground.wind_m_s.mean())

    @cached_property
    def scores(self) -> tuple[GroundScore, ...]:
        """Fitted and held-out minutes, each by day, by night and together; empty spans are skipped."""
        day, every = self.ground.daylight, np.ones_like(self.chosen)
        halves = {"fitted": self.chosen, "held out": ~self.chosen}
        spans = {"day": day, "night": ~day, "all": every}
        return tuple(
            self._score(half, span, minutes & hours)
            for half, minutes in halves.items()
            for span, hours in spans.items()
            if np.any(minutes & hours & np.isfinite(self.ground.surface_k))
        )

    def _score(self, minutes: str, span: str, rows: BoolArray) -> GroundScore:
        rows = rows & np.isfinite(self.ground.surface_k)
        score = Score.of(self.modelled_k, self.ground.surface_k, rows)
        inside = np.abs(self.modelled_k - self.ground.surface_k) <= self.half_width_k
        return GroundScore(
            minutes, span, int(rows.sum()), score.rmse_k, score.bias_k, float(inside[rows].mean())
        )


def ground_fits(path: Path, on_step: Callable[[str], None] = lambda _: None) -> list[GroundFit]:
    """Fit the first half of a record (`read_measured_ground`), then the second; each is tried on the other.

    `on_step` receives a few words after each of `steps` parts of the work. Raises `ConfigError` if the file
    is not such a record.
    """
    ground = read_measured_ground(path)
    first = np.arange(ground.surface_k.size) < ground.surface_k.size // 2
    return [
        fit(ground, chosen, f"{name} half", on_step)
        for name, chosen in (("first", first), ("second", ~first))
    ]


def steps(files: int) -> int:
    """Number of steps that `ground_fits` reports for so many files."""
    return files * 2 * (1 + BLOCKS)


def fit(
    ground: MeasuredGround, chosen: BoolArray, name: str = "", on_step: Callable[[str], None] = lambda _: None
) -> GroundFit:
    """Fit the five parameters to the chosen minutes, and find out how wrong the model is elsewhere.

    Each of four blocks of the chosen minutes is left out once and predicted from the others. Their error
    contains what the model lacks; the interval adds what the parameters leave open.
    """
    chosen = chosen & np.isfinite(ground.surface_k)
    values, design = _fitted(ground, chosen, _MEAN)
    on_step(f"{ground.name}, {name}")
    errors = []
    for block in np.array_split(np.flatnonzero(chosen), BLOCKS):
        rest = chosen.copy()
        rest[block] = False
        elsewhere, _ = _fitted(ground, rest, values)
        errors.append((surface_k(ground, elsewhere) - ground.surface_k)[block])
        on_step(f"{ground.name}, {name}, without a quarter")
    error_k = float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))
    information = design.T @ design / (error_k**2 * ERROR_LASTS_MIN) + np.diag(_SD**-2.0)
    covariance = np.asarray(np.linalg.inv(information), np.float64)
    modelled = surface_k(ground, values)
    slopes = _slopes(ground, values, modelled)
    variance = error_k**2 + np.einsum("ni,ij,nj->n", slopes, covariance, slopes)
    return GroundFit(ground, name, chosen, values, covariance, modelled, SDS * np.sqrt(variance))


def surface_k(ground: MeasuredGround, values: FloatArray) -> FloatArray:
    """Modelled temperature as the radiometer shows it, every minute (n,), kelvin.

    `values` are those of `PARAMETERS`, (5,); the record's own `surface_k` is not used.
    """
    still, per_wind, inertia, albedo_error, response_min = np.asarray(values).tolist()
    reflected = ground.shortwave_up_w_m2 + albedo_error * ground.shortwave_down_w_m2
    absorbed = ground.shortwave_down_w_m2 - reflected + EMISSIVITY * ground.longwave_down_w_m2
    exchange = still + per_wind * ground.wind_m_s
    rows = np.concatenate([np.tile(np.arange(DAY_MIN), SPIN_UP_DAYS), np.arange(absorbed.size)])
    slab = replace(DEEP, conductivity_w_m_k=inertia**2 / HEAT_CAPACITY_J_M3_K)
    supply = (absorbed + exchange * ground.air_k)[:DAY_MIN]
    start_k = balance_temperature(supply.mean(), exchange[:DAY_MIN].mean(), EMISSIVITY)
    surface = surface_series(
        (slab,), float(start_k), 60.0, absorbed[rows], exchange[rows], ground.air_k[rows], EMISSIVITY
    )
    return _delayed(surface, response_min)[-absorbed.size :]


def _delayed(series: FloatArray, response_min: float) -> FloatArray:
    """A first-order response to minutes."""
    kept = float(np.exp(-1.0 / response_min)) if response_min > 0.0 else 0.0
    delayed, _ = lfilter([1.0 - kept], [1.0, -kept], series, zi=[kept * series[0]])
    return np.asarray(delayed)


def _fitted(ground: MeasuredGround, chosen: BoolArray, start: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Most probable values (5,), and the derivatives of the chosen minutes, K per unit, (m, 5)."""
    spread_k = ERROR_K * np.sqrt(ERROR_LASTS_MIN)

    def residuals(values: FloatArray) -> FloatArray:
        misfit = (surface_k(ground, values) - ground.surface_k)[chosen] / spread_k
        return np.concatenate([misfit, (values - _MEAN) / _SD])

    found = least_squares(
        residuals,
        np.maximum(start, _LEAST + 1e-3 * _SD),
        bounds=(_LEAST, np.inf),
        x_scale=_SD,
        diff_step=[1e-4] * len(PARAMETERS),
        ftol=1e-6,
        xtol=1e-6,
        max_nfev=30,
    )
    return found.x, np.asarray(found.jac)[: -len(PARAMETERS)] * spread_k


def _slopes(ground: MeasuredGround, values: FloatArray, modelled: FloatArray) -> FloatArray:
    """Derivatives of every minute by the parameters, K per unit, (n, 5)."""
    changes = np.diag(1e-3 * _SD)
    columns = [surface_k(ground, values + change) - modelled for change in changes]
    return np.stack(columns, axis=1) / np.diag(changes)


def _learnt(one: Parameter, value: float, sd: float) -> LearntParameter:
    return LearntParameter(
        name=one.name,
        unit=one.unit,
        prior=one.mean,
        prior_low=max(one.mean - SDS * one.sd, one.at_least),
        prior_high=one.mean + SDS * one.sd,
        value=value,
        low=max(value - SDS * sd, one.at_least),
        high=value + SDS * sd,
        share_of_prior=min(sd / one.sd, 1.0),
    )


# --- a record: a radiometer that looks at the ground beside a weather station, minute by minute

DAY_MIN = 1440
_GROUND = "ground_radiometer_c"
_WEATHER = (
    "air_c",
    "wind_m_s",
    "shortwave_down_w_m2",
    "shortwave_up_w_m2",
    "longwave_down_w_m2",
    "sun_zenith_apparent_deg",
)


@dataclass(frozen=True, slots=True)
class MeasuredGround:
    """Minutes of flat ground and its weather, arrays (n,), at least a day; NaN only in `surface_k`."""

    name: str
    surface_k: FloatArray
    air_k: FloatArray
    wind_m_s: FloatArray
    shortwave_down_w_m2: FloatArray
    shortwave_up_w_m2: FloatArray
    longwave_down_w_m2: FloatArray
    daylight: BoolArray


def read_measured_ground(path: Path) -> MeasuredGround:
    """Read a table of measured ground; the sun is up in rows with a zenith angle below 90 degrees.

    CSV with one row a minute and the columns minute, ground_radiometer_c, air_c, wind_m_s,
    shortwave_down_w_m2, shortwave_up_w_m2, longwave_down_w_m2 and sun_zenith_apparent_deg; others are
    ignored. Raises `ConfigError` if a column is missing, a cell is not a number, minutes are missing, or
    there is less than a day.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        columns = {
            name: np.array([float(row[name] or "nan") for row in rows])
            for name in ("minute", _GROUND, *_WEATHER)
        }
    except KeyError as missing:
        raise ConfigError(f"{path} has no column {missing}", fix="see `fieldkit study --help`") from None
    except (OSError, TypeError, ValueError) as error:
        raise ConfigError(
            f"{path} is not a table of measured ground: {message_of(error)}", fix="give a CSV file of numbers"
        ) from error
    _check(path, columns)
    return MeasuredGround(
        name=path.stem,
        surface_k=columns[_GROUND] + CELSIUS_ZERO_K,
        air_k=columns["air_c"] + CELSIUS_ZERO_K,
        wind_m_s=columns["wind_m_s"],
        shortwave_down_w_m2=columns["shortwave_down_w_m2"],
        shortwave_up_w_m2=columns["shortwave_up_w_m2"],
        longwave_down_w_m2=columns["longwave_down_w_m2"],
        daylight=columns["sun_zenith_apparent_deg"] < 90.0,
    )


def _check(path: Path, columns: dict[str, FloatArray]) -> None:
    minutes = columns["minute"]
    if minutes.size < DAY_MIN:
        raise ConfigError(f"{path} has {minutes.size} minutes", fix=f"give at least a day, {DAY_MIN}")
    if np.any(np.diff(minutes) != 1.0):
        row = int(np.argmax(np.diff(minutes) != 1.0))
        raise ConfigError(f"{path} has a gap after minute {minutes[row]:g}", fix="fill it, or cut the record")
    for name in _WEATHER:
        if not np.all(np.isfinite(columns[name])):
            row = int(np.argmin(np.isfinite(columns[name])))
            raise ConfigError(
                f"{path} has no {name} in minute {minutes[row]:g}", fix="fill it, or cut the record"
            )
