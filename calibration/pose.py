"""Pose of a camera from ground points marked in its frame, by least squares on their pixels.

It starts from OpenCV's SQPnP (G. Terzakis and M. Lourakis, "A consistently fast and globally optimal solution
to the perspective-n-point problem", ECCV 2020) for each of some fields of view.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from fieldkit.calibration.uncertainty import students_factor
from fieldkit.model.arrays import FloatArray
from fieldkit.model.errors import CalibrationError
from fieldkit.model.next_step import Argument
from fieldkit.physics.camera_geometry import Camera, angles_of_axes, project

LEAST_POINTS, WORST_MARK = 4, 10.0
"""Points of a pose; standard uncertainties by which the worst mark may be off."""
FIELDS_DEG = (10.0, 20.0, 35.0, 50.0, 70.0, 95.0)
"""Horizontal fields of view to start from where it is not known."""
WORST_CONDITION = 1e7
QUANTITIES = ("east_m", "north_m", "height_m", "yaw_deg", "pitch_deg", "roll_deg", "hfov_deg")


@dataclass(frozen=True, slots=True)
class PoseFit:
    """A camera's pose, with standard uncertainties by the names of `QUANTITIES` (0 of a given field of view).

    `residuals_px` (n,) are the distances of each mark from where the pose sees its point.
    """

    camera: Camera
    sd: dict[str, float]
    residuals_px: FloatArray


def fit_pose(
    pixels: FloatArray, points_m: FloatArray, shape: tuple[int, int], *, hfov_deg: float | None = None,
    mark_sd_px: float = 1.0, distortion: tuple[float, ...] = (), grid_scale: float = 1.0,
) -> PoseFit:  # fmt: skip
    """Find the pose that sees points where they were marked.

    `pixels` are marks x, y, (n, 2), four or more, `points_m` their east, north, up, (n, 3), `shape` the rows
    and columns of a frame. The horizontal field of view is found as well if it is not given. `mark_sd_px` is
    the standard uncertainty of a mark, in x and in y; the scatter, by Student's factor for few points, counts
    where it is larger. `distortion` of the lens, as of a `Camera`, is not found; `grid_scale` is metres on
    the grid of the points per metre on the ground. Raises `CalibrationError` if there are fewer than four
    points, a mark is outside the frame or off by ten standard uncertainties, or they do not determine the
    pose.
    """
    if len(points_m) < LEAST_POINTS:
        raise CalibrationError(
            f"a pose needs {LEAST_POINTS} points, here are {len(points_m)}", fix="mark more of them"
        )
    _refuse_outside(pixels, shape)
    centre, on_ground = points_m.mean(axis=0), np.array([grid_scale, grid_scale, 1.0])
    apart = (points_m - centre) / on_ground
    starts = [
        start
        for field in ((hfov_deg,) if hfov_deg is not None else FIELDS_DEG)
        if (start := _start(pixels, apart, shape, field, distortion)) is not None
    ]
    count = len(QUANTITIES) - (hfov_deg is not None)

    def misses(numbers: FloatArray) -> FloatArray:
        x, y, _ = project(_camera(numbers, shape, hfov_deg, distortion), apart)
        # behind the camera there is no pixel: far off
        return np.nan_to_num(np.column_stack([x, y]) - pixels, nan=1e4).ravel() / mark_sd_px

    fits = [least_squares(misses, start[:count], x_scale="jac") for start in starts]
    if not fits:
        raise CalibrationError(
            "no pose sees the points where they are marked",
            fix="check their order, that they are apart, the size of the frame and the lens",
        )
    best = min(fits, key=lambda fit: float(fit.cost))
    slopes = np.asarray(best.jac, np.float64)
    information = slopes.T @ slopes
    scale = np.sqrt(np.diag(information))
    if not (scale > 0.0).all() or np.linalg.cond(information / np.outer(scale, scale)) > WORST_CONDITION:
        raise CalibrationError(
            "the points do not determine the pose",
            fix="mark points farther apart and of different heights, or give " + Argument("hfov_deg"),
        )
    freedom = max(best.fun.size - count, 1)
    scatter = students_factor(freedom) * float(np.sqrt(2.0 * best.cost / freedom))
    sd = np.zeros(len(QUANTITIES))
    sd[:count] = np.sqrt(np.diag(np.linalg.inv(information))) * max(1.0, scatter)
    residuals = np.linalg.norm(best.fun.reshape(-1, 2), axis=1) * mark_sd_px
    _refuse_wrong_point(residuals, mark_sd_px)
    camera = _camera(best.x, shape, hfov_deg, distortion)
    east, north, up = (float(coordinate) for coordinate in np.asarray(camera.position_m) * on_ground + centre)
    return PoseFit(
        replace(camera, position_m=(east, north, up), grid_scale=grid_scale),
        dict(zip(QUANTITIES, map(float, sd), strict=True)),
        residuals,
    )


def _refuse_outside(pixels: FloatArray, shape: tuple[int, int]) -> None:
    inside = ((pixels >= -0.5) & (pixels < np.array(shape[::-1]) - 0.5)).all(axis=1)
    for number in np.flatnonzero(~inside):
        x, y = pixels[number]
        raise CalibrationError(
            f"outside a frame of {shape[1]} x {shape[0]} pixels",
            place=f"point {number + 1} at {x:g}, {y:g}",
            fix="check its row, and the size of the frame",
        )


def _refuse_wrong_point(residuals_px: FloatArray, mark_sd_px: float) -> None:
    """Raise `CalibrationError` where no scatter of marks explains how far one is off."""
    if residuals_px.max() > WORST_MARK * mark_sd_px:
        raise CalibrationError(
            f"off by {residuals_px.max():.0f} px: no pose sees all points where they are marked",
            place=f"point {residuals_px.argmax() + 1}",
            fix="check marks and coordinates (east and north swapped?), or enlarge " + Argument("mark_sd_px"),
        )


def _camera(
    numbers: FloatArray, shape: tuple[int, int], hfov_deg: float | None, distortion: tuple[float, ...]
) -> Camera:
    east, north, up, yaw, pitch, roll, *field = (float(number) for number in numbers)
    field_deg = field[0] if hfov_deg is None else hfov_deg
    return Camera((east, north, up), yaw, pitch, roll, field_deg, shape, distortion)


def _start(
    pixels: FloatArray,
    points_m: FloatArray,
    shape: tuple[int, int],
    hfov_deg: float,
    distortion: tuple[float, ...],
) -> FloatArray | None:
    """Position, angles and field of view by SQPnP; None where it finds none."""
    import cv2

    intrinsics = Camera((0.0, 0.0, 0.0), 0.0, 0.0, 0.0, hfov_deg, shape).intrinsics
    marks, points = (
        np.ascontiguousarray(values, np.float64) for values in (pixels, points_m)
    )  # as OpenCV asks
    lens = np.array(distortion) if distortion else None
    try:
        ok, rotation, translation = cv2.solvePnP(points, marks, intrinsics, lens, flags=cv2.SOLVEPNP_SQPNP)
    except cv2.error:  # points or marks that are all at one place
        return None
    if not ok:
        return None
    axes = cv2.Rodrigues(rotation)[0]
    position = -axes.T @ translation.ravel()
    return np.array([*position, *angles_of_axes(np.asarray(axes)), hfov_deg])
