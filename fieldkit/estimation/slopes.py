"""From the minute bins of a session to the slopes at its last one: one pure function for live and batch.

`slopes` looks back over a window, whose bins become rows (`balance`) that are solved by the chosen method
(`methods`). During a cloud or a shadow the estimate just before is held, not reset.

Without a fixed length the window reaches "since the last change of weather", that is as far back as one slope
explains the bins: a cloud that passed has next to no weight and ends no window, while a lasting change of
sky, wind or offset shows as a misfit, and the window is halved until it fits.

Drift of one region (a shadow that creeps in, a footprint in the sand): a slope of the bins before the last
twenty predicts those twenty. Clouds, wind and stored heat affect all regions alike, so a region is suspected
only if it deviates on its own and against the others. In measured weather clear hours move regions by 0.4 K
at most, hence the least deviation of half a kelvin.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import compress

import numpy as np

from fieldkit.estimation.balance import Rows, least_squares_rows
from fieldkit.estimation.bins import History, RegionColumns
from fieldkit.estimation.budget import BudgetTerm, RowBudget
from fieldkit.estimation.methods import Solution, solutions, sunlit
from fieldkit.estimation.normal import Misfit, choose, cramer_rao, solve, tangents
from fieldkit.estimation.region_temperatures import remove_offsets, shifted_temperatures
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.arrays import BoolArray, FloatArray, IntArray
from fieldkit.model.samples import Quality
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import SOLVED, SlopeEstimate, SlopeState
from fieldkit.physics.facet import normal, tilt_azimuth
from fieldkit.physics.horizon import MINUTE_EDGE_DEG, sunlit_share

DISTURBED_WEIGHT = 0.01
"""Relative weight of a shaded bin, and of a clouded one in the paper's model, which has no stored heat."""
WARMING_MINUTES = 90
"""Memory of the ground for the shadow of its horizon: five time constants of 2 cm of sand."""
SHORTEST_MINUTES = 20
"""A window is not halved below the paper's length."""
# the last minutes are compared with what those before them predict
RECENT_MINUTES = 20
LOOK_BACK_MINUTES = 120
LEAST_BEFORE = 40
LEAST_RECENT = 5
LEAST_K = 0.5  # above the 0.4 K by which clear hours move a region in measured weather
SIGMAS = 4.0  # judged: because every target is tested every minute
NO_REFERENCE = "no reference region"


def slopes(
    history: History, regions: Sequence[Region], settings: EstimatorSettings
) -> tuple[SlopeEstimate, ...]:
    """Slope of every target at the last minute bin of a history, in the order of the regions, its columns.

    The bins begin with the session: the full model needs those before the window.
    """
    by_name = {
        estimate.region: estimate
        for bins, seen in _by_camera(history, regions)
        for estimate in _slopes(bins, seen, settings)
    }
    return tuple(by_name[region.name] for region in regions if region.name in by_name)


def _by_camera(history: History, regions: Sequence[Region]) -> Iterator[tuple[History, tuple[Region, ...]]]:
    """The targets of each camera beside its own references, or beside all where it has none."""
    references = [region for region in regions if region.kind is RegionKind.REFERENCE]
    for camera in dict.fromkeys(region.camera for region in regions if region not in references):
        own = [region for region in references if region.camera == camera] or references
        seen = [region in own or (region not in references and region.camera == camera) for region in regions]
        yield history.only(np.flatnonzero(seen)), tuple(compress(regions, seen))


def _slopes(
    history: History, regions: Sequence[Region], settings: EstimatorSettings
) -> tuple[SlopeEstimate, ...]:
    columns = RegionColumns(tuple(regions))
    last = _end_of_clear(history, settings)
    if last < len(history):
        return _held_clouded(history, columns, last, settings)
    window = Window(history, last, columns, settings)
    return tuple(
        _held_shaded(history, columns, index, settings) if estimate.flags & Quality.SHADED else estimate
        for index, estimate in enumerate(window.flag_drift(window.estimates(range(columns.targets.size))))
    )


def budgets(
    history: History, regions: Sequence[Region], settings: EstimatorSettings
) -> dict[str, tuple[BudgetTerm, ...]]:
    """Uncertainty budget of every target that has a slope at the last minute, by the model paper or full."""
    terms: dict[str, tuple[BudgetTerm, ...]] = {}
    for bins, seen in _by_camera(history, regions):
        last = _end_of_clear(bins, settings) or len(bins)
        terms |= Window(bins, last, RegionColumns(tuple(seen)), settings).budgets()
    return terms


def _end_of_clear(history: History, settings: EstimatorSettings) -> int:
    """End of the minutes that a slope is estimated at: the paper's model holds its last one under a cloud."""
    clear = np.flatnonzero((history.flags & Quality.CLOUD) == 0) + 1
    return int(clear.max(initial=0)) if settings.model == "paper" else len(history)


def _held_clouded(
    history: History, columns: RegionColumns, last: int, settings: EstimatorSettings
) -> tuple[SlopeEstimate, ...]:
    window = Window(history, last, columns, settings)
    now, flags = int(history.time_ns[-1]), Quality(int(history.flags[-1]))
    ago = (now - history.time_ns[last - 1]) / 60e9 if last else 0.0
    held = []
    for estimate in window.estimates(range(columns.targets.size)):
        estimate = replace(estimate, time_ns=now, flags=estimate.flags | flags)
        if estimate.state in SOLVED:
            reason = f"unsteady light; estimate of {ago:.0f} min ago"
            estimate = replace(estimate, state=SlopeState.HELD_CLOUD, reason=reason)
        held.append(estimate)
    return tuple(held)


def _held_shaded(
    history: History, columns: RegionColumns, index: int, settings: EstimatorSettings
) -> SlopeEstimate:
    """The last estimate before this region alone, or the reference, was shaded."""
    column = columns.targets[index]
    lit = ~shaded_rows(history, columns, columns.targets[[index]])[:, 0]
    last = int(np.flatnonzero(lit)[-1]) + 1 if lit.any() else 0
    (held,) = Window(history, last, columns, settings).estimates([index])
    return replace(
        held,
        time_ns=int(history.time_ns[-1]),
        state=SlopeState.SHADED,
        flags=held.flags | Quality.SHADED,
        reason=_shade_reason(history, column),
    )


def shaded_rows(history: History, columns: RegionColumns, targets: IntArray) -> BoolArray:
    """Minutes (n, m) in which a target or a reference is shaded alone: they cannot be compared."""
    shaded = history.is_shaded()
    return np.asarray(shaded[:, targets] | shaded[:, columns.references].any(axis=1, keepdims=True))


def _shade_reason(history: History, column: np.int64) -> str:
    is_target = history.region_flags[-1, column] & Quality.SHADED
    return "this region alone is shaded" if is_target else "the reference is shaded"


class Window:
    """The minute bins an estimate looks back on, ending before index `last` of the history."""

    def __init__(
        self,
        history: History,
        last: int,
        columns: RegionColumns,
        settings: EstimatorSettings,
        minutes: float | None = None,
    ) -> None:
        self.columns = columns
        self.settings = settings
        self.past: History = history.until(last)
        if settings.fixed_window_s is not None:
            minutes = settings.fixed_window_s / 60.0
        self.first: int = 0
        if minutes is not None and len(self.past):
            self.first = int(np.searchsorted(self.past.minute, self.past.minute[-1] - minutes))
        self.rows: Rows | None = None
        if last and columns.references.size and columns.targets.size:
            corrected = remove_offsets(self.past, columns.regions, settings)
            shifted = shifted_temperatures(corrected.temperature_k, columns.regions, settings)
            self.rows = least_squares_rows(corrected, self.first, columns, settings, shifted)

    def estimates(self, indices: Sequence[int]) -> list[SlopeEstimate]:
        """Slopes of some of the targets."""
        blanks = {index: self._blank(index) for index in indices}
        by_target = {index: blank for index, (blank, _) in blanks.items()}
        solved = [index for index, (_, is_solvable) in blanks.items() if is_solvable]
        if not solved or self.rows is None:
            return list(by_target.values())
        beds = [self.columns.regions[self.columns.targets[index]] for index in solved]
        unexplained = []
        for index, solution in zip(
            solved, solutions(self.rows, solved, self._weights.T[solved], beds, self.settings), strict=True
        ):
            azimuth = self._known_azimuth(self.columns.targets[index])
            by_target[index] = _with_solution(by_target[index], solution, self.rows, index, azimuth)
            if not solution.explained:
                unexplained.append(index)
        if unexplained and self.shorter is not None:
            later = zip(unexplained, self.shorter.estimates(unexplained), strict=True)
            # half of a window may have too little: the whole one's contradiction is then the answer
            nothing = (SlopeState.TOO_FEW, SlopeState.NO_DATA)
            by_target |= {index: solution for index, solution in later if solution.state not in nothing}
        return list(by_target.values())

    def budgets(self) -> dict[str, tuple[BudgetTerm, ...]]:
        """The uncertainty budget of each target with a slope, by its name."""
        return {
            slope.region: self._budget(self.rows, index, normal(slope.tilt_deg, slope.azimuth_deg)).terms()
            for index, slope in enumerate(self.estimates(range(self.columns.targets.size)))
            if self.rows is not None and math.isfinite(slope.tilt_deg)
        }

    def _budget(self, rows: Rows, index: int, slope: FloatArray) -> RowBudget:
        weights, regions = self._weights[:, index], self.columns.regions
        return RowBudget(rows, index, weights, slope, self.past, regions, self.settings)

    def _blank(self, index: int) -> tuple[SlopeEstimate, bool]:
        """The estimate of a target without a slope, and whether it can be solved."""
        column = self.columns.targets[index]
        region = self.columns.regions[column]
        if self.rows is None:
            blank = blank_estimate(region, column, self.past.until(0), self.first, self.settings)
            return (blank if self.columns.references.size else replace(blank, reason=NO_REFERENCE)), False
        blank = blank_estimate(region, column, self.past, self.first, self.settings)
        # a target is shaded also where its reference is: they cannot be compared
        flags = blank.flags | (Quality.SHADED if self._is_shaded[-1, index] else Quality.GOOD)
        n_bins = int(self._is_used[:, index].sum())
        if (unsolvable := self._unsolvable(index, n_bins)) is not None:
            state, reason = unsolvable
            flags |= Quality.LOW_SUN if state == SlopeState.LOW_SUN else Quality.GOOD
            return replace(blank, state=state, reason=reason, flags=flags, n_bins=n_bins), False
        return replace(blank, flags=flags), True

    @cached_property
    def shorter(self) -> Window | None:
        """The later half of a window without a fixed length; None where it is short enough."""
        minutes = int(self.past.minute[-1] - self.past.minute[self.first])
        if self.settings.fixed_window_s is not None or minutes <= SHORTEST_MINUTES:
            return None
        half = max(minutes / 2.0, SHORTEST_MINUTES)
        return Window(self.past, len(self.past), self.columns, self.settings, half)

    def flag_drift(self, estimates: list[SlopeEstimate]) -> list[SlopeEstimate]:
        """The estimates, `NO_INTERSECTION` with a reason where one region alone deviates from its prediction.

        Only where the minute bins contradict each other, and not soon after a cloud.
        """
        minute = self.past.minute
        lately = minute[-1:] - minute < 2 * RECENT_MINUTES
        if self.rows is None or not len(minute) or (self.past.flags[lately] & Quality.CLOUD).any():
            return estimates
        start = self.past.time_ns[self.first]
        if all(
            estimate.state is not SlopeState.NO_INTERSECTION and estimate.window_start_ns <= start
            for estimate in estimates
        ):
            return estimates
        drifts = drifts_k(self.rows, self._weights, minute[self.first :], self.settings.tilt_limit_deg)
        return [_with_drift(slope, float(kelvin)) for slope, kelvin in zip(estimates, drifts, strict=True)]

    @cached_property
    def _is_used(self) -> BoolArray:
        """Rows of each target that can be used (n, targets)."""
        if self.rows is None:
            return np.zeros((0, self.columns.targets.size), np.bool_)
        y, sigma, shade = self.rows.y, self.rows.sigma, self.rows.shade
        lit = np.column_stack([self._above_horizon(index) for index in range(y.shape[1])])
        return np.asarray(np.isfinite(y) & self._high_sun[:, np.newaxis] & lit & sunlit(y, sigma, shade))

    def _above_horizon(self, index: int) -> BoolArray:
        """Minutes (n,) in which no horizon of the target or of a reference hides any of the sun.

        Without the beam nothing depends on the slope; while the ground warms up again, an error of its heat
        exchange would count as slope.
        """
        compared = [int(self.columns.targets[index]), *self.columns.references.tolist()]
        horizons = [self.settings.horizon_of(self.columns.regions[column].name) for column in compared]
        if not any(horizons):
            return np.ones(len(self.past) - self.first, np.bool_)
        sun, minute = self.past.sun, self.past.minute
        lit = np.all([sunlit_share(horizon, sun, MINUTE_EDGE_DEG) == 1.0 for horizon in horizons], axis=0)
        hidden_at = np.maximum.accumulate(np.where(lit, minute[0] - WARMING_MINUTES, minute))
        return np.asarray(minute - hidden_at >= WARMING_MINUTES)[self.first :]

    @cached_property
    def _high_sun(self) -> BoolArray:
        return np.asarray(self.past.sun[self.first :, 2] >= np.sin(np.radians(self.settings.low_sun_deg)))

    @cached_property
    def _weights(self) -> FloatArray:
        """Inverse variances (n, targets); zero where a row is not used."""
        if self.rows is None:
            return np.zeros(self._is_used.shape)
        # a divisor of 1 where no row is used, whose sigma may be NaN
        weights = np.where(self._is_used, 1.0 / np.where(self._is_used, self.rows.sigma, 1.0) ** 2, 0.0)
        downweighted = self._is_shaded[self.first :]
        if self.settings.model == "paper":
            clouded = (self.past.flags[self.first :] & Quality.CLOUD) != 0
            downweighted = downweighted | clouded[:, np.newaxis]
        return np.where(downweighted, DISTURBED_WEIGHT * weights, weights)

    def _unsolvable(self, index: int, n_bins: int) -> tuple[SlopeState, str] | None:
        """State and reason where no slope can be estimated at all, else None."""
        column = self.columns.targets[index]
        if self.columns.regions[column].name in self.settings.kinds:
            return SlopeState.NO_DATA, "a surface_kind of its own needs the model learned"
        if not self._high_sun[-1]:
            elevation = math.degrees(math.asin(self.past.sun[-1, 2]))
            reason = f"the sun is at {elevation:.1f}°, below {self.settings.low_sun_deg:g}°"
            return SlopeState.LOW_SUN, reason
        for what, is_known in (
            ("no temperatures of this region", self._has_temperature[column]),
            ("no temperatures of the reference", self._has_temperature[self.columns.references].any()),
            ("no irradiance", np.isfinite(self.past.dni_w_m2[self.first :]).any()),
        ):
            if not is_known:
                return SlopeState.NO_DATA, f"{what} in the window"
        # one minute bin more than unknown angles, so that a misfit can show
        needed = max(3 if math.isnan(self._known_azimuth(column)) else 2, self.settings.min_minutes)
        if n_bins < needed:
            return SlopeState.TOO_FEW, f"{n_bins} of {needed} minutes so far"
        if self._is_shaded[-1, index]:
            return SlopeState.SHADED, _shade_reason(self.past, column)
        return None

    @cached_property
    def _has_temperature(self) -> BoolArray:
        """Regions that have a temperature in the window."""
        return np.asarray(np.isfinite(self.past.temperature_k[self.first :]).any(axis=0))

    @cached_property
    def _is_shaded(self) -> BoolArray:
        """Minutes (n, targets) in which a target or a reference is shaded alone."""
        return shaded_rows(self.past, self.columns, self.columns.targets)

    def _known_azimuth(self, column: np.int64) -> float:
        """Azimuth of a region where it is known, in degrees [0, 360), else NaN."""
        is_known = self.settings.azimuth == "known"
        return self.columns.regions[column].azimuth_deg % 360.0 if is_known else math.nan


def blank_estimate(
    region: Region, column: np.int64, history: History, first: int, settings: EstimatorSettings
) -> SlopeEstimate:
    """The estimate of a region, a column of the history, without a slope at the last minute.

    Its window begins in the row `first`.
    """
    label, confidence = label_of(settings), settings.confidence
    blank = SlopeEstimate(0, region.name, SlopeState.NO_DATA, model=label, confidence=confidence)
    if not len(history):
        return replace(blank, reason="no minutes yet")
    time_ns, start_ns = int(history.time_ns[-1]), int(history.time_ns[first])
    return replace(blank, time_ns=time_ns, window_start_ns=start_ns, flags=history.last_flags(int(column)))


def label_of(settings: EstimatorSettings) -> str:
    """The model of a slope in words, with the method where there is a choice."""
    model = settings.model if settings.model == "learned" else f"{settings.model}, {settings.method}"
    words = "weather" if settings.reference == "weather" else model
    return f"{words}{', azimuth known' if settings.azimuth == 'known' else ''}"


def _with_solution(
    blank: SlopeEstimate, solved: Solution, rows: Rows, index: int, azimuth: float
) -> SlopeEstimate:
    """The estimate with the solution's numbers; `azimuth` is the known one, or NaN."""
    filled = replace(
        blank,
        state=solved.state,
        reason=solved.reason,
        n_bins=solved.used,
        chi_square=solved.chi_square,
        flags=blank.flags | (Quality.UNRESOLVED if solved.second is not None else Quality.GOOD),
    )
    if solved.best is None:
        return filled
    tilt, facing = _angles(solved.best, azimuth)
    imaged = np.flatnonzero(np.isfinite(rows.per_kelvin[:, index]))  # the last bin may have no frame
    last = imaged[-1] if imaged.size else -1
    direction, per_kelvin = rows.design[last], float(rows.per_kelvin[last, index])
    if solved.second is not None:
        second_tilt, second_azimuth = _angles(solved.second, azimuth)
        filled = replace(filled, second_tilt_deg=second_tilt, second_azimuth_deg=second_azimuth)
    bounds = solved.whole.bounds() | solved.noise.bounds("noise_")
    per_degree = kelvin_per_degree(tilt, facing, direction, per_kelvin)
    return replace(filled, tilt_deg=tilt, azimuth_deg=facing, kelvin_per_degree=per_degree, **bounds)


def kelvin_per_degree(
    tilt_deg: float, azimuth_deg: float, direction: FloatArray, y_per_kelvin: float
) -> float:
    """Change of surface temperature per degree of tilt at a slope, K per degree.

    By the design vector of a minute bin (3,) and the change of its measured cosine per kelvin
    (`Rows.per_kelvin`).
    """
    steeper = normal(tilt_deg + 90.0, azimuth_deg)  # the unit vector along growing tilt
    return float(np.radians(1.0) * (steeper @ direction) / y_per_kelvin)


def _angles(unit_normal: FloatArray, known_azimuth: float) -> tuple[float, float]:
    """Tilt and azimuth of a normal, degrees; a known azimuth holds for a vertical normal too."""
    tilt, azimuth = (float(angle) for angle in tilt_azimuth(unit_normal))
    return tilt, azimuth if math.isnan(known_azimuth) else known_azimuth


# One region alone off its own prediction: a drift, a shade that creeps in, a foot in the sand


def drifts_k(rows: Rows, weights: FloatArray, minutes: IntArray, tilt_limit_deg: float) -> FloatArray:
    """Deviation (m,) of each target alone from its own prediction in the last 20 minutes, K.

    Rows (n, m) are those of a window, with inverse variances `weights` (n, m), zero to exclude one,
    at increasing minutes since 1970 (n,). 0 where it is not significant, and for all targets with too few
    rows.
    """
    age = minutes[-1] - minutes
    lately = age < RECENT_MINUTES
    before = ~lately & (age < LOOK_BACK_MINUTES)
    recent = np.where(lately[:, np.newaxis], weights, 0.0).T
    past = Misfit.of_rows(rows.design, rows.y.T, np.where(before[:, np.newaxis], weights, 0.0).T)
    testable = (past.count >= LEAST_BEFORE) & (np.count_nonzero(recent, axis=1) >= LEAST_RECENT)
    off, sd = np.full((2, testable.size), np.nan)
    if testable.any():
        chosen = choose(past, solve(past), tilt_limit_deg).best
        for target in np.flatnonzero(testable):
            off[target], sd[target] = _deviation(rows, int(target), chosen[target], past.H, recent[target])
    # clouds, wind and stored heat move all regions alike: only what one does alone is its own
    others = np.array([_median(np.delete(off, target)) for target in range(off.size)])
    alone = np.minimum(np.abs(off), np.abs(off - others)) > LEAST_K + SIGMAS * sd
    return np.where(alone, off, 0.0)


def _deviation(
    rows: Rows, target: int, normal: FloatArray, information: FloatArray, weights: FloatArray
) -> tuple[float, float]:
    """Mean residual of a target against a normal, and its standard deviation, kelvin."""
    counted = weights > 0.0
    share = weights[counted] / weights[counted].sum()
    direction, y = share @ rows.design[counted], share @ rows.y[counted, target]
    per_kelvin = share @ rows.per_kelvin[counted, target]
    H = information if information.ndim == 2 else information[target]
    towards = np.stack(tangents(normal)) @ direction
    variance = towards @ cramer_rao(H, normal) @ towards + 1.0 / weights.sum()
    return float((y - normal @ direction) / per_kelvin), float(np.sqrt(variance) / per_kelvin)


def _median(values: FloatArray) -> float:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else 0.0


def _with_drift(estimate: SlopeEstimate, kelvin: float) -> SlopeEstimate:
    if not kelvin or estimate.state not in (*SOLVED, SlopeState.NO_INTERSECTION):
        return estimate
    reason = (
        f"this region alone deviates from its prediction by {kelvin:+.1f} K in {RECENT_MINUTES} min: drift"
    )
    return replace(estimate, state=SlopeState.NO_INTERSECTION, reason=reason)
