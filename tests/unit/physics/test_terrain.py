"""Expected values by hand: right triangles with sides in whole numbers, and the integral of a sine."""

import numpy as np
import pytest

from fieldkit.physics.facet import VERTICAL, tilt_azimuth
from fieldkit.physics.terrain import climb_deg, northerly_tilt_deg, sunlit_cosine

FACING_EAST = np.array([0.6, 0.0, 0.8])  # 3-4-5: falls to the east by 3 in 4
NORTH_EAST = np.array([2.0, 3.0, 6.0]) / 7.0  # 4 + 9 + 36 = 49


def test_slope_and_heading_of_hand_computed_normals():
    tilt, azimuth = tilt_azimuth(np.array([FACING_EAST, 7.0 * NORTH_EAST]))  # of any length
    assert tilt == pytest.approx([36.8698976, 31.0027191], abs=1e-6)  # arc cosines of 4/5 and 6/7
    assert azimuth == pytest.approx([90.0, 33.6900675], abs=1e-6)  # arc tangent of 2/3


@pytest.mark.parametrize(
    ("azimuth", "expected"),
    # the last is arctan(0.6 * 0.6 / 0.8)
    [(90.0, -36.8698976), (270.0, 36.8698976), (0.0, 0.0), (36.8698976, -24.2277453)],
)
def test_a_drive_climbs_against_the_way_the_ground_faces(azimuth, expected):
    assert climb_deg(FACING_EAST, azimuth) == pytest.approx(expected, abs=1e-6)


def test_northerly_tilt_is_the_slope_in_the_meridian_plane():
    found = northerly_tilt_deg(np.array([NORTH_EAST, FACING_EAST, VERTICAL, [0.0, -0.6, 0.8]]))
    assert found == pytest.approx([26.5650512, 0.0, 0.0, -36.8698976], abs=1e-6)  # arc tangent of 3/6


def test_share_of_an_equinox_sun_over_the_equator():
    """The sun on a circle through east, zenith and west: level ground gets 1/pi of it over the day."""
    angle = 2.0 * np.pi * (np.arange(86_400) + 0.5) / 86_400
    suns = np.column_stack([np.cos(angle), np.zeros(angle.size), np.sin(angle)])
    found = sunlit_cosine(np.array([VERTICAL, FACING_EAST, [0.0, 0.6, 0.8]]), suns)
    # facing east at t: (1 + cos t) / 2 pi, lit from sunrise until the sun is t short of west
    assert found == pytest.approx([1.0 / np.pi, 1.8 / (2.0 * np.pi), 0.8 / np.pi], abs=1e-6)
