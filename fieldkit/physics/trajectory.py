"""Pose of a camera over time, and the ground that it saw then.

Positions are east, north, up in metres; quaternions (x, y, z, w) turn right, down, forward of the camera into
east, north, up. Times are UTC nanoseconds since 1970.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np

from fieldkit.model.arrays import FloatArray
from fieldkit.physics.camera_geometry import Camera, angles_of_quaternion

Point = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Poses in order of time; a single one holds at any time."""

    time_ns: tuple[int, ...]
    position_m: tuple[Point, ...]
    quaternion: tuple[Quaternion, ...]

    def at(self, time_ns: int) -> tuple[Point, Quaternion] | None:
        """Position and quaternion at a time, moved and turned evenly between two poses.

        None before the first and after the last.
        """
        if len(self.time_ns) == 1:
            return self.position_m[0], self.quaternion[0]
        if not self.time_ns[0] <= time_ns <= self.time_ns[-1]:
            return None
        # slow to import, and every recording imports this file
        from scipy.spatial.transform import Rotation, Slerp

        after = min(bisect_right(self.time_ns, time_ns), len(self.time_ns) - 1)
        pair = slice(after - 1, after + 1)
        first, last = self.time_ns[pair]
        share = (time_ns - first) / (last - first)
        start, end = np.array(self.position_m[pair])
        turned = Slerp((0.0, 1.0), Rotation.from_quat(self.quaternion[pair]))(share).as_quat()
        (east, north, up), (x, y, z, w) = (start + share * (end - start)).tolist(), turned.tolist()
        return (east, north, up), (x, y, z, w)


@dataclass(frozen=True, slots=True)
class CameraPath:
    """A camera along a trajectory, whose quaternions are against true north.

    `true_north_deg` is the direction of true north on the grid of the positions, clockwise from the grid's
    own; `hfov_deg`, `distortion` and `grid_scale` are as of a `Camera`.
    """

    trajectory: Trajectory
    hfov_deg: float
    distortion: tuple[float, ...] = ()
    true_north_deg: float = 0.0
    grid_scale: float = 1.0

    def camera(self, time_ns: int, shape: tuple[int, int]) -> Camera | None:
        """The camera at a time, in the axes of the grid; None where the trajectory has no pose."""
        if (pose := self.trajectory.at(time_ns)) is None:
            return None
        position_m, quaternion = pose
        yaw_deg, pitch_deg, roll_deg = angles_of_quaternion(quaternion)
        angles = yaw_deg + self.true_north_deg, pitch_deg, roll_deg
        return Camera(position_m, *angles, self.hfov_deg, shape, self.distortion, self.grid_scale)


def homography_over_level(view: Camera, other: Camera, height_m: float) -> FloatArray:
    """Map (3, 3), of x, y, 1 in pixels, from one camera's frame of level ground at a height to that of
    another.

    The lens's distortion is not taken into account. R. Hartley, A. Zisserman, "Multiple View Geometry in
    Computer Vision", 2003, eq. (13.2).
    """
    above_m = view.position_m[2] - height_m
    moved_m = np.subtract(view.position_m, other.position_m) / (view.grid_scale, view.grid_scale, 1.0)
    down = -view.axes[:, 2] / above_m
    turned = other.axes @ (view.axes.T + np.outer(moved_m, down))
    return np.asarray(other.intrinsics @ turned @ np.linalg.inv(view.intrinsics))
