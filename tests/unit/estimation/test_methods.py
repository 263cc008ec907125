"""How good a window is: noise from neighbouring minutes, the alarm of chi-square, kelvin per degree."""

import numpy as np
import pytest
from scipy.stats import chi2

from fieldkit.estimation.balance import Rows
from fieldkit.estimation.methods import chi_square_limit, noise_ratio, solutions, sunlit
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.slopes import kelvin_per_degree
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import SlopeState
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


def test_a_row_with_no_more_light_than_its_own_shade_has_is_not_used():
    y = np.array([[0.059, 0.06, 0.5, 0.19, 0.2]]).T
    sigma = np.array([[0.01, 0.01, 0.01, 0.05, 0.05]]).T
    shade = np.array([0.0, 0.0, 0.0, 0.1, 0.1])
    # two of the cosine that counts as grazing (0.03), or of the noise where that is more
    assert sunlit(y, sigma, shade)[:, 0].tolist() == [False, True, True, False, True]
    assert not sunlit(y, sigma, shade + 0.5).any()


def test_minutes_that_no_slope_agrees_to_be_sunlit_in_give_no_slope():
    """Noon, 60 and 75 degrees later, latitude 40: the slope that fits faces away from one of the three."""
    hour_angle, latitude = np.radians([0.0, 60.0, 75.0]), np.radians(40.0)
    height = np.cos(hour_angle)
    sun = np.stack([-np.sin(hour_angle), -height * np.sin(latitude), height * np.cos(latitude)], axis=-1)
    y, sigma, level = np.array([[0.1], [0.3], [1.0]]), np.full((3, 1), 0.01), np.array([0.0, 0.0, 1.0])
    no_effects, no_light = np.zeros((1, 3, 1)), np.zeros((0, 3, 4))
    ones = np.ones(3)
    rows = Rows(sun, y, sigma, ones[:, np.newaxis], ones, no_effects, level, sun, 0.0 * ones, no_light)
    settings = EstimatorSettings(model="paper", tilt_limit_deg=90.0)
    (found,) = solutions(rows, [0], sigma.T**-2, [Region("b", RegionKind.TARGET, ((0.0, 0.0),))], settings)
    assert found.state is SlopeState.NO_INTERSECTION
    assert not found.explained
    assert "own shade" in found.reason
