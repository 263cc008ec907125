"""The three ways from rows to a slope of one region, and what each answer comes with.

Unit-norm least squares is the default, contour scoring the paper's, the posterior the
robust one. They differ in the answer; the likelihood regions are drawn the same way for
all, once for noise alone and once with the stated doubts of scale, offset and stored heat.
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
from fieldkit.estimation.normal import Misfit, choose, solve, solve_known_azimuth
from fieldkit.estimation.settings import PAPER_SCALE_SD, EstimatorSettings
from fieldkit.model.site import Region
from fieldkit.model.slope import SlopeState, is_too_wide
from fieldkit.physics.facet import FloatArray, normal, tilt_azimuth

ALARM_PROBABILITY = 0.01
"""Chance that chi-square calls a good window a bad one."""
MIN_DIFFERENCES = 8
LOWEST_COS_INCIDENCE = 0.03
"""Rows whose predicted cosine of incidence is lower count as in the bed's own shade."""
SHADE_SIGMAS = 2.0
NOWHERE = LikelihoodRegion(*(float("nan"),) * 4, vertical=False)


@dataclass(frozen=True, slots=True)
class Solution:
    """What is known of one slope: best normal (3,) or None, the second that fits, both regions, the state.

    `explained` is false where the minutes agree on no slope, however steep.
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
    """Slope of one region from its rows; weights (n,), zero for rows that do not count."""
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
    best, votes, problem = _answer(problem, fit)
    if problem.settings.method == "posterior":
        fit = _least_squares(problem)
    if best is None:
        nowhere = _nowhere(problem, fit, f"no slope lies on enough contours: {votes}")
        return replace(nowhere, explained=False)
    return _judged(problem, fit, best)


@dataclass(frozen=True, slots=True)
class _Problem:
    """Rows of one region, their weights (n,), the azimuth where it is known, and what else counts."""

    rows: Rows
    index: int
    weights: FloatArray
    azimuth_deg: float | None
    settings: EstimatorSettings

    @property
    def used(self) -> NDArray[np.bool_]:
        """Rows that count."""
        return self.weights > 0.0

    @property
    def design(self) -> FloatArray:
        """Lamps of the rows that count."""
        return np.asarray(self.rows.design[self.used])

    @property
    def y(self) -> FloatArray:
        """Measured cosines of the rows that count."""
        return np.asarray(self.rows.y[self.used, self.index])

    @property
    def misfit(self) -> Misfit:
        """Noise only."""
        return Misfit.of_rows(self.design, self.y, self.weights[self.used])

    @property
    def doubtful(self) -> ProfileMisfit:
        """With the stated doubts of offset, stored heat and scale."""
        settings, used = self.settings, self.used
        systematics = self.rows.systematics[:, used, self.index]
        summed = with_systematics(self.design, self.y, self.weights[used], systematics)
        left_out = PAPER_SCALE_SD if settings.model == "paper" else 0.0
        scale_sd = math.hypot(settings.scale_sd, settings.factor_sd, left_out)
        return ProfileMisfit(summed, self.rows.reference, scale_sd)

    @property
    def freedom(self) -> int:
        """Rows less fitted angles."""
        return int(self.used.sum()) - (2 if self.azimuth_deg is None else 1)

    @property
    def drop(self) -> float:
        """How far the misfit may rise within the 90 % region."""
        return NINETY_PERCENT if self.azimuth_deg is None else NINETY_PERCENT_ONE

    def standardised(self, best: FloatArray) -> FloatArray:
        """What a normal leaves unexplained, in standard deviations."""
        return np.asarray((self.y - self.design @ best) * np.sqrt(self.weights[self.used]))


@dataclass(frozen=True, slots=True)
class _Fit:
    """Least squares: the normal to believe, the other branch within the limit or None, their misfits."""

    best: FloatArray
    other: FloatArray | None
    misfit: float
    other_misfit: float
    steeper_misfit: float  # of the better branch, where both break the limit; else that of best


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
    """Along a known azimuth; of two tilts that both fit the flatter one is believed."""
    tilt, other = solve_known_azimuth(misfit, azimuth_deg, limit)
    best, second = normal([tilt, other], azimuth_deg)
    values = misfit(np.stack([best, second]))
    if np.isnan(other):
        return _Fit(best, None, float(values[0]), float("nan"), float(values[0]))
    if other < tilt and values[1] - values[0] < NINETY_PERCENT_ONE:
        best, second, values = second, best, values[::-1]
    return _Fit(best, second, float(values[0]), float(values[1]), float(values[0]))


def _answer(problem: _Problem, fit: _Fit) -> tuple[FloatArray | None, str, _Problem]:
    """The method's own best normal (None with the votes in words), and the weights it gave."""
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
    """Contour scoring on the cosine of incidence, so that every minute's tolerance is its own."""
    settings, used, reference = problem.settings, problem.used, problem.rows.reference
    table = RadiationTable(slope_grid(settings.tilt_limit_deg), problem.design, reference)
    tolerance = 2.0 * problem.rows.sigma[used, problem.index]
    if settings.contour_tolerance_w_m2 is not None:
        tolerance = settings.contour_tolerance_w_m2 * problem.rows.per_w_m2[used]
    difference = problem.y - problem.design @ reference
    votes = table.winner(difference, tolerance, settings.contour_threshold)
    if np.isnan(votes.normals).any():
        return None, f"at most {votes.best[0]} of {used.sum()} minutes agree"
    return votes.normals[0], ""


def _nowhere(problem: _Problem, fit: _Fit, reason: str) -> Solution:
    chi_square = fit.misfit / problem.freedom
    used = int(problem.used.sum())
    return Solution(SlopeState.NO_INTERSECTION, reason, None, None, NOWHERE, NOWHERE, chi_square, used)


def _judged(problem: _Problem, fit: _Fit, best: FloatArray) -> Solution:
    """State and regions of a method's answer."""
    if fit.misfit - fit.steeper_misfit > problem.drop:
        limit = problem.settings.tilt_limit_deg
        return _nowhere(problem, fit, f"what fits best is steeper than the limit of {limit:g}°")
    misfit, doubtful = problem.misfit, problem.doubtful
    alarm = chi_square_limit(problem.freedom)
    chi_square = max(fit.misfit, 0.0) / problem.freedom  # rounding may leave less than nothing
    is_bad = float(doubtful(fit.best)) / problem.freedom > alarm
    # beyond what noise explains, the misfit itself is the measure of how far to trust
    swollen = chi_square if chi_square > alarm else 1.0
    if swollen > 1.0:
        loose = replace(problem, weights=problem.weights / swollen)
        misfit, doubtful = loose.misfit, loose.doubtful
    noise = _region(problem, misfit, misfit.H, best)
    whole = _region(problem, doubtful, doubtful.linearised(best), best)
    second = fit.other if fit.other_misfit - fit.misfit < problem.drop * swollen else None
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
    """What the misfit looks like, in words."""
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
    """Variance of standardised residuals (n,) by their second differences; 1.0 when too few.

    ``mean (r[k-1] - 2 r[k] + r[k+1])**2 / 6``. Below 1, or above it by less than chance
    explains (95 %), the stated noise stands: 1.0.
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
    """Reduced chi-square that noise alone exceeds once in a hundred windows."""
    return float(chdtri(freedom, ALARM_PROBABILITY)) / freedom


def kelvin_per_degree(tilt_deg: float, azimuth_deg: float, lamp: FloatArray, y_per_kelvin: float) -> float:
    """Change of surface temperature per degree of tilt at a slope under a lamp (3,), K per degree."""
    steeper = normal(tilt_deg + 90.0, azimuth_deg)  # the unit vector along growing tilt
    return float(np.radians(1.0) * (steeper @ lamp) / y_per_kelvin)


def sunlit(y: FloatArray, sigma: FloatArray) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Rows bright enough to be an equation: in its own shade a bed only says ``n . s < 0``."""
    return np.asarray(y >= SHADE_SIGMAS * sigma)
