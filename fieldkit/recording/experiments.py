"""Prediction of experiments: planned sessions on a simulated field, estimated with the learned model.

The field is what the settings expect: their sand, surface and exchange, a clear sky by formula, gusts and the
camera's noise of a fixed seed. The half-widths are those that a session like it would report at its end.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fieldkit.estimation.bins import History
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.day_plan import label
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.confidence import percent
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.model.slope import SlopeEstimate, SlopeState
from fieldkit.model.units import MINUTE_NS
from fieldkit.recording.field_history import field_history
from fieldkit.simulation.boards import Board, boards_in_turn
from fieldkit.simulation.facets import Facet
from fieldkit.simulation.gusts import Gusts, GustySky
from fieldkit.simulation.scene_series import Exchange, SceneModel
from fieldkit.simulation.sky import ClearSky
from fieldkit.views import html

if TYPE_CHECKING:
    import pandas as pd

LEAD_MIN = 180
"""Time before the session at which the sand begins to store heat."""
PER_WIND = 1.8
"""Exchange per m/s of wind on measured ground, W m-2 K-1: with the default gusts about the prior's median."""
UNDISTURBED_MIN, BOARD_MIN, BETWEEN_BOARDS_MIN = 10, 5, 15
AFTER_SUNSET_MIN = 60
SEED = 1
NO_OUTLINE = ((0.0, 0.0),)


@dataclass(frozen=True, slots=True)
class PlannedSession:
    """A session that an experiment is compared with: where, which slopes, from when and how long.

    `sunset_ns` is the end of the last minute with sun, None where it does not set; `air_logged` whether an
    air temperature will be recorded. [UTC ns], [min]
    """

    site: Site
    facets: tuple[tuple[float, float], ...]
    start_ns: int
    minutes: int
    sky: ClearSky
    settings: EstimatorSettings
    sunset_ns: int | None = None
    air_logged: bool = False


@dataclass(frozen=True, slots=True)
class Experiment:
    """Half of the likelihood region of each bed's tilt at the end of a session of `minutes`, by `name`.

    NaN for the bed that is known and for one of `not_resolved`, which two slopes fit. [degrees]
    """

    name: str
    minutes: int
    half_region_deg: tuple[float, ...]
    known: tuple[bool, ...]
    not_resolved: tuple[bool, ...]


@dataclass(frozen=True)
class Experiments:
    """Predictions for each experiment, the session as planned first; `to_frame` is the table."""

    session: PlannedSession
    outcomes: tuple[Experiment, ...]

    def __getitem__(self, name: str) -> Experiment:
        found = {one.name: one for one in self.outcomes}
        try:
            return found[name]
        except KeyError:
            raise KeyError(f"no experiment {name!r}; there are {', '.join(found)}") from None

    @property
    def document(self) -> list[dict[str, Any]]:
        """The experiments as ``fieldkit plan --experiments --json`` prints them."""
        return [asdict(one) for one in self.outcomes]

    @property
    def table(self) -> html.Table:
        """The experiments for people, a column for each bed."""
        rows = [(one.name, f"{one.minutes} min", *_cells(one)) for one in self.outcomes]
        sure = percent(self.session.settings.confidence)
        caption = f"Half of the {sure} region of each tilt after the session, on a simulated clear day."
        return html.Table(("session", "length", *map(label, self.session.facets)), rows, caption)

    def _repr_html_(self) -> str:
        return html.table_html(self.table)

    def to_frame(self) -> pd.DataFrame:
        """A row for each experiment and bed, as a pandas frame; needs ``fieldkit[lab]``."""
        import pandas as pd

        return pd.DataFrame(
            [
                {
                    "experiment": one.name,
                    "minutes": one.minutes,
                    "tilt_deg": tilt,
                    "azimuth_deg": azimuth,
                    "half_region_deg": half,
                    "known": known,
                }
                for one in self.outcomes
                for (tilt, azimuth), half, known in zip(
                    self.session.facets, one.half_region_deg, one.known, strict=True
                )
            ]
        )


def _cells(one: Experiment) -> list[str]:
    words = zip(one.half_region_deg, one.known, one.not_resolved, strict=True)
    return ["known" if known else "two slopes fit" if two else f"±{half:.1f}°" for half, known, two in words]


def experiments(session: PlannedSession) -> Iterator[Experiment]:
    """Each experiment with a planned session, one after the other: a few seconds each.

    Parameters
    ----------
    session
        What is planned without any experiment.

    Yields
    ------
    Experiment
        The session as planned; a shade test of each bed; the steepest bed known; the air temperature logged,
        or not logged where it is planned; the same session continued until sunset and for an hour more.
    """
    regions, beds = _regions(session.facets), range(len(session.facets))
    history = _measured(session, _model(session), session.minutes)
    yield _outcome("as planned", history, regions, session)
    tested = _measured(session, _model(session, _boards(session)), session.minutes)
    yield _outcome("with a shade test of each bed", tested, regions, session)
    if len(beds) > 1:
        steepest = max(beds, key=lambda bed: session.facets[bed][0])
        name = f"with {label(session.facets[steepest])} known"
        yield _outcome(name, history, _with_known(regions, steepest), session)
    other = replace(session, air_logged=not session.air_logged)
    name = "with air temperature logged" if other.air_logged else "without air temperature"
    yield _outcome(name, _measured(other, _model(other), session.minutes), regions, other)
    yield from _evening(session, regions)


def _evening(session: PlannedSession, regions: tuple[Region, ...]) -> Iterator[Experiment]:
    """The session continued until sunset, and for an hour more."""
    if session.sunset_ns is None or session.sunset_ns < session.start_ns + session.minutes * MINUTE_NS:
        return
    until_sunset = (session.sunset_ns - session.start_ns) // MINUTE_NS
    history = _measured(session, _model(session), until_sunset + AFTER_SUNSET_MIN)
    chain = SlopeChain(regions, session.settings)
    for name, last in (("until sunset", until_sunset), ("until an hour after sunset", len(history))):
        yield _named(name, regions, last, chain.at(history.until(last)).slopes)


def _outcome(name: str, history: History, regions: tuple[Region, ...], session: PlannedSession) -> Experiment:
    slopes = SlopeChain(regions, session.settings).at(history).slopes
    return _named(name, regions, len(history), slopes)


def _named(
    name: str, regions: tuple[Region, ...], minutes: int, slopes: Sequence[SlopeEstimate]
) -> Experiment:
    by_region: Mapping[str, SlopeEstimate] = {one.region: one for one in slopes}
    found = [by_region.get(region.name) for region in regions[1:]]
    two = tuple(one is not None and one.state is SlopeState.NOT_RESOLVED for one in found)
    halves = tuple(
        float("nan") if one is None or twice else 0.5 * (one.tilt_high_deg - one.tilt_low_deg)
        for one, twice in zip(found, two, strict=True)
    )
    return Experiment(name, minutes, halves, tuple(one is None for one in found), two)


def _regions(facets: Sequence[tuple[float, float]]) -> tuple[Region, ...]:
    """A level reference and the beds."""
    beds = (
        Region(f"bed {number}", RegionKind.TARGET, NO_OUTLINE, tilt, azimuth)
        for number, (tilt, azimuth) in enumerate(facets, start=1)
    )
    return (Region("flat", RegionKind.REFERENCE, NO_OUTLINE, 0.0, 0.0), *beds)


def _with_known(regions: tuple[Region, ...], bed: int) -> tuple[Region, ...]:
    known = regions[1 + bed]
    return tuple(
        replace(region, kind=RegionKind.REFERENCE) if region is known else region for region in regions
    )


def _model(session: PlannedSession, boards: tuple[Board, ...] = ()) -> SceneModel:
    """The field that the settings expect."""
    settings = session.settings
    beds = tuple(_bed(region, settings) for region in _regions(session.facets))
    ground = replace(beds[0], albedo=settings.ground_albedo)
    exchange = Exchange(settings.prior.exchange_w_m2_k - PER_WIND * session.sky.wind_m_s, PER_WIND)
    sky = GustySky(session.sky, Gusts(SEED))
    circumsolar = settings.prior.circumsolar_share
    return SceneModel(
        session.site, sky, beds, ground, exchange, (), 1.0, circumsolar_share=circumsolar, boards=boards
    )


def _bed(region: Region, settings: EstimatorSettings) -> Facet:
    surface, slab = settings.surface, settings.slab
    return Facet(
        region.name,
        region.vertices,
        region.tilt_deg,
        region.azimuth_deg,
        albedo=surface.albedo,
        emissivity=surface.emissivity,
        emissivity_broadband=surface.emissivity_broadband,
        depth_m=slab.depth_m,
        conductivity_w_m_k=slab.conductivity_w_m_k,
        heat_capacity_j_m3_k=slab.heat_capacity_j_m3_k,
    )


def _boards(session: PlannedSession) -> tuple[Board, ...]:
    """Five minutes over each bed in turn; closer and shorter where the session has no room for that."""
    beds = len(session.facets)
    between = min(BETWEEN_BOARDS_MIN, max((session.minutes - UNDISTURBED_MIN) // beds, 2))
    lasts = min(BOARD_MIN, between // 2)
    names = [region.name for region in _regions(session.facets)[1:]]
    return boards_in_turn(names, LEAD_MIN + UNDISTURBED_MIN, between, lasts)


def _measured(session: PlannedSession, model: SceneModel, minutes: int) -> History:
    """The session's minutes with the camera's noise, and air temperature where it is logged."""
    begin_ns = session.start_ns - LEAD_MIN * MINUTE_NS
    history = field_history(model, begin_ns, LEAD_MIN + minutes).since(LEAD_MIN)
    noise_k = np.random.default_rng(SEED).standard_normal(history.temperature_k.shape)
    return replace(
        history,
        temperature_k=history.temperature_k + session.settings.noise_k * noise_k,
        air_k=history.air_k if session.air_logged else np.full(len(history), np.nan),
    )
