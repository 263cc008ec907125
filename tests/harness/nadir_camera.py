"""The pose of the simulated camera that moves: it looks straight down, a pixel is 0.1 m of level ground."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from fieldkit.model.arrays import FloatArray
from fieldkit.simulation.camera_frame import FOCAL_PX, Motion

PIXEL_M = 0.1
LENS = {
    "crs": "+proj=tmerc +lon_0=-105.92 +k=0.9996 +x_0=500000 +datum=WGS84 +units=m",
    "hfov_deg": float(np.degrees(2.0 * np.arctan(80.0 / FOCAL_PX))),
    "range_m": 100.0,
    "ground_m": 0.0,
}
"""On the central meridian, at the simulated site, where the grid's north is true north."""
EAST_M, NORTH_M = 500_000.0, 4_172_000.0
AXES = np.diag([1.0, -1.0, -1.0])
"""Right, down, forward of a camera that looks down, north up."""


def on_ground(points_px: Iterable[Iterable[float]]) -> list[list[float]]:
    """East and north of what the camera shows at pixels before it moves."""
    return [[EAST_M + (x - 79.5) * PIXEL_M, NORTH_M - (y - 59.5) * PIXEL_M] for x, y in points_px]


def pose(motion: Motion, share: float, error_deg: FloatArray) -> tuple[list[float], list[float]]:
    """Position and quaternion after a share of the motion, without its shaking; turned by an error."""
    right, down = -PIXEL_M * share * np.asarray(motion.drift_px)
    turn = cv2.Rodrigues(np.array([0.0, np.radians(share * motion.pan_deg), 0.0]))[0]
    wrong = cv2.Rodrigues(np.radians(error_deg))[0]
    quaternion = Rotation.from_matrix((wrong @ turn @ AXES).T).as_quat()
    return [EAST_M + right, NORTH_M - down, FOCAL_PX * PIXEL_M], quaternion.tolist()


def write_trajectory(
    path: Path, motion: Motion, start_ns: int, duration_s: float, error_sd_deg: float
) -> None:
    """A pose a minute in TUM's format, each wrong by an error of its own about each axis."""
    random, count = np.random.default_rng(3), round(duration_s / 60.0) + 2
    with path.open("w", newline="") as file:
        table = csv.writer(file, delimiter=" ")
        for minute in range(-1, count):
            position, quaternion = pose(
                motion, 60.0 * minute / duration_s, error_sd_deg * random.standard_normal(3)
            )
            table.writerow([f"{start_ns // 10**9 + 60 * minute}.0", *position, *quaternion])
