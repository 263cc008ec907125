"""Slopes from temperatures and light that others measured, whose true planes are known.

Read from a `shared` folder beside the project where there is one. Settings follow from the kind of surface
alone and are the same for every day of a set; the days are chosen by the weather, never by the result.
A day without a slope is refused: it counts in neither error nor coverage, and every row says how many.

* `pv`: back of a photovoltaic module, 40 degrees to the south, from the weather alone
  (``estimator.reference = "weather"``), which is a satellite's; days are clear where satellite and clear sky
  agree within 5 %. Single days, and three that span six weeks as one estimate.
* `twin`, `glob`: pyranometers in known planes on sunny days (sunshine as WMO-No. 8 defines it in half of
  the rows or more), as if they were surfaces: one watt per square metre warms by one
  kelvin, nothing is emitted or stored. What is left is the way from irradiance to the normal.
* `wall`: the surface of the Twin Houses' west wall on the same days, from the weather of its station;
  its white render's albedo is the experiment's own (0.23 absorbed: IDEAS, TwinHouses, ext_plaster), or its
  kind's.
* `flat`: a radiometer over level ground, from its weather: the null test.
* `landsat`, `zeelim`: thermal images over surface models (`benchmarks.one_image`).
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import norm

from benchmarks.estimation_learned import SUNSHINE_W_M2
from benchmarks.ok_counts import ok_words
from benchmarks.one_image import desert, ridges
from benchmarks.result import Result
from fieldkit.config import config_from_text
from fieldkit.estimation.bins import History
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.surface_kinds import Kind
from fieldkit.estimation.table import TemperatureTable, as_part, slopes_of_part
from fieldkit.estimation.together import slopes_together
from fieldkit.model.arrays import BoolArray, FloatArray, IntArray
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.model.slope import SOLVED, SlopeEstimate
from fieldkit.model.units import CELSIUS_ZERO_K, MINUTE_NS, SECOND_NS
from fieldkit.physics.facet import angle_between_deg, normal
from fieldkit.physics.irradiance import IrradianceModel, direct_normal
from fieldkit.physics.slab import Slab
from fieldkit.physics.sun import sun_vectors

SHARED = Path(__file__).parents[1].parent / "shared" / "data"
DAY_NS = 86_400 * SECOND_NS
DAY_S = 86_400.0
ROUNDING_DEG = 0.05
"""Of the ends of a region at the limits of the tilt, level and vertical."""

PV_SITE = Site(39.7406, -105.1775, 1829.0)
EQUINOX_NEAR_NS = int(np.datetime64("2016-08-22", "ns").astype(np.int64))
"""From here on the sun of a day runs so nearly in a plane that tilt and gain are hardly parted."""
TWIN_SITE = Site(47.874, 11.728, 680.0)
TWIN_PLANES = {"south": 180.0, "east": 90.0, "west": 270.0, "north": 0.0}
TWIN_GOALS = {"south": "<= 2", "east": "<= 9", "west": "<= 9", "north": ""}
GLOB_SITE = Site(78.9227, 11.9273, 10.0)
GLOB_PLANES = {"N": 0, "NE": 45, "E": 90, "SE": 135, "S": 180, "SW": 225, "W": 270, "NW": 315}
OF_GHI = IrradianceModel(kind="pyranometer", diffuse="erbs")
MOST_ALBEDO = 0.95
WHITE_ALBEDO = 0.77
LIGHT_K = 200.0
"""A dark pyranometer as a temperature."""
Columns = dict[str, FloatArray]
Truth = tuple[float, float]


def run() -> list[Result]:
    """Rows of every file that is there, and a row that says which is not."""
    twin_house = "twinhouse-o5-2013-aug-sep.csv"
    sources = (
        ("photovoltaic module", "pv-module-2016-jul-sep.csv", pv),
        ("vertical pyranometers", twin_house, twin),
        ("west wall", twin_house, wall),
        ("pyranometers of 45°", "glob-2025-apr-may-odd-days.csv", _glob),
    )
    results: list[Result] = []
    for name, file, rows in sources:
        path = SHARED / "real" / file
        results += rows(_columns(path)) if path.exists() else [_missing(name, path)]
    return [*results, *_flat(), *_images()]


@dataclass(frozen=True, slots=True)
class Case:
    """Estimates of some days with the true tilt and azimuth of each; goals in degrees and per cent."""

    name: str
    estimates: Sequence[tuple[SlopeEstimate, Truth]]
    goal_deg: str = ""
    goal_covered: str = ""

    def rows(self) -> Iterator[Result]:
        """Median error of the normal and share of covered tilts, of the estimates that are not refused."""
        solved = [(slope, truth) for slope, truth in self.estimates if slope.state in SOLVED]
        errors = [float(angle_between_deg(_normal(slope), normal(*truth))) for slope, truth in solved]
        inside = [100.0 * _covers(slope, truth[0]) for slope, truth in solved]
        tilt_deg = _average(np.median, [slope.tilt_deg for slope, _ in solved])
        note = f"{self._refusals()}; median tilt {tilt_deg:.1f}"
        median = _average(np.median, errors)
        half = _average(np.mean, [slope.tilt_half_width_deg for slope, _ in solved])
        yield Result(f"{self.name}: error of the normal, median", median, "deg", self.goal_deg, note)
        covered = _average(np.mean, inside)
        tilt_errors = np.array([slope.tilt_deg - truth[0] for slope, truth in solved])
        density = _log_density(tilt_errors, np.array([slope.tilt_half_width_deg for slope, _ in solved]))
        note = f"half width {half:.1f}, {density}; {self._refusals()}"
        yield Result("  tilt inside its 90 % region", covered, "%", self.goal_covered, note)

    def _refusals(self) -> str:
        """How many estimates there are, how many are refused and why, and how many are ok."""
        states = [slope.state for slope, _ in self.estimates]
        refusals = [state.name.lower() for state in states if state not in SOLVED]
        reasons = ", ".join(f"{refusals.count(name)} {name}" for name in sorted(set(refusals)))
        words = f"refused {len(refusals)}{f' ({reasons})' if reasons else ''}"
        return f"{len(states)} estimates, {words}, {ok_words(slope for slope, _ in self.estimates)}"


def _average(average: Callable[[Sequence[float]], Any], values: Sequence[float]) -> float:
    """The average, NaN of no value."""
    return float(average(values)) if values else np.nan


def _normal(one: SlopeEstimate) -> FloatArray:
    return normal(one.tilt_deg, one.azimuth_deg if np.isfinite(one.azimuth_deg) else 0.0)


def _covers(one: SlopeEstimate, tilt_deg: float) -> bool:
    return one.tilt_low_deg - ROUNDING_DEG <= tilt_deg <= one.tilt_high_deg + ROUNDING_DEG


def settings_of(kind: Kind, stated: str = "", **changes: object) -> EstimatorSettings:
    """The full model of a kind of surface, over whole days."""
    text = f'[site]\nlatitude_deg = 0\nlongitude_deg = 0\n[surface]\nkind = "{kind}"\n{stated}\n'
    configured = config_from_text(text, Path("benchmark.toml")).estimator_settings()
    return replace(configured, model="full", window_s=DAY_S, site=None, **changes)  # type: ignore[arg-type]


def of_light(**changes: object) -> EstimatorSettings:
    """Settings by which irradiance in W/m2 is a temperature in kelvin: offsets and noise of 5 W/m2."""
    settings = settings_of("plate", "", noise_k=5.0, offset_sd_k=5.0, **changes)
    surface = replace(
        settings.surface,
        albedo=0.0,
        emissivity_broadband=1e-9,
        exchange_m_s=1.0 / (settings.surface.heat_capacity_j_kg_k * settings.surface.air_density_kg_m3),
    )
    return replace(
        settings,
        surface=surface,
        irradiance=OF_GHI,
        slab=Slab(1e-6, 0.25, 1.0),
        tilt_limit_deg=90.0,
        scale_sd=EstimatorSettings().scale_sd,
        exchange_sd=0.0,
        limits={"surface_temperature": (0.0, 3000.0)},
    )


def _columns(path: Path) -> Columns:
    """Numbers by column, NaN where empty; times as UTC nanoseconds by the name of their column."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    times = [name for name in rows[0] if name.startswith("time")]
    columns = {
        name: np.array([float(row[name] or "nan") for row in rows]) for name in rows[0] if name not in times
    }
    for name in times:
        text = [row[name][:19].replace(" ", "T") for row in rows]
        columns[name] = np.array(text, "datetime64[ns]").astype(np.int64)
    return columns


def _missing(name: str, path: Path) -> Result:
    return Result(name, float("nan"), "deg", "", f"skipped: no {path.name} in {path.parent}")


def _days(table: TemperatureTable, longitude_deg: float) -> Iterator[TemperatureTable]:
    """A table for each solar day."""
    day = (table.time_ns + round(longitude_deg / 360.0 * DAY_NS)) // DAY_NS
    for number in np.unique(day):
        yield _rows(table, day == number)


def _rows(table: TemperatureTable, chosen: BoolArray) -> TemperatureTable:
    names = ("irradiance_w_m2", "diffuse_w_m2", "air_k", "ghi_w_m2", "longwave_w_m2", "wind_m_s")
    columns = {name: value[chosen] for name in names if (value := getattr(table, name)) is not None}
    targets = {name: value[chosen] for name, value in table.targets_k.items()}
    return TemperatureTable(table.time_ns[chosen], table.reference_k[chosen], targets, **columns)


def _estimates(
    days: Iterable[TemperatureTable], site: Site, settings: EstimatorSettings, truths: dict[str, Truth]
) -> list[tuple[SlopeEstimate, Truth]]:
    parts = (as_part("", day, site, settings) for day in days)
    return [(slope, truths[slope.region]) for part in parts for slope in slopes_of_part(part)]


def pv(columns: Columns) -> Iterator[Result]:
    """Rows of the back of a photovoltaic module."""
    settings, truth = settings_of("plate", reference="weather", air="model"), {"module": (40.0, 180.0)}
    days = [day for day in _days(_module(columns), PV_SITE.longitude_deg) if _is_clear(day, columns)]
    estimates = _estimates(days, PV_SITE, settings, truth)
    name = f"module of 40°, {len(days)} clear days"
    yield from Case(name, estimates, "<= 20", ">= 90").rows()
    yield from _components(estimates, "<= 7")
    by_end = {int(three[-1].time_ns[-1]): _together(three, settings) for three in triples(days)}
    together = [(slope, truth["module"]) for slope in by_end.values()]
    name = "three clear days that span six weeks, one estimate"
    yield from Case(name, together, "<= 15", ">= 90").rows()
    yield from _components(together)
    early = [estimate for end_ns, estimate in zip(by_end, together, strict=True) if end_ns < EQUINOX_NEAR_NS]
    yield from Case("  the last of them before 22 August", early).rows()


def _components(estimates: Sequence[tuple[SlopeEstimate, Truth]], goal_east: str = "") -> Iterator[Result]:
    """Rows of the components to east and north apart; intervals only of the models that state them."""
    solved = [(slope, normal(*truth)) for slope, truth in estimates if slope.state in SOLVED]
    for axis, (name, goal) in enumerate({"east": goal_east, "north": ""}.items()):
        keys = [f"{name}_{end}deg" for end in ("", "low_", "high_")]
        numbers = [[getattr(slope, key) for key in keys] for slope, _ in solved]
        middle, low, high = np.reshape(numbers, (-1, 3)).T
        true = np.degrees(np.arcsin([truth[axis] for _, truth in solved]))
        leans = np.degrees(np.arcsin([_normal(slope)[axis] for slope, _ in solved]))
        error: FloatArray = np.where(np.isfinite(middle), middle, leans) - true
        note = ""
        if np.isfinite(low).any():
            held = 100.0 * np.mean((low <= true + ROUNDING_DEG) & (true <= high + ROUNDING_DEG))
            half = 0.5 * (high - low)
            note = f"held {held:.0f} %, half width {np.mean(half):.1f}, {_log_density(error, half)}"
            note += f", {np.sum(half > 15.0)} undetermined" if axis else ""
        yield Result(
            f"  component to the {name}: mean error",
            _average(np.mean, np.abs(error).tolist()),
            "deg",
            goal,
            note,
        )


def _log_density(error_deg: FloatArray, half_deg: FloatArray) -> str:
    """Mean logarithm of the density, per degree, that normal regions of 90 % give the truth."""
    sd = half_deg / norm.ppf(0.95)
    known = np.isfinite(error_deg) & (sd > 0.0)
    densities = np.asarray(norm.logpdf(error_deg[known], scale=sd[known]))
    return f"log density {_average(np.mean, densities.tolist()):.1f}"


def triples(days: Sequence[TemperatureTable]) -> Iterator[tuple[TemperatureTable, ...]]:
    """For each last day the day nearest six weeks before it, not below five, and the one nearest half-way."""
    ends_ns = np.array([day.time_ns[-1] for day in days])
    for last, end_ns in enumerate(ends_ns):
        first = int(np.argmin(np.abs(end_ns - 42 * DAY_NS - ends_ns)))
        if end_ns - ends_ns[first] >= 35 * DAY_NS:
            middle = int(np.argmin(np.abs(ends_ns - (ends_ns[first] + end_ns) // 2)))
            yield days[first], days[middle], days[last]


def _together(tables: Iterable[TemperatureTable], settings: EstimatorSettings) -> SlopeEstimate:
    """The slope of the only target of tables."""
    parts = [as_part(str(number), table, PV_SITE, settings) for number, table in enumerate(tables)]
    return slopes_together(parts).estimated.slopes[0]


def _module(columns: Columns) -> TemperatureTable:
    module_k = columns["module_c"] + CELSIUS_ZERO_K
    return TemperatureTable(
        columns["time_utc"].astype(np.int64),
        np.full_like(module_k, np.nan),
        {"module": module_k},
        irradiance_w_m2=columns["dni_clear"],
        diffuse_w_m2=columns["dhi_clear"],
        air_k=columns["air_c"] + CELSIUS_ZERO_K,
    )


def _of(day: TemperatureTable, columns: Columns, name: str) -> FloatArray:
    return columns[name][np.isin(columns["time_utc"], day.time_ns)]


def _is_clear(day: TemperatureTable, columns: Columns) -> bool:
    ghi, clear = (_of(day, columns, name) for name in ("ghi", "ghi_clear"))
    sunny = clear > 50.0
    return bool(sunny.any() and np.mean(np.abs(ghi[sunny] / clear[sunny] - 1.0)) < 0.05)


def twin(columns: Columns) -> Iterator[Result]:
    """Rows of the vertical pyranometers of the twin house, under either sky."""
    time_ns = columns["time_cet"].astype(np.int64) - 65 * MINUTE_NS  # the end of ten minutes, UTC+1
    ghi, dhi = columns["ghi_w_m2"], columns["dhi_w_m2"]
    planes = {name: columns[f"{name}_vertical_w_m2"] for name in TWIN_PLANES}
    table = _pyranometers(time_ns, ghi, planes, dhi)
    truths = {name: (90.0, azimuth) for name, azimuth in TWIN_PLANES.items()}
    for sky in ("hay-davies", "isotropic"):
        days = [day for day in _days(table, TWIN_SITE.longitude_deg) if _is_sunny(day, TWIN_SITE)]
        estimates = _estimates(days, TWIN_SITE, of_light(sky=sky), truths)
        for name, goal in TWIN_GOALS.items():
            mine = [estimate for estimate in estimates if estimate[0].region == name]
            yield from Case(f"vertical pyranometer facing {name}, {sky} sky", mine, goal).rows()
            yield from _components(mine)


def wall(columns: Columns) -> Iterator[Result]:
    """Rows of the west wall's surface."""
    table = TemperatureTable(
        columns["time_cet"].astype(np.int64) - 65 * MINUTE_NS,
        np.full_like(columns["air_c"], np.nan),
        {"west wall": columns["west_wall_outside_c"] + CELSIUS_ZERO_K},
        ghi_w_m2=columns["ghi_w_m2"],
        diffuse_w_m2=columns["dhi_w_m2"],
        longwave_w_m2=columns["longwave_down_w_m2"],
        air_k=columns["air_c"] + CELSIUS_ZERO_K,
        wind_m_s=columns["wind_m_s"],
    )
    days = [day for day in _days(table, TWIN_SITE.longitude_deg) if _is_sunny(day, TWIN_SITE)]
    for name, stated, goals in (
        ("white, as stated", f"albedo = {WHITE_ALBEDO}", ("<= 8", ">= 85", "<= 7")),
        ("albedo by the kind", "", ("", "", "")),
    ):
        settings = settings_of("wall", stated, reference="weather", irradiance=OF_GHI)
        estimates = _estimates(days, TWIN_SITE, settings, {"west wall": (90.0, 270.0)})
        yield from Case(f"west wall's surface, {name}", estimates, *goals[:2]).rows()
        solved = [slope for slope, _ in estimates if slope.state in SOLVED]
        off = [abs((slope.azimuth_deg - 90.0) % 360.0 - 180.0) for slope in solved]
        held = [slope.azimuth_low_deg <= 270.0 <= slope.azimuth_high_deg for slope in solved]
        note = f"held {100.0 * _average(np.mean, held):.0f} %"
        yield Result("  error of its azimuth, median", _average(np.median, off), "deg", goals[2], note)
        yield from _components(estimates)


def _glob(columns: Columns) -> Iterator[Result]:
    time_ns, ghi = columns["time_utc"].astype(np.int64), columns["GHI"]
    planes = {f"{name}_45": columns[f"{name}_45"] for name in GLOB_PLANES}
    table = _pyranometers(time_ns, ghi, planes, np.full_like(ghi, np.nan))
    days = [day for day in _days(table, 0.0) if _is_sunny(day, GLOB_SITE)]
    albedo = min(float(np.nansum(columns["GHI_ground"]) / np.nansum(ghi)), MOST_ALBEDO)
    truths = {f"{name}_45": (45.0, float(azimuth)) for name, azimuth in GLOB_PLANES.items()}
    for sky in ("hay-davies", "isotropic"):
        settings = of_light(sky=sky, ground_albedo=albedo)
        estimates = _estimates(days, GLOB_SITE, settings, truths)
        yield from Case(f"pyranometers of 45° at 79° N, {sky} sky", estimates, "<= 7", ">= 80").rows()
        yield from _components(estimates)


def _pyranometers(time_ns: IntArray, ghi: FloatArray, planes: Columns, dhi: FloatArray) -> TemperatureTable:
    """Pyranometers as surfaces beside a level one; without diffuse light it is that of Erbs et al. (1982)."""
    targets = {name: LIGHT_K + value for name, value in planes.items()}
    return TemperatureTable(time_ns, LIGHT_K + ghi, targets, ghi_w_m2=ghi, diffuse_w_m2=dhi)


def _is_sunny(day: TemperatureTable, site: Site) -> bool:
    """Sunshine in half of the rows with the sun high enough."""
    sun = sun_vectors(day.time_ns, site)
    high = sun[:, 2] > np.sin(np.radians(EstimatorSettings().low_sun_deg))
    ghi, dhi = (np.asarray(column) for column in (day.ghi_w_m2, day.diffuse_w_m2))
    light = direct_normal(OF_GHI, ghi, sun, day.time_ns, dhi)[high]
    return bool(light.size and np.mean(light > SUNSHINE_W_M2) >= 0.5)


GROUNDS = {
    "real/flat-bp-rad.csv": ("ground_c", "sun_azimuth_ccw_from_south_deg"),
    "ground/cinder-2022.csv": ("ground_radiometer_c", "sun_azimuth_cw_from_south_deg"),
    "ground/clay-2024.csv": ("ground_radiometer_c", "sun_azimuth_cw_from_south_deg"),
}
"""Records of level ground, their temperature and azimuth of the sun, which runs anticlockwise in all."""


def _flat() -> Iterator[Result]:
    paths = [SHARED / name for name in GROUNDS if (SHARED / name).exists()]
    if not paths:
        yield _missing("level ground", SHARED / "real" / "flat-bp-rad.csv")
        return
    settings = settings_of("soil", reference="weather")
    estimates = [
        (SlopeChain([GROUND], settings).at(day).slopes[0], (0.0, 0.0))
        for path in paths
        for day in _ground_days(path, settings)
    ]
    yield from Case(f"level ground, {len(paths)} sites", estimates).rows()
    refused = sum(slope.state not in SOLVED for slope, _ in estimates)
    yield Result(f"  refused, of {len(estimates)} days", float(refused), "", f"{len(estimates)}")


LEAST_SUNNY_MINUTES = 360
"""Of a day with the sun high enough."""
GROUND = Region("ground", RegionKind.TARGET, ((0.0, 0.0),))


def _ground_days(path: Path, settings: EstimatorSettings) -> Iterator[History]:
    """The minutes up to the end of each day's sunny hours.

    The record has no dates: the sun is its own, and its light above the atmosphere that of an equinox.
    """
    ground, azimuth = GROUNDS[str(path.relative_to(SHARED))]
    columns = _columns(path)
    count = columns[ground].size
    sun = normal(columns["sun_zenith_apparent_deg"], 180.0 - columns[azimuth])
    ghi = columns["shortwave_down_w_m2"]
    dhi = columns["diffuse_share"] * ghi
    up = sun[:, 2] > np.sin(np.radians(settings.low_sun_deg))
    dni = np.where(up, (ghi - dhi) / np.where(up, sun[:, 2], 1.0), 0.0)
    minute = np.datetime64("2022-03-21", "m").astype(np.int64) + np.arange(count)
    history = History(
        minute=minute,
        time_ns=minute * MINUTE_NS,
        sun=sun,
        temperature_k=columns[ground][:, np.newaxis] + CELSIUS_ZERO_K,
        dni_w_m2=dni,
        dhi_w_m2=dhi,
        longwave_down_w_m2=columns["longwave_down_w_m2"],
        air_k=columns["air_c"] + CELSIUS_ZERO_K,
        wind_m_s=columns["wind_m_s"],
    )
    edges = np.flatnonzero(np.diff(up, prepend=False, append=False)).reshape(-1, 2)
    yield from (history.until(int(end)) for first, end in edges if end - first >= LEAST_SUNNY_MINUTES)


def _images() -> Iterator[Result]:
    """One image each; the kind of ground is all that is known of it beforehand."""
    scenes = (
        ("ridges from Landsat", "landsat-west-half.npz", ridges, settings_of("forest")),
        ("desert from a drone", "zeelim-1516-tiles123-0.6m.npz", desert, settings_of("soil")),
    )
    for name, file, rows, settings in scenes:
        path = SHARED / "real" / file
        yield from rows(path, settings) if path.exists() else [_missing(name, path)]
