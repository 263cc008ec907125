"""The horizon: expected values follow from a straight line between two points, and from closed forms."""

import numpy as np
import pytest

from fieldkit.physics.facet import normal
from fieldkit.physics.horizon import (
    SUN_RADIUS_DEG,
    higher_horizon,
    horizon_elevation,
    horizon_of_neighbours,
    sky_view_factor,
    sunlit_share,
)


def test_elevation_is_linear_and_goes_on_across_north():
    horizon = [(350.0, 10.0), (10.0, 20.0), (180.0, 0.0)]
    np.testing.assert_allclose(
        horizon_elevation(horizon, [0.0, 360.0, 355.0, 95.0]), [15.0, 15.0, 12.5, 10.0]
    )
    assert horizon_elevation([], [12.0, 200.0]).tolist() == [0.0, 0.0]


def test_the_sun_is_hidden_where_it_is_lower_than_the_ridge():
    sun = normal([75.0, 65.0, 70.0], 90.0)  # elevations of 15, 25 and 20 degrees in the east
    assert sunlit_share([(0.0, 20.0)], sun).tolist() == pytest.approx([0.0, 1.0, 0.5])
    upper_limb = normal(70.0 + SUN_RADIUS_DEG, 90.0)
    assert sunlit_share([(0.0, 20.0)], upper_limb) == pytest.approx(0.0, abs=1e-9)
    cliff = [(0.0, 0.0), (90.0 - 1e-6, 0.0), (90.0, 80.0), (180.0, 80.0)]  # from the east on
    assert sunlit_share(cliff, normal(60.0, [89.0, 90.0, 91.0])).tolist() == pytest.approx([1.0, 0.5, 0.0])
    assert sunlit_share([], sun).tolist() == [1.0, 1.0, 1.0]


@pytest.mark.parametrize("elevation", [0.0, 10.0, 45.0, 80.0])
def test_an_even_horizon_leaves_the_squared_cosine_of_the_sky(elevation):
    assert sky_view_factor([(0.0, elevation)]) == pytest.approx(np.cos(np.radians(elevation)) ** 2)


@pytest.mark.parametrize("elevation", [5.0, 30.0, 60.0])
def test_an_endless_ridge_leaves_the_sky_of_a_tilted_plane(elevation):
    """Its plane through the place hides what a facet of that tilt cannot see: (1 - cos) / 2 of the sky."""
    azimuths = np.arange(0.0, 360.0, 0.5)
    facing = np.maximum(np.cos(np.radians(azimuths)), 0.0)
    heights = np.degrees(np.arctan(np.tan(np.radians(elevation)) * facing))
    horizon = list(zip(azimuths.tolist(), heights.tolist(), strict=True))
    assert sky_view_factor(horizon) == pytest.approx((1.0 + np.cos(np.radians(elevation))) / 2.0, abs=1e-5)


def test_what_lies_lower_than_level_hides_nothing():
    assert sky_view_factor([(0.0, -20.0)]) == 1.0


BED = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])


def test_a_step_beside_a_bed_is_as_high_as_its_triangle():
    """Level, half a metre higher, from one to two metres east of the bed: its near edge, then its corners."""
    horizon = horizon_of_neighbours(BED, [BED + np.array([2.0, 0.0, 0.5])])
    found = horizon_elevation(horizon, [90.0, 60.0, 120.0, 46.0, 44.9, 270.0])
    expected = [0.5, *[0.5 * np.sin(np.radians(azimuth)) for azimuth in (60.0, 120.0, 46.0)], 0.0, 0.0]
    np.testing.assert_allclose(found, np.degrees(np.arctan(expected)), atol=1e-9)


def test_the_highest_edge_of_a_tilted_bed_counts():
    """One that rises from the bed's level, 1 m east, to 0.6 m over it, 2 m east: 0.6 / 2 beats 0 / 1."""
    risen = BED + np.array([2.0, 0.0, 0.0])
    risen[1:3, 2] = 0.6
    horizon = horizon_of_neighbours(BED, [risen])
    assert horizon_elevation(horizon, 90.0) == pytest.approx(np.degrees(np.arctan(0.6 / 2.0)))


def test_a_narrow_neighbour_shades_the_middle_of_a_long_bed():
    """A post 1 m north of a bed of 10 m, at azimuths where a line from neither end meets it."""
    long_bed = BED * [10.0, 1.0, 1.0]
    post = BED * [0.2, 0.2, 0.0] + np.array([5.0, 2.0, 0.5])
    assert horizon_elevation(horizon_of_neighbours(long_bed, [post]), [0.0, 180.0]) == pytest.approx(
        [np.degrees(np.arctan(0.5)), 0.0]
    )


def test_lower_neighbours_hide_nothing():
    assert {up for _, up in horizon_of_neighbours(BED, [BED + np.array([2.0, 0.0, -0.5])])} == {0.0}
    assert {up for _, up in horizon_of_neighbours(BED, [])} == {0.0}


def test_of_two_horizons_the_higher_one_counts_at_every_azimuth():
    ridge = [(0.0, 10.0), (180.0, 0.0)]
    bank = [(90.0, 20.0), (90.1, 0.0), (270.0, 0.0), (269.9, 0.0), (89.9, 0.0)]
    found = higher_horizon(ridge, bank)
    assert horizon_elevation(found, [0.0, 90.0, 180.0]).tolist() == pytest.approx([10.0, 20.0, 0.0])
    assert higher_horizon(ridge, ()) == ridge
    assert higher_horizon((), ridge) == ridge
