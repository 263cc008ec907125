"""Terrain products of a map, against the slope alone: from mean frames to layers."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.estimation_speed import PAPER, SITE, START_NS
from benchmarks.result import Result, Row
from benchmarks.session_data import LARGE, camera
from benchmarks.sides import share
from fieldkit.estimation.pixel_slopes import MapSums, posterior, with_bounds
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.ground.terrain_products import NAMES, Products
from fieldkit.model.learnt import LearntParameter
from fieldkit.model.samples import Quality
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.energy_balance import surface_temperature
from fieldkit.physics.facet import VERTICAL, FloatArray, normal
from fieldkit.physics.sun import sun_vectors
from fieldkit.results.slope_map import MappedSession

MINUTES, NOISE_K, ROUNDS = 20, 0.05, 5
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


def mapped(frames_k: Sequence[FloatArray], rays: NDArray[Any]) -> MappedSession:
    """The map of some frames, as `fieldkit.slope_map` makes it of a session's."""
    (rows, cols), _ = LARGE
    sums = MapSums((rows, cols), PAPER, NOISE_K, SETTINGS.tilt_limit_deg)
    for frame_k, ray in zip(frames_k, rays, strict=True):
        level_k = float(surface_temperature(800.0 * ray[2], 400.0, 303.15, PAPER))
        sums.add(frame_k, level_k, ray, 800.0, VERTICAL)
    solved = sums.solve()
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


def run() -> list[Result]:
    """One row; half a minute."""
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

    def seconds(wanted: Products) -> float:
        began = time.process_time()
        mapped(frames_k, rays).products(wanted)
        return time.process_time() - began

    return [share(ALL, [(seconds(every), seconds(Products(("slope",)))) for _ in range(ROUNDS)])]
