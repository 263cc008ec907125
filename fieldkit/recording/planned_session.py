"""Prediction of a session: planned minutes of a simulated field, estimated with the learned model.

The field is what the settings expect: their sand, surface and exchange, a clear sky by formula, gusts and the
camera's noise of a fixed seed. What is not measured is unknown to the model, as it would be. The half-widths
are those that a session like it would report by then, and what each measure would leave of them at the end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fieldkit.estimation.bins import History
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.day_plan import label
from fieldkit.estimation.learned.learner import ROUND
from fieldkit.estimation.measures import LEAST_GAIN
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.arrays import FloatArray, IntArray
from fieldkit.model.confidence import percent
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.model.slope import SlopeEstimate, SlopeState, is_too_wide
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.bodies import body_of
from fieldkit.physics.irradiance import direct_normal, shares_on_plane
from fieldkit.recording.predict import expected_field, field_history
from fieldkit.results.cache import Cache, as_text, digest, of_text
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
MARKS_MIN = (30, 60)
"""Minutes after which half-widths are predicted, beside the end."""
SEED = 1
NO_OUTLINE = ((0.0, 0.0),)
LEVEL: tuple[float, float] = (0.0, 0.0)
AS_PLANNED = "as planned"
AIR, DIFFUSE, LONGWAVE = "air", "diffuse", "longwave"
ONE_DRAW = "of one simulated clear day: other gusts and noise give up to a third more or less"


@dataclass(frozen=True, slots=True)
class PlannedSession:
    """A session to predict: where, which slopes, from when and how long.

    `facets` and `references` are tilt and azimuth of each region [degrees], `logged` what is measured beside
    light and frames: any of ``air``, ``diffuse``, ``longwave``. [UTC ns], [min]
    """

    site: Site
    facets: tuple[tuple[float, float], ...]
    start_ns: int
    minutes: int
    sky: ClearSky
    settings: EstimatorSettings
    logged: frozenset[str] = frozenset()
    references: tuple[tuple[float, float], ...] = (LEVEL,)


@dataclass(frozen=True, slots=True)
class Expected:
    """Half of the likelihood region of each target's tilt after `minutes` of a session, by `name`.

    NaN where two slopes fit, and for a target that a measure hardly narrows. [degrees]
    """

    name: str
    minutes: int
    half_region_deg: tuple[float, ...]


@dataclass(frozen=True)
class Prediction:
    """Half-widths as planned by the time, and at the end with each measure; `to_frame` is the table."""

    session: PlannedSession
    rows: tuple[Expected, ...]

    @property
    def planned(self) -> tuple[Expected, ...]:
        """The session as planned, in order of time; after these rows come the measures, the best first."""
        return tuple(row for row in self.rows if row.name == AS_PLANNED)

    @property
    def document(self) -> dict[str, Any]:
        """The session and its prediction as ``fieldkit plan --json`` prints them."""
        session = self.session
        return {
            "session": {
                "start": formatting.local_time(session.start_ns, session.site).isoformat(),
                "minutes": session.minutes,
                "confidence": session.settings.confidence,
                "linke_turbidity": session.sky.linke_turbidity,
                "logged": sorted(session.logged),
            },
            "prediction": [asdict(row) for row in self.rows],
            "verdict": self.verdict(self.planned[-1]),
        }

    @property
    def table(self) -> html.Table:
        """The prediction for people, a column for each target."""
        rows = [(row.name, f"{row.minutes} min", *self._cells(row)) for row in self.rows]
        return html.Table(("session", "after", *map(label, self.session.facets)), rows, self._caption)

    @property
    def _caption(self) -> str:
        session = self.session
        measured = [word for word in (AIR, DIFFUSE, LONGWAVE) if word in session.logged]
        air = f" (Linke turbidity {session.sky.linke_turbidity:g})" * body_of(session.site).has_air_of_earth
        return (
            f"Half of the {percent(session.settings.confidence)} region of each tilt, {ONE_DRAW}{air}; "
            f"measured beside frames and light: {', '.join(measured) or 'nothing'}. Measures that narrow one "
            f"by {percent(LEAST_GAIN)} or more, with what they bring at least."
        )

    @property
    def summary(self) -> list[str]:
        """The end of the session as planned, and the measure that narrows its regions most."""
        planned, site = self.planned[-1], self.session.site
        ends = (self.session.start_ns, self.session.start_ns + planned.minutes * MINUTE_NS)
        between = "–".join(formatting.clock_time(end, site) for end in ends)
        sure = percent(self.session.settings.confidence)
        cells = "  ".join(self._cells(planned))
        lines = [f"after {planned.minutes} min ({between}) tilt {cells} ({sure}): {self.verdict(planned)}"]
        measures = self.rows[len(self.planned) :][:1]
        return lines + [f"narrowed most {best.name}: {'  '.join(self._cells(best))}" for best in measures]

    @property
    def course(self) -> tuple[IntArray, FloatArray]:
        """Times (m,) of the session as planned and half-widths then (m, targets), UTC ns and degrees."""
        minutes = np.array([row.minutes for row in self.planned], np.int64)
        halves = np.array([row.half_region_deg for row in self.planned])
        return self.session.start_ns + minutes * MINUTE_NS, halves

    def verdict(self, row: Expected) -> str:
        """``good``, or the targets that stay wide or that two slopes fit."""
        tilts, halves = np.array([tilt for tilt, _ in self.session.facets]), np.array(row.half_region_deg)
        two = np.isnan(halves)
        wide = is_too_wide(tilts, halves, self.session.settings.target_half_width_deg) & ~two
        words = [
            f"{word} for {', '.join(label(self.session.facets[target]) for target in np.flatnonzero(chosen))}"
            for word, chosen in (("two slopes", two), ("wide", wide))
            if chosen.any()
        ]
        return "; ".join(words) or "good"

    def _cells(self, row: Expected) -> list[str]:
        """Half-widths as planned, of a measure by how much less it leaves; ``–`` where it is hardly any."""
        if row.name == AS_PLANNED:
            return [_about(half) for half in row.half_region_deg]
        shares = np.divide(row.half_region_deg, self.planned[-1].half_region_deg)
        return ["–" if np.isnan(share) else f"−{percent(round(1.0 - share, 2))}" for share in shares]

    def _repr_html_(self) -> str:
        return html.table_html(self.table)

    def to_frame(self) -> pd.DataFrame:
        """A row for each prediction and target, as a pandas frame; needs ``fieldkit-slope[lab]``."""
        import pandas as pd

        columns = ("name", "minutes", "tilt_deg", "azimuth_deg", "half_region_deg")
        records = [
            (row.name, row.minutes, *facet, half)
            for row in self.rows
            for facet, half in zip(self.session.facets, row.half_region_deg, strict=True)
        ]
        return pd.DataFrame(records, columns=columns)


def _about(half_deg: float) -> str:
    """A half-width no finer than one draw determines it: ``≈2.5°``."""
    if np.isnan(half_deg):
        return "two slopes fit"
    step, digits = (1.0, 0) if half_deg >= 5.0 else (0.5, 1) if half_deg >= 1.0 else (0.1, 1)
    return f"≈{round(half_deg / step) * step:.{digits}f}°"


def predict_session(session: PlannedSession) -> Prediction:
    """Estimate the simulated minutes of a session after each of `MARKS_MIN` and at the end.

    Three hours of three targets take four seconds of one processor; the same again is found in the cache.
    """
    history, regions = _simulated_minutes(session), _regions(session)
    # by the minutes themselves: whatever simulates them otherwise asks for another estimate
    cache = Cache()
    key = digest(session.settings, regions, *(column.tobytes() for column in astuple(history)))
    if (entry := cache.load(key)) is not None:
        return Prediction(session, of_text(tuple[Expected, ...], entry["rows"]))
    rows = tuple(_estimated(session, regions, history))
    cache.store(key, {"rows": as_text(rows)})
    return Prediction(session, rows)


def _estimated(session: PlannedSession, regions: Sequence[Region], history: History) -> list[Expected]:
    """Half-widths as planned, and with each measure at the end."""
    rows, measures = [], []
    for minutes in sorted({*(mark for mark in MARKS_MIN if mark < session.minutes), session.minutes}):
        chain = SlopeChain(regions, session.settings)
        slopes = chain.at_once(history.until(minutes), ROUND).slopes
        rows.append(Expected(AS_PLANNED, minutes, tuple(map(_half_deg, slopes))))
    shares = [chain.narrowing().get(slope.region, {}) for slope in slopes]
    words = {measure for by_measure in shares for measure in by_measure}
    for measure in sorted(words, key=lambda measure: sum(of.get(measure, 1.0) for of in shares)):
        halves = zip(rows[-1].half_region_deg, shares, strict=True)
        left = tuple(half * of.get(measure, np.nan) for half, of in halves)
        measures.append(Expected(f"with {measure}", session.minutes, left))
    return [*rows, *measures]


def _half_deg(slope: SlopeEstimate) -> float:
    return np.nan if slope.state is SlopeState.NOT_RESOLVED else slope.tilt_half_width_deg


def _regions(session: PlannedSession) -> tuple[Region, ...]:
    """References, and targets by their slopes; several of one slope have a number."""
    facets = session.facets
    names = [label(facet) + f" ({n})" * (facets.count(facet) > 1) for n, facet in enumerate(facets, start=1)]
    references = (
        Region(f"reference {n}", RegionKind.REFERENCE, NO_OUTLINE, *slope)
        for n, slope in enumerate(session.references, start=1)
    )
    targets = (
        Region(name, RegionKind.TARGET, NO_OUTLINE, *slope) for name, slope in zip(names, facets, strict=True)
    )
    return (*references, *targets)


def _model(session: PlannedSession) -> SceneModel:
    """The field that the settings expect."""
    settings, facets = session.settings, (*session.references, *session.facets)
    whole, wind_m_s = settings.prior.exchange_w_m2_k, session.sky.wind_m_s
    # in thin air a lull would turn the exchange negative
    per_wind = min(PER_WIND, LEAST_STILL * whole / max(wind_m_s, 0.1))
    exchange = Exchange(whole - per_wind * wind_m_s, per_wind)
    return expected_field(session.site, GustySky(session.sky, Gusts(SEED)), facets, settings, exchange)


def _simulated_minutes(session: PlannedSession) -> History:
    """The session's minutes with the camera's noise, as far as instruments measure them."""
    begin_ns = session.start_ns - LEAD_MIN * MINUTE_NS
    history = field_history(_model(session), begin_ns, LEAD_MIN + session.minutes).since(LEAD_MIN)
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
