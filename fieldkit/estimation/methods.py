"""From rows to the slopes of targets by one of two methods, with their states and likelihood regions.

Unit-norm least squares is the default, contour scoring is the paper's method. They differ in the best normal;
the likelihood regions are computed alike for both, once for noise alone and once with the stated systematic
uncertainties of scale, offset and stored heat.

The noise level comes from second differences, which a slope, a drift or the hour of day cannot mimic. A small
chi-square does not mean a small error: a smooth model error fits a smooth wrong slope, and only the stated
systematic uncertainties cover that.

Targets are solved side by side: with a hundred of them one call on arrays costs hardly more than with one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.estimation.balance import Rows
from fieldkit.estimation.contours import RadiationTable, slope_grid
from fieldkit.estimation.distributions import chi_square_exceeded
from fieldkit.estimation.likelihood import (
    LikelihoodRegion,
    ProfileMisfit,
    profiled_gram,
    regions,
    regions_known_azimuth,
    with_systematics,
)
from fieldkit.estimation.normal import LOWEST_COS_INCIDENCE, Choice, Misfit, choose, choose_along, solve
from fieldkit.estimation.settings import PAPER_SCALE_SD, EstimatorSettings
from fieldkit.model.arrays import BoolArray, FloatArray, IntArray
from fieldkit.model.confidence import misfit_drop, percent
from fieldkit.model.site import Region
from fieldkit.model.slope import SlopeState, half_width_deg, is_too_wide
from fieldkit.physics.facet import angle_between_deg, tilt_azimuth

ALARM_PROBABILITY = 0.01
"""Probability that chi-square rejects a good window."""
MIN_DIFFERENCES = 8  # second differences of ten minutes
SHADE_SIGMAS = 2.0  # only light that noise does not explain puts a row in the sun
SHADE_ROUNDS = 10  # a choice of rows that still changes then contradicts its own slope
SETTLED_DEG = 0.01
"""Move of a slope in a round below which what is uncertain of the light on it no longer changes."""
NOWHERE = LikelihoodRegion(*(float("nan"),) * 4, vertical=False)


@dataclass(frozen=True, slots=True)
class Solution:
    """Slope of one target: best normal (3,) or None, a second one that fits as well or None, regions, state.

    `whole` is the region with systematic uncertainties, `noise` that of noise alone, `used` the number of
    rows. `explained` is false if no slope fits the minute bins together, however steep.
    """

    state: SlopeState
    reason: str
    chi_square: float
    used: int
    best: FloatArray | None = None
    second: FloatArray | None = None
    whole: LikelihoodRegion = NOWHERE
    noise: LikelihoodRegion = NOWHERE
    explained: bool = True


def solutions(
    rows: Rows,
    indices: Sequence[int],
    weights: FloatArray,
    beds: Sequence[Region],
    settings: EstimatorSettings,
) -> list[Solution]:
    """Slopes of m targets, the columns `indices` of the rows, each one of `beds`.

    Inverse variances `weights` (m, n) exclude a row by zero and leave at least three rows of each target (two
    with a known azimuth, that of its bed). `settings` give method, tilt limit, noise and systematic
    uncertainties.
    """
    azimuths = np.array([bed.azimuth_deg for bed in beds], np.float64)
    is_known = np.isfinite(azimuths) & (settings.azimuth == "known")
    by_place: dict[int, Solution] = {}
    for places in (np.flatnonzero(is_known), np.flatnonzero(~is_known)):
        if places.size:
            along = azimuths[places] if is_known[places[0]] else None
            columns = np.asarray(indices)[places]
            level = np.broadcast_to(rows.reference, (places.size, 3))
            problem = _Problem(rows, columns, weights[places], along, settings, level)
            by_place |= dict(zip(places.tolist(), _solve(problem), strict=True))
    return [by_place[place] for place in range(len(beds))]


def _solve(problem: _Problem) -> list[Solution]:
    problem, fit, stands = _of_sunlit_rows(problem)
    solved = _by_method(problem, fit)
    return [slope if ok else _as_undecided(slope) for slope, ok in zip(solved, stands.tolist(), strict=True)]


def _of_sunlit_rows(problem: _Problem) -> tuple[_Problem, Choice, BoolArray]:
    """Each target's rows in which the sun shines on the slope that they give, and whether there are any.

    Whether a row is in the facet's own shade depends on its slope, which depends on the rows: they are chosen
    anew until the choice stands. If fewer than an estimate needs remain, all are kept.
    """
    whole, fit = problem, _least_squares(problem)
    for _ in range(SHADE_ROUNDS):
        lit = whole.is_used & (fit.best @ problem.rows.sun.T >= LOWEST_COS_INCIDENCE)
        is_enough = lit.sum(axis=1) >= problem.fewest
        lit = np.where(is_enough[:, np.newaxis], lit, whole.is_used)
        stands = is_enough & (lit == problem.is_used).all(axis=1)
        if (lit == problem.is_used).all() and problem.is_of(fit.best):
            break
        problem = whole.of(fit.best, lit)
        fit = _least_squares(problem)
    return problem, fit, stands


def _as_undecided(solution: Solution) -> Solution:
    reason = "no slope agrees with the minutes in its own shade"
    return replace(solution, state=SlopeState.NO_INTERSECTION, reason=reason, explained=False)


def _by_method(problem: _Problem, fit: Choice) -> list[Solution]:
    residuals = (problem.y - fit.best @ problem.design.T) * np.sqrt(problem.weights)
    ratio = np.array([noise_ratio(row[used]) for row, used in zip(residuals, problem.is_used, strict=True)])
    if (ratio > 1.0).any():
        problem = replace(problem, weights=problem.weights / ratio[:, np.newaxis])
        fit = _least_squares(problem)
    if problem.settings.method == "unit-norm" or problem.azimuth_deg is not None:
        return _solutions(problem, fit, fit.best)
    return [_by_contours(problem.only(place)) for place in range(len(problem.indices))]


def _by_contours(problem: _Problem) -> Solution:
    """One target by the paper's contours: a score of cosines, with a tolerance of its own for every bin."""
    settings, used, reference = problem.settings, problem.is_used[0], problem.rows.reference
    design = problem.design[used]
    table = RadiationTable(slope_grid(settings.tilt_limit_deg), design, reference)
    tolerance = 2.0 * problem.rows.sigma[used, problem.indices[0]]
    if settings.contour_tolerance_w_m2 is not None:
        tolerance = settings.contour_tolerance_w_m2 * problem.rows.per_w_m2[used]
    difference = problem.y[0, used] - design @ reference
    winners = table.winner(difference, tolerance, settings.contour_threshold)
    fit = _least_squares(problem)
    if np.isnan(winners.normals).any():
        reason = f"no slope lies on enough contours: at most {winners.best[0]} of {used.sum()} minutes agree"
        return replace(_nowhere(problem, fit, 0, reason), explained=False)
    return _solutions(problem, fit, winners.normals)[0]


@dataclass(frozen=True)
class _Problem:
    """Rows of m targets, their weights (m, n), the azimuths (m,) where they are known, and the settings.

    `slopes` (m, 3) are those that the light falls on: what is uncertain of it depends on them.
    """

    rows: Rows
    indices: IntArray
    weights: FloatArray
    azimuth_deg: FloatArray | None
    settings: EstimatorSettings
    slopes: FloatArray

    def of(self, slopes: FloatArray, lit: BoolArray) -> _Problem:
        """The rows that are lit, as certain as the light on these slopes is."""
        passing = np.sum(self.rows.light_effects(slopes) ** 2, axis=0)
        # variances add: 1 / w' = 1 / w + passing
        weights = np.where(lit, self.weights / (1.0 + self.weights * passing), 0.0)
        return replace(self, weights=weights, slopes=slopes)

    def is_of(self, slopes: FloatArray) -> bool:
        """True if these slopes are those that the light falls on, or if it is certain."""
        return not self.rows.light.size or bool(angle_between_deg(slopes, self.slopes).max() < SETTLED_DEG)

    def only(self, place: int) -> _Problem:
        """One of the targets."""
        part = slice(place, place + 1)
        azimuth = None if self.azimuth_deg is None else self.azimuth_deg[part]
        indices, weights, slopes = self.indices[part], self.weights[part], self.slopes[part]
        return replace(self, indices=indices, weights=weights, azimuth_deg=azimuth, slopes=slopes)

    @cached_property
    def is_used(self) -> BoolArray:
        """Rows of each target that are used (m, n)."""
        return self.weights > 0.0

    @cached_property
    def design(self) -> FloatArray:
        """Design vectors (n, 3); zeros where no target has a row."""
        return np.nan_to_num(self.rows.design)

    @cached_property
    def y(self) -> FloatArray:
        """Measured cosines (m, n), zeros where a row is not used."""
        return np.where(self.is_used, self.rows.y.T[self.indices], 0.0)

    @cached_property
    def misfit(self) -> Misfit:
        """Noise alone, with what passes of the light's uncertainty."""
        return Misfit.of_rows(self.design, self.y, self.weights)

    @cached_property
    def profile_misfit(self) -> ProfileMisfit:
        """Noise and the stated systematic uncertainties."""
        settings = self.settings
        neglected = PAPER_SCALE_SD if settings.model == "paper" else 0.0
        scale_sd = math.hypot(settings.scale_sd, settings.factor_sd, neglected)
        light = self.rows.light_near(self.slopes)
        columns = [*self.design.T, self.y, *light.reshape(-1, *self.y.shape)]
        gram = profiled_gram(columns, self.weights, self.systematics)
        return ProfileMisfit(gram, self.rows.reference, scale_sd)

    @cached_property
    def systematics(self) -> FloatArray:
        """Effects that do not depend on the slope, (p, m, n)."""
        return np.where(self.is_used, np.swapaxes(self.rows.systematics, 1, 2)[:, self.indices], 0.0)

    def information(self, best: FloatArray) -> FloatArray:
        """Information (m, 3, 3) about normals near the best ones, after the part of every uncertainty."""
        away = self.profile_misfit.scale_sd * (best - self.rows.reference) @ self.design.T
        every = [self.systematics, self.light_effects(best), away[np.newaxis]]
        return with_systematics(self.design, self.y, self.weights, np.concatenate(every)).H

    def light_effects(self, slopes: FloatArray) -> FloatArray:
        """Effects of the uncertain light on slopes (m, 3), (q, m, n)."""
        return np.where(self.is_used, self.rows.light_effects(slopes), 0.0)

    @cached_property
    def freedom(self) -> IntArray:
        """Degrees of freedom (m,): rows less fitted angles."""
        return np.asarray(self.is_used.sum(axis=1) - (2 if self.azimuth_deg is None else 1))

    @property
    def fewest(self) -> int:
        """One row more than fitted angles."""
        return 3 if self.azimuth_deg is None else 2

    @property
    def drop(self) -> float:
        """Misfit above the least that bounds the likelihood region."""
        return misfit_drop(self.settings.confidence, 2 if self.azimuth_deg is None else 1)


def _least_squares(problem: _Problem) -> Choice:
    """Preferred normals (m, 3), other branches, their misfits (m,)."""
    limit, misfit = problem.settings.tilt_limit_deg, problem.misfit
    if problem.azimuth_deg is not None:
        return choose_along(misfit, problem.azimuth_deg, limit, problem.drop)
    return choose(misfit, solve(misfit), limit, at_limit=bool(problem.rows.light.size))


def _nowhere(problem: _Problem, fit: Choice, place: int, reason: str) -> Solution:
    chi_square = max(float(fit.misfit[place]), 0.0) / int(problem.freedom[place])  # rounding
    return Solution(SlopeState.NO_INTERSECTION, reason, chi_square, int(problem.is_used[place].sum()))


def _solutions(problem: _Problem, fit: Choice, best: FloatArray) -> list[Solution]:
    """States and regions of a method's best normals (m, 3)."""
    alarm = np.array([chi_square_limit(freedom) for freedom in problem.freedom.tolist()])
    chi_square = np.maximum(fit.misfit, 0.0) / problem.freedom  # rounding may make it negative
    is_bad = problem.profile_misfit(fit.best) / problem.freedom > alarm
    # a misfit beyond noise inflates the variance, so that the regions are as wide as the residuals
    inflation = np.where(chi_square > alarm, chi_square, 1.0)
    widened = replace(problem, weights=problem.weights / inflation[:, np.newaxis])
    profiled = widened.profile_misfit
    noise_alone = ProfileMisfit.of(widened.misfit, profiled.reference, 0.0)
    noise = _regions(problem, noise_alone, widened.misfit.H, best)
    whole = _regions(problem, profiled, widened.information(best), best)
    is_second = fit.other_misfit - fit.misfit < problem.drop * inflation
    likelihood = profiled if problem.rows.light.size else problem.misfit
    is_too_steep = likelihood(fit.best) - likelihood(fit.steeper) > problem.drop
    limit = problem.settings.tilt_limit_deg
    judged = []
    for place, normal_ in enumerate(best):
        if is_too_steep[place]:
            reason = f"the best fit is steeper than the limit of {limit:g}°"
            judged.append(_nowhere(problem, fit, place, reason))
            continue
        second = fit.other[place] if is_second[place] else None
        if is_bad[place]:
            state, reason = SlopeState.NO_INTERSECTION, _misfit_reason(problem, place, chi_square[place])
        else:
            state, reason = _state(normal_, second, whole[place], problem.settings)
        solution = replace(_nowhere(problem, fit, place, reason), state=state, explained=not is_bad[place])
        judged.append(replace(solution, best=normal_, second=second, whole=whole[place], noise=noise[place]))
    return judged


def _state(
    best: FloatArray, second: FloatArray | None, whole: LikelihoodRegion, settings: EstimatorSettings
) -> tuple[SlopeState, str]:
    """State of a slope that explains the minutes, with the reason."""
    if second is not None:
        tilt, azimuth = tilt_azimuth(second)
        return SlopeState.NOT_RESOLVED, f"tilt {tilt:.1f}°, azimuth {azimuth:.0f}° fits as well"
    low, high, slope_deg = whole.tilt_low_deg, whole.tilt_high_deg, float(tilt_azimuth(best)[0])
    if is_too_wide(slope_deg, half_width_deg(slope_deg, low, high), settings.target_half_width_deg):
        return (
            SlopeState.WIDE,
            f"anything from {low:.1f}° to {high:.1f}° fits ({percent(settings.confidence)})",
        )
    if whole.vertical:
        return SlopeState.FLAT, f"flat within {high:.1f}°"
    return SlopeState.OK, ""


def _misfit_reason(problem: _Problem, place: int, chi_square: float) -> str:
    """The likely cause of a misfit, in words."""
    brightest = float(problem.y[place, problem.is_used[place]].max())
    if brightest > 1.0:
        return f"warmer than any slope explains (cosine {brightest:.2f}): check scale, offset and emissivity"
    return f"no slope fits all minutes (chi-square {chi_square:.1f}): cloud, shade, wind or drift?"


def _regions(
    problem: _Problem, misfit: ProfileMisfit, information: FloatArray, best: FloatArray
) -> list[LikelihoodRegion]:
    limit = problem.settings.tilt_limit_deg
    if problem.azimuth_deg is not None:
        return regions_known_azimuth(misfit, problem.azimuth_deg, best, problem.drop, limit)
    return regions(misfit, information, best, problem.drop, limit)


def noise_ratio(residuals: ArrayLike) -> float:
    """Ratio of the observed noise variance to the stated one, from second differences of residuals.

    ``mean (r[k-1] - 2 r[k] + r[k+1])**2 / 6`` of standardised residuals in order of time (n,); 1.0 with fewer
    than ten, and where it does not exceed 1 by more than chance explains (95 %).
    """
    bends = np.diff(np.asarray(residuals, np.float64), 2)
    if bends.size < MIN_DIFFERENCES:
        return 1.0
    ratio = float(np.mean(bends**2)) / 6.0
    # neighbouring second differences share samples: 18/35 of their number is independent
    freedom = bends.size * 18.0 / 35.0
    return ratio if ratio > chi_square_exceeded(freedom, 0.05) / freedom else 1.0


@cache
def chi_square_limit(freedom: int) -> float:
    """Reduced chi-square that noise alone exceeds in one window of a hundred; `freedom` >= 1."""
    return chi_square_exceeded(freedom, ALARM_PROBABILITY) / freedom


def sunlit(y: FloatArray, sigma: FloatArray, shade: FloatArray) -> BoolArray:
    """Rows (n, m) with more light than a facet in its own shade can have, which only shows ``n . s < 0``.

    `y` and `sigma` (n, m) and `shade` (n,) as of `Rows`; a cosine near that of grazing light does not count.
    """
    margin = SHADE_SIGMAS * np.maximum(sigma, LOWEST_COS_INCIDENCE)
    return np.asarray(y >= shade[:, np.newaxis] + margin)
