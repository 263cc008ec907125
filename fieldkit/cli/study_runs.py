"""The runs of ``fieldkit study``: which sky, which starts, which estimators, and what comes out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, date, datetime, time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldkit.cli.types import utc_ns, with_zone
from fieldkit.estimation.study import (
    Conditions,
    Method,
    Outcome,
    StudySettings,
    paper_slopes,
    random_slopes,
    run_study,
    summarise,
)
from fieldkit.model.errors import NoAnswerError
from fieldkit.model.site import Site
from fieldkit.physics.clearsky import clear_sky
from fieldkit.physics.facet import FloatArray
from fieldkit.physics.sun import sun_vectors
from fieldkit.station_files import read_station_file
from fieldkit.views.formatting import zone
from fieldkit.weather import Weather

PAPER_SITE = Site(35.558675, 139.395232, 9.0, "Asia/Tokyo")
PAPER_DAY = date(2017, 8, 30)
PAPER_STARTS = (time(9), time(12), time(15))
PAPER_TURBIDITY = 4.16
"""Linke turbidity of the site's late August in the climatology that pvlib carries."""

POSTERIOR_SLOPES = 500  # one at a time, some milliseconds each
MINUTE_NS = 60_000_000_000
ZERO_CELSIUS_K = 273.15


@dataclass(frozen=True)
class Choices:
    """What the options of the verb say; `weather` replaces the formula sky, `dni` only its beam."""

    site: Site
    day: date
    starts: tuple[time, ...]
    minutes: int
    dni: float | None
    turbidity: float
    weather: Weather | None
    longwave: float
    air_c: float
    slopes: int | None
    noise: float
    quantum: float
    tolerance: float
    estimators: tuple[Method, ...]
    seed: int

    @property
    def light(self) -> str:
        """Where the direct irradiance comes from, in words."""
        if self.weather is not None:
            return f"measured: {self.weather.source}"
        return f"constant {self.dni:g} W/m²" if self.dni else f"clear sky, Linke turbidity {self.turbidity:g}"

    def settings(self, method: Method) -> StudySettings:
        """Settings of one run."""
        return StudySettings(
            method, noise_k=self.noise, quantum_k=self.quantum, tolerance_w_m2=self.tolerance, seed=self.seed
        )


@dataclass(frozen=True)
class Run:
    """One start with one estimator."""

    start: time
    method: Method
    conditions: Conditions
    outcome: Outcome


def choices(given: dict[str, Any]) -> Choices:
    """The choices with everything that depends on others filled in; `given` by the names of the options."""
    words = dict(given)
    site, zone_name, day, starts = (words.pop(name) for name in ("site", "zone", "day", "starts"))
    path = words.pop("weather")
    words["turbidity"] = words["turbidity"] or PAPER_TURBIDITY
    place = with_zone(site, zone_name) if site else PAPER_SITE
    weather = read_station_file(path) if path else None
    if weather is not None:
        place, middle_ns = weather.site, int(weather.time_ns[weather.time_ns.size // 2])
        day = day or datetime.fromtimestamp(middle_ns / 1e9, UTC).date()
    return Choices(site=place, day=day or PAPER_DAY, starts=starts or PAPER_STARTS, weather=weather, **words)


def conditions(chosen: Choices, start: time) -> Conditions:
    """Sun and weather of the minutes from a local start on.

    Raises `NoAnswerError` with the sun down or no measured weather then.
    """
    local = datetime.combine(chosen.day, start, tzinfo=zone(chosen.site))
    times = utc_ns(local) + np.arange(chosen.minutes + 1, dtype=np.int64) * MINUTE_NS
    sun = sun_vectors(times, chosen.site)
    light, longwave, air = _weather(chosen, times, sun)
    if not (np.all(sun[:, 2] > 0.0) and np.all(light > 0.0)):
        raise NoAnswerError(
            f"no direct sunlight all the time from {local.isoformat()} on",
            fix="choose another --start or --on",
        )
    return Conditions(sun, light, longwave, air)


def _weather(
    chosen: Choices, times: NDArray[np.int64], sun: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    if chosen.weather is not None:
        day = chosen.weather
        columns = (day.dni, day.longwave_down_w_m2, day.air_temperature_k)
        light, longwave, air = (np.interp(times, day.time_ns, values, np.nan, np.nan) for values in columns)
        return light, longwave, air
    light, _ = clear_sky(sun[:, 2], times, chosen.site.elevation_m, chosen.turbidity)
    if chosen.dni:
        light = np.full(times.size, chosen.dni)
    air_k = chosen.air_c + ZERO_CELSIUS_K
    return light, np.full(times.size, chosen.longwave), np.full(times.size, air_k)


def run_all(chosen: Choices) -> list[Run]:
    """Every start with every estimator."""
    return [
        Run(start, method, sky, run_study(slopes_for(chosen, method), sky, chosen.settings(method)))
        for start in chosen.starts
        for sky in [conditions(chosen, start)]
        for method in chosen.estimators
    ]


def slopes_for(chosen: Choices, method: Method) -> FloatArray:
    """The paper's slopes, or random ones; the posterior takes slopes one by one and gets fewer."""
    if chosen.slopes:
        return random_slopes(chosen.slopes, chosen.seed)
    return random_slopes(POSTERIOR_SLOPES, chosen.seed) if method == "posterior" else paper_slopes()


def sensitivity(chosen: Choices) -> list[dict[str, Any]]:
    """90th percentile of the tilt error per start for irradiances and tolerances the paper does not tell."""
    rows = []
    for light in (
        {"dni": None}, {"dni": None, "turbidity": 2.5}, {"dni": 800.0}, {"dni": 500.0}, {"dni": 270.0},
    ):  # fmt: skip
        for tolerance in (0.25, 0.5, 1.0, 2.0):
            tried = replace(chosen, weather=None, tolerance=tolerance, estimators=("contours",), **light)
            row: dict[str, Any] = {"irradiance": tried.light, "tolerance_w_m2": tolerance}
            for run in run_all(tried):
                row[f"p90_{run.start:%H:%M}"] = summarise(run.outcome.tilt_error_deg).p90
            rows.append(row)
    return rows
