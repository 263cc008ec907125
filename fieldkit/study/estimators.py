"""The paper's simulation study (its section 4): make temperatures for many slopes, estimate, compare.

Temperatures follow eq. (7), the measured difference eq. (6); noise and quantisation are
added in between. One estimator at a time is run on all slopes at once. Pure: the sun and
the weather are given. Slopes are rows (m,), times columns (n,); angles in degrees.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from fieldkit.estimation.contours import RadiationTable, slope_grid
from fieldkit.estimation.instruments import mean_of
from fieldkit.estimation.normal import LOWEST_COS_INCIDENCE, Misfit, choose, solve
from fieldkit.estimation.statistics import mean_absolute_error, sd_of_absolute_error
from fieldkit.model.arrays import BoolArray, FloatArray
from fieldkit.physics.energy_balance import (
    SurfaceParameters,
    direct_irradiance,
    irradiance_difference,
    irradiance_per_kelvin,
    surface_temperature,
)
from fieldkit.physics.facet import VERTICAL, angle_between_deg, cos_incidence, normal, tilt_azimuth
from fieldkit.study.posterior import posterior

Method = Literal["contours", "unit-norm", "posterior"]
TABLE_1 = SurfaceParameters()
GRID_LIMIT_DEG = 30.0
PIECE = 4096


@dataclass(frozen=True, slots=True)
class Conditions:
    """Sun (n, 3) and weather (n,) of the study's minutes: DNI, downward longwave [W/m2], air [K]."""

    sun: FloatArray
    dni_w_m2: FloatArray
    longwave_w_m2: FloatArray
    air_k: FloatArray


@dataclass(frozen=True, slots=True)
class StudySettings:
    """Conditions of a measurement and settings of its estimate.

    `noise_k` falls independently on target and reference at every minute, `quantum_k` is
    the step of the thermometer (0: none). `tolerance_w_m2` is how near a contour a cell
    counts as on it; the paper does not say, 0.5 gives its size of error. `tilt_limit_deg`
    bounds the estimates of least squares and posterior, as the grid bounds the contours.
    """

    method: Method = "contours"
    surface: SurfaceParameters = TABLE_1
    noise_k: float = 0.0
    quantum_k: float = 0.0
    tolerance_w_m2: float = 0.5
    tilt_limit_deg: float = 30.0
    seed: int = 1


@dataclass(frozen=True, slots=True)
class Outcome:
    """True and estimated normals (m, 3) of a study; NaN where there is no estimate."""

    truth: FloatArray
    estimate: FloatArray

    @property
    def tilt_error_deg(self) -> FloatArray:
        """Absolute error of the tilt (m,), the paper's |y - x|."""
        return np.abs(tilt_azimuth(self.estimate)[0] - tilt_azimuth(self.truth)[0])

    @property
    def normal_error_deg(self) -> FloatArray:
        """Angle between the estimated and the true normal (m,): azimuth counts, as much as it matters."""
        return angle_between_deg(self.estimate, self.truth)

    def by_direction(self) -> tuple[FloatArray, FloatArray]:
        """Directions 0, 30, ... and the mean absolute tilt error of the slopes nearest to each (Fig. 10)."""
        centres = np.arange(0.0, 360.0, 30.0)
        tilt, azimuth = tilt_azimuth(self.truth)
        nearest = np.round(azimuth / 30.0).astype(np.int64) % centres.size
        sloped = tilt > 0.0  # flat ground has no direction
        errors = [self.tilt_error_deg[sloped & (nearest == index)] for index in range(centres.size)]
        return centres, np.array([mean_of(values) for values in errors])


def paper_slopes() -> FloatArray:
    """Normals (61 * 361, 3) of the study: tilt 0 to 30 by 0.5, direction 0 to 360 by 1 degree, both ends."""
    tilts = np.arange(0.0, 30.25, 0.5)[:, np.newaxis]
    return normal(tilts, np.arange(0.0, 360.5, 1.0)).reshape(-1, 3)


def random_slopes(count: int, seed: int) -> FloatArray:
    """Normals (count, 3) off every grid, tilt (to 30 degrees) and azimuth uniform."""
    rng = np.random.default_rng([seed, count])
    return normal(rng.uniform(0.0, 30.0, count), rng.uniform(0.0, 360.0, count))


def simulated_temperatures(
    slopes: FloatArray, conditions: Conditions, settings: StudySettings
) -> tuple[FloatArray, FloatArray]:
    """Measured temperatures of targets and of their flat reference, kelvin, (m, n) each."""
    weather = (conditions.longwave_w_m2, conditions.air_k, settings.surface)

    def temperatures(some: FloatArray) -> FloatArray:
        irradiance = direct_irradiance(conditions.dni_w_m2, cos_incidence(some, conditions.sun))
        return surface_temperature(irradiance, *weather)

    on_flat = direct_irradiance(conditions.dni_w_m2, conditions.sun[:, 2])
    target = _in_pieces(temperatures, slopes)
    reference = np.broadcast_to(surface_temperature(on_flat, *weather), target.shape)
    if settings.noise_k > 0.0:
        rng = np.random.default_rng(settings.seed)
        target = target + settings.noise_k * rng.standard_normal(target.shape)
        reference = reference + settings.noise_k * rng.standard_normal(target.shape)
    return _quantise(target, settings.quantum_k), _quantise(reference, settings.quantum_k)


def run_study(slopes: FloatArray, conditions: Conditions, settings: StudySettings) -> Outcome:
    """Simulate and estimate all slopes (m, 3)."""
    target, reference = simulated_temperatures(slopes, conditions, settings)
    return Outcome(slopes, estimated_normals(target, reference, conditions, settings))


def estimated_normals(
    target_k: FloatArray, reference_k: FloatArray, conditions: Conditions, settings: StudySettings
) -> FloatArray:
    """Normals (m, 3) from temperatures (m, n) of targets and reference; NaN where none fits."""
    if settings.method == "contours":
        return _by_contours(
            irradiance_difference(target_k, reference_k, settings.surface), conditions, settings
        )
    # the noise of the reference stands for all slopes, so that they share one matrix
    noise_k = max(settings.noise_k, settings.quantum_k / np.sqrt(12.0), 1e-3)
    noise_w_m2 = np.sqrt(2.0) * noise_k * irradiance_per_kelvin(reference_k.mean(axis=0), settings.surface)
    sigma = noise_w_m2 / conditions.dni_w_m2

    def cosines(target: FloatArray, reference: FloatArray) -> FloatArray:
        difference = irradiance_difference(target, reference, settings.surface)
        return difference / conditions.dni_w_m2 + conditions.sun[:, 2]

    y = _in_pieces(cosines, target_k, reference_k)
    limit_deg = settings.tilt_limit_deg
    estimate = _in_pieces(lambda some: _by_unit_norm(some, sigma, conditions.sun, limit_deg), y)
    if settings.method == "posterior":
        estimate = _by_posterior(y, sigma, estimate, conditions.sun, limit_deg)
    return estimate


def _in_pieces(work: Callable[..., FloatArray], *arrays: FloatArray) -> FloatArray:
    """Work on some rows at a time, which fit the processor's cache: half the time of all at once."""
    begins = range(0, len(arrays[0]), PIECE)
    return np.concatenate([work(*(array[at : at + PIECE] for array in arrays)) for at in begins])


def _by_contours(difference: FloatArray, conditions: Conditions, settings: StudySettings) -> FloatArray:
    design = conditions.sun * conditions.dni_w_m2[:, np.newaxis]
    table = RadiationTable(slope_grid(GRID_LIMIT_DEG), design, VERTICAL)
    # the paper takes the cell of highest score; with noise it may stand on few contours
    return table.winners(difference, settings.tolerance_w_m2, threshold=0.0).normals


def _by_unit_norm(y: FloatArray, sigma: FloatArray, sun: FloatArray, limit_deg: float) -> FloatArray:
    """Unit-norm least squares; slopes that were in their own shade are solved again without those minutes."""
    weights = 1.0 / np.square(sigma)
    estimate = _least_within(Misfit.of_rows(sun, y, weights), limit_deg)
    lit = _lit(y, sigma, estimate, sun)
    again = ~lit.all(axis=1) & (lit.sum(axis=1) >= 3)
    if again.any():
        estimate[again] = _least_within(Misfit.of_rows(sun, y[again], lit[again] * weights), limit_deg)
    return estimate


def _least_within(misfit: Misfit, limit_deg: float) -> FloatArray:
    """Normals of least misfit up to the tilt limit: inside it, or the best on its rim."""
    return choose(misfit, solve(misfit), limit_deg).best


def _lit(y: FloatArray, sigma: FloatArray, estimate: FloatArray, sun: FloatArray) -> BoolArray:
    """Minutes (m, n) that are an equation and not an inequality: the slope sees the sun."""
    return np.asarray((cos_incidence(estimate, sun) >= LOWEST_COS_INCIDENCE) & (y >= 2.0 * sigma))


def _by_posterior(
    y: FloatArray, sigma: FloatArray, start: FloatArray, sun: FloatArray, limit_deg: float
) -> FloatArray:
    lit = _lit(y, sigma, start, sun)
    means = np.full_like(start, np.nan)
    for row in np.flatnonzero(lit.sum(axis=1) >= 3):
        used = lit[row]
        means[row] = posterior(sun[used], y[row, used], 1.0 / sigma[used] ** 2, limit_deg)
    return means


def _quantise(temperature_k: FloatArray, quantum_k: float) -> FloatArray:
    return np.round(temperature_k / quantum_k) * quantum_k if quantum_k > 0.0 else temperature_k


@dataclass(frozen=True, slots=True)
class Summary:
    """Statistics of absolute errors in degrees; `unsolved` slopes have no estimate and do not count.

    `mae` is eq. (8), `sd_paper` eq. (9) as printed, `sd_usual` the standard deviation.
    """

    slopes: int
    unsolved: int
    mae: float
    sd_paper: float
    sd_usual: float
    p50: float
    p90: float
    largest: float


def summarise(errors_deg: FloatArray) -> Summary:
    """Statistics of absolute errors (m,)."""
    solved = errors_deg[np.isfinite(errors_deg)]
    if not solved.size:
        return Summary(errors_deg.size, errors_deg.size, *(float("nan"),) * 6)
    zeros = np.zeros_like(solved)
    return Summary(
        slopes=errors_deg.size,
        unsolved=errors_deg.size - solved.size,
        mae=mean_absolute_error(solved, zeros),
        sd_paper=sd_of_absolute_error(solved, zeros, "paper"),
        sd_usual=sd_of_absolute_error(solved, zeros, "usual"),
        p50=float(np.percentile(solved, 50)),
        p90=float(np.percentile(solved, 90)),
        largest=float(solved.max()),
    )
