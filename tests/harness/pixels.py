"""Simulated pixels with known slopes, mapped as by `fieldkit map`: for tests and the figure of risk."""

from __future__ import annotations

import math

import numpy as np

from fieldkit.estimation.pixel_posterior import PixelPosterior
from fieldkit.estimation.pixel_slopes import MapSums, SlopeMap, posterior
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.arrays import AnyArray, FloatArray
from fieldkit.physics.facet import VERTICAL, normal
from tests.harness.papers_field import SURFACE, suns, temperatures_k

SETTINGS = EstimatorSettings(model="full", scale_sd=0.0, offset_sd_k=0.0, drift_sd_k_per_h=0.0, noise_k=0.05)


def add_frame(sums: MapSums, normals: AnyArray, ray: AnyArray, error_k: FloatArray | float = 0.0) -> None:
    """A frame of slopes, beside the temperature of level ground in the same sun."""
    frame_k = temperatures_k(normals, ray) + error_k
    sums.add(frame_k, float(temperatures_k(VERTICAL, ray)), ray, 800.0, VERTICAL)


def simulated(
    tilt_deg: FloatArray, azimuth_deg: FloatArray, minutes: int = 20, noise_k: float = 0.05, seed: int = 4
) -> tuple[SlopeMap, PixelPosterior]:
    """Slopes seen from 11:00 JST, one frame a minute, with a noise of target and reference."""
    truth, random = normal(tilt_deg, azimuth_deg), np.random.default_rng(seed)
    sums = MapSums(np.shape(tilt_deg), SURFACE, noise_k, SETTINGS.tilt_limit_deg)
    for ray in suns("2017-08-30T02:00", minutes):
        add_frame(sums, truth, ray, math.sqrt(2.0) * noise_k * random.standard_normal(np.shape(tilt_deg)))
    slopes = sums.solve()
    return slopes, posterior(slopes, sums, VERTICAL, SETTINGS)


def drawn(pixels: int, seed: int = 3) -> tuple[FloatArray, FloatArray]:
    """Slopes of the map's prior: uniform in tilt and azimuth up to the limit."""
    random = np.random.default_rng(seed)
    return random.uniform(0.0, 45.0, (20, pixels // 20)), random.uniform(0.0, 360.0, (20, pixels // 20))
