"""Slopes minute after minute: what live view, replay and batch ask, whatever the model.

The models of the paper and `full` are functions of the bins alone. The learned model is a chain of minutes:
each is taken once, in order, with the shade known at that minute, so that asking late or often gives the
same slopes. A session's first minutes are repeated where a shade test is recognised or dismissed afterwards.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from fieldkit.estimation.bins import History, RegionColumns, join
from fieldkit.estimation.budget import BudgetTerm, slope_budget
from fieldkit.estimation.instant import with_along_sun
from fieldkit.estimation.learned import inputs, readout
from fieldkit.estimation.learned.errors import ErrorSums
from fieldkit.estimation.learned.layout import Layout
from fieldkit.estimation.learned.learner import AT_ONCE, Learner
from fieldkit.estimation.learned.prior_state import prior_sds
from fieldkit.estimation.learned.reading_gaps import settled
from fieldkit.estimation.learned.statements import statement_sds, unstated_slope
from fieldkit.estimation.measures import LEAST_GAIN, measures, narrowing
from fieldkit.estimation.region_temperatures import CAMERA_OFFSET_SD_K, remove_offsets
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.shade_evidence import DoubtfulShade
from fieldkit.estimation.slopes import blank_estimate, budgets, kelvin_per_degree, slopes
from fieldkit.estimation.weather_slopes import ROW_MINUTES, weather_slopes
from fieldkit.model.arrays import BoolArray, FloatArray, IntArray
from fieldkit.model.confidence import interval_sds, percent
from fieldkit.model.learnt import Learnt
from fieldkit.model.region_schedule import Regions, RegionSchedule
from fieldkit.model.samples import Quality
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import CERTAIN, ReferenceCheck, SlopeEstimate, SlopeState, is_too_wide
from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.physics.constants import STEFAN_BOLTZMANN
from fieldkit.physics.facet import tilt_azimuth

TOGETHER = 4
"""Targets that learn together with the references.

Judged: because a fifth bed adds hardly anything about the sand, and the cost grows with the square.
"""
GRAZING = 0.02
"""Cosine of the angle of incidence below which light is no measurement.

Judged: because within a degree of grazing a bed's own roughness decides what it sees of the sun.
"""
NO_SUN = "the sun has not been up; if it has, check clock, time zone and site"
MOST_OF_PRIOR = 0.5
"""Half-width of a certain slope over the prior's.

Judged: because above it the prior has at least as much of the number as the minutes.
"""
DRIES_SDS = 2.0
"""Judged: because chance takes one bed of forty for one that dries, and naming it costs a look."""
MOST_UNLIKE = 1.0
"""What beds do alone, over the usual, up to which slopes are certain.

Judged: because simulated beds of one heap showed 0.3 to 0.6, those that were not alike 1.3 to 5.
"""
WELL_FITTING = 2.0
"""Misfit up to which slopes are certain.

Judged: because in simulated worlds without harm it was 0.7 to 1.5.
"""
MELTING_K, MELTING_MINUTES = 1.0, 60
"""Judged: because dry ground in the sun passes through so few kelvins within minutes; ice melts for hours."""
FAILED = "the estimate failed numerically; it starts again with the next minute"


@dataclass(frozen=True, slots=True)
class Estimated:
    """Slopes of all targets at one minute, and what was learnt by then (with the learned model)."""

    slopes: tuple[SlopeEstimate, ...]
    learnt: Learnt | None = None


class SlopeChain:
    """Slopes of the targets of some regions at the last minute of a history that grows.

    `schedule` may be replaced by one that has grown. A target that is added, redrawn or removed leaves the
    others learning as before; a reference that is makes all of them learn anew.
    """

    def __init__(self, regions: Regions, settings: EstimatorSettings) -> None:
        self.schedule: RegionSchedule = RegionSchedule.of(regions)
        self._settings = settings
        self._learns = settings.model == "learned" and settings.reference == "region"
        model = "full" if settings.model == "learned" else settings.model
        self._of_bins = replace(settings, model=model)  # by the bins alone, where nothing can be learned
        self._groups: list[_Group] = []
        self._by_weather: tuple[object, tuple[SlopeEstimate, ...]] = (None, ())
        self._active: tuple[int, ...] = ()
        self._taken = 0
        self._regroup(self.schedule.at(0))

    def at(self, history: History) -> Estimated:
        """Slopes at the last minute; the history must begin with the minutes given before."""
        estimated = self._learned_slopes(history) if self._learns else None
        minute, history = int(history.minute[-1]) if len(history) else 0, history.in_place()
        of_active, regions = history.at_last(self.schedule)
        if estimated is None:
            estimated = Estimated(self._slopes_of_bins(of_active, regions))
        explained = [self._with_reason(slope, minute) for slope in estimated.slopes]
        # a slope has two angles, and too few minutes measure one number: its component along the sun
        if any(slope.state is SlopeState.TOO_FEW for slope in explained):
            explained = [with_along_sun(slope, of_active, regions, self._settings) for slope in explained]
        if (history.flags & int(Quality.MOVED)).any() and not np.isfinite(history.temperature_k).any():
            explained = [replace(slope, reason=LOST) for slope in estimated.slopes]
        explained = [self._beside_other_cameras(slope, regions) for slope in explained]
        explained = [self._on_ice(slope, of_active, regions) for slope in explained]
        return replace(estimated, slopes=tuple(explained))

    def _slopes_of_bins(self, history: History, regions: Sequence[Region]) -> tuple[SlopeEstimate, ...]:
        """Slopes that need the bins alone; those from the weather change with whole rows of ten minutes."""
        if self._settings.reference == "region" or not len(history):
            return slopes(history, regions, self._of_bins)
        row = (int(history.minute[-1]) // ROW_MINUTES, *regions)
        if self._by_weather[0] != row:
            self._by_weather = row, weather_slopes(history, regions, self._settings)
        now = int(history.time_ns[-1])
        return tuple(replace(slope, time_ns=now) for slope in self._by_weather[1])

    def series(self, history: History) -> Iterator[Estimated]:
        """Slopes at every minute of a history."""
        return (self.at(history.until(last)) for last in range(1, len(history) + 1))

    def at_once(self, history: History, hypotheses: int = AT_ONCE) -> Estimated:
        """As `at` of a new chain with the learned model, in half the time, for plans.

        Widths differ by a tenth from those of minutes taken one by one, which draw other hypotheses.
        """
        return self._at_once(history, [max(rows_after_gaps(history), default=0)], hypotheses)

    def together(self, sessions: Sequence[History]) -> Estimated:
        """Slopes of the targets at the last minute of sessions with the same columns, in order of time.

        What lasts (slopes, gain, inertia, what is unlike in a bed) is learned from all of them; what belongs
        to a session, or to what follows a gap of hours in it, begins anew. A region that a session does not
        have is without temperatures there.
        """
        history = join(sessions)
        ends = np.cumsum([len(session) for session in sessions])[:-1]
        return self._at_once(history, sorted({0, *ends.tolist(), *rows_after_gaps(history)}))

    def _at_once(self, history: History, starts: Sequence[int], hypotheses: int = AT_ONCE) -> Estimated:
        corrected = remove_offsets(history.in_place(), self.schedule.columns, self._settings)
        for group in self._groups if self._learns else ():
            group.take_at_once(corrected, starts, hypotheses)
        self._taken = len(history)
        return self.at(history)

    def narrowing(self) -> dict[str, dict[str, float]]:
        """By target and measure, the share of a half-width that the measure would leave, after `at`."""
        return {name: shares for group in self._groups for name, shares in group.narrowing()}

    def budgets(self, history: History) -> dict[str, tuple[BudgetTerm, ...]]:
        """The uncertainty budget of each target, after `at` of this history; none from the weather alone."""
        if self._learns and self._groups:
            return {name: terms for group in self._groups for name, terms in group.budgets()}
        if self._settings.reference == "weather" or not len(history):
            return {}
        return budgets(*history.in_place().at_last(self.schedule), self._of_bins)

    def reference_checks(self) -> tuple[ReferenceCheck, ...]:
        """Each reference's slope by all others, after `at`; none with fewer than two, or by bins alone."""
        return tuple(self._groups[0].reference_checks()) if self._learns and self._groups else ()

    def _learned_slopes(self, history: History) -> Estimated | None:
        """Slopes by what was learned; None without a reference or a target."""
        drawn = self.schedule.columns[: history.temperature_k.shape[1]]
        corrected = remove_offsets(history.in_place(), drawn, self._settings)
        for last in range(self._taken + 1, len(history) + 1):
            self._regroup(self.schedule.at(int(history.minute[last - 1])))
            for group in self._groups:
                group.take(corrected.until(last))
            self._taken = last
        if not self._groups:
            return None
        estimates = [estimate for group in self._groups for estimate in group.estimates(corrected)]
        order = [self.schedule.columns[column].name for column in self._active]
        # groups that were formed later come last, but slopes stand in the order of the regions
        estimates.sort(key=lambda slope: order.index(slope.region))
        return Estimated(tuple(estimates), self._groups[0].learnt() if len(history) else None)

    def _regroup(self, active: IntArray) -> None:
        """Follow a change of the regions: targets that hold on stay together, new ones form groups."""
        if tuple(active.tolist()) == self._active:
            return
        self._active = tuple(active.tolist())
        kinds = {column: self.schedule.columns[column].kind for column in self._active}
        references = [column for column, kind in kinds.items() if kind is RegionKind.REFERENCE]
        targets = [column for column, kind in kinds.items() if kind is RegionKind.TARGET]
        continuing = [group for group in self._groups if group.goes_on(references, targets)]
        grouped = {column for group in continuing for column in group.targets}
        new = np.array([column for column in targets if column not in grouped], np.int64)
        # evenly: a group of four beside one of one would know the sand unequally
        parts = np.array_split(new, -(-new.size // TOGETHER)) if new.size and references else []
        added = [_Group(self.schedule, references, part, self._settings) for part in parts]
        self._groups = [*continuing, *added]

    def _with_reason(self, estimate: SlopeEstimate, minute: int) -> SlopeEstimate:
        """Say that too little is known because a region was redrawn."""
        schedule, column = self.schedule, self.schedule.column(estimate.region, minute)
        if estimate.state not in (SlopeState.NO_DATA, SlopeState.TOO_FEW) or column is None:
            return estimate
        references = [i for i in schedule.at(minute) if schedule.columns[i].kind is RegionKind.REFERENCE]
        if any(schedule.is_redrawn(i) and schedule.since[i] > schedule.since[column] for i in references):
            return replace(estimate, reason=f"{estimate.reason}; the reference was redrawn: started again")
        if schedule.is_redrawn(column):
            return replace(estimate, reason=f"{estimate.reason}; redrawn: started again")
        return estimate

    def _beside_other_cameras(self, estimate: SlopeEstimate, regions: Sequence[Region]) -> SlopeEstimate:
        """Say that a slope includes the offset between cameras: its own has no reference."""
        cameras = {region.camera for region in regions if region.kind is RegionKind.REFERENCE}
        region = next(region for region in regions if region.name == estimate.region)
        if not cameras or region.camera in cameras or self._settings.reference == "weather":
            return estimate
        return replace(estimate, reason="; ".join(filter(None, (estimate.reason, OTHER_CAMERA))))

    def _on_ice(self, estimate: SlopeEstimate, history: History, regions: Sequence[Region]) -> SlopeEstimate:
        """Doubt a slope of a surface that stays at the melting point by day, or of a reference that does."""
        melting = [
            region.name
            for column, region in enumerate(regions)
            if region.name == estimate.region or region.kind is RegionKind.REFERENCE
            if stays_at_melting(history.temperature_k[:, column], history.sun[:, 2], history.minute)
        ]
        if not melting or self._settings.body != "earth":
            return estimate
        reason = f"{', '.join(melting)} stayed at 0 °C for an hour of sun: is it frost, snow or ice?"
        state = SlopeState.WIDE if estimate.state in CERTAIN else estimate.state
        return replace(estimate, state=state, reason="; ".join(filter(None, (reason, estimate.reason))))


def stays_at_melting(temperature_k: FloatArray, sun_up: FloatArray, minute: IntArray) -> bool:
    """True if a surface stays within a kelvin of 0 °C for an hour with the sun up: melting takes all heat.

    `temperature_k`, the sun's upward component `sun_up` and the numbers `minute` are by minute (n,); minutes
    without a temperature count as the ones around them.
    """
    seen = np.isfinite(temperature_k)
    melts = (np.abs(temperature_k[seen] - CELSIUS_ZERO_K) <= MELTING_K) & (sun_up[seen] > 0.0)
    minute = minute[seen]
    before = np.maximum.accumulate(np.where(melts, minute[:1] - 1, minute))
    return bool(np.any(minute - before >= MELTING_MINUTES))


def rows_after_gaps(history: History) -> list[int]:
    """Rows that follow a gap too long to be bridged: the learned model begins anew there."""
    gaps: list[int] = (np.flatnonzero(np.diff(history.minute) > inputs.BRIDGED_MINUTES) + 1).tolist()
    return gaps


OTHER_CAMERA = f"no reference in its camera: ± includes {CAMERA_OFFSET_SD_K:g} K between cameras"
LOST = "the regions were lost in all frames: the camera moved too far, or its trajectory has no pose here"


class _Group:
    """References and a few targets, given as columns of a schedule, that learn together.

    A target that holds no more stays in what is learned, without frames.
    """

    def __init__(
        self,
        schedule: RegionSchedule,
        references: Sequence[int],
        targets: IntArray,
        settings: EstimatorSettings,
    ) -> None:
        self.targets = set(targets.tolist())
        self._places = np.array([*references, *targets.tolist()], np.int64)
        self._references, self._held = list(references), set(self.targets)
        columns = RegionColumns(tuple(schedule.columns[place] for place in self._places))
        self._columns, self._targets, self._settings = columns, columns.targets, settings
        self._layout = Layout.of(columns, columns.targets, settings)
        self._about = self._layout, columns.regions, settings
        self._learner: Learner | None = None
        self._found: list[readout.KnownSlope] = []
        self._moments = readout.Moments((), np.empty(0), np.empty((0, 0)))
        self._unusual = ""
        self._errors: ErrorSums = ErrorSums()
        self._first, self._taken = 0, -1
        self._shade: BoolArray = np.zeros((0, 2, 0), np.bool_)
        self._doubtful: list[DoubtfulShade] = []
        self._has_failed = False

    def goes_on(self, references: Sequence[int], targets: Sequence[int]) -> bool:
        """True if the group goes on with these regions: all its references and some of its targets."""
        self._held = self.targets & set(targets)
        return list(references) == self._references and bool(self._held)

    def take(self, history: History) -> None:
        """Take the last minute, with the shade as known then."""
        try:
            self._take_last(history.only(self._places))
            self._has_failed = False
        except np.linalg.LinAlgError:  # recording and other regions go on
            self._learner, self._has_failed, self._taken = None, True, len(history)

    def _take_last(self, history: History) -> None:
        row = len(history) - 1
        is_apart = row > 0 and history.minute[row] - history.minute[row - 1] > inputs.BRIDGED_MINUTES
        if is_apart or self._taken < 0:
            self._learner, self._first, self._taken = None, row, row
        shaded = inputs.shade(history, self._layout)
        # shade and instruments that are known only now were there in minutes that were taken without them
        if self._learner and (
            not np.array_equal(shaded[self._first : self._taken], self._shade)
            or self._learner.logged_inputs != inputs.logged_inputs(history, self._first, *self._about)
        ):
            self._learner.take_again(inputs.recorded_session(history, self._first, self._taken, *self._about))
        while self._taken < settled(history):
            self._take_row(history, self._taken, shaded[self._taken])
            self._taken += 1
        self._read(history, shaded)

    def _take_row(self, history: History, row: int, shaded: BoolArray) -> None:
        """Take a minute, or begin with it."""
        layout, settings = self._layout, self._settings
        if self._learner is not None:
            start, before = int(history.minute[self._first]), self._learner.last
            self._learner.add(inputs.minute_inputs(history, row, layout, settings, before, start, shaded))
        elif inputs.can_start(history, row, layout):
            self._first = row
            session = inputs.recorded_session(history, row, row + 1, *self._about)
            self._learner = Learner(layout, settings, [session])

    def take_at_once(self, history: History, starts: Sequence[int], hypotheses: int) -> None:
        """Take a whole history in which all regions hold, as sessions that begin in the rows `starts`."""
        history = history.only(self._places)
        sessions: list[inputs.Recorded] = []
        for first, end in pairwise([*starts, len(history)]):
            session = history.at(slice(first, end))
            session = session.until(settled(session))
            if (row := inputs.first_row(session, self._layout)) is None:
                continue
            if not sessions:
                self._first = first + row
            sessions.append(inputs.recorded_session(session, row, len(session), *self._about))
        try:
            if sessions:
                self._learner = Learner(self._layout, self._settings, sessions, hypotheses)
            self._taken = len(history)
            self._read(history, inputs.shade(history, self._layout))
        except np.linalg.LinAlgError:  # other regions go on
            self._learner, self._has_failed = None, True

    def _read(self, history: History, shaded: BoolArray) -> None:
        """Slopes and moments of what is learned by now, with the `shade` of the minutes."""
        self._doubtful = inputs.doubtful(history, self._layout, self._columns.regions)
        if self._learner is not None:
            # from the first minute taken on: a shade test that ends changes minutes that were taken
            self._shade = shaded[self._first : self._taken]
            heaviest = int(np.argmax(self._learner.posterior.log_weights))
            self._errors = self._learner.errors.under(heaviest)
            self._found = [
                readout.known_slope(self._learner, self._place(index)) for index in range(self._targets.size)
            ]
            self._moments = readout.moments(self._learner)
            self._unusual = self._unusual_in(self._learner)

    def estimates(self, history: History) -> list[SlopeEstimate]:
        """Slope of each target that holds at the last minute taken."""
        chosen = history.only(self._places)
        return [self._with_doubtful(self._estimate(chosen, index)) for index in self._holding()]

    def _with_doubtful(self, slope: SlopeEstimate) -> SlopeEstimate:
        """The estimate with shade of its region, or of a reference, that the temperatures contradict."""
        others = {self._columns.regions[column].name for column in self._targets} - {slope.region}
        reasons = (*(str(shade) for shade in self._doubtful if shade.region not in others), slope.reason)
        return replace(slope, reason="; ".join(filter(None, reasons)))

    def _place(self, index: int) -> int:
        """Place of a target of the group among those of the layout, where further references come first."""
        return self._layout.stated + index

    def _holding(self) -> list[int]:
        """Indices of the targets that hold."""
        count = len(self._references)
        return [i for i in range(self._targets.size) if int(self._places[count + i]) in self._held]

    def _estimate(self, history: History, index: int) -> SlopeEstimate:
        column = self._targets[index]
        region = self._columns.regions[column]
        blank = blank_estimate(region, column, history, self._first, self._settings)
        if not len(history):
            return blank
        if self._learner is None:
            since = history.since(self._first)
            reason = FAILED if self._has_failed else _missing(since, self._layout, region)
            return replace(blank, reason=reason)
        used = int(np.isfinite(history.temperature_k[self._first :, column]).sum())
        if used < self._settings.min_minutes:
            reason = f"{used} of {self._settings.min_minutes} minutes so far"
            return replace(blank, state=SlopeState.TOO_FEW, reason=reason, n_bins=used)
        return self._with_slope(replace(blank, n_bins=used), self._learner, index)

    def _with_slope(self, blank: SlopeEstimate, learner: Learner, index: int) -> SlopeEstimate:
        if not any(minute.sun[2] > 0.0 for minute in learner.minutes):
            return replace(blank, state=SlopeState.LOW_SUN, reason=NO_SUN)
        slope = self._found[index]
        target = self._place(index)
        tilt, azimuth = (float(angle) for angle in tilt_azimuth(slope.best))
        if self._layout.facing[target].shape[1] == 2:
            azimuth = self._columns.regions[self._targets[index]].azimuth_deg % 360.0
        filled = replace(
            blank,
            tilt_deg=tilt,
            azimuth_deg=azimuth,
            tilt_low_deg=min(slope.region.tilt_low_deg, tilt),
            tilt_high_deg=max(min(slope.region.tilt_high_deg, self._settings.tilt_limit_deg), tilt),
            azimuth_low_deg=slope.region.azimuth_low_deg,
            azimuth_high_deg=slope.region.azimuth_high_deg,
            tilt_half_width_deg=slope.half_width_deg,
            chi_square=self._errors.chi_square(self._layout.region(target)),
            kelvin_per_degree=_kelvin_per_degree(learner, target, tilt, azimuth),
        )
        if not any(minute.sun[2] > 0.0 and minute.sun @ slope.best > GRAZING for minute in learner.minutes):
            reason = "the sun has not reached it: this follows from skylight alone"
            return replace(filled, state=SlopeState.SHADED, reason=reason)
        if why := self._contradiction(learner, index):
            return replace(filled, state=SlopeState.NO_INTERSECTION, reason=why)
        return self._with_state(filled, slope, index)

    def _with_state(self, filled: SlopeEstimate, slope: readout.KnownSlope, index: int) -> SlopeEstimate:
        """The estimate with its state, and what would help where it is not certain."""
        if slope.second is not None:
            tilt, azimuth = (float(angle) for angle in tilt_azimuth(slope.second))
            return replace(
                filled,
                state=SlopeState.NOT_RESOLVED,
                second_tilt_deg=tilt,
                second_azimuth_deg=azimuth,
                flags=filled.flags | Quality.UNRESOLVED,
                reason=f"tilt {tilt:.1f}°, azimuth {azimuth:.0f}° fits as well ({1.0 - slope.share:.0%})",
            )
        # from what refuses a slope to what only leaves it wide: the first that applies is the state
        limit = self._settings.tilt_limit_deg
        if filled.tilt_deg > limit:
            reason = f"no tilt up to {limit:.0f}° fits"
            return replace(filled, state=SlopeState.NO_INTERSECTION, reason=reason)
        state = SlopeState.FLAT if slope.region.vertical else SlopeState.OK
        reason = f"flat within {filled.tilt_high_deg:.1f}°" if slope.region.vertical else ""
        if doubt := next(self._doubts(filled, slope, index), ""):
            state, reason = SlopeState.WIDE, doubt
        return replace(
            filled,
            state=state,
            reason="; ".join(filter(None, (reason, self._drying(index), _leaning(slope.away)))),
        )

    def _drying(self, index: int) -> str:
        """Loss of a bed that dries, in words; "" for one that does not."""
        if self._learner is None:
            return ""
        flux, sd = readout.drying_w_m2(self._moments, self._place(index), self._learner.last.hours)
        dries, half = flux < -DRIES_SDS * sd, interval_sds(self._settings.confidence) * sd
        return f"it dries: {-flux:.0f} ± {half:.0f} W/m² more than the others at first" if dries else ""

    def _doubts(self, filled: SlopeEstimate, slope: readout.KnownSlope, index: int) -> Iterator[str]:
        """Why a slope that fits is not known well enough for the purpose; nothing if it is."""
        low, high, half = filled.tilt_low_deg, filled.tilt_high_deg, filled.tilt_half_width_deg
        limit, sure = self._settings.tilt_limit_deg, percent(filled.confidence)
        if slope.region.tilt_high_deg >= limit:
            yield f"anything from {low:.1f}° up to the limit of {limit:g}° fits ({sure})"
        if self._unusual:
            yield self._unusual
        # before the width: a statement that the minutes contradict is the cause, and advice would not help
        if self._learner and (unlike := readout.unlikeness(self._learner)) > MOST_UNLIKE:
            stated = ", against surface.same" if self._settings.same else ""
            yield f"the beds differ {unlike:.1f} times as much as usual{stated}: are they alike?"
        if is_too_wide(filled.tilt_deg, half, self._settings.target_half_width_deg):
            azimuth = {"a known azimuth": slope.along_half_width_deg / half}
            shares = azimuth | self._narrowing(index)
            measure = min(shares, key=shares.__getitem__)
            narrowed = f"; {measure} would narrow ±{half:.1f}° to ±{half * shares[measure]:.1f}°"
            hint = narrowed if shares[measure] <= 1.0 - LEAST_GAIN else ""
            yield f"anything from {low:.1f}° to {high:.1f}° fits ({sure}){hint}"
        prior_sd_deg = math.degrees(self._layout.unlike_of(self._place(index)).normal_horizontal_sd)
        if half > MOST_OF_PRIOR * interval_sds(filled.confidence) * prior_sd_deg:
            yield "the data narrow the prior by less than half"
        if (misfit := self._misfit(index)) > WELL_FITTING:
            yield f"the model fits badly (misfit {misfit:.1f}, at most {WELL_FITTING:g} for a certain slope)"
        if slope.away > filled.confidence:
            yield "no slope towards the known azimuth fits well"

    def _contradiction(self, learner: Learner, index: int) -> str:
        """Why no slope of a target explains the minutes; "" if one does."""
        worst, most = self._misfit(index), readout.MOST_MISFIT
        if worst <= most:
            return ""
        question = readout.cause(learner.minutes, self._surprise(learner))
        return f"no slope explains the minutes (misfit {worst:.1f}, at most {most:g}): {question}"

    def _misfit(self, index: int) -> float:
        # the reference's errors too: every slope rests on it
        return float(self._errors.misfit[[0, self._layout.region(self._place(index))]].max())

    def _unusual_in(self, learner: Learner) -> str:
        """The learnt parameter or statement that nothing usual explains, in words; "" if there is none."""
        columns = self._layout.columns[: len(self._references)]
        sds = max(statement_sds(learner, reference) for reference in range(len(columns)))
        if sds > readout.SURPRISING_SDS:
            references = [self._columns.regions[column] for column in columns]
            tilts = (f"{region.name} {np.nan_to_num(region.tilt_deg):g}°" for region in references)
            stated = f"the stated {' and '.join(tilts)} ({sds:.1f} deviations)"
            return f"the minutes contradict {stated}: is each as steep as that?"
        unusual = self._surprise(learner)
        return f"{unusual}: {readout.cause(learner.minutes, unusual)}" if unusual else ""

    def _surprise(self, learner: Learner) -> readout.Surprise | None:
        sds = prior_sds(self._settings, learner.logged_inputs)
        return readout.surprise(self._moments, self._settings, sds)

    def narrowing(self) -> Iterator[tuple[str, dict[str, float]]]:
        """Name of each target that holds, and the share of its half-width that each measure would leave."""
        for index in self._holding():
            yield self._columns.regions[self._targets[index]].name, self._narrowing(index)

    def _narrowing(self, index: int) -> dict[str, float]:
        if self._learner is None:
            return {}
        names = {self._place(i): self._columns.regions[c].name for i, c in enumerate(self._targets)}
        offers = measures(self._settings, self._learner.logged_inputs, names)
        return narrowing(self._moments, f"tilt{self._place(index)}", offers)

    def budgets(self) -> Iterator[tuple[str, tuple[BudgetTerm, ...]]]:
        """Name and uncertainty budget of each target that holds; none before the first minute."""
        if self._learner is not None:
            for index in self._holding():
                name = self._columns.regions[self._targets[index]].name
                yield name, slope_budget(self._learner, self._moments, self._place(index))

    def reference_checks(self) -> Iterator[ReferenceCheck]:
        """The slope of each reference as the other regions show it; none with a single one."""
        if self._learner is None or not self._layout.stated:
            return
        for reference, column in enumerate(self._layout.columns[: len(self._references)]):
            slope, stated = unstated_slope(self._learner, reference), self._columns.regions[column]
            holds = statement_sds(self._learner, reference) <= readout.SURPRISING_SDS
            tilt_deg, bounds = float(tilt_azimuth(slope.best)[0]), slope.region
            ends = min(bounds.tilt_low_deg, tilt_deg), max(bounds.tilt_high_deg, tilt_deg)
            yield ReferenceCheck(stated.name, float(np.nan_to_num(stated.tilt_deg)), tilt_deg, *ends, holds)

    def learnt(self) -> Learnt | None:
        """Parameters and prediction errors by now; None before the first minute."""
        if (learner := self._learner) is None:
            return None
        names = [self._columns.regions[column].name for column in self._layout.columns]
        return Learnt(
            readout.learnt_parameters(learner, self._moments),
            dict(zip(names, self._errors.rms_k.tolist(), strict=True)),
            dict(zip(names, self._errors.autocorrelation.tolist(), strict=True)),
            self._errors.chi_square(),
        )


def _kelvin_per_degree(learner: Learner, target: int, tilt_deg: float, azimuth_deg: float) -> float:
    """Change of a target's temperature per degree of tilt in balance, NaN without sun."""
    minute, posterior = learner.last, learner.posterior
    weights = posterior.weights
    unlike = learner.layout.unlike_of(target)
    light = float(weights @ posterior.normals.mode.gain) * minute.direct * unlike.light
    if light <= 0.0 or minute.sun[2] <= 0.0:
        return math.nan
    grey = learner.settings.surface.emissivity_broadband
    kelvin = float(minute.temperature_k.mean())
    exchange = float(weights @ posterior.filters.exchange) * unlike.exchange
    # a kelvin more loses so much, and a degree of tilt takes in so much more light
    loss = exchange + 4.0 * grey * STEFAN_BOLTZMANN * kelvin**3
    return kelvin_per_degree(tilt_deg, azimuth_deg, minute.sun, loss / light)


def _leaning(away: float) -> str:
    """The probability of what a known azimuth excludes, in words; "" for one that is small."""
    question = ": is the azimuth right?" if away > 0.5 else ""
    return f"{away:.0%} probability of leaning the other way{question}" if away >= readout.LEAST_SHARE else ""


def _missing(history: History, layout: Layout, region: Region) -> str:
    """Reason why the chain has not begun."""
    if not np.isfinite(history.temperature_k[:, layout.columns[0]]).any():
        return "no temperatures of the reference yet"
    if not np.isfinite(history.temperature_k[:, layout.columns]).all(axis=1).any():
        return "no minute yet with temperatures of all regions"
    return "no irradiance yet"
