"""Plan a measuring day: what a session will determine, when, and what would narrow it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, date, datetime, time, timedelta
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fieldkit.config import FILE_NAME, Config, config_from_text
from fieldkit.estimation.day_plan import WINDOW_MIN, DayPlan, PlanSettings, label, plan_day
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.arrays import FloatArray, IntArray
from fieldkit.model.channels import components_named, is_air_temperature
from fieldkit.model.clock import as_day, utc_ns
from fieldkit.model.door import checked
from fieldkit.model.errors import ConfigError, NoAnswerError
from fieldkit.model.next_step import Argument
from fieldkit.model.site import RegionKind, Site, as_site
from fieldkit.model.units import CELSIUS_ZERO_K, DAY_S, HOUR_NS, MINUTE_NS, SECOND_NS
from fieldkit.physics.bodies import EARTH, body_of
from fieldkit.physics.constants import STEFAN_BOLTZMANN
from fieldkit.physics.daylight import clear_day
from fieldkit.physics.facet import tilt_azimuth
from fieldkit.physics.horizon import MINUTE_EDGE_DEG, sunlit_share
from fieldkit.physics.sun import solar_time_h, sun_vectors
from fieldkit.recording.planned_session import (
    AIR,
    DIFFUSE,
    LEVEL,
    LONGWAVE,
    PlannedSession,
    Prediction,
    predict_session,
)
from fieldkit.results.result_files import writing
from fieldkit.results.sun_angles import checked_facets
from fieldkit.simulation.sky import ClearSky
from fieldkit.views import formatting, html, plan_page, plots

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes


@checked
@dataclass(frozen=True)
class PlanOptions:
    """Assumptions of a plan: a constant `dni_w_m2`, or a clear sky of Linke `turbidity`.

    Elsewhere than on the Earth light and air are those of the body's clear season instead.
    `noise_k` is that of a region's minute mean, by default the estimator's; `air_c` the air temperature
    expected, `step_min` the time between rows. Raises `ConfigError` for numbers that are not finite, or, but
    for the air, not above 0.

    Examples
    --------
    >>> options = fieldkit.PlanOptions(turbidity=3.0, noise_k=0.05)
    >>> options.irradiance
    'clear sky, Linke turbidity 3'
    >>> fieldkit.plan((37.70, -105.92, 2317.0), "2016-01-01", options=options).options.noise_k
    0.05
    """

    dni_w_m2: float = 800.0
    turbidity: float | None = None
    noise_k: float | None = None
    air_c: float = 15.0
    step_min: int = 30

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if value is not None and not (isfinite(value) and (value > 0.0 or name == "air_c")):
                raise ConfigError(
                    f"{value} cannot be planned with",
                    place=Argument(name),
                    fix="give a finite number, above 0 but for the air",
                )

    @property
    def irradiance(self) -> str:
        """The assumed irradiance in words."""
        if self.turbidity:
            return f"clear sky, Linke turbidity {self.turbidity:g}"
        return f"S {self.dni_w_m2:g} W/m² assumed"


DEFAULTS = PlanOptions()
SESSION_MIN = 180


@dataclass(frozen=True)
class MeasuringPlan:
    """The plan of one local day at a site; `day_plan` has its arrays."""

    site: Site
    day: date
    options: PlanOptions
    day_plan: DayPlan
    estimator: EstimatorSettings = field(default_factory=EstimatorSettings)

    @property
    def irradiance(self) -> str:
        """The assumed irradiance in words."""
        body = body_of(self.site)
        return self.options.irradiance if body is EARTH else f"clear season of {body.name.title()}"

    @property
    def warnings(self) -> list[str]:
        """Warnings for that day."""
        return plan_page.warnings(self.day_plan, self.site)

    @property
    def rows(self) -> list[dict[str, Any]]:
        """One row for each planned time, with one entry for each facet."""
        return [_row(self.day_plan, index, self.site) for index in range(self.day_plan.rows.size)]

    @property
    def document(self) -> dict[str, Any]:
        """The plan as ``fieldkit plan --json`` prints it."""
        plan, best = self.day_plan, self.day_plan.best_minute()
        return {
            "site": asdict(self.site),
            "day": str(self.day),
            "irradiance": self.irradiance,
            "noise_k": self.estimator.noise_k,
            "best_time": None if best is None else _iso(int(plan.time_ns[best]), self.site),
            "bias_budget": [
                {
                    "tilt_deg": tilt,
                    "azimuth_deg": azimuth,
                    "for_deg": plan.settings.bias_deg,
                    "kelvin": kelvin,
                }
                for (tilt, azimuth), kelvin in zip(plan.facets, plan.bias_budget_k(), strict=True)
            ],
            "warnings": self.warnings,
            "rows": self.rows,
        }

    def __repr__(self) -> str:
        return f"<MeasuringPlan of {self.day}: {'; '.join(self.warnings) or 'no warnings'}>"

    def _repr_html_(self) -> str:
        columns, rows = plan_page.COLUMNS, plan_page.rows(self.day_plan, self.site)
        return html.table_html(html.Table(columns, rows, f"Plan for {self.day}"))

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot what one degree of tilt is worth in kelvin over the day, a line for each facet."""
        plan = self.day_plan
        values = dict(zip(map(label, plan.facets), plan.sensitivity.temperature_k, strict=True))
        up = {name: np.where(plan.usable, kelvin, np.nan) for name, kelvin in values.items()}
        return plots.lines(plan.time_ns, up, "K per ° of tilt", self.site, ax)

    def table(self) -> pd.DataFrame:
        """The plan as `to_frame` gives it, by time and facet."""
        return self.to_frame().set_index(["time", "tilt_deg", "azimuth_deg"])

    def to_frame(self) -> pd.DataFrame:
        """A row for each time and facet, as a pandas frame; needs ``fieldkit-slope[lab]``."""
        import pandas as pd

        rows = [{**row, **facet} for row in self.rows for facet in row["facets"]]
        return pd.DataFrame(rows).drop(columns="facets")

    def session(
        self,
        minutes: int = SESSION_MIN,
        *,
        at: time | None = None,
        logged: Iterable[str] = (),
        references: Sequence[tuple[float, float]] = (LEVEL,),
    ) -> PlannedSession:
        """A session of that day, for `prediction`.

        Parameters
        ----------
        minutes
            Length. [min]
        at
            Start on the site's clocks; by default the middle is the best time of the day.
        logged
            What is measured beside light and frames: any of ``"air"``, ``"diffuse"``, ``"longwave"``.
        references
            Tilt and azimuth of each reference; by default one is level. [degrees]

        Raises
        ------
        NoAnswerError
            If no start is given, and no hour of the day is usable.
        """
        options = self.options
        sky = ClearSky(air_temperature_k=options.air_c + CELSIUS_ZERO_K)
        return PlannedSession(
            site=self.site,
            facets=self.day_plan.facets,
            start_ns=self._start_ns(minutes, at),
            minutes=minutes,
            sky=replace(sky, linke_turbidity=options.turbidity) if options.turbidity else sky,
            settings=replace(self.estimator, model="learned"),
            logged=frozenset(logged),
            references=tuple(references),
        )

    def _start_ns(self, minutes: int, at: time | None) -> int:
        if at is not None:
            return utc_ns(datetime.combine(self.day, at, formatting.zone(self.site)))
        best = self.day_plan.best_minute(minutes) or self.day_plan.best_minute()
        if best is None:
            raise NoAnswerError(
                f"no {WINDOW_MIN} min are usable",
                place=f"{self.day}",
                fix="choose a day on which the sun is higher",
            )
        return int(self.day_plan.time_ns[best]) - minutes // 2 * MINUTE_NS

    def prediction(self, session: PlannedSession | None = None) -> Prediction:
        """Half-widths after half an hour, an hour and at the end, and what each measure leaves of them.

        Simulates the session and estimates it with the learned model, about four seconds of one processor for
        three hours of three targets, and nothing the next time. The measures follow from what is known at the
        end.

        Parameters
        ----------
        session
            From `session`; by default three hours around the best time of the day.

        Raises
        ------
        NoAnswerError
            If no session is given, and no hour of the day is usable.
        """
        return predict_session(session or self.session())

    def write(self, path: str | Path, prediction: Prediction | None = None) -> Path:
        """Write the plan as a page to print, led by the session if predicted; raises `StorageError`."""
        path = Path(path)
        session = (
            plan_page.Session(prediction.summary, prediction.table, prediction.course) if prediction else None
        )
        content = plan_page.page(self.day_plan, self.site, f"Plan for {self.day}", self.irradiance, session)
        with writing(path):
            path.write_text(content, encoding="utf-8")
        return path


PAPER_TILTS_DEG = (5.0, 15.0, 25.0)
"""The paper's sand slopes."""


def plan(
    site: Site | Sequence[float],
    day: date | str | None = None,
    facets: Sequence[tuple[float, float]] | None = None,
    options: PlanOptions = DEFAULTS,
    *,
    estimator: EstimatorSettings | None = None,
) -> MeasuringPlan:
    """Plan a measuring day: sun and kelvin per degree over the hours; `prediction` predicts a session.

    Parameters
    ----------
    site
        Where, or its latitude, longitude and elevation [degrees, m]; its zone sets the day and is shown.
    day
        Which local day, such as ``"2026-12-11"``; by default the next one.
    facets
        Tilt from horizontal and azimuth from north of each region [degrees]; by default the paper's
        slopes of 5, 15 and 25 degrees, facing the equator.
    options
        What is assumed of irradiance, noise and air.
    estimator
        Settings that will be estimated with: surface parameters, the site's horizon, and whether azimuths are
        known.

    Returns
    -------
    MeasuringPlan
        With `prediction`, `to_frame` and `write`.

    Raises
    ------
    ConfigError
        If the site or the day is not a valid one; as `fieldkit.results.sun_angles.checked_facets`.
    NoAnswerError
        If the sun does not rise.

    Examples
    --------
    >>> day = fieldkit.plan((37.70, -105.92, 2317.0), "2016-01-01", [(15.0, 180.0)])
    >>> day
    <MeasuringPlan of 2016-01-01: no warnings>
    >>> day.to_frame()[["sun_zenith_deg", "kelvin_per_degree"]].loc[10].round(2).tolist()
    [60.93, 0.33]
    """
    site = as_site(site)
    tomorrow = datetime.now(formatting.zone(site)).date() + timedelta(days=1)
    day = tomorrow if day is None else as_day(day)
    if facets is None:
        equator = 180.0 if site.latitude_deg >= 0.0 else 0.0
        facets = [(tilt, equator) for tilt in PAPER_TILTS_DEG]
    facets = checked_facets(facets)
    time_ns = np.arange(*_ends_ns(site, day), MINUTE_NS, dtype=np.int64)
    settings = _settings(site, options)
    if estimator is not None:
        settings = replace(settings, surface=estimator.surface, tilt_limit_deg=estimator.tilt_limit_deg)
    estimator = estimator or _default_settings(site)
    sun = sun_vectors(time_ns, site)
    is_sunlit = sunlit_share(estimator.horizon, sun, MINUTE_EDGE_DEG) == 1.0
    light = np.where(is_sunlit, _dni(sun, time_ns, site, options), 0.0)
    day_plan = plan_day(facets, time_ns, sun, light, settings, options.step_min)
    if not day_plan.rows.size:
        raise NoAnswerError(
            "the sun does not rise at this site", place=f"{day}", fix="choose a day on which the sun rises"
        )
    estimator = replace(estimator, noise_k=options.noise_k or estimator.noise_k)
    return MeasuringPlan(site, day, options, day_plan, estimator)


def _default_settings(site: Site) -> EstimatorSettings:
    """Those of dry sand on the Earth; elsewhere those of a campaign there."""
    if body_of(site) is EARTH:
        return EstimatorSettings()
    place = f"latitude_deg = {site.latitude_deg}\nlongitude_deg = {site.longitude_deg}"
    text = f'schema = 1\n[site]\n{place}\nbody = "{site.body}"\n'
    return config_from_text(text, Path(FILE_NAME)).estimator_settings()


def target_facets(config: Config) -> tuple[tuple[float, float], ...]:
    """Tilt and azimuth of a campaign's targets where both are known; raises `ConfigError` without any."""
    known = tuple(
        (region.tilt_deg, region.azimuth_deg)
        for region in config.regions
        if region.kind is RegionKind.TARGET and isfinite(region.tilt_deg) and isfinite(region.azimuth_deg)
    )
    if not known:
        raise ConfigError(
            "no target has a tilt and an azimuth to plan for", place=config.path, fix=Argument("facets")
        )
    return known


def regions_without_slope(config: Config) -> list[str]:
    """Names of the targets that cannot be planned for."""
    targets = (region for region in config.regions if region.kind is RegionKind.TARGET)
    return [region.name for region in targets if not isfinite(region.tilt_deg + region.azimuth_deg)]


def reference_facets(config: Config) -> tuple[tuple[float, float], ...]:
    """Tilt and azimuth of a campaign's references, level if it has none."""
    references = [region for region in config.regions if region.kind is RegionKind.REFERENCE]
    return tuple((reference.tilt_deg, reference.azimuth_deg) for reference in references) or (LEVEL,)


def logged_quantities(config: Config) -> frozenset[str]:
    """Quantities measured beside light and frames, by their labels and the keys."""
    labels = [str(label) for device in config.devices for label in device.options.get("labels", ())]
    components = {*components_named(labels), *config.tables.irradiance.measures.values()}
    is_logged_by_name = {AIR: any(map(is_air_temperature, labels))}
    is_logged_by_name |= {DIFFUSE: "dhi" in components, LONGWAVE: "longwave_down" in components}
    return frozenset(word for word, is_logged in is_logged_by_name.items() if is_logged)


def _ends_ns(site: Site, day: date) -> tuple[int, int]:
    """A day of the site's zone, moved by whole hours to have the sun's noon in its middle.

    So that no night is cut in two where clocks are of another place, or the sun sets after midnight.
    Elsewhere it is the first solar day from then on, of the Moon two days of the Earth.
    """
    body = body_of(site)
    if body is not EARTH:
        begin_ns = utc_ns(datetime(day.year, day.month, day.day, tzinfo=UTC))
        if body.day_s < 2 * DAY_S:
            begin_ns += round(float((-solar_time_h(begin_ns, site)) % 24.0) / 24.0 * body.day_s) * SECOND_NS
        return begin_ns, begin_ns + round(min(body.day_s, 2 * DAY_S)) * SECOND_NS
    start = datetime(day.year, day.month, day.day, tzinfo=formatting.zone(site))
    ahead_h = (start.utcoffset() or timedelta()) / timedelta(hours=1) - site.longitude_deg / 15.0
    moved_ns = round((ahead_h + 12.0) % 24.0 - 12.0) * HOUR_NS
    return utc_ns(start) + moved_ns, utc_ns(start) + moved_ns + DAY_S * SECOND_NS


def _dni(sun: FloatArray, time_ns: IntArray, site: Site, options: PlanOptions) -> FloatArray:
    if options.turbidity or body_of(site) is not EARTH:
        return clear_day(sun[:, 2], time_ns, site, turbidity=options.turbidity or np.nan)[0]
    return np.full(len(sun), options.dni_w_m2)


def _settings(site: Site, options: PlanOptions) -> PlanSettings:
    """The air expected and the paper's surface on the Earth; elsewhere air, sky and ground of the body."""
    body, air_k = body_of(site), options.air_c + CELSIUS_ZERO_K
    settings = PlanSettings(air_k=air_k)
    if body is EARTH:
        return settings
    air_k = body.air_temperature_k
    emissivity = body.longwave_down_w_m2 / (STEFAN_BOLTZMANN * air_k**4)
    return replace(
        settings, air_k=air_k, sky_emissivity=emissivity, rising_deg=body.rising_deg, surface=body.surface
    )


def _row(plan: DayPlan, index: int, site: Site) -> dict[str, Any]:
    minute = int(plan.rows[index])
    zenith, azimuth = (float(angle) for angle in tilt_azimuth(plan.sun[minute]))
    return {
        "time": _iso(int(plan.time_ns[minute]), site),
        "sun_zenith_deg": zenith,
        "sun_azimuth_deg": azimuth,
        "direct_normal_w_m2": plan.dni_w_m2[minute],
        "verdict": plan.verdict(index),
        "facets": [
            {
                "tilt_deg": tilt,
                "azimuth_deg": turn,
                "w_m2_per_degree": plan.sensitivity.irradiance_w_m2[place, minute],
                "kelvin_per_degree": plan.sensitivity.temperature_k[place, minute],
                "weak": bool(plan.weak[place, minute]),
            }
            for place, (tilt, turn) in enumerate(plan.facets)
        ],
    }


def _iso(time_ns: int, site: Site) -> str:
    return formatting.local_time(time_ns, site).isoformat()
