"""The study's robust estimate of a slope: outliers, and both branches of the fold."""

import numpy as np
import pytest

from fieldkit.estimation.normal import Misfit, choose, solve
from fieldkit.physics.facet import angle_between_deg, normal, tilt_azimuth
from fieldkit.study.posterior import posterior
from tests.harness.papers_field import suns


def sun(minutes: int) -> np.ndarray:
    return suns("2017-08-30T03:00", minutes)


def test_noiseless_minutes_give_the_slope():
    rays, truth = sun(61), normal(12.4, 61.0)
    estimate = posterior(rays, rays @ truth, np.full(61, 4e4), 45.0)
    assert angle_between_deg(estimate, truth) < 0.3


def test_wild_minutes_are_hardly_heard():
    rays, truth = sun(61), normal(12.4, 61.0)
    random = np.random.default_rng(3)
    y = rays @ truth + 0.005 * random.standard_normal(61)
    wild = random.choice(61, 9, replace=False)
    y[wild] += random.choice([-1, 1], 9) * random.uniform(0.04, 0.08, 9)
    estimate = posterior(rays, y, np.full(61, 4e4), 45.0)
    misfit = Misfit.of_rows(rays, y, 4e4)
    plain = choose(misfit, solve(misfit), 45.0).best
    assert angle_between_deg(estimate, truth) < 2.0
    assert angle_between_deg(estimate, truth) < angle_between_deg(plain, truth)


def test_of_two_branches_the_flatter_is_preferred():
    rays, truth = sun(21), normal(20.0, 180.0)
    estimate = posterior(rays, rays @ truth, np.full(21, 3e4), 45.0)
    # the prior, uniform in tilt, prefers the flatter one
    assert tilt_azimuth(estimate)[0] < 27.0


@pytest.mark.slow
def test_outliers_cost_at_most_a_third_of_the_accuracy():
    rays, random = sun(21), np.random.default_rng(12)
    truths = normal(random.uniform(0, 30, 800), random.uniform(0, 360, 800))
    sigma = np.sqrt(2.0) * 31.0 * 0.1 / 800.0
    clean = truths @ rays.T + sigma * random.standard_normal((800, 21))
    wild = random.random(clean.shape) < 0.15
    size = random.choice([-1, 1], clean.shape) * random.uniform(1.0, 2.0, clean.shape) * 31.0 / 800.0
    errors = [
        [angle_between_deg(posterior(rays, row, np.full(21, sigma**-2), 30.0), t) for row, t in pairs]
        for pairs in (zip(clean, truths, strict=True), zip(clean + wild * size, truths, strict=True))
    ]
    assert np.percentile(errors[1], 90) <= 1.3 * np.percentile(errors[0], 90)
