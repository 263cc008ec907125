"""Pinhole geometry against OpenCV's projection, and on a terrain with a ridge and a crater."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fieldkit.physics.camera_geometry import (
    Camera,
    Heights,
    angles_of_quaternion,
    distances_to_ground_m,
    distances_to_plane_m,
    project,
    project_to_frame,
    rays,
)

CAMERA = Camera((500.0, 200.0, 12.0), 20.0, -25.0, 4.0, 50.0, (120, 160))


def terrain(east, north):
    """A ridge to the north, a crater before it, flat elsewhere."""
    ridge = 3.0 * np.exp(-(((north - 236.0) / 3.0) ** 2))
    crater = -1.5 * np.exp(-((east - 506.0) ** 2 + (north - 222.0) ** 2) / 8.0)
    return ridge + crater


@pytest.fixture(scope="module")
def ground():
    cells = 0.5 * (np.arange(200) + 0.5)
    east, north = np.meshgrid(460.0 + cells, 290.0 - cells)
    return Heights(460.0, 290.0, 0.5, terrain(east, north))


def test_axis_of_a_level_camera_to_the_east():
    right, down, forward = Camera((0.0, 0.0, 0.0), 90.0, 0.0, 0.0, 50.0, (3, 5)).axes
    assert right == pytest.approx([0.0, -1.0, 0.0], abs=1e-12)
    assert down == pytest.approx([0.0, 0.0, -1.0], abs=1e-12)
    assert forward == pytest.approx([1.0, 0.0, 0.0], abs=1e-12)


def test_what_is_behind_the_camera_has_no_pixel():
    assert np.isnan(project(CAMERA, [500.0, 150.0, 12.0])[0])


def test_level_ground_as_a_grid_and_as_a_plane_are_the_same(ground):
    level = Heights(ground.west_m, ground.north_m, ground.cell_m, np.full((200, 200), 0.25))
    on_grid, on_plane = distances_to_ground_m(CAMERA, level, 60.0), distances_to_plane_m(CAMERA, 0.25)
    met = np.isfinite(on_grid)
    assert met.mean() > 0.7
    assert on_grid[met] == pytest.approx(on_plane[met], abs=1e-3)
    assert np.isnan(distances_to_plane_m(Camera((0, 0, 5), 0, 30, 0, 20, (4, 4)), 0.0)).all()


def test_rays_meet_the_near_side_of_the_ridge(ground):
    away = distances_to_ground_m(CAMERA, ground, 90.0)
    points = CAMERA.position_m + away[..., np.newaxis] * rays(CAMERA)
    met = np.isfinite(away)
    east, north, up = points[met].T
    assert up == pytest.approx(terrain(east, north), abs=0.05)  # bilinear between cells of half a metre
    row, _, seen = project_to_frame(CAMERA, np.array([[505.0, 235.0, terrain(505.0, 235.0)]]), away, 0.5)
    assert seen.all()
    assert 0 <= row[0] < 120


def test_a_low_camera_does_not_see_behind_the_ridge(ground):
    low = Camera((500.0, 200.0, 2.0), 0.0, 0.0, 0.0, 50.0, (120, 160))
    away = distances_to_ground_m(low, ground, 90.0)
    before, behind = (np.array([500.0, north, float(terrain(500.0, north))]) for north in (234.0, 245.0))
    assert project_to_frame(low, before, away, 0.5)[2]
    assert not project_to_frame(low, behind, away, 0.5)[2]


LENSES = [(), (-0.30, 0.12, 0.001, -0.002, -0.02), (0.08, 0.02, -0.003, 0.001, 0.0)]


@pytest.mark.parametrize("lens", LENSES)
def test_points_are_shown_where_opencv_projects_them(lens):
    camera = replace(CAMERA, distortion=lens)
    points = np.asarray(camera.position_m) + 9.0 * rays(CAMERA).reshape(-1, 3)
    x, y, _ = project(camera, points)
    focal = camera.focal_px
    intrinsics = np.array([[focal, 0, 79.5], [0, focal, 59.5], [0, 0, 1.0]])
    seen = (points - camera.position_m) @ camera.axes.T
    coefficients = np.array(lens) if lens else None
    expected = cv2.projectPoints(seen, np.zeros(3), np.zeros(3), intrinsics, coefficients)[0].reshape(-1, 2)
    assert np.column_stack([x, y]) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("lens", LENSES)
def test_the_ray_of_each_pixel_leads_back_to_it(lens):
    camera = replace(CAMERA, distortion=lens)
    x, y, away = project(camera, np.asarray(camera.position_m) + 30.0 * rays(camera))
    assert away == pytest.approx(np.full((120, 160), 30.0))
    assert x == pytest.approx(np.tile(np.arange(160.0), (120, 1)), abs=1e-6)
    assert y == pytest.approx(np.tile(np.arange(120.0)[:, np.newaxis], (1, 160)), abs=1e-6)


def test_what_lies_where_the_lens_model_folds_back_is_not_seen():
    camera = replace(CAMERA, distortion=(-0.3, 0.0, 0.0, 0.0, 0.0))
    right, _, forward = camera.axes
    x, y, _ = project(camera, np.asarray(camera.position_m) + forward + 1.8 * right)
    assert np.isnan([x, y]).all()


@pytest.mark.parametrize("angles", [(20.0, -25.0, 4.0), (-170.0, 10.0, -95.0), (0.0, -90.0, 30.0)])
def test_a_quaternion_has_the_angles_of_the_axes_that_it_turns(angles):
    axes = Camera((0.0, 0.0, 0.0), *angles, 50.0, (3, 5)).axes
    found = angles_of_quaternion(Rotation.from_matrix(axes.T).as_quat())
    assert Camera((0.0, 0.0, 0.0), *found, 50.0, (3, 5)).axes == pytest.approx(axes, abs=1e-9)
