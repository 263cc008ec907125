"""From pixels to the ground and back: a pinhole camera with a pose, over a plane or a grid of heights.

Axes are east, north, up, in metres. Pixel centres are at whole numbers, x to the right, y downwards.
Refraction and the Earth's curvature are not here: at 100 m the latter is below a millimetre.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.model.arrays import BoolArray, FloatArray, IndexArray

_UNDISTORTING_STEPS = 50
"""Steps of the fixed-point iteration: each at least halves the error of a lens that bends rays moderately."""


@dataclass(frozen=True, slots=True)
class Grid:
    """The grid of a projected reference system at a place.

    `true_north_deg` is the direction of true north, clockwise from the grid's own: less the convergence.
    `scale` are metres on the grid per metre on the ground.
    """

    true_north_deg: float = 0.0
    scale: float = 1.0

    def __str__(self) -> str:
        return f"convergence {0.0 - round(self.true_north_deg, 2):+.2f}°, scale {self.scale:.5f}"


@dataclass(frozen=True, slots=True)
class Camera:
    """A pinhole camera, with the distortion of its lens.

    `position_m` is east, north, up. `yaw_deg` is the azimuth of the optical axis from north, clockwise,
    `pitch_deg` its elevation, negative downwards, `roll_deg` the turn of the camera about it, clockwise as
    the camera sees. `hfov_deg` is the horizontal field of view, from edge to edge of the outermost pixels,
    `shape` are rows and columns. `distortion` is k1, k2, p1, p2, k3 in OpenCV's order, none for a lens
    without (D. C. Brown, "Close-range camera calibration", Photogrammetric Engineering 37, 1971);
    `grid_scale` are metres on the grid of east and north per metre on the ground.
    """

    position_m: tuple[float, float, float]
    yaw_deg: float
    pitch_deg: float
    roll_deg: float
    hfov_deg: float
    shape: tuple[int, int]
    distortion: tuple[float, ...] = ()
    grid_scale: float = 1.0

    @property
    def focal_px(self) -> float:
        """Focal length in pixels."""
        return 0.5 * self.shape[1] / float(np.tan(np.radians(0.5 * self.hfov_deg)))

    @property
    def intrinsics(self) -> FloatArray:
        """Matrix (3, 3) from right, down and forward to pixels x, y, 1, without the distortion."""
        rows, cols = self.shape
        middle = 0.5 * (cols - 1), 0.5 * (rows - 1)
        return np.array([[self.focal_px, 0.0, middle[0]], [0.0, self.focal_px, middle[1]], [0.0, 0.0, 1.0]])

    @property
    def axes(self) -> FloatArray:
        """Unit vectors to the right of the frame, downwards in it and along the optical axis, as rows."""
        yaw, pitch, roll = np.radians([self.yaw_deg, self.pitch_deg, self.roll_deg])
        forward = np.array([np.cos(pitch) * np.sin(yaw), np.cos(pitch) * np.cos(yaw), np.sin(pitch)])
        level = np.array([np.cos(yaw), -np.sin(yaw), 0.0])
        below = np.array([np.sin(pitch) * np.sin(yaw), np.sin(pitch) * np.cos(yaw), -np.cos(pitch)])
        right, down = np.cos(roll) * level + np.sin(roll) * below, np.cos(roll) * below - np.sin(roll) * level
        return np.array([right, down, forward])


def rays(camera: Camera) -> FloatArray:
    """Unit vectors from the camera through its pixels, shape (rows, cols, 3)."""
    rows, cols = camera.shape
    x, y = np.meshgrid(np.arange(cols) - 0.5 * (cols - 1), np.arange(rows) - 0.5 * (rows - 1))
    x, y = x / camera.focal_px, y / camera.focal_px
    if camera.distortion:
        x, y = _undistort(camera, x, y)
    lines = np.stack([x, y, np.ones(camera.shape)], axis=-1) @ camera.axes
    return np.asarray(lines / np.linalg.norm(lines, axis=-1, keepdims=True))


def ground_points(camera: Camera, distances_m: FloatArray) -> FloatArray:
    """Points on the pixels' rays at distances (rows, cols) from the camera: east, north, up, metres."""
    along = rays(camera) * (camera.grid_scale, camera.grid_scale, 1.0)
    return np.asarray(np.asarray(camera.position_m) + distances_m[..., np.newaxis] * along)


def project(camera: Camera, points_m: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Pixels x and y of points (east, north, up), (..., 3), and their distances from the camera in metres.

    Shape (...) each; x and y are NaN behind the camera and where the lens model folds back.
    """
    away = np.asarray(points_m, np.float64) - camera.position_m
    away = away / (camera.grid_scale, camera.grid_scale, 1.0)
    right, down, forward = np.moveaxis(away @ camera.axes.T, -1, 0)
    ahead = np.where(forward > 0.0, forward, np.nan)
    x, y = right / ahead, down / ahead
    if camera.distortion:
        x, y = _distort(camera, x, y)
    rows, cols = camera.shape
    x, y = camera.focal_px * x + 0.5 * (cols - 1), camera.focal_px * y + 0.5 * (rows - 1)
    return x, y, np.linalg.norm(away, axis=-1)


def angles_of_quaternion(quaternion: Sequence[float]) -> tuple[float, float, float]:
    """Yaw, pitch and roll in degrees, as of a `Camera`, of the unit quaternion (x, y, z, w) of its axes.

    It turns right, down, forward of the camera into east, north, up: the optical frame of ROS (REP 103).
    """
    from scipy.spatial.transform import Rotation  # slow to import, and every recording imports this file

    return angles_of_axes(Rotation.from_quat(quaternion).as_matrix().T)


def angles_of_axes(axes: FloatArray) -> tuple[float, float, float]:
    """Yaw, pitch and roll in degrees, as of a `Camera`, of the axes right, down, forward, (3, 3)."""
    right, _, forward = axes
    yaw, pitch = np.arctan2(forward[0], forward[1]), np.arcsin(np.clip(forward[2], -1.0, 1.0))
    level = np.array([np.cos(yaw), -np.sin(yaw), 0.0])
    roll = np.arctan2(right @ np.cross(forward, level), right @ level)
    return float(np.degrees(yaw)), float(np.degrees(pitch)), float(np.degrees(roll))


def quaternion_of_angles(yaw_deg: float, pitch_deg: float, roll_deg: float) -> list[float]:
    """The unit quaternion x, y, z, w of these angles in degrees: the inverse of `angles_of_quaternion`."""
    from scipy.spatial.transform import Rotation

    axes = Camera((0.0, 0.0, 0.0), yaw_deg, pitch_deg, roll_deg, 90.0, (1, 1)).axes
    return [float(component) for component in Rotation.from_matrix(axes.T).as_quat()]


def _radial(camera: Camera, square: FloatArray) -> FloatArray:
    k1, k2, _, _, k3 = camera.distortion
    return np.asarray(1.0 + square * (k1 + square * (k2 + square * k3)))


def _tangential(camera: Camera, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    _, _, p1, p2, _ = camera.distortion
    square = x * x + y * y
    across = p2 * (square + 2.0 * x * x) + 2.0 * p1 * x * y
    return across, p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y


def _distort(camera: Camera, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Place at which the lens shows what a pinhole shows at x and y, in focal lengths from the axis."""
    square = x * x + y * y
    k1, k2, _, _, k3 = camera.distortion
    # d/dr of r (1 + k1 r^2 + k2 r^4 + k3 r^6): where it is negative the lens model folds back
    grows = 1.0 + square * (3.0 * k1 + square * (5.0 * k2 + square * 7.0 * k3)) > 0.0
    radial, (right, down) = np.where(grows, _radial(camera, square), np.nan), _tangential(camera, x, y)
    return x * radial + right, y * radial + down


def _undistort(camera: Camera, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The inverse of `_distorted`, by the fixed-point iteration of OpenCV."""
    straight_x, straight_y = x, y
    for _ in range(_UNDISTORTING_STEPS):
        radial = _radial(camera, straight_x**2 + straight_y**2)
        right, down = _tangential(camera, straight_x, straight_y)
        straight_x, straight_y = (x - right) / radial, (y - down) / radial
    return straight_x, straight_y


@dataclass(frozen=True, slots=True)
class Heights:
    """Heights of the ground on a grid of square cells with north up.

    `west_m` and `north_m` are the outer edges of the first cell, `heights_m` (rows, cols) its rows from
    north to south; NaN is unknown. `scale` are metres on the grid per metre on the ground.
    """

    west_m: float
    north_m: float
    cell_m: float
    heights_m: FloatArray
    scale: float = 1.0

    def at(self, east_m: ArrayLike, north_m: ArrayLike) -> FloatArray:
        """Heights in metres between cell centres, bilinear, shape of the coordinates; NaN outside."""
        from scipy.ndimage import map_coordinates

        x = (np.asarray(east_m, np.float64) - self.west_m) / self.cell_m - 0.5
        y = (self.north_m - np.asarray(north_m, np.float64)) / self.cell_m - 0.5
        y, x = np.broadcast_arrays(y, x)
        height_m = map_coordinates(self.heights_m, [y.ravel(), x.ravel()], order=1, cval=np.nan)
        return np.asarray(height_m).reshape(x.shape)

    def normals(self, east_m: ArrayLike, north_m: ArrayLike) -> FloatArray:
        """Unit normals (east, north, up) by the differences over one cell, (..., 3); NaN where unknown."""
        east, north, half = np.asarray(east_m), np.asarray(north_m), 0.5 * self.cell_m
        rise_east = self.at(east + half, north) - self.at(east - half, north)
        rise_north = self.at(east, north + half) - self.at(east, north - half)
        apart = np.full(rise_east.shape, self.cell_m / self.scale)
        across = np.stack([-rise_east, -rise_north, apart], axis=-1)
        return np.asarray(across / np.linalg.norm(across, axis=-1, keepdims=True))


def distances_to_plane_m(camera: Camera, height_m: float) -> FloatArray:
    """Distance in metres along each pixel's ray to a level plane, (rows, cols); NaN without one."""
    up = rays(camera)[..., 2]
    drop = height_m - camera.position_m[2]
    with np.errstate(divide="ignore"):
        away = drop / up
    return np.where(np.isfinite(away) & (away > 0.0), away, np.nan)


def distances_to_ground_m(camera: Camera, ground: Heights, range_m: float) -> FloatArray:
    """Distance along each pixel's ray to where it first meets the ground within a range, (rows, cols), else
    NaN.

    The camera may stand outside the heights. Steps of half a cell, then twelve halvings: a ridge narrower
    than half a cell may be missed.
    """
    lines = rays(camera).reshape(-1, 3)
    distance_m = np.full(len(lines), np.nan)
    aloft, step = np.arange(len(lines)), 0.5 * ground.cell_m / ground.scale
    above = np.ones(len(lines), np.bool_)  # a ray that enters from below the grid's edge meets nothing
    for number in range(1, int(range_m / step) + 1):
        over = _height_over(camera, ground, lines[aloft], np.full(aloft.size, number * step))
        meets = above[aloft] & (over <= 0.0)
        above[aloft] = np.where(np.isnan(over), above[aloft], over > 0.0)
        distance_m[aloft[meets]] = _bisect(camera, ground, lines[aloft[meets]], number * step, step)
        aloft = aloft[~meets]
        if not aloft.size:
            break
    return distance_m.reshape(camera.shape)


def _height_over(camera: Camera, ground: Heights, lines: FloatArray, away_m: FloatArray) -> FloatArray:
    along = lines * (camera.grid_scale, camera.grid_scale, 1.0)
    east, north, up = (np.asarray(camera.position_m) + away_m[:, np.newaxis] * along).T
    return np.asarray(up - ground.at(east, north))


def _bisect(camera: Camera, ground: Heights, lines: FloatArray, away_m: float, step_m: float) -> FloatArray:
    low, high = np.full(len(lines), away_m - step_m), np.full(len(lines), away_m)
    for _ in range(12):
        middle = 0.5 * (low + high)
        below = _height_over(camera, ground, lines, middle) <= 0.0
        low, high = np.where(below, low, middle), np.where(below, middle, high)
    return high


def project_to_frame(
    camera: Camera, points_m: FloatArray, distances_m: FloatArray, slack_m: float
) -> tuple[IndexArray, IndexArray, BoolArray]:
    """Row and column, (...) each, of the pixel that sees each point (..., 3), and whether it does; else 0.

    `distances_m` (rows, cols) are of the ground along each pixel's ray: what is farther is hidden, but for
    `slack_m`, about the size of a cell.
    """
    x, y, away = project(camera, points_m)
    rows, cols = camera.shape
    inside = (x > -0.5) & (x < cols - 0.5) & (y > -0.5) & (y < rows - 0.5)
    row, col = (np.rint(np.where(inside, coordinate, 0.0)).astype(np.intp) for coordinate in (y, x))
    # the pixel's own ray may meet farther ground than the point does near its edge
    is_visible = inside & (np.abs(distances_m[row, col] - away) <= slack_m + 0.05 * away)
    return np.where(is_visible, row, 0), np.where(is_visible, col, 0), is_visible


def is_hidden(ground: Heights, eye_m: ArrayLike, points_m: FloatArray, slack_m: float) -> BoolArray:
    """Whether nearer ground hides points (n, 3) from an eye (3,), in metres east, north, up; shape (n,).

    In steps of half a cell. Unknown ground hides nothing, nor do the last `slack_m` before a point, its own
    ground: about the size of a cell.
    """
    eye, hidden = np.asarray(eye_m, np.float64), np.zeros(len(points_m), np.bool_)
    for place, line in enumerate(points_m - eye):
        length = float(np.linalg.norm(line))
        shares = np.arange(0.0, max(length - slack_m, 0.0), 0.5 * ground.cell_m) / length
        east, north, up = (eye + shares[:, np.newaxis] * line).T
        hidden[place] = bool((ground.at(east, north) > up).any())
    return hidden


def horizon_of_ground(
    ground: Heights, east_m: ArrayLike, north_m: ArrayLike, azimuths_deg: FloatArray, nearest_m: float
) -> FloatArray:
    """Elevation of the ground's skyline from points on it.

    In steps of half a cell, and without the Earth's curvature: it lowers a ridge at 20 km by 0.1 degrees.

    Parameters
    ----------
    ground
        Heights around the points.
    east_m, north_m
        The points, within the grid, shapes that broadcast to (...). [m]
    azimuths_deg
        Directions from the grid's north, clockwise, shape (n,). [degrees]
    nearest_m
        Ground nearer than this on the grid is not looked at. [m]

    Returns
    -------
    Shape (..., n); NaN where no ground is known. [degrees]
    """
    rows, cols = ground.heights_m.shape
    step = 0.5 * ground.cell_m
    away = np.arange(max(nearest_m, step), ground.cell_m * float(np.hypot(rows, cols)), step)
    east, north = (array[..., np.newaxis] for array in np.broadcast_arrays(east_m, north_m))
    eye = ground.at(east, north)
    heights_deg = np.empty((*eye.shape[:-1], azimuths_deg.size))
    for place, azimuth in enumerate(np.radians(azimuths_deg)):
        over = ground.at(east + away * np.sin(azimuth), north + away * np.cos(azimuth)) - eye
        steepest = np.fmax.reduce(over / away, axis=-1, initial=np.nan) * ground.scale
        heights_deg[..., place] = np.degrees(np.arctan(steepest))
    return heights_deg
