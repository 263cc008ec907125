"""The horizon: expected values follow from a straight line between two points."""

import numpy as np

from fieldkit.physics.facet import normal
from fieldkit.physics.horizon import horizon_elevation, is_below_horizon


def test_elevation_is_linear_and_goes_on_across_north() -> None:
    horizon = [(350.0, 10.0), (10.0, 20.0), (180.0, 0.0)]
    np.testing.assert_allclose(
        horizon_elevation(horizon, [0.0, 360.0, 355.0, 95.0]), [15.0, 15.0, 12.5, 10.0]
    )


def test_the_sun_is_hidden_where_it_is_lower_than_the_ridge() -> None:
    sun = normal([75.0, 65.0], 90.0)  # elevations of 15 and 25 degrees in the east
    assert is_below_horizon([(0.0, 20.0)], sun).tolist() == [True, False]
    assert not is_below_horizon([], sun).any()
