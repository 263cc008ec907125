"""Prediction of a session: planned minutes of a simulated field, estimated with the learned model.

The field is what the settings expect: their sand, surface and exchange, a clear sky by formula, gusts and the
camera's noise of a fixed seed. What is not measured is unknown to the model, as it would be. The half widths
are those that a session like it would report by then, as planned and with each measure that narrows them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from fieldkit.estimation.bins import History
from fieldkit.estimation.chain import DEPTH_MEASURED_SD, LONGWAVE_MEASURED_SD_W_M2, SlopeChain
from fieldkit.estimation.day_plan import label
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.arrays import FloatArray, IntArray
from fieldkit.model.confidence import percent
from fieldkit.model.errors import FieldkitError
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.model.slope import SlopeEstimate, SlopeState, is_too_wide
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.bodies import body_of
from fieldkit.physics.irradiance import direct_normal, shares_on_plane
from fieldkit.recording.predict import expected_field, field_history
from fieldkit.results.executors import results
from fieldkit.simulation.boards import Board, boards_in_turn
from fieldkit.simulation.gusts import Gusts, GustySky
from fieldkit.simulation.scene_series import Exchange, SceneModel
from fieldkit.simulation.sky import ClearSky
from fieldkit.views import formatting, html

if TYPE_CHECKING:
    import pandas as pd

LEAD_MIN = 180
"""Time before the session at which the sand begins to store heat."""
PER_WIND = 1.8
"""Exchange per m/s of wind on measured ground, W m-2 K-1: with the default gusts about the prior's median."""
LEAST_STILL = 0.5
"""Least share of the exchange that does not depend on the wind."""
UNDISTURBED_MIN, BOARD_MIN, BETWEEN_BOARDS_MIN = 10, 5, 15
AFTER_SUNSET_MIN = 60
EVERY_MIN = 30
"""Time between two predictions as the session goes on."""
SEED = 1
NO_OUTLINE = ((0.0, 0.0),)
LEVEL: tuple[float, float] = (0.0, 0.0)
AS_PLANNED = "as planned"
AIR, DIFFUSE, LONGWAVE = "air", "diffuse", "longwave"
OFFSET_SD_K = 0.05
"""What a calibration of uniformity leaves of the offsets."""


@dataclass(frozen=True, slots=True)
class PlannedSession:
    """A session to predict: where, which slopes, from when and how long.

    `facets` and `references` are tilt and azimuth of each region [degrees], `logged` what is measured beside
    light and frames: any of ``air``, ``diffuse``, ``longwave``. `sunset_ns` is the end of the last minute
    with sun, None where it does not set. [UTC ns], [min]
    """

    site: Site
    facets: tuple[tuple[float, float], ...]
    start_ns: int
    minutes: int
    sky: ClearSky
    settings: EstimatorSettings
    sunset_ns: int | None = None
    logged: frozenset[str] = frozenset()
    references: tuple[tuple[float, float], ...] = (LEVEL,)


@dataclass(frozen=True, slots=True)
class Experiment:
    """Half of the likelihood region of each target's tilt after `minutes` of a session, by `name`.

    NaN for the target that is known and for one of `not_resolved`, which two slopes fit. [degrees]
    """

    name: str
    minutes: int
    half_region_deg: tuple[float, ...]
    known: tuple[bool, ...]
    not_resolved: tuple[bool, ...]


@dataclass(frozen=True)
class Experiments:
    """Predictions: as planned by the half hour, then each measure at the end; `to_frame` is the table."""

    session: PlannedSession
    outcomes: tuple[Experiment, ...]

    def __getitem__(self, name: str) -> Experiment:
        by_name = {outcome.name: outcome for outcome in self.outcomes}
        try:
            return by_name[name]
        except KeyError:
            raise KeyError(f"no experiment {name!r}; there are {', '.join(by_name)}") from None

    @property
    def document(self) -> dict[str, Any]:
        """The session and its predictions as ``fieldkit plan --json`` prints them."""
        session = self.session
        return {
            "session": {
                "start": formatting.local_time(session.start_ns, session.site).isoformat(),
                "minutes": session.minutes,
                "confidence": session.settings.confidence,
                "linke_turbidity": session.sky.linke_turbidity,
                "logged": sorted(session.logged),
            },
            "experiments": [
                {**asdict(outcome), "verdict": self.verdict(outcome)} for outcome in self.outcomes
            ],
        }

    @property
    def table(self) -> html.Table:
        """The predictions for people, a column for each target."""
        rows = [
            (outcome.name, f"{outcome.minutes} min", *_cells(outcome), self.verdict(outcome))
            for outcome in self.outcomes
        ]
        columns = ("session", "after", *map(label, self.session.facets), "verdict")
        return html.Table(columns, rows, self._caption)

    @property
    def _caption(self) -> str:
        session = self.session
        measured = [word for word in (AIR, DIFFUSE, LONGWAVE) if word in session.logged]
        sure, turbidity = percent(session.settings.confidence), session.sky.linke_turbidity
        air = f" of Linke turbidity {turbidity:g}" if body_of(session.site).has_air_of_earth else ""
        return (
            f"Half of the {sure} region of each tilt on a simulated clear day{air}; measured beside frames "
            f"and light: {', '.join(measured) or 'nothing'}."
        )

    @property
    def summary(self) -> list[str]:
        """The end of the session as planned, and the measure that narrows the widest region most."""
        planned, site = self[AS_PLANNED], self.session.site
        ends = (self.session.start_ns, self.session.start_ns + planned.minutes * MINUTE_NS)
        between = "–".join(formatting.clock_time(end, site) for end in ends)
        lines = [
            f"after {planned.minutes} min ({between}) tilt {'  '.join(_cells(planned))} "
            f"({percent(self.session.settings.confidence)}): {self.verdict(planned)}"
        ]
        others = [outcome for outcome in self.outcomes if outcome.name != AS_PLANNED]
        if others:
            best = min(others, key=lambda outcome: _narrowing(outcome, planned))
            lines.append(f"narrowed most {best.name} ({best.minutes} min): {'  '.join(_cells(best))}")
        return lines

    @property
    def course(self) -> tuple[IntArray, FloatArray]:
        """Times (m,) of the session as planned and half widths then (m, targets), UTC ns and degrees."""
        planned = [outcome for outcome in self.outcomes if outcome.name == AS_PLANNED]
        minutes = np.array([experiment.minutes for experiment in planned], np.int64)
        halves = np.array([experiment.half_region_deg for experiment in planned])
        return self.session.start_ns + minutes * MINUTE_NS, halves

    def verdict(self, experiment: Experiment) -> str:
        """``good``, or the targets that stay wide or that two slopes fit."""
        tilts = np.array([tilt for tilt, _ in self.session.facets])
        halves = np.array(experiment.half_region_deg)
        two, is_known = np.array(experiment.not_resolved), np.array(experiment.known)
        target_deg = self.session.settings.target_half_width_deg
        wide = is_too_wide(tilts, halves, target_deg) & ~two & ~is_known
        words = [
            f"{word} for {', '.join(label(self.session.facets[target]) for target in np.flatnonzero(chosen))}"
            for word, chosen in (("two slopes", two), ("wide", wide))
            if chosen.any()
        ]
        return "; ".join(words) or "good"

    def _repr_html_(self) -> str:
        return html.table_html(self.table)

    def to_frame(self) -> pd.DataFrame:
        """A row for each prediction and target, as a pandas frame; needs ``fieldkit-slope[lab]``."""
        import pandas as pd

        return pd.DataFrame(
            [
                {
                    "experiment": outcome.name,
                    "minutes": outcome.minutes,
                    "tilt_deg": tilt,
                    "azimuth_deg": azimuth,
                    "half_region_deg": half,
                    "known": known,
                }
                for outcome in self.outcomes
                for (tilt, azimuth), half, known in zip(
                    self.session.facets, outcome.half_region_deg, outcome.known, strict=True
                )
            ]
        )


def _cells(one: Experiment) -> list[str]:
    words = zip(one.half_region_deg, one.known, one.not_resolved, strict=True)
    return ["known" if known else "two slopes fit" if two else f"±{half:.1f}°" for half, known, two in words]


def _narrowing(one: Experiment, planned: Experiment) -> float:
    """Mean half width over that as planned, of the targets that have both; infinite where two slopes fit."""
    ratios = np.array(one.half_region_deg) / np.array(planned.half_region_deg)
    is_finite = np.isfinite(ratios)
    return float(ratios[is_finite].mean()) if is_finite.any() and not any(one.not_resolved) else np.inf


@dataclass(frozen=True, slots=True)
class Run:
    """A session to simulate, with names for what is known after so many minutes.

    `known` is the target that is a reference too, `shade_test` whether a board lies over each in turn.
    """

    session: PlannedSession
    marks: tuple[tuple[str, int], ...]
    shade_test: bool = False
    known: int | None = None


def as_planned(session: PlannedSession) -> Run:
    """The session by the half hour, and at its end."""
    halves = range(EVERY_MIN, session.minutes, EVERY_MIN)
    return Run(session, tuple((AS_PLANNED, minutes) for minutes in (*halves, session.minutes)))


def measures(session: PlannedSession) -> Iterator[Run]:
    """The same session with each measure that could narrow its regions, and continued into the evening."""
    end = session.minutes
    for name, changed in _better_known(session):
        yield Run(changed, ((f"with {name}", end),))
    yield Run(session, (("with a shade test of each target", end),), shade_test=True)
    if len(session.facets) > 1:
        steepest = max(range(len(session.facets)), key=lambda target: session.facets[target][0])
        yield Run(session, ((f"with {label(session.facets[steepest])} known", end),), known=steepest)
    if session.sunset_ns is not None and session.sunset_ns >= session.start_ns + end * MINUTE_NS:
        until = (session.sunset_ns - session.start_ns) // MINUTE_NS + AFTER_SUNSET_MIN
        yield Run(session, (("until an hour after sunset", until),))


def _better_known(session: PlannedSession) -> Iterator[tuple[str, PlannedSession]]:
    """Additions of instruments and calibrations to the knowledge of the settings."""
    settings, prior, logged = session.settings, session.settings.prior, session.logged
    if AIR not in logged:
        yield "air temperature logged", replace(session, logged=logged | {AIR})
    if DIFFUSE not in logged:
        yield "diffuse irradiance measured", replace(session, logged=logged | {DIFFUSE})
    if prior.longwave_sd_w_m2 > LONGWAVE_MEASURED_SD_W_M2:
        measured = replace(settings, prior=replace(prior, longwave_sd_w_m2=LONGWAVE_MEASURED_SD_W_M2))
        name = f"longwave measured, prior.longwave_sd_w_m2 = {LONGWAVE_MEASURED_SD_W_M2:g}"
        yield name, replace(session, logged=logged | {LONGWAVE}, settings=measured)
    if prior.depth_log_sd > DEPTH_MEASURED_SD:
        measured = replace(settings, prior=replace(prior, depth_log_sd=DEPTH_MEASURED_SD, deep_share=0.0))
        name = f"depth measured, prior.depth_log_sd = {DEPTH_MEASURED_SD:g}, prior.deep_share = 0"
        yield name, replace(session, settings=measured)
    if settings.offset_sd_k > OFFSET_SD_K:
        name = f"offsets calibrated, estimator.offset_sd_k = {OFFSET_SD_K:g}"
        yield name, replace(session, settings=replace(settings, offset_sd_k=OFFSET_SD_K))
    if settings.emissivity_sd > 0.0:
        name = "emissivity calibrated, surface.emissivity_sd = 0"
        yield name, replace(session, settings=replace(settings, emissivity_sd=0.0))


def predict_runs(
    runs: Sequence[Run], executor: Executor | None = None, on_run: Callable[[], None] | None = None
) -> tuple[Experiment, ...]:
    """The report of each session at its marks, in the order of the runs.

    Three hours of three targets take six seconds as planned, and three with each measure. `on_run` is called
    as each run is finished.
    Raises `FieldkitError` if worker processes are killed.
    """
    by_run: dict[int, tuple[Experiment, ...]] = {}
    pieces = ((index, partial(_outcomes, run)) for index, run in enumerate(runs))
    for index, outcomes in results(executor, pieces):
        if isinstance(outcomes, FieldkitError):
            raise outcomes
        by_run[index] = outcomes
        if on_run:
            on_run()
    return tuple(experiment for index in sorted(by_run) for experiment in by_run[index])


def _outcomes(run: Run) -> tuple[Experiment, ...]:
    """Half widths at the marks of a run."""
    session, regions = run.session, _regions(run.session, run.known)
    model = _model(session, _boards(session) if run.shade_test else ())
    history = _simulated_minutes(session, model, run.marks[-1][1])
    chain = SlopeChain(regions, session.settings)
    # a single mark needs no minute before
    slopes_at = chain.at if len(run.marks) > 1 else chain.at_once
    targets = [region.name for region in regions[len(session.references) :]]
    return tuple(
        _experiment_at(mark, targets, slopes_at(history.until(mark[1])).slopes) for mark in run.marks
    )


def _experiment_at(
    mark: tuple[str, int], targets: Sequence[str], slopes: Sequence[SlopeEstimate]
) -> Experiment:
    by_region: Mapping[str, SlopeEstimate] = {slope.region: slope for slope in slopes}
    estimates = [by_region.get(target) for target in targets]
    two = tuple(estimate is not None and estimate.state is SlopeState.NOT_RESOLVED for estimate in estimates)
    halves = tuple(
        float("nan") if estimate is None or twice else estimate.tilt_half_width_deg
        for estimate, twice in zip(estimates, two, strict=True)
    )
    return Experiment(*mark, halves, tuple(estimate is None for estimate in estimates), two)


def _regions(session: PlannedSession, known: int | None = None) -> tuple[Region, ...]:
    """References and targets; the target that is known is a reference too."""
    kinds = [RegionKind.REFERENCE] * len(session.references) + [RegionKind.TARGET] * len(session.facets)
    if known is not None:
        kinds[len(session.references) + known] = RegionKind.REFERENCE
    facets = (*session.references, *session.facets)
    return tuple(
        Region(f"region {number}", kind, NO_OUTLINE, tilt, azimuth)
        for number, (kind, (tilt, azimuth)) in enumerate(zip(kinds, facets, strict=True), start=1)
    )


def _model(session: PlannedSession, boards: tuple[Board, ...] = ()) -> SceneModel:
    """The field that the settings expect."""
    settings, facets = session.settings, (*session.references, *session.facets)
    whole, wind_m_s = settings.prior.exchange_w_m2_k, session.sky.wind_m_s
    # in thin air a lull would turn the exchange negative
    per_wind = min(PER_WIND, LEAST_STILL * whole / max(wind_m_s, 0.1))
    exchange = Exchange(whole - per_wind * wind_m_s, per_wind)
    return expected_field(
        session.site, GustySky(session.sky, Gusts(SEED)), facets, settings, exchange, boards
    )


def _boards(session: PlannedSession) -> tuple[Board, ...]:
    """Five minutes over each bed in turn; closer and shorter where the session has no room for that."""
    beds = len(session.facets)
    between = min(BETWEEN_BOARDS_MIN, max((session.minutes - UNDISTURBED_MIN) // beds, 2))
    lasts = min(BOARD_MIN, between // 2)
    names = [region.name for region in _regions(session)[len(session.references) :]]
    return boards_in_turn(names, LEAD_MIN + UNDISTURBED_MIN, between, lasts)


def _simulated_minutes(session: PlannedSession, model: SceneModel, minutes: int) -> History:
    """The session's minutes with the camera's noise, as far as instruments measure them."""
    begin_ns = session.start_ns - LEAD_MIN * MINUTE_NS
    history = field_history(model, begin_ns, LEAD_MIN + minutes).since(LEAD_MIN)
    noise_k = np.random.default_rng(SEED).standard_normal(history.temperature_k.shape)
    unknown, logged = np.full(len(history), np.nan), session.logged
    diffuse = history.dhi_w_m2 if DIFFUSE in logged else unknown
    return replace(
        history,
        temperature_k=history.temperature_k + session.settings.noise_k * noise_k,
        dni_w_m2=_direct_by_meter(history, diffuse, session.settings),
        dhi_w_m2=diffuse,
        longwave_down_w_m2=history.longwave_down_w_m2 if LONGWAVE in logged else unknown,
        air_k=history.air_k if AIR in logged else unknown,
    )


def _direct_by_meter(history: History, diffuse: FloatArray, settings: EstimatorSettings) -> FloatArray:
    """Direct irradiance as it follows from a light meter mounted as configured."""
    if settings.irradiance.is_direct:
        return history.dni_w_m2
    model = replace(settings.irradiance, kind="pyranometer")
    per_beam, per_sky = shares_on_plane(model, history.sun)
    reading = history.dni_w_m2 * per_beam + history.dhi_w_m2 * per_sky
    return direct_normal(model, reading, history.sun, history.time_ns, diffuse)
