"""Simulated pixels with known slopes, mapped as by `fieldkit map`: for tests and the figure of risk."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from fieldkit.estimation.pixel_posterior import PixelPosterior
from fieldkit.estimation.pixel_slopes import MapSums, SlopeMap, posterior
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.arrays import AnyArray, FloatArray
from fieldkit.physics.energy_balance import irradiance_difference, irradiance_per_kelvin
from fieldkit.physics.facet import VERTICAL, normal
from tests.harness.papers_field import SURFACE, suns, temperatures_k

SETTINGS = EstimatorSettings(model="full", scale_sd=0.0, offset_sd_k=0.0, drift_sd_k_per_h=0.0, noise_k=0.05)


def sums_of_frames(
    frames_k: Sequence[AnyArray], level_k: Sequence[float], suns: AnyArray, noise_k: float, dni: float = 800.0
) -> MapSums:
    """Frames (rows, cols) by the paper's eq. (6), beside temperatures of level ground in the same suns."""
    kelvin, reference_k = np.reshape(frames_k, (len(suns), -1)), np.asarray(level_k)[:, np.newaxis]
    per_kelvin = irradiance_per_kelvin(reference_k, SURFACE) / dni
    sd = math.sqrt(2.0) * noise_k * per_kelvin

    def values(piece: slice) -> FloatArray:
        light = irradiance_difference(kelvin[:, piece], reference_k, SURFACE) / dni
        return np.asarray((light + suns[:, 2:]) / sd)

    mean_per_kelvin = float(np.sum(per_kelvin / sd**2) / np.sum(sd**-2.0))
    towards = np.sum(suns / sd**2, axis=0)
    return MapSums.of(np.shape(frames_k[0]), suns / sd, towards, values, mean_per_kelvin)


def sums_of_slopes(
    normals: AnyArray, suns: AnyArray, noise_k: float, errors_k: Iterable[AnyArray]
) -> MapSums:
    """A frame of slopes under each sun with an error of its own, beside level ground without."""
    frames_k = [temperatures_k(normals, ray) + error for ray, error in zip(suns, errors_k, strict=True)]
    return sums_of_frames(frames_k, [float(temperatures_k(VERTICAL, ray)) for ray in suns], suns, noise_k)


def simulated(
    tilt_deg: FloatArray, azimuth_deg: FloatArray, minutes: int = 20, noise_k: float = 0.05, seed: int = 4
) -> tuple[SlopeMap, PixelPosterior]:
    """Slopes seen from 11:00 JST, one frame a minute, with a noise of target and reference."""
    truth, random = normal(tilt_deg, azimuth_deg), np.random.default_rng(seed)
    errors_k = math.sqrt(2.0) * noise_k * random.standard_normal((minutes, *np.shape(tilt_deg)))
    sums = sums_of_slopes(truth, suns("2017-08-30T02:00", minutes), noise_k, errors_k)
    slopes = sums.solve(SETTINGS)
    return slopes, posterior(slopes, sums, VERTICAL, SETTINGS)


def drawn(pixels: int, seed: int = 3) -> tuple[FloatArray, FloatArray]:
    """Slopes of the map's prior: uniform in tilt and azimuth up to the limit."""
    random = np.random.default_rng(seed)
    return random.uniform(0.0, 45.0, (20, pixels // 20)), random.uniform(0.0, 360.0, (20, pixels // 20))
