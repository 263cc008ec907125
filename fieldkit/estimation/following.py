"""A camera that moves: by how much each frame is shifted against the one in which the regions were drawn.

Shifts come from the edges in the frames (Kuglin and Hines, "The phase correlation image alignment method",
1975): regions warm and cool through the day, their edges stay. Every frame is compared with one frame, the
key, so errors do not add up; only where its edges have faded the last one that was followed becomes the key.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldkit.model.arrays import AnyArray, AnyIntArray, FloatArray, IntArray, SingleArray
from fieldkit.model.site import Region
from fieldkit.physics.camera_geometry import Camera, project
from fieldkit.physics.trajectory import CameraPath, homography_over_level

CLEAR_PEAK = 8.0
"""Height of the correlation peak over the rest that makes a shift credible, in standard deviations."""
FADED_PEAK = 12.0
"""Height below which the last frame becomes the key."""
FARTHEST_STEP = 0.1
"""Largest shift from one frame to the next that is followed, as a share of the frame's width."""
MOST_COLUMNS = 320
"""Frames wider than this are compared at a half, a third …: ten of 640x512 in a second cost 2 % of a core."""
DRAWN_ON = 10
"""Frames whose mean place is that of the regions: a camera that shakes shows each of them elsewhere."""
SHAKE_PX = 5.0
"""A larger shift among these is a kick."""
LEAST_OVERLAP = 0.7
"""Share of the ground in the frame compared with that another must show; else it becomes that frame."""
_BLUR_PX = 1.0  # without it the pattern of the detector, which does not move, holds the shift back
Spectrum = NDArray[np.complexfloating[Any, Any]]


Shift = FloatArray
"""Pixels (2,) by which the content of a frame lies to the right and below where it was."""


@dataclass(frozen=True, slots=True)
class _Match:
    shift: Shift
    peak: float


class FrameFollower:
    """Follows the content of one camera's frames, in order of time, from the first one given."""

    def __init__(self) -> None:
        import scipy.fft  # noqa: F401  # slow to import: here, so that no frame waits for it

        self._key: Spectrum | None = None
        self._key_at: Shift = np.zeros(2)
        self._last: Spectrum | None = None
        self._at: Shift = np.zeros(2)
        self._is_clear = False
        self._is_lost = False

    def update(self, counts: AnyIntArray) -> Shift | None:
        """The shift of a frame (rows, cols); None where it cannot be followed.

        A frame without edges to compare says nothing: it counts as where the one before was.
        """
        scale = -(-counts.shape[1] // MOST_COLUMNS)
        now, shape = _spectrum(counts, scale)
        if self._key is None or self._last is None:
            self._key = self._last = now
            return np.zeros(2)
        match = _match(self._key, now, shape, scale, self._key_at)
        if match.peak < FADED_PEAK and not self._is_lost:
            step = _match(self._last, now, shape, scale, self._at)
            if step.peak > match.peak:
                self._key, self._key_at, match = self._last, self._at, step
        return self._follow(match, now, FARTHEST_STEP * counts.shape[1])

    def _follow(self, match: _Match, now: Spectrum, farthest_px: float) -> Shift | None:
        is_clear = match.peak >= CLEAR_PEAK
        # no frame has shown edges yet, so none can be lost
        if not is_clear and not self._is_clear:
            self._last = now
            return self._at
        self._is_lost = not is_clear or bool(np.hypot(*(match.shift - self._at)) > farthest_px)
        if self._is_lost:
            return None
        self._at, self._last, self._is_clear = match.shift, now, True
        return self._at


def _spectrum(counts: AnyIntArray, scale: int) -> tuple[Spectrum, tuple[int, int]]:
    """Spectrum of the gradient's root, faded out towards the border (else the border itself is matched)."""
    import cv2
    from scipy import fft

    rows, cols = counts.shape[0] // scale, counts.shape[1] // scale
    # 16 bits would cost digits of small contrasts
    small = cv2.resize(counts.astype(np.float32), (cols, rows), interpolation=cv2.INTER_AREA)
    smooth = cv2.GaussianBlur(small, (0, 0), _BLUR_PX)
    right, down = (cv2.Sobel(smooth, cv2.CV_32F, *axis, ksize=1) for axis in ((1, 0), (0, 1)))
    steepness = cv2.sqrt(cv2.magnitude(right, down))
    return np.asarray(fft.rfft2((steepness - steepness.mean()) * _fade(rows, cols))), (rows, cols)


@lru_cache(maxsize=4)
def _fade(rows: int, cols: int) -> SingleArray:
    return np.outer(np.hanning(rows), np.hanning(cols)).astype(np.float32)


def _match(key: Spectrum, now: Spectrum, shape: tuple[int, int], scale: int, key_at: Shift) -> _Match:
    """Present shift of the key's content."""
    from scipy import fft

    cross = key.conj() * now
    # divided by the root of its magnitude: pure phase would weight noise as much as edges
    surface = fft.irfft2(cross / np.sqrt(np.abs(cross) + np.float32(1e-30)), s=shape)
    row, col = (int(index) for index in np.unravel_index(int(np.argmax(surface)), shape))
    spread = float(surface.std())
    peak = float(surface[row, col] - surface.mean()) / spread if spread > 0.0 else 0.0
    right, down = _signed_peak(surface[row], col), _signed_peak(surface[:, col], row)
    return _Match(key_at + np.array([right, down]) * scale, peak)


def _signed_peak(line: NDArray[np.floating[Any]], at: int) -> float:
    """Peak position on a line, refined by a parabola, as a signed shift."""
    left, middle, right = (float(line[(at + step) % line.size]) for step in (-1, 0, 1))
    bend = left - 2.0 * middle + right
    offset = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    return (at + offset + line.size / 2.0) % line.size - line.size / 2.0


class RegionFollower:
    """Places of regions in each frame: each was drawn on the mean of its first `DRAWN_ON` frames."""

    def __init__(self) -> None:
        self._frames = FrameFollower()
        self._drawn: dict[int, list[Shift]] = {}
        self.shift_px = 0.0
        """Shift of the last frame that was followed from the first region's. [pixels]"""

    def update(self, counts: AnyIntArray, columns: IntArray) -> IntArray | None:
        """Whole pixels to the right and down by which the regions of some columns moved, (columns, 2).

        None where they cannot be found in this frame (rows, cols). If all are redrawn, following begins anew.
        """
        if not columns.size:
            return np.zeros((0, 2), np.int64)
        drawn = [int(column) for column in columns]
        if not self._drawn.keys() & drawn:
            self._frames, self._drawn = FrameFollower(), {}
        if (now := self._frames.update(counts)) is None:
            return None
        off = np.array([now - self._first_place(column, now) for column in drawn])
        self.shift_px = float(np.hypot(*off[0]))
        return np.asarray(np.rint(off), np.int64)

    def _first_place(self, column: int, now: Shift) -> Shift:
        first = self._drawn.setdefault(column, [])
        is_shake = not first or bool(np.hypot(*(now - first[0])) < SHAKE_PX)
        if len(first) < DRAWN_ON and is_shake:
            first.append(now)
        return np.asarray(np.mean(first, axis=0))


class GroundFollower:
    """Places of regions on the ground in each frame of a camera whose pose is known.

    The pose places them; each frame, as it would look from where an earlier one was taken, shows how far the
    pose is wrong, and whether it is right at all. `has_pose` is whether there was one of the last frame.
    """

    def __init__(self, path: CameraPath) -> None:
        self._path = path
        self._view: Camera | None = None
        self._seen = RegionFollower()
        self._is_lost = False
        self._began: FloatArray = np.full(2, np.nan)
        self.has_pose = True
        self.shift_px = 0.0
        """Shift of the middle of the first region from its first place. [pixels]"""

    def update(
        self,
        counts: AnyIntArray,
        time_ns: int,
        regions: Sequence[Region],
        columns: IntArray,
    ) -> list[Region] | None:
        """The regions as they lie in a frame (rows, cols), without corners where they are not wholly in it.

        None where the trajectory has no pose, or the frame does not show what the pose says.
        """
        if not regions:
            return []
        camera = self._path.camera(time_ns, (counts.shape[0], counts.shape[1]))
        self.has_pose = camera is not None
        if camera is None:
            return None
        height_m = float(np.mean([corner[2] for region in regions for corner in region.points_m]))
        if self._view is None or not (self._is_lost or _overlaps(camera, self._view, height_m)):
            self._view, self._seen = camera, RegionFollower()
        back = homography_over_level(camera, self._view, height_m)
        steps = self._seen.update(_from_there(counts, back), columns)
        self._is_lost = steps is None
        if steps is None:
            return None
        corners = [
            _corners_by_pose(camera, region, back, step) for region, step in zip(regions, steps, strict=True)
        ]
        self._report(corners[0].mean(axis=0))
        return [
            replace(region, points_px=_within(outline, camera.shape))
            for region, outline in zip(regions, corners, strict=True)
        ]

    def _report(self, middle: FloatArray) -> None:
        if np.isnan(self._began).any():
            self._began = middle
        if np.isfinite(middle).all():
            self.shift_px = float(np.hypot(*(middle - self._began)))


def _overlaps(camera: Camera, view: Camera, height_m: float) -> bool:
    """True if the camera sees enough of the level ground that a view shows."""
    last = np.array([camera.shape[1] - 1.0, camera.shape[0] - 1.0])
    grid = last * np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, 9)] * 2), axis=-1).reshape(-1, 2)
    # rays that do not point down never meet the ground
    up = np.column_stack([(grid - 0.5 * last) / view.focal_px, np.ones(len(grid))]) @ view.axes[:, 2]
    here = _map_points(homography_over_level(view, camera, height_m), grid[up < 0.0])
    inside = ((here >= 0.0) & (here <= last)).all(axis=1)
    return bool(inside.sum() >= LEAST_OVERLAP * inside.size)


def _from_there(counts: AnyIntArray, back: FloatArray) -> AnyArray:
    """A frame as it would look from another pose; beyond its edge it is mirrored, which shows no edge."""
    import cv2

    if np.allclose(back, np.eye(3), atol=1e-12):
        return counts
    size = counts.shape[1], counts.shape[0]
    return np.asarray(
        cv2.warpPerspective(counts.astype(np.float32), back, size, borderMode=cv2.BORDER_REFLECT_101)
    )


def _corners_by_pose(camera: Camera, region: Region, back: FloatArray, step: IntArray) -> FloatArray:
    """Corners (n, 2) by the pose, and by whole pixels from there by what the frames show."""
    x, y, _ = project(camera, region.points_m)
    corners: FloatArray = np.column_stack([x, y])
    middle = corners.mean(axis=0, keepdims=True)
    forth: FloatArray = np.asarray(np.linalg.inv(back), np.float64)
    shown = _map_points(forth, _map_points(back, middle) + step) - middle
    # whole pixels here too: sums of counts stay exact
    return np.asarray(corners + np.rint(shown))


def _map_points(homography: NDArray[np.floating[Any]], points: NDArray[np.floating[Any]]) -> FloatArray:
    """Points (n, 2), NaN where they come to lie behind the camera."""
    mapped = np.column_stack([points, np.ones(len(points))]) @ homography.T
    return np.asarray(mapped[:, :2] / np.where(mapped[:, 2:] > 0.0, mapped[:, 2:], np.nan))


def _within(corners: FloatArray, shape: tuple[int, int]) -> tuple[tuple[float, float], ...]:
    """The corners if all lie in a frame of these rows and columns, else none."""
    x, y = corners.T
    rows, cols = shape
    inside = (x >= -0.5) & (x <= cols - 0.5) & (y >= -0.5) & (y <= rows - 0.5)
    return tuple((float(right), float(down)) for right, down in corners) if inside.all() else ()
