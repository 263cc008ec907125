import numpy as np
import pytest

from fieldkit.physics.facet import angle_between_deg, cos_incidence, incidence_deg, normal, tilt_azimuth


def test_normals_of_the_compass_point_where_they_say():
    normals = normal([0.0, 90.0, 90.0, 90.0], [123.0, 0.0, 90.0, 180.0])
    expected = [[0, 0, 1], [0, 1, 0], [1, 0, 0], [0, -1, 0]]
    np.testing.assert_allclose(normals, expected, atol=1e-15)


def test_a_hair_west_of_north_stays_below_360():
    _, azimuth = tilt_azimuth([-1e-18, 1.0, 1.0])
    assert 0.0 <= azimuth < 360.0


def test_shapes_of_facets_and_suns_combine():
    facets, suns = normal(np.full((5, 7), 10.0), 180.0), normal([20.0, 30.0, 40.0], 100.0)
    assert cos_incidence(facets, suns).shape == (5, 7, 3)
    assert incidence_deg(facets, suns).shape == (5, 7, 3)
    assert cos_incidence(facets, suns[0]).shape == (5, 7)
    assert incidence_deg(facets, suns[0]).shape == (5, 7)


def test_microdegree_between_directions_is_resolved():
    # an arc cosine of 1 - 1.5e-16 would say 0 or 1.2e-6 degrees
    assert angle_between_deg(normal(30.0, 50.0), normal(30.000001, 50.0)) == pytest.approx(1e-6, rel=1e-6)
    assert angle_between_deg(normal(30.0, 50.0), -normal(30.0, 50.0)) == 180.0


@pytest.mark.parametrize("azimuth", [0.0, 90.0, 180.0, 270.0])
def test_a_flat_facet_has_azimuth_zero_whatever_it_was_made_of(azimuth):
    tilt, found = tilt_azimuth(2.0 * normal(0.0, azimuth))
    assert (tilt, found) == (0.0, 0.0)
