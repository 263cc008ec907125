"""The paper's study on another world: which slopes, at which hour, with which noise, how well, how soon.

The estimator is the paper's study's least squares over `estimated_normals`, temperatures follow eq. (7) with
the world's sunlight, air and ground, one measurement a minute. Stored heat is left out there, as in the
paper; `WorldDay` has it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fieldkit.estimation.day_plan import bound, cosine_noise
from fieldkit.model.arrays import FloatArray, IntArray
from fieldkit.model.errors import NoAnswerError
from fieldkit.model.site import Site
from fieldkit.model.units import MINUTE_NS, SECOND_NS
from fieldkit.physics.bodies import Body, body_of
from fieldkit.physics.constants import STEFAN_BOLTZMANN
from fieldkit.physics.daylight import clear_day
from fieldkit.physics.energy_balance import SurfaceParameters, direct_irradiance, surface_temperature
from fieldkit.physics.facet import normal
from fieldkit.physics.regolith import day_temperatures
from fieldkit.physics.sun import solar_time_h, sun_vectors
from fieldkit.results.json_document import to_json
from fieldkit.study.estimators import Conditions, StudySettings, random_slopes, run_study, summarise
from fieldkit.study.output import Rows, write_files
from fieldkit.views import plotting
from fieldkit.views.study_figures import errors_over_window, temperatures_over_day

HOURS = (9.0, 12.0, 15.0)
NOISES_K = (0.02, 0.05, 0.1)
WINDOWS_MIN = (20, 60, 180)
LONG_WINDOWS_MIN = (24 * 60, 72 * 60)
"""On a world whose day lasts weeks."""
STEPS, SETTLING_DAYS = 480, 12
"""Of a day of the ground; the days before it that settle its temperature."""
ASPECTS_DEG = (0.0, 90.0, 180.0, 270.0)
EXAMPLE_TILT_DEG = 15.0
GUESS_DEG = 27.0
"""90th percentile of the angle between normals if every slope, 0 to 30 degrees evenly, is called flat."""
GOOD_DEG, WORTHLESS_DEG = 3.0, GUESS_DEG / 2.0
SITES = {
    "mars": Site(18.44, 77.45, -2600.0, body="mars"),
    "moon": Site(26.13, 3.63, -1900.0, body="moon"),
}
"""Sites of the study unless one is given: Jezero, and the landing site of Apollo 15."""


@dataclass(frozen=True, slots=True)
class Window:
    """One start, window and noise: errors of random slopes, and the bound of a slope of 15 degrees by aspect.

    `tilt_mae_deg` and `tilt_p90_deg` are of the absolute tilt error, `normal_p90_deg` of the angle between
    normals, all degrees; the bounds are one standard deviation of the tilt, azimuth unknown.
    """

    hour: float
    minutes: int
    noise_k: float
    tilt_mae_deg: float
    tilt_p90_deg: float
    normal_p90_deg: float
    bound_north_deg: float
    bound_east_deg: float
    bound_south_deg: float
    bound_west_deg: float

    @property
    def verdict(self) -> str:
        """Verdict on the window."""
        if not self.normal_p90_deg < WORTHLESS_DEG:
            return "worthless"
        return "good" if self.normal_p90_deg <= GOOD_DEG else "weak"


@dataclass(frozen=True, slots=True)
class WorldDay:
    """A day of flat ground and of slopes of 15 degrees (by `ASPECTS_DEG`), with the heat that ground stores.

    `hour` (n,) of true solar time from 0 to 24, `flat_k` (n,), `slope_k` (4, n).
    """

    hour: FloatArray
    flat_k: FloatArray
    slope_k: FloatArray

    @property
    def rows(self) -> Rows:
        """Every half hour: temperature of flat ground, and by how much the slopes are warmer, kelvin."""
        names = ("north_k", "east_k", "south_k", "west_k")
        return [
            {"hour": round(float(self.hour[at]), 2), "flat_k": round(float(self.flat_k[at]), 2)}
            | {
                name: round(float(self.slope_k[index, at] - self.flat_k[at]), 2)
                for index, name in enumerate(names)
            }
            for at in range(self.hour.size // 48 - 1, self.hour.size, self.hour.size // 48)
        ]


@dataclass(frozen=True, slots=True)
class WorldStudy:
    """The study on one world."""

    site: Site
    day: str
    windows: tuple[Window, ...]
    ground: WorldDay

    @property
    def summary(self) -> list[str]:
        """The answer in sentences: 20 minutes, and the shortest window that is good, for every noise."""
        return [
            sentence
            for noise_k in sorted({window.noise_k for window in self.windows})
            for sentence in self._at(noise_k)
        ]

    def _at(self, noise_k: float) -> list[str]:
        shown = [window for window in self.windows if window.noise_k == noise_k]
        first = min(shown, key=_soonest)
        of_world = (
            f"{length(first.minutes)} windows on {self.site.body.title()}, {noise_k:g} K, best start "
            f"{first.hour:g} h: 90 % of the normals within {first.normal_p90_deg:.1f}° "
            f"(calling every slope flat: {GUESS_DEG:g}°): {first.verdict}"
        )
        good = [window for window in shown if window.verdict == "good"]
        if not good:
            return [of_world, f"no window tried brings {GOOD_DEG:g}° at {noise_k:g} K"]
        best = min(good, key=_soonest)
        return [of_world, f"{GOOD_DEG:g}° at {noise_k:g} K takes {length(best.minutes)} from {best.hour:g} h"]

    @property
    def document(self) -> dict[str, Any]:
        """The study for ``--json``."""
        return {
            "site": asdict(self.site),
            "day": self.day,
            "summary": self.summary,
            "windows": self.rows,
            "ground": self.ground.rows,
        }

    @property
    def rows(self) -> Rows:
        """One row for each window."""
        return [{**asdict(window), "verdict": window.verdict} for window in self.windows]

    def write(self, folder: Path) -> None:
        """Write world.json, world.csv, world-day.csv and their figures; raises `StorageError`."""
        drawn = {"world": self.figure(), "world-day": self.day_figure()} if plotting.available() else {}
        tables = {"world": self.rows, "world-day": self.ground.rows}
        write_files(folder, {"world.json": to_json(self.document)}, tables, drawn)

    def day_figure(self) -> str:
        """Temperature of flat ground and what slopes add over a day, as SVG text."""
        warmer = {
            f"15° to {name}": one - self.ground.flat_k
            for name, one in zip(("north", "east", "south", "west"), self.ground.slope_k, strict=True)
        }
        return temperatures_over_day(self.ground.hour, self.ground.flat_k, warmer, self._title)

    @property
    def _title(self) -> str:
        return f"{self.site.body.title()}, latitude {self.site.latitude_deg:g}°"

    def figure(self) -> str:
        """90th percentile of the error over the length of the window, as SVG text."""
        return errors_over_window(
            [(window.hour, window.noise_k, window.minutes, window.normal_p90_deg) for window in self.windows],
            self._title,
            GUESS_DEG,
        )


def _soonest(window: Window) -> tuple[int, float]:
    return window.minutes, window.normal_p90_deg


def length(minutes: int) -> str:
    """A window in words: ``20 min``, ``3 h``, ``3 days``."""
    if minutes < 60:
        return f"{minutes} min"
    return f"{minutes / 60:g} h" if minutes <= 24 * 60 else f"{minutes / (24 * 60):g} days"


def world_study(
    site: Site,
    day: str,
    *,
    dust: float | None = None,
    noises_k: tuple[float, ...] = NOISES_K,
    slopes: int = 300,
    seed: int = 1,
    on_window: Callable[[str], None] = lambda _: None,
) -> WorldStudy:
    """Study how well slopes can be estimated on the site's world.

    Parameters
    ----------
    site
        Where; its `body` sets sun, sunlight, air and ground.
    day
        UTC date from which on each start is the next one of its local true solar time, such as
        ``"2024-06-01"``.
    dust
        Optical depth of dust; None for the body's clear season. [-]
    noises_k
        Standard deviations of a region's minute mean. [K]
    slopes, seed
        Number of random slopes of 0 to 30 degrees, and their seed.
    on_window
        Called with each window before it is simulated.

    Returns
    -------
    WorldStudy
        With `summary`, `rows`, `figure` and `write`.

    Raises
    ------
    ConfigError
        If there is no model of the body.
    NoAnswerError
        If the sun is down in every window.
    """
    body = body_of(site)
    minutes = WINDOWS_MIN + (LONG_WINDOWS_MIN if body.day_s > 7 * 86_400 else ())
    windows = []
    for hour in HOURS:
        start_ns = next_solar_time(site, day, hour)
        for length_min in minutes:
            time_ns = start_ns + np.arange(length_min + 1, dtype=np.int64) * MINUTE_NS
            on_window(f"{hour:g} h, {length(length_min)}")
            sky = _conditions(site, time_ns, dust)
            if sky.sun[:, 2].min() > 0.0:
                windows += [
                    _window(site, sky, hour, length_min, noise_k, slopes, seed) for noise_k in noises_k
                ]
    if not windows:
        raise NoAnswerError(
            f"the sun does not rise at latitude {site.latitude_deg:g}", fix="give another --site"
        )
    on_window("a day of the ground")
    return WorldStudy(site, day, tuple(windows), world_day(site, day, dust=dust))


def world_day(site: Site, day: str, *, dust: float | None = None) -> WorldDay:
    """A day of the ground with conduction, light and longwave of that world; parameters as `world_study`.

    Slopes see the sky of a level surface: no light or longwave from the ground around.
    """
    body, start_ns = body_of(site), next_solar_time(site, day, 0.0)
    step_ns = round(body.day_s * SECOND_NS / STEPS)
    time_ns = start_ns + step_ns * np.arange(1, STEPS + 1, dtype=np.int64)
    sun = sun_vectors(time_ns, site)
    dni, dhi = clear_day(sun[:, 2], time_ns, site, turbidity=3.0, dust=dust)
    normals = normal([0.0, *(EXAMPLE_TILT_DEG,) * 4], [0.0, *ASPECTS_DEG])
    light = (1.0 - body.albedo) * (np.maximum(normals @ sun.T, 0.0) * dni + dhi)
    supply = light + body.emissivity * body.longwave_down_w_m2
    temperatures = np.array([_temperatures(body, absorbed) for absorbed in supply])
    return WorldDay(24.0 * np.arange(1, STEPS + 1) / STEPS, temperatures[0], temperatures[1:])


def _temperatures(body: Body, absorbed_w_m2: FloatArray) -> FloatArray:
    mean_k = float((absorbed_w_m2.mean() / (body.emissivity * STEFAN_BOLTZMANN)) ** 0.25)
    return day_temperatures(
        body.regolith,
        absorbed_w_m2,
        body.day_s,
        exchange_w_m2_k=body.exchange_w_m2_k,
        air_temperature_k=body.air_temperature_k,
        days=SETTLING_DAYS,
        start_k=0.95 * mean_k,
    )


def next_solar_time(site: Site, day: str, hour: float) -> int:
    """UTC nanoseconds of the first minute from a UTC date on at which it is `hour` of true solar time."""
    begin = int(np.datetime64(day, "ns").astype(np.int64))
    step_ns = round(body_of(site).day_s / 300.0) * SECOND_NS
    coarse = begin + np.arange(400, dtype=np.int64) * step_ns
    past = (solar_time_h(coarse, site) - hour) % 24.0
    first = int(np.argmax(np.diff(past) < -12.0))
    fine = np.arange(coarse[first], coarse[first + 1] + MINUTE_NS, MINUTE_NS, dtype=np.int64)
    is_past = (solar_time_h(fine, site) - hour) % 24.0 < 12.0
    return int(fine[np.argmax(is_past)])


def _conditions(site: Site, time_ns: IntArray, dust: float | None) -> Conditions:
    body, sun = body_of(site), sun_vectors(time_ns, site)
    dni, _ = clear_day(sun[:, 2], time_ns, site, turbidity=3.0, dust=dust)
    longwave, air = (
        np.full(time_ns.size, value) for value in (body.longwave_down_w_m2, body.air_temperature_k)
    )
    return Conditions(sun, dni, longwave, air)


def _window(
    site: Site, sky: Conditions, hour: float, minutes: int, noise_k: float, slopes: int, seed: int
) -> Window:
    surface = body_of(site).surface
    settings = StudySettings("unit-norm", surface, noise_k=noise_k, seed=seed)
    outcome = run_study(random_slopes(slopes, seed), sky, settings)
    tilt, angle = summarise(outcome.tilt_error_deg), summarise(outcome.normal_error_deg)
    bounds = _bounds_deg(sky, noise_k, surface)
    return Window(hour, minutes, noise_k, tilt.mae, tilt.p90, angle.p90, *bounds)


def _bounds_deg(sky: Conditions, noise_k: float, surface: SurfaceParameters) -> list[float]:
    """Cramér-Rao bound of the tilt of a slope of 15 degrees by aspect, degrees."""
    normals = normal(EXAMPLE_TILT_DEG, ASPECTS_DEG)
    flat_k = surface_temperature(
        direct_irradiance(sky.dni_w_m2, sky.sun[:, 2]), sky.longwave_w_m2, sky.air_k, surface
    )
    sigma: FloatArray = cosine_noise(sky.dni_w_m2, flat_k, noise_k, surface)
    return [float(value) for value in bound(normals, sky.sun, sigma).tilt_deg]
