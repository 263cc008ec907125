"""What regions do alone is found in their minutes: white noise, and what passes one region for minutes."""

from types import SimpleNamespace

import numpy as np
import pytest

from fieldkit.estimation.learned.noise import OWN_K, OWN_MINUTES, noise_of


def minutes(white_k, own_k, gusts_k=1.0, count=3000, regions=4, seed=1, own_minutes=4.0):
    """Regions under common gusts of 10 min with noise and an Ornstein-Uhlenbeck process each."""
    random = np.random.default_rng(seed)

    def wandering(time, columns):
        kept = np.exp(-1.0 / time)
        found = np.zeros((count, columns))
        for i in range(1, count):
            found[i] = kept * found[i - 1] + np.sqrt(1.0 - kept**2) * random.standard_normal(columns)
        return found

    kelvin = 300.0 + gusts_k * wandering(10.0, 1) + own_k * wandering(own_minutes, regions)
    kelvin += white_k * random.standard_normal(kelvin.shape)
    seen = np.ones(regions, np.bool_)
    sun = {"shaded": np.zeros(regions), "sunlit": np.ones(regions)}
    return [SimpleNamespace(temperature_k=one, measured=seen, **sun) for one in kelvin]


@pytest.mark.parametrize(("white_k", "own_k"), [(0.05, 0.2), (0.02, 0.1), (0.05, 0.0)])
def test_both_deviations_are_found_under_gusts_that_all_share(white_k, own_k):
    found = noise_of(minutes(white_k, own_k), 0.1)
    assert found.white_k == pytest.approx(white_k, abs=0.01)
    assert found.own_k == pytest.approx(own_k, abs=0.025)
    assert found.own_minutes < 6.0


def test_what_regions_do_alone_for_longer_is_found_beside_slopes_that_differ():
    # a bed of 25 degrees takes a tenth more of every cloud than the mean of the others
    gusts_k = np.array([0.9, 1.0, 1.05, 1.1])
    alike, unlike = (noise_of(minutes(0.05, own_k, gusts_k, own_minutes=30.0), 0.1) for own_k in (0.0, 0.5))
    assert alike.own_k < 0.05
    assert alike.own_minutes < 6.0
    # a process without gusts of minutes; what these would show over the longest lag is taken off
    assert 0.25 < unlike.own_k < 0.5
    assert unlike.own_minutes > 10.0


def test_a_few_minutes_say_little_and_noise_is_never_more_than_configured():
    assert noise_of(minutes(0.01, 0.0, count=5), 0.05) == (0.05, OWN_K, OWN_MINUTES)
    assert noise_of(minutes(0.3, 0.0), 0.05).white_k == 0.05


def test_a_shadow_of_one_region_is_nothing_that_it_does_alone_for_longer():
    lit, cooled = minutes(0.05, 0.0), minutes(0.05, 0.0)
    for row in range(60, 90):
        cooled[row].temperature_k[1] -= 5.0
        cooled[row].sunlit = np.where(np.arange(len(cooled[row].shaded)) == 1, 0.0, 1.0)
    assert noise_of(cooled, 0.1).own_k == pytest.approx(noise_of(lit, 0.1).own_k, abs=0.02)
