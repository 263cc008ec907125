"""Risk and uncertainty of pixels, against the truth of many simulated ones and against `tilt_probability`."""

import math

import numpy as np
import pytest

from fieldkit.estimation.pixel_posterior import PixelPosterior
from fieldkit.estimation.pixel_slopes import with_bounds
from fieldkit.estimation.tilt_probability import tilt_probability
from fieldkit.model.slope import SlopeEstimate, SlopeState
from fieldkit.physics.facet import normal, tilt_azimuth
from tests.harness.pixels import SETTINGS, drawn, simulated


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
