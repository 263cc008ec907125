"""Maps: terrain products against the slope alone, and pixels of beds against the slopes of these."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.drawn_worlds import CLEAR, RANDOM, SOUTH, World
from benchmarks.estimation_learned import without_wind
from benchmarks.estimation_speed import PAPER, SITE, START_NS
from benchmarks.harsh_worlds import harsh_world
from benchmarks.result import Result, Row
from benchmarks.session_data import LARGE, camera
from benchmarks.sides import seconds, share
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.estimator_keys import Model
from fieldkit.estimation.minute_maps import MinuteMap
from fieldkit.estimation.pixel_slopes import PixelBounds, SlopeMap, posterior, with_bounds
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.ground.terrain_products import NAMES, Products
from fieldkit.model.arrays import AnyArray, FloatArray
from fieldkit.model.learnt import LearntParameter
from fieldkit.model.samples import Quality
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import WITH_SLOPE, SlopeEstimate, SlopeState
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.energy_balance import surface_temperature
from fieldkit.physics.facet import VERTICAL, normal
from fieldkit.physics.sun import sun_vectors
from fieldkit.results.slope_map import MappedSession
from tests.harness.pixels import sums_of_frames

MINUTES, NOISE_K, ROUNDS = 20, 0.05, 5
PIXELS = 20
"""Of each bed of a drawn world."""
FIRST_WORLD, WORLDS = 6000, 8
MODELS: tuple[Model, ...] = ("learned", "full")
REFUSED = (SlopeState.NO_INTERSECTION, SlopeState.SHADED)
SETTINGS = EstimatorSettings(model="full", noise_k=NOISE_K)
INERTIA = LearntParameter(
    name="thermal_inertia",
    unit="J m⁻² K⁻¹ s⁻½",
    prior=570.0,
    prior_low=380.0,
    prior_high=860.0,
    value=600.0,
    low=450.0,
    high=790.0,
    share_of_prior=0.7,
)
ALL = Row(
    "all", "a map of 640x512 with all products over one of the slope alone", "<= 3",
    included="20 mean frames added, the map solved, likelihood, layers with uncertainties; processor time",
)  # fmt: skip


def slope_map(frames_k: Sequence[FloatArray], rays: AnyArray) -> MappedSession:
    """The map of some frames, as `fieldkit.slope_map` makes it of a session's."""
    (rows, cols), _ = LARGE
    level_k = [float(surface_temperature(800.0 * ray[2], 400.0, 303.15, PAPER)) for ray in rays]
    sums = sums_of_frames(frames_k, level_k, rays, NOISE_K)
    solved = sums.solve(SETTINGS)
    likelihood = posterior(solved, sums, VERTICAL, SETTINGS)
    slopes, bounds = with_bounds(solved, likelihood, SETTINGS)
    whole = Region("beds", RegionKind.TARGET, ((0.0, 0.0), (cols, 0.0), (cols, rows), (0.0, rows)))
    return MappedSession(
        path=Path("benchmark.h5"), overrides=(), window=None, slopes=slopes, bounds=bounds,
        likelihood=likelihood,
        camera=camera(*LARGE), site=SITE, regions=(whole,), settings=SETTINGS, model="full",
        irradiance_model="", start_ns=START_NS, end_ns=START_NS + MINUTES * MINUTE_NS,
        minutes=MINUTES, flags=Quality(0), inertia=INERTIA,
    )  # fmt: skip


class WorldMap(NamedTuple):
    """Slopes of the pixels of a world, a row for each region, and the estimates of its targets."""

    slopes: SlopeMap
    bounds: PixelBounds
    regions: tuple[SlopeEstimate, ...]


def mapped_world(world: World, model: Model = "learned") -> WorldMap:
    """The map of a drawn world: pixels as noisy as a minute, and on average as warm as their region."""
    history, shape = without_wind(world.history), (len(world.regions), PIXELS)
    estimated = SlopeChain(world.regions, replace(world.settings, model="learned")).at_once(history)
    noise_k = NOISE_K * np.random.default_rng(5).standard_normal((len(history), *shape))
    noise_k -= noise_k.mean(axis=-1, keepdims=True)
    frames_k = history.temperature_k[..., np.newaxis] + noise_k
    by_minute = dict(zip(history.minute.tolist(), frames_k, strict=True))
    outlines = [((0.0, y), (PIXELS - 1.0, y), (PIXELS - 1.0, y), (0.0, y)) for y in range(shape[0])]
    minute_map = MinuteMap(
        history,
        tuple(replace(region, points_px=at) for region, at in zip(world.regions, outlines, strict=True)),
        np.arange(len(history)),
        shape,
        replace(world.settings, model=model),
        {
            slope.region: normal(slope.tilt_deg, slope.azimuth_deg)
            for slope in estimated.slopes
            if slope.state in WITH_SLOPE
        },
        estimated.learnt,
    )
    slopes, bounds, *_ = minute_map.solve(by_minute.__getitem__)
    return WorldMap(slopes, bounds, estimated.slopes)


def of_beds() -> list[Result]:
    """Pixels of beds with a slope, in harsh worlds: how many are refused, and how far off the bed's."""
    kinds = [(RANDOM, 180), (SOUTH, 60)] * (WORLDS // 2)
    worlds = [
        harsh_world(FIRST_WORLD + number, CLEAR, beds, minutes=minutes)
        for number, (beds, minutes) in enumerate(kinds)
    ]
    learned, full = (_refused_and_off([mapped_world(world, model) for world in worlds]) for model in MODELS)
    note = f"{WORLDS} harsh worlds; with one exchange for all minutes, as configured (full): {full[0]:.0f} %"
    return [
        Result("pixels of beds with a slope that are refused", learned[0], "%", "0", note),
        Result("  their median tilt off the bed's", learned[1], "°", "reported", f"full: {full[1]:.1f}°"),
    ]


def _refused_and_off(maps: Sequence[WorldMap]) -> tuple[float, float]:
    """Share of refused pixels in percent, and the median of how far the tilts are off those of their beds."""
    beds = [
        (world.slopes.state[row], world.slopes.tilt_deg[row] - bed.tilt_deg)
        for world in maps
        for row, bed in enumerate(world.regions, start=1)
        if bed.state in WITH_SLOPE
    ]
    states, off_deg = (np.concatenate(columns) for columns in zip(*beds, strict=True))
    return 100.0 * float(np.isin(states, REFUSED).mean()), float(np.nanmedian(np.abs(off_deg)))


def run() -> list[Result]:
    """All rows; two minutes."""
    random = np.random.default_rng(1)
    shape = LARGE[0]
    facets = normal(random.uniform(0.0, 30.0, shape), random.uniform(0.0, 360.0, shape))
    rays = sun_vectors(START_NS + np.arange(MINUTES) * MINUTE_NS, SITE)
    frames_k = [
        surface_temperature(800.0 * np.maximum(facets @ ray, 0.0), 400.0, 303.15, PAPER)
        + NOISE_K * random.standard_normal(shape)
        for ray in rays
    ]
    every = Products(NAMES, limit_deg=20.0, drive_deg=90.0)

    def cpu_s(products: Products) -> float:
        return seconds(lambda: slope_map(frames_k, rays).products(products), time.process_time)

    return [*of_beds(), share(ALL, [(cpu_s(every), cpu_s(Products(("slope",)))) for _ in range(ROUNDS)])]
