"""A known camera's pose from points projected by OpenCV, with and without noise."""

import cv2
import numpy as np
import pytest

from fieldkit.calibration.pose import QUANTITIES, fit_pose
from fieldkit.model.errors import CalibrationError
from fieldkit.physics.camera_geometry import Camera
from tests.harness.next_steps import at

TRUTH = Camera((354600.0, 3936200.0, 112.0), 20.0, -25.0, 4.0, 50.0, (120, 160))
POINTS = np.array([
    [354602.0, 3936215.0, 100.0], [354608.0, 3936217.0, 101.5], [354606.0, 3936228.0, 100.2],
    [354614.0, 3936232.0, 103.0], [354610.0, 3936221.0, 99.0], [354604.0, 3936223.0, 102.0],
])  # fmt: skip


def marked(noise_px=0.0, seed=1, lens=None):
    centre = np.asarray(TRUTH.position_m)
    intrinsics = np.array([[TRUTH.focal_px, 0, 79.5], [0, TRUTH.focal_px, 59.5], [0, 0, 1]])
    turned = cv2.Rodrigues(TRUTH.axes)[0]
    distortion = None if lens is None else np.array(lens)
    pixels = cv2.projectPoints(POINTS - centre, turned, np.zeros(3), intrinsics, distortion)[0]
    pixels = pixels.reshape(-1, 2)
    return pixels + noise_px * np.random.default_rng(seed).standard_normal(pixels.shape)


def numbers(camera):
    return np.array([*camera.position_m, camera.yaw_deg, camera.pitch_deg, camera.roll_deg, camera.hfov_deg])


@pytest.mark.parametrize(
    ("count", "hfov_deg", "grid_scale"), [(6, None, 1.0), (6, 50.0, 1.0), (4, 50.0, 1.0), (6, None, 1.008)]
)
def test_exact_marks_give_the_pose(count, hfov_deg, grid_scale):
    """Where all distances on the grid are longer, position and heights stay those on the ground."""
    points = (POINTS[:count] - TRUTH.position_m) * (grid_scale, grid_scale, 1.0) + TRUTH.position_m
    found = fit_pose(marked()[:count], points, TRUTH.shape, hfov_deg=hfov_deg, grid_scale=grid_scale)
    assert found.camera.grid_scale == grid_scale
    assert numbers(found.camera) == pytest.approx(numbers(TRUTH), abs=1e-3)
    assert found.residuals_px.max() < 1e-3
    assert (found.sd["hfov_deg"] == 0.0) == (hfov_deg is not None)


def test_stated_uncertainties_are_those_of_noisy_marks():
    fits = [
        fit_pose(marked(0.5, seed), POINTS, TRUTH.shape, hfov_deg=50.0, mark_sd_px=0.5) for seed in range(60)
    ]
    scatter = np.std([numbers(one.camera) for one in fits], axis=0)[:6]
    stated = np.median([[one.sd[name] for name in QUANTITIES[:6]] for one in fits], axis=0)
    assert stated == pytest.approx(scatter, rel=0.35)


@pytest.mark.parametrize(
    ("count", "hfov_deg"),
    [
        *((count, 50.0) for count in (4, 5, 6)),
        *(pytest.param(n, None, marks=pytest.mark.slow) for n in (4, 5)),
    ],
)
def test_twice_the_standard_uncertainty_covers_the_truth_with_few_points(count, hfov_deg):
    """Marks twice as far off as stated; without Student's factor it covered 79 to 92 %."""
    quantities = len(QUANTITIES) - (hfov_deg is not None)
    covered = []
    for seed in range(40):
        found = fit_pose(marked(2.0, seed)[:count], POINTS[:count], TRUTH.shape, hfov_deg=hfov_deg)
        off = np.abs(numbers(found.camera) - numbers(TRUTH))[:quantities]
        covered.append(off <= 2.0 * np.array([found.sd[name] for name in QUANTITIES[:quantities]]))
    assert np.mean(covered) > 0.94


@pytest.mark.parametrize("count", [0, 3])
def test_too_few_points_are_an_error(count):
    with pytest.raises(CalibrationError, match="needs 4 points"):
        fit_pose(marked()[:count], POINTS[:count], TRUTH.shape)


def test_the_pose_of_a_camera_with_a_distorting_lens_is_found():
    lens = (-0.3, 0.12, 0.001, -0.002, 0.0)
    found = fit_pose(marked(lens=lens), POINTS, TRUTH.shape, hfov_deg=50.0, distortion=lens)
    assert numbers(found.camera) == pytest.approx(numbers(TRUTH), abs=1e-3)
    without = fit_pose(marked(lens=lens), POINTS, TRUTH.shape, hfov_deg=50.0)
    assert without.residuals_px.max() > 0.2 > 1e-3 > found.residuals_px.max()


@pytest.mark.parametrize("place", [[5000.0, -300.0], [np.nan, 50.0], [160.0, 50.0]])
def test_a_mark_outside_the_frame_is_named(place):
    pixels = marked()
    pixels[2] = place
    with pytest.raises(CalibrationError, match=r"^point 3 at .*: .* 160 x 120 "):
        fit_pose(pixels, POINTS, TRUTH.shape)


def test_a_mistyped_coordinate_gives_no_pose():
    """Thirty metres to the east: 36 px of misfit gave a pose of 23 degrees, and the exit code of success."""
    points = POINTS.copy()
    points[1, 0] += 30.0
    with pytest.raises(CalibrationError, match="23 px", check=at("point 5")):
        fit_pose(marked(), points, TRUTH.shape, hfov_deg=50.0)


@pytest.mark.parametrize(
    "same", [(marked()[:1].repeat(6, axis=0), POINTS), (marked(), POINTS[:1].repeat(6, axis=0))]
)
def test_points_that_are_all_at_one_place_are_refused(same):
    with pytest.raises(CalibrationError):
        fit_pose(*same, TRUTH.shape, hfov_deg=50.0)
