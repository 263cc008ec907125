"""Risk and uncertainty of pixels, against the truth of many simulated ones and against `tilt_probability`."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fieldkit.estimation.pixel_posterior import PixelPosterior
from fieldkit.estimation.pixel_slopes import MapSums, posterior, with_bounds
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.tilt_probability import tilt_probability
from fieldkit.model.site import Site
from fieldkit.model.slope import SlopeEstimate, SlopeState
from fieldkit.physics.energy_balance import SurfaceParameters, surface_temperature
from fieldkit.physics.facet import VERTICAL, normal, tilt_azimuth
from fieldkit.physics.sun import sun_vectors

SITE = Site(35.558675, 139.395232, 9.0)
PAPER = SurfaceParameters()
SETTINGS = EstimatorSettings(model="full", scale_sd=0.0, offset_sd_k=0.0, drift_sd_k_per_h=0.0, noise_k=0.05)


def temperatures(normals, ray):
    return surface_temperature(800.0 * np.maximum(normals @ ray, 0.0), 400.0, 303.15, PAPER)


def simulated(tilt_deg, azimuth_deg, minutes=20, noise_k=0.05, seed=4):
    """Slopes seen from 11:00 JST, one frame a minute, with a noise of target and reference."""
    start = int(np.datetime64("2017-08-30T02:00", "ns").astype(np.int64))
    truth, random = normal(tilt_deg, azimuth_deg), np.random.default_rng(seed)
    sums = MapSums(np.shape(tilt_deg), PAPER, noise_k, SETTINGS.tilt_limit_deg)
    for ray in sun_vectors(start + np.arange(minutes) * 60_000_000_000, SITE):
        frame_k = temperatures(truth, ray) + math.sqrt(2.0) * noise_k * random.standard_normal(
            np.shape(tilt_deg)
        )
        sums.add(frame_k, float(temperatures(VERTICAL, ray)), ray, 800.0, VERTICAL)
    slopes = sums.solve()
    return slopes, posterior(slopes, sums, VERTICAL, SETTINGS)


def drawn(pixels, seed=3):
    """Slopes of the map's prior: uniform in tilt and azimuth up to the limit."""
    random = np.random.default_rng(seed)
    return random.uniform(0.0, 45.0, (20, pixels // 20)), random.uniform(0.0, 360.0, (20, pixels // 20))


@pytest.mark.parametrize("pixels", [2000, pytest.param(40_000, marks=pytest.mark.slow)])
def test_of_pixels_that_are_as_likely_steeper_as_not_about_half_are(pixels):
    tilt, azimuth = drawn(pixels)
    steeper = total = 0
    for limit in range(5, 41, 5):
        probability = simulated(tilt, azimuth)[1].risk(limit)[0]
        even = (probability > 0.4) & (probability < 0.6)
        steeper, total = steeper + int((tilt[even] > limit).sum()), total + int(even.sum())
    assert total > pixels / 20
    assert 0.4 < steeper / total < 0.6


def test_risk_agrees_with_that_of_a_region_with_the_same_bounds():
    tilt, azimuth = np.tile(np.linspace(8.0, 25.0, 30), (2, 1)), np.tile([[90.0], [270.0]], (1, 30))
    slopes, likelihood = simulated(tilt, azimuth, minutes=60)
    probability = likelihood.risk(15.0)[0]
    slopes, bounds = with_bounds(slopes, likelihood, SETTINGS)
    of_regions = np.array([
        tilt_probability(
            SlopeEstimate(
                0, "b", SlopeState.OK, slopes.tilt_deg[at], slopes.azimuth_deg[at], bounds.tilt_low_deg[at],
                bounds.tilt_high_deg[at], bounds.azimuth_low_deg[at], bounds.azimuth_high_deg[at],
            ), 15.0,
        ) for at in np.ndindex(tilt.shape)
    ]).reshape(tilt.shape)  # fmt: skip
    assert np.isfinite(of_regions).mean() > 0.9
    assert np.nanmax(np.abs(probability - of_regions)) < 0.1


def test_deviations_cover_two_thirds_of_the_truths():
    tilt, azimuth = np.full((20, 50), 18.0), np.full((20, 50), 60.0)
    slopes, likelihood = simulated(tilt, azimuth, minutes=60)
    measures = {"tilt": lambda n: tilt_azimuth(n)[0], "heading": lambda n: tilt_azimuth(n)[1]}
    found = likelihood.deviations(measures, cyclic=frozenset({"heading"}))
    assert np.mean(np.abs(slopes.tilt_deg - tilt) < found["tilt"]) == pytest.approx(0.68, abs=0.06)
    assert np.mean(np.abs(slopes.azimuth_deg - azimuth) < found["heading"]) == pytest.approx(0.68, abs=0.06)


def test_value_at_risk_is_the_mean_of_the_steepest_tenth():
    """Of a normal distribution 1.755 standard deviations above its mean (Rockafellar and Uryasev 2000)."""
    at = normal([[20.0]], [[0.0]])[0]
    axes = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    sd = math.radians(0.5)  # of tilt; its sine is what has this covariance
    covariance = np.diag([(sd * math.cos(math.radians(20.0))) ** 2, 1e-10])[np.newaxis]
    one = PixelPosterior(np.ones((1, 1), np.bool_), at @ axes.T, covariance, np.zeros(1), axes, 45.0)
    probability, worst = one.risk(20.0)
    assert worst == pytest.approx(20.0 + 1.755 * 0.5, abs=0.05)
    assert probability == pytest.approx(0.5, abs=0.03)


def test_pixels_without_a_slope_have_no_risk():
    tilt, azimuth = np.full((2, 3), 80.0), np.full((2, 3), 0.0)
    assert np.isnan(simulated(tilt, azimuth)[1].risk(15.0)).all()
