"""From rows to the slope of one target by one of three methods, with its state and its likelihood regions.

Unit-norm least squares is the default, contour scoring is the paper's method, the posterior is the robust
one. They differ in the best normal; the likelihood regions are computed alike for all, once for noise alone
and once with the stated systematic uncertainties of scale, offset and stored heat.

The noise level comes from second differences, which a slope, a drift or the hour of day cannot mimic. A small
chi-square does not mean a small error: a smooth model error fits a smooth wrong slope, and only the stated
systematic uncertainties cover that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtri

from fieldkit.estimation.balance import Rows
from fieldkit.estimation.contours import RadiationTable, slope_grid
from fieldkit.estimation.likelihood import (
    NINETY_PERCENT,
    NINETY_PERCENT_ONE,
    LikelihoodRegion,
    MisfitOf,
    ProfileMisfit,
    posterior,
    region,
    region_known_azimuth,
    with_systematics,
)
from fieldkit.estimation.normal import LOWEST_COS_INCIDENCE, Misfit, choose, solve, solve_known_azimuth
from fieldkit.estimation.settings import PAPER_SCALE_SD, EstimatorSettings
from fieldkit.model.site import Region
from fieldkit.model.slope import SlopeState, is_too_wide
from fieldkit.physics.facet import FloatArray, normal, tilt_azimuth

ALARM_PROBABILITY = 0.01
"""Probability that chi-square rejects a good window."""
MIN_DIFFERENCES = 8
SHADE_SIGMAS = 2.0
NOWHERE = LikelihoodRegion(*(float("nan"),) * 4, vertical=False)


@dataclass(frozen=True, slots=True)
class Solution:
    """Slope of one target: best normal (3,) or None, a second one that fits as well or None, regions, state.

    `whole` is the region with systematic uncertainties, `noise` that of noise alone, `used` the number of
    rows. `explained` is false if no slope fits the minute bins together, however steep.
    """

    state: SlopeState
    reason: str
    best: FloatArray | None
    second: FloatArray | None
    whole: LikelihoodRegion
    noise: LikelihoodRegion
    chi_square: float
    used: int
    explained: bool = True


def solution(
    rows: Rows, index: int, weights: FloatArray, bed: Region, settings: EstimatorSettings
) -> Solution:
    """Slope of one target from its rows.

    Parameters
    ----------
    rows
        Least-squares rows of all targets.
    index
        The target's column in `rows`.
    weights
        Inverse variances, shape (n,); zero excludes a row. At least three rows (two with a known azimuth).
    bed
        The target, for its azimuth where `settings.azimuth` is ``known``.
    settings
        Method, tilt limit, noise and systematic uncertainties.
    """
    known = settings.azimuth == "known" and np.isfinite(bed.azimuth_deg)
    problem = _Problem(rows, index, weights, bed.azimuth_deg if known else None, settings)
    fit = _least_squares(problem)
    lit = problem.used & (np.nan_to_num(rows.design) @ fit.best >= LOWEST_COS_INCIDENCE)
    if 3 <= lit.sum() < problem.used.sum():
        problem = replace(problem, weights=np.where(lit, weights, 0.0))
        fit = _least_squares(problem)
    ratio = noise_ratio(problem.standardised(fit.best))
    if ratio > 1.0:
        problem = replace(problem, weights=problem.weights / ratio)
        fit = _least_squares(problem)
    best, score, problem = _best_normal(problem, fit)
    if problem.settings.method == "posterior":
        fit = _least_squares(problem)
    if best is None:
        nowhere = _nowhere(problem, fit, f"no slope lies on enough contours: {score}")
        return replace(nowhere, explained=False)
    return _judged(problem, fit, best)


@dataclass(frozen=True, slots=True)
class _Problem:
    """Rows of one target, their weights (n,), the azimuth where it is known, and the settings."""

    rows: Rows
    index: int
    weights: FloatArray
    azimuth_deg: float | None
    settings: EstimatorSettings

    @property
    def used(self) -> NDArray[np.bool_]:
        """Rows that are used."""
        return self.weights > 0.0

    @property
    def design(self) -> FloatArray:
        """Design vectors of the rows that are used."""
        return np.asarray(self.rows.design[self.used])

    @property
    def y(self) -> FloatArray:
        """Measured cosines of the rows that are used."""
        return np.asarray(self.rows.y[self.used, self.index])

    @property
    def misfit(self) -> Misfit:
        """Noise alone."""
        return Misfit.of_rows(self.design, self.y, self.weights[self.used])

    @property
    def profile_misfit(self) -> ProfileMisfit:
        """Noise and the stated systematic uncertainties."""
        settings, used = self.settings, self.used
        systematics = self.rows.systematics[:, used, self.index]
        summed = with_systematics(self.design, self.y, self.weights[used], systematics)
        neglected = PAPER_SCALE_SD if settings.model == "paper" else 0.0
        scale_sd = math.hypot(settings.scale_sd, settings.factor_sd, neglected)
        return ProfileMisfit(summed, self.rows.reference, scale_sd)

    @property
    def freedom(self) -> int:
        """Degrees of freedom: rows less fitted angles."""
        return int(self.used.sum()) - (2 if self.azimuth_deg is None else 1)

    @property
    def drop(self) -> float:
        """Misfit above the least that bounds the 90 % region."""
        return NINETY_PERCENT if self.azimuth_deg is None else NINETY_PERCENT_ONE

    def standardised(self, best: FloatArray) -> FloatArray:
        """Residuals of a normal, in standard deviations."""
        return np.asarray((self.y - self.design @ best) * np.sqrt(self.weights[self.used]))


@dataclass(frozen=True, slots=True)
class _Fit:
    """Least squares: the preferred normal, the other branch within the limit or None, their misfits."""

    best: FloatArray
    other: FloatArray | None
    misfit: float
    other_misfit: float
    steeper_misfit: float  # of the better branch if both exceed the limit; else that of best


def _least_squares(problem: _Problem) -> _Fit:
    limit, misfit = problem.settings.tilt_limit_deg, problem.misfit
    if problem.azimuth_deg is not None:
        return _along_azimuth(misfit, problem.azimuth_deg, limit)
    branches = solve(misfit)
    choice = choose(misfit, branches, limit)
    other = None if np.isnan(choice.other).any() else choice.other
    least = min(float(branches.first_misfit), float(choice.misfit))
    steeper = float(choice.misfit) if other is not None else least
    return _Fit(choice.best, other, float(choice.misfit), float(choice.other_misfit), steeper)


def _along_azimuth(misfit: Misfit, azimuth_deg: float, limit: float) -> _Fit:
    """Along a known azimuth; if two tilts fit, the flatter one is preferred."""
    tilt, other = solve_known_azimuth(misfit, azimuth_deg, limit)
    best, second = normal([tilt, other], azimuth_deg)
    values = misfit(np.stack([best, second]))
    if np.isnan(other):
        return _Fit(best, None, float(values[0]), float("nan"), float(values[0]))
    if other < tilt and values[1] - values[0] < NINETY_PERCENT_ONE:
        best, second, values = second, best, values[::-1]
    return _Fit(best, second, float(values[0]), float(values[1]), float(values[0]))


def _best_normal(problem: _Problem, fit: _Fit) -> tuple[FloatArray | None, str, _Problem]:
    """The method's best normal (None with the contour score in words), and the weights it used."""
    settings = problem.settings
    if settings.method == "unit-norm" or problem.azimuth_deg is not None:
        return fit.best, "", problem
    if settings.method == "contours":
        return *_scored(problem), problem
    used = problem.used
    found = posterior(problem.design, problem.y, problem.weights[used], settings.tilt_limit_deg)
    weights = np.zeros_like(problem.weights)
    weights[used] = found.weights
    return found.mean, "", replace(problem, weights=weights)


def _scored(problem: _Problem) -> tuple[FloatArray | None, str]:
    """Contour scoring of the cosine of incidence, with a tolerance of its own for every minute bin."""
    settings, used, reference = problem.settings, problem.used, problem.rows.reference
    table = RadiationTable(slope_grid(settings.tilt_limit_deg), problem.design, reference)
    tolerance = 2.0 * problem.rows.sigma[used, problem.index]
    if settings.contour_tolerance_w_m2 is not None:
        tolerance = settings.contour_tolerance_w_m2 * problem.rows.per_w_m2[used]
    difference = problem.y - problem.design @ reference
    winners = table.winner(difference, tolerance, settings.contour_threshold)
    if np.isnan(winners.normals).any():
        return None, f"at most {winners.best[0]} of {used.sum()} minutes agree"
    return winners.normals[0], ""


def _nowhere(problem: _Problem, fit: _Fit, reason: str) -> Solution:
    chi_square = fit.misfit / problem.freedom
    used = int(problem.used.sum())
    return Solution(SlopeState.NO_INTERSECTION, reason, None, None, NOWHERE, NOWHERE, chi_square, used)


def _judged(problem: _Problem, fit: _Fit, best: FloatArray) -> Solution:
    """State and regions of a method's best normal."""
    if fit.misfit - fit.steeper_misfit > problem.drop:
        limit = problem.settings.tilt_limit_deg
        return _nowhere(problem, fit, f"what fits best is steeper than the limit of {limit:g}°")
    misfit, profiled = problem.misfit, problem.profile_misfit
    alarm = chi_square_limit(problem.freedom)
    chi_square = max(fit.misfit, 0.0) / problem.freedom  # rounding may make it negative
    is_bad = float(profiled(fit.best)) / problem.freedom > alarm
    # a misfit beyond noise inflates the variance, so that the regions are as wide as the residuals
    inflation = chi_square if chi_square > alarm else 1.0
    if inflation > 1.0:
        widened = replace(problem, weights=problem.weights / inflation)
        misfit, profiled = widened.misfit, widened.profile_misfit
    noise = _region(problem, misfit, misfit.H, best)
    whole = _region(problem, profiled, profiled.linearised(best), best)
    second = fit.other if fit.other_misfit - fit.misfit < problem.drop * inflation else None
    state, reason = SlopeState.OK, ""
    if is_bad:
        state, reason = SlopeState.NO_INTERSECTION, _misfit_reason(problem, chi_square)
    elif second is not None:
        tilt, azimuth = tilt_azimuth(second)
        state, reason = SlopeState.NOT_RESOLVED, f"tilt {tilt:.1f}°, azimuth {azimuth:.0f}° fits as well"
    elif is_too_wide(tilt_azimuth(best)[0], whole.tilt_low_deg, whole.tilt_high_deg):
        low, high = whole.tilt_low_deg, whole.tilt_high_deg
        state, reason = SlopeState.UNCERTAIN, f"anything from {low:.1f}° to {high:.1f}° fits (90 %)"
    elif whole.vertical:
        state, reason = SlopeState.FLAT, f"flat within {whole.tilt_high_deg:.1f}°"
    used = int(problem.used.sum())
    return Solution(state, reason, best, second, whole, noise, chi_square, used, explained=not is_bad)


def _misfit_reason(problem: _Problem, chi_square: float) -> str:
    """The likely cause of a misfit, in words."""
    brightest = float(problem.y.max())
    if brightest > 1.0:
        return f"warmer than any slope explains (cosine {brightest:.2f}): scale, offset or emissivity is off"
    return f"the minutes agree on no slope (chi-square {chi_square:.1f}): cloud, shade, wind or a drift"


def _region(
    problem: _Problem, misfit: MisfitOf, information: FloatArray, best: FloatArray
) -> LikelihoodRegion:
    limit = problem.settings.tilt_limit_deg
    if problem.azimuth_deg is not None:
        return region_known_azimuth(misfit, problem.azimuth_deg, best, problem.drop, limit)
    return region(misfit, information, best, problem.drop, limit)


def noise_ratio(residuals: ArrayLike) -> float:
    """Ratio of the observed noise variance to the stated one, from second differences of residuals.

    ``mean (r[k-1] - 2 r[k] + r[k+1])**2 / 6``

    Parameters
    ----------
    residuals
        Standardised residuals in order of time, shape (n,). [-]

    Returns
    -------
    The ratio; 1.0 with fewer than ten residuals, and where it does not exceed 1 by more than chance explains
    (95 %). [-]
    """
    values = np.asarray(residuals, np.float64)
    bends = np.diff(values, 2)
    if bends.size < MIN_DIFFERENCES:
        return 1.0
    ratio = float(np.mean(bends**2)) / 6.0
    # neighbouring second differences share samples: 18/35 of their number is independent
    freedom = bends.size * 18.0 / 35.0
    return ratio if ratio > float(chdtri(freedom, 0.05)) / freedom else 1.0


def chi_square_limit(freedom: int) -> float:
    """Reduced chi-square that noise alone exceeds in one window of a hundred; `freedom` >= 1."""
    return float(chdtri(freedom, ALARM_PROBABILITY)) / freedom


def kelvin_per_degree(
    tilt_deg: float, azimuth_deg: float, direction: FloatArray, y_per_kelvin: float
) -> float:
    """Change of surface temperature per degree of tilt, K per degree.

    Parameters
    ----------
    tilt_deg, azimuth_deg
        The slope. [degrees]
    direction
        Design vector of the minute bin, shape (3,). [-]
    y_per_kelvin
        Change of the measured cosine per kelvin (`Rows.per_kelvin`). [1/K]
    """
    steeper = normal(tilt_deg + 90.0, azimuth_deg)  # the unit vector along growing tilt
    return float(np.radians(1.0) * (steeper @ direction) / y_per_kelvin)


def sunlit(y: FloatArray, sigma: FloatArray) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Rows with enough sun to be used: a self-shaded facet only shows ``n . s < 0``."""
    return np.asarray(y >= SHADE_SIGMAS * sigma)
