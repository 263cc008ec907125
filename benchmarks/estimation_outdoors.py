"""Slopes under measured weather: what the paper's model leaves out, and what the full model leaves over.

Beds of sand on an insulating sheet are warmed by the scene from measured minutes of sun,
sky, long wave, air and wind (NOAA SURFRAD, Alamosa): 2016-01-01 clear, which the package
carries, and 2015-12-31 broken cloud, read from a `shared` folder beside the project where
there is one. The paper's method here is eq. (6) with the same windows and the same noise.
Truths lie off every grid; seeds are fixed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.result import Result
from fieldkit.estimation.bins import History
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.slopes import slopes
from fieldkit.model.arrays import FloatArray
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import SlopeEstimate
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.facet import angle_between_deg, normal
from fieldkit.physics.slab import Slab
from fieldkit.recording.field_history import field_history
from fieldkit.simulation import Exchange, Facet, MeasuredSky
from fieldkit.simulation.scene_series import SceneModel
from fieldkit.weather import Weather, packaged, read_surfrad

BROKEN = Path(__file__).parents[1].parent / "shared" / "data" / "weather" / "slv15365.dat"
STILL = Exchange(18.15, 0.0)
"""The paper's exchange, whatever the wind."""
NOISE_K = 0.05
LOCAL_NOON_UTC = 19  # Mountain Standard Time is UTC - 7
BEDS_SOUTH = tuple((tilt, 180.0) for tilt in (5.0, 10.0, 15.0, 20.0, 25.0))
SLAB = Slab(depth_m=0.03)

Bed = tuple[float, float]
WINDOW_S = 1200.0
PAPERS = EstimatorSettings(model="paper", window_s=WINDOW_S, azimuth="known")


def days() -> Iterator[tuple[str, Weather]]:
    """The clear day, and the broken one where its file is."""
    yield "clear", packaged()
    if BROKEN.exists():
        yield "broken cloud", read_surfrad(BROKEN)


def field_day(weather: Weather, beds: Sequence[Bed], sand: Facet, exchange: Exchange) -> History:
    """Minute means (true temperatures) of a flat bed and of `beds`, 9 to 15 h local."""
    day_ns = int(weather.time_ns[len(weather.time_ns) // 2]) // (1440 * MINUTE_NS) * 1440 * MINUTE_NS
    start_ns, minutes = day_ns + (LOCAL_NOON_UTC - 3) * 60 * MINUTE_NS, 6 * 60
    facets = tuple(replace(sand, tilt_deg=tilt, azimuth_deg=azimuth) for tilt, azimuth in ((0.0, 0.0), *beds))
    # flat ground around the beds is of the same sand, as in the difference equation
    ground = replace(sand, tilt_deg=0.0, azimuth_deg=0.0)
    model = SceneModel(weather.site, MeasuredSky(weather), facets, ground, exchange, (), 1.0)
    return field_history(model, start_ns, minutes)


def noisy(history: History, random: np.random.Generator, offsets_k: FloatArray | float = 0.0) -> History:
    """The same day with camera noise, and offsets of the beds against the flat one."""
    temperature = history.temperature_k + NOISE_K * random.standard_normal(history.temperature_k.shape)
    temperature[:, 1:] += offsets_k
    return replace(history, temperature_k=temperature)


def regions(beds: Sequence[Bed]) -> tuple[Region, ...]:
    """The flat reference and the beds."""
    none = ((0.0, 0.0),)
    targets = (
        Region(f"bed{i}", RegionKind.TARGET, none, tilt, azimuth) for i, (tilt, azimuth) in enumerate(beds)
    )
    return (Region("flat", RegionKind.REFERENCE, none, 0.0, 0.0), *targets)


def estimates(
    history: History, beds: Sequence[Bed], settings: EstimatorSettings, every: int
) -> Iterator[tuple[Bed, SlopeEstimate]]:
    """Every bed's estimate each `every` minutes, 12 to 15 h local, once the window is full."""
    noon = int(np.searchsorted(history.minute, history.minute[0] + 180))
    window = int((settings.fixed_window_s or 0.0) // 60)
    for last in range(noon + window, len(history), every):
        yield from zip(beds, slopes(history.until(last + 1), regions(beds), settings), strict=True)


def mean_tilt_error(history: History, settings: EstimatorSettings) -> float:
    """Mean absolute tilt error of the south-facing beds, degrees, three draws of noise."""
    errors = [
        abs(found.tilt_deg - bed[0])
        for seed in range(3)
        for bed, found in estimates(
            noisy(history, np.random.default_rng(seed)), BEDS_SOUTH, settings, every=5
        )
    ]
    return float(np.mean(errors))


def known_azimuth() -> list[Result]:
    """Beds of 5 to 25 degrees, azimuth known, 20 minutes."""
    sand = Facet("sand", (), depth_m=0.03)
    full = EstimatorSettings(model="full", window_s=WINDOW_S, azimuth="known", slab=SLAB)
    found = []
    must = {"clear": ("0.15", "0.3", "0.8"), "broken cloud": ("0.4", "0.6", "1.0")}
    for day, weather in days():
        history = field_day(weather, BEDS_SOUTH, sand, STILL)
        softer = replace(SLAB, conductivity_w_m_k=SLAB.conductivity_w_m_k * 0.8**2)
        papers = mean_tilt_error(history, PAPERS)
        for what, slab, limit in (
            ("", SLAB, must[day][0]),
            (", inertia 20 % wrong", softer, must[day][1]),
            (", depth 5 cm taken for 3", replace(SLAB, depth_m=0.05), must[day][2]),
        ):
            error = mean_tilt_error(history, replace(full, slab=slab))
            name = f"{day}, azimuth known, 20 min{what}: mean tilt error"
            found.append(Result(name, error, "°", f"≤ {limit}", f"paper's model {papers:.2f}°"))
        gusty = field_day(weather, BEDS_SOUTH, sand, Exchange())
        error, papers = (mean_tilt_error(gusty, settings) for settings in (full, PAPERS))
        name = f"{day}, the same with exchange that follows the wind"
        found.append(Result(name, error, "°", "reported", f"paper's model {papers:.2f}°"))
    return found


def free_azimuth(trials: int = 40) -> list[Result]:
    """Any slope up to 30 degrees, scale, offset and surface drawn from the stated priors."""
    found = []
    for day, weather in days():
        for minutes in (60, 180):
            settings = EstimatorSettings(model="full", window_s=60.0 * (minutes - 1), slab=SLAB)
            random = np.random.default_rng(minutes)
            held, errors, silent = [], [], 0
            for _ in range(trials):
                for bed, one in _drawn(weather, settings, random):
                    if np.isnan(one.tilt_deg):  # in its own shade, or called no intersection
                        silent += 1
                        continue
                    held.append(holds(one, bed))
                    errors.append(angle_between_deg(normal(one.tilt_deg, one.azimuth_deg), normal(*bed)))
            name = f"{day}, azimuth free, {minutes} min, everything drawn from its prior"
            note = (
                f"{len(held)} estimates of {2 * trials} beds; {silent} times no answer (bed in its own shade)"
            )
            found.append(
                Result(f"{name}: regions hold the truth", 100.0 * float(np.mean(held)), "%", "85-95", note)
            )
            p90 = float(np.nanpercentile(errors, 90))
            note = f"90th percentile {p90:.1f}°"
            found.append(
                Result(
                    f"{name}: median angle between normals",
                    float(np.nanmedian(errors)),
                    "°",
                    "reported",
                    note,
                )
            )
    return found


def _drawn(
    weather: Weather, settings: EstimatorSettings, random: np.random.Generator
) -> list[tuple[Bed, SlopeEstimate]]:
    """Estimates of two beds in a world whose parameters are drawn from the settings' priors."""
    albedo, air, grey, conductivity, capacity, light = random.standard_normal(6)
    beds = [(float(random.uniform(0, 30)), float(random.uniform(0, 360))) for _ in range(2)]
    sand = Facet(
        "sand",
        (),
        albedo=0.20 + 0.03 * albedo,
        emissivity_broadband=min(1.0, 0.90 + 0.02 * grey),
        depth_m=SLAB.depth_m,
        conductivity_w_m_k=SLAB.conductivity_w_m_k * (1.0 + settings.conductivity_sd * conductivity),
        heat_capacity_j_m3_k=SLAB.heat_capacity_j_m3_k * (1.0 + settings.capacity_sd * capacity),
    )
    exchange = Exchange(18.15 * (1.0 + settings.exchange_sd * air), 0.0)
    history = field_day(weather, beds, sand, exchange)
    hours = (np.arange(len(history)) - len(history) / 2.0)[:, np.newaxis] / 60.0
    drifts = settings.drift_sd_k_per_h * hours * random.standard_normal(2)
    history = noisy(history, random, settings.offset_sd_k * random.standard_normal(2) + drifts)
    # albedo took 0.0375 of the scale's 0.08; the rest is the light meter's
    meter = 1.0 + 0.07 * light
    history = replace(history, dni_w_m2=history.dni_w_m2 * meter, dhi_w_m2=history.dhi_w_m2 * meter)
    return list(estimates(history, beds, settings, every=60))


def holds(one: SlopeEstimate, bed: Bed) -> bool:
    """Whether the likelihood region's projections contain the bed, on either branch that is reported."""
    width = one.azimuth_high_deg - one.azimuth_low_deg
    inside = one.tilt_low_deg <= bed[0] <= one.tilt_high_deg
    return bool(inside and (bed[1] - one.azimuth_low_deg) % 360.0 <= width)


def run() -> list[Result]:
    """All rows; about two minutes."""
    return known_azimuth() + free_azimuth()
