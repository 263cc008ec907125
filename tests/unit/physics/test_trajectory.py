"""Poses over time, and the ground as two of them see it."""

import numpy as np
import pytest

from fieldkit.physics.camera_geometry import Camera, Heights, is_hidden, project
from fieldkit.physics.trajectory import CameraPath, Trajectory, homography_over_level

EAST = (-0.5, 0.5, -0.5, 0.5)
"""Level to the east in ROS's optical frame, REP 103."""
SOUTH = (0.0, 0.5**0.5, -(0.5**0.5), 0.0)


def test_poses_are_moved_and_turned_evenly_and_end_with_the_trajectory():
    path = Trajectory((0, 10, 30), ((0.0, 0.0, 2.0), (1.0, 0.0, 2.0), (1.0, 4.0, 2.0)), (EAST, EAST, SOUTH))
    camera = CameraPath(path, 50.0, true_north_deg=1.0).camera(20, (120, 160))
    assert camera.position_m == (1.0, 2.0, 2.0)
    assert (camera.yaw_deg, camera.pitch_deg) == pytest.approx((136.0, 0.0), abs=1e-6)
    assert path.at(30)[0] == (1.0, 4.0, 2.0)
    assert path.at(-1) is path.at(31) is None


def test_a_single_pose_holds_at_any_time():
    assert Trajectory((0,), ((1.0, 2.0, 3.0),), (EAST,)).at(10**18) == ((1.0, 2.0, 3.0), EAST)


@pytest.mark.parametrize("scale", [1.0, 1.008])
def test_level_ground_lies_in_one_frame_where_the_homography_maps_it_from_another(scale):
    one = Camera((3.0, 5.0, 8.0), 20.0, -40.0, 3.0, 50.0, (120, 160), grid_scale=scale)
    other = Camera((4.5, 4.0, 9.0), 35.0, -55.0, -2.0, 50.0, (120, 160), grid_scale=scale)
    ground = np.column_stack([np.linspace(4.0, 9.0, 7), np.linspace(9.0, 14.0, 7) ** 1.02, np.full(7, 1.5)])
    x, y, _ = project(one, ground)
    mapped = np.column_stack([x, y, np.ones(7)]) @ homography_over_level(one, other, 1.5).T
    assert mapped[:, :2] / mapped[:, 2:] == pytest.approx(
        np.column_stack(project(other, ground)[:2]), abs=1e-9
    )


def test_ground_behind_a_wall_is_hidden_and_its_own_ground_hides_nothing():
    """A wall of 3 m at 10 m from an eye at 2 m."""
    heights = np.zeros((20, 40))
    heights[:, 20] = 3.0
    ground = Heights(0.0, 20.0, 1.0, heights)
    points = np.array([[30.5, 10.0, 0.0], [15.5, 10.0, 0.0]])
    assert is_hidden(ground, (10.5, 10.0, 2.0), points, 2.0).tolist() == [True, False]
    # the ray to a point 20 m away passes the wall, half way, at 6 m
    assert is_hidden(ground, (10.5, 10.0, 12.0), points, 2.0).tolist() == [False, False]
