"""The simulated runs of the study: sky, starts and estimators, and their outcomes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, date, datetime, time
from typing import Any

import numpy as np

from fieldkit.model.arrays import FloatArray, IntArray
from fieldkit.model.clock import utc_ns
from fieldkit.model.errors import NoAnswerError
from fieldkit.model.site import Site
from fieldkit.model.units import CELSIUS_ZERO_K, MINUTE_NS
from fieldkit.physics.daylight import clear_day
from fieldkit.physics.sun import sun_vectors
from fieldkit.study.estimators import (
    Conditions,
    Method,
    Outcome,
    StudySettings,
    paper_slopes,
    random_slopes,
    run_study,
    summarise,
)
from fieldkit.views.formatting import zone
from fieldkit.weather import Weather

PAPER_SITE = Site(35.558675, 139.395232, 9.0, "Asia/Tokyo")
PAPER_DAY = date(2017, 8, 30)
PAPER_STARTS = (time(9), time(12), time(15))
PAPER_TURBIDITY = 4.16
"""Linke turbidity of the site's late August in the climatology that pvlib carries."""

POSTERIOR_SLOPES = 500  # one at a time, some milliseconds each


@dataclass(frozen=True)
class StudyOptions(StudySettings):
    """Options of the simulation and the estimates, those of a run among them; the defaults are the paper's.

    Windows begin at local `starts` and last `minutes`. Measured `weather` replaces the clear sky
    of Linke `turbidity`, longwave and air temperature; a constant `dni_w_m2` only the sky's beam.
    `slopes` random ones are drawn with `seed`, the paper's grid of slopes if None.
    """

    site: Site = PAPER_SITE
    day: date = PAPER_DAY
    starts: tuple[time, ...] = PAPER_STARTS
    minutes: int = 20
    dni_w_m2: float | None = None
    turbidity: float = PAPER_TURBIDITY
    weather: Weather | None = None
    longwave_w_m2: float = 400.0
    air_c: float = 30.0
    slopes: int | None = None
    estimators: tuple[Method, ...] = ("contours", "unit-norm")

    @classmethod
    def of(cls, *, weather: Weather | None = None, **given: Any) -> StudyOptions:
        """The paper's study with what is given; None and empty tuples stand for the paper's values."""
        study = cls(**{name: value for name, value in given.items() if value not in (None, ())})
        return study.under_weather(weather, given.get("day")) if weather else study

    def under_weather(self, weather: Weather, day: date | None = None) -> StudyOptions:
        """The same study at the site of measured weather, on its day unless one is given."""
        middle_ns = int(weather.time_ns[weather.time_ns.size // 2])
        day = day or datetime.fromtimestamp(middle_ns / 1e9, UTC).date()
        return replace(self, site=weather.site, day=day, weather=weather)

    @property
    def irradiance(self) -> str:
        """The source of the direct irradiance, in words."""
        if self.weather is not None:
            return f"measured: {self.weather.source}"
        if self.dni_w_m2:
            return f"constant {self.dni_w_m2:g} W/m²"
        return f"clear sky, Linke turbidity {self.turbidity:g}"


@dataclass(frozen=True)
class Run:
    """One start with one estimator."""

    start: time
    method: Method
    outcome: Outcome

    @property
    def begin(self) -> str:
        """Local start, ``09:00``."""
        return f"{self.start:%H:%M}"

    @property
    def key(self) -> dict[str, Any]:
        """The columns that name it in a table."""
        return {"start": self.begin, "estimator": self.method}


def conditions(options: StudyOptions, start: time) -> Conditions:
    """Sun and weather of the minutes from a local start on.

    Raises `NoAnswerError` with the sun down or no measured weather then.
    """
    local = datetime.combine(options.day, start, tzinfo=zone(options.site))
    times = utc_ns(local) + np.arange(options.minutes + 1, dtype=np.int64) * MINUTE_NS
    sun = sun_vectors(times, options.site)
    dni, longwave, air = _weather(options, times, sun)
    if not (np.all(sun[:, 2] > 0.0) and np.all(dni > 0.0)):
        raise NoAnswerError(
            "no direct sunlight all the time",
            place=f"from {local.isoformat()} on",
            fix="choose another day or start",
        )
    return Conditions(sun, dni, longwave, air)


def _weather(
    options: StudyOptions, times: IntArray, sun: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    if options.weather is not None:
        day = options.weather
        columns = (day.dni_w_m2, day.longwave_down_w_m2, day.air_temperature_k)
        dni, longwave, air = (np.interp(times, day.time_ns, values, np.nan, np.nan) for values in columns)
        return dni, longwave, air
    dni, _ = clear_day(sun[:, 2], times, options.site, turbidity=options.turbidity)
    if options.dni_w_m2:
        dni = np.full(times.size, options.dni_w_m2)
    air_k = options.air_c + CELSIUS_ZERO_K
    return dni, np.full(times.size, options.longwave_w_m2), np.full(times.size, air_k)


def run_all(options: StudyOptions) -> list[Run]:
    """Every start with every estimator."""
    return [
        Run(start, method, run_study(slopes_for(options, method), sky, replace(options, method=method)))
        for start in options.starts
        for sky in [conditions(options, start)]
        for method in options.estimators
    ]


def slopes_for(options: StudyOptions, method: Method) -> FloatArray:
    """The paper's slopes, or random ones; the posterior solves slopes one by one and gets fewer."""
    if options.slopes:
        return random_slopes(options.slopes, options.seed)
    return random_slopes(POSTERIOR_SLOPES, options.seed) if method == "posterior" else paper_slopes()


def sensitivity(options: StudyOptions) -> list[dict[str, Any]]:
    """90th percentile of the tilt error per start, by irradiance and tolerance, unstated in the paper."""
    rows = []
    for irradiance in (
        {"dni_w_m2": None}, {"dni_w_m2": None, "turbidity": 2.5},
        {"dni_w_m2": 800.0}, {"dni_w_m2": 500.0}, {"dni_w_m2": 270.0},
    ):  # fmt: skip
        for tolerance in (0.25, 0.5, 1.0, 2.0):
            tried = replace(
                options, weather=None, tolerance_w_m2=tolerance, estimators=("contours",), **irradiance
            )
            row: dict[str, Any] = {"irradiance": tried.irradiance, "tolerance_w_m2": tolerance}
            for run in run_all(tried):
                row[f"p90_{run.begin}"] = summarise(run.outcome.tilt_error_deg).p90
            rows.append(row)
    return rows
