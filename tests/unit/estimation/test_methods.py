"""How good a window is: noise from neighbouring minutes, the alarm of chi-square, kelvin per degree."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from fieldkit.estimation.methods import chi_square_limit, kelvin_per_degree, noise_ratio, sunlit
from fieldkit.physics.energy_balance import SurfaceParameters, irradiance_per_kelvin, surface_temperature
from fieldkit.physics.facet import normal

TABLE_1 = SurfaceParameters()


@pytest.mark.parametrize("sd", [2.0, 3.0])
def test_noise_that_is_larger_than_stated_is_measured(sd):
    """Second differences of white noise have six times its variance, whatever slow curve lies below."""
    random = np.random.default_rng(4)
    slow = 5.0 * np.linspace(-1.0, 1.0, 4000) ** 2
    assert noise_ratio(slow + sd * random.standard_normal(4000)) == pytest.approx(sd**2, rel=0.1)


def test_noise_as_stated_or_quieter_changes_nothing():
    random = np.random.default_rng(5)
    for sd in (0.3, 1.0):
        assert noise_ratio(sd * random.standard_normal(40)) == 1.0
    assert noise_ratio(10.0 * random.standard_normal(9)) == 1.0  # too few


@pytest.mark.parametrize("freedom", [5, 18, 100])
def test_one_good_window_in_a_hundred_is_called_a_bad_one(freedom):
    assert chi_square_limit(freedom) == pytest.approx(chi2.ppf(0.99, freedom) / freedom, rel=1e-6)


@pytest.mark.parametrize("zenith_azimuth", [(55.0, 180.0), (55.0, 0.0), (20.0, 120.0)])
def test_kelvin_per_degree_is_the_derivative_of_eq_7(zenith_azimuth):
    """A bed towards the sun warms as it is tilted more, one away from it cools."""
    direction = normal(*zenith_azimuth)

    def kelvin(tilt_deg):
        light = 800.0 * float(normal(tilt_deg, 180.0) @ direction)
        return float(surface_temperature(light, 300.0, 290.0, TABLE_1))

    y_per_kelvin = float(irradiance_per_kelvin(kelvin(15.0), TABLE_1)) / 800.0
    expected = (kelvin(15.1) - kelvin(14.9)) / 0.2
    assert kelvin_per_degree(15.0, 180.0, direction, y_per_kelvin) == pytest.approx(expected, rel=1e-3)


def test_a_row_within_two_sigmas_of_no_light_is_in_the_shade():
    assert sunlit(np.array([0.019, 0.02, 0.5]), np.array([0.01, 0.01, 0.01])).tolist() == [False, True, True]
