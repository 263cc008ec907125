"""Shifts of frames against the motion of the scene that they were drawn of."""

import numpy as np
import pytest

from fieldkit.estimation.bins import RegionPixels
from fieldkit.estimation.following import FrameFollower, RegionFollower
from fieldkit.model.site import Region, RegionKind
from fieldkit.simulation.camera_frame import Correction, Motion
from fieldkit.simulation.scene import sand_slopes

MINUTE_NS = 60_000_000_000
CENTRE = np.array([79.5, 59.5, 1.0])


def shifts(motion: Motion, minutes: range) -> tuple[list[tuple[float, float] | None], list[np.ndarray]]:
    """What was found in a frame a minute, each after a shutter correction, and the truth."""
    scene, follower = sand_slopes(motion=motion), FrameFollower()
    found, true = [], []
    for minute in minutes:
        time_ns = scene.start_ns + minute * MINUTE_NS
        frame = scene.frame(time_ns, minute, Correction(minute, time_ns - 10**9))
        found.append(follower.update(np.rint(frame * 100.0).astype(np.uint16)))
        where = motion.homography(minute / 180.0, np.random.default_rng(0)) @ CENTRE
        true.append((where / where[2] - CENTRE)[:2])
    return found, true


def test_a_drift_and_a_pan_over_three_hours_are_followed_without_adding_up_errors():
    found, true = shifts(Motion((8.0, 6.0), 3.0), range(0, 180, 3))
    assert np.abs(np.array(found, float) - true).max() < 0.2


def test_a_jump_of_40_pixels_is_lost_at_once_and_found_again_once_put_back():
    found, _ = shifts(Motion(jump_px=(32.0, 24.0)), range(80, 100))
    assert [one is None for one in found] == [False] * 10 + [True] * 10


def test_a_jump_is_over_once_the_camera_is_put_back():
    still, there = (
        np.rint(sand_slopes(motion=motion).frame(1_451_674_800_000_000_000, 1) * 100).astype(np.uint16)
        for motion in (None, Motion(jump_px=(32.0, 24.0), jump_at=-1.0))
    )
    follower = FrameFollower()
    found = [follower.update(frame) for frame in (still, still, there, still)]
    assert [one is None for one in found] == [False, False, True, False]


def test_frames_without_edges_move_nothing():
    random, follower = np.random.default_rng(1), FrameFollower()
    found = [follower.update(random.integers(29_000, 29_005, (60, 80)).astype(np.uint16)) for _ in range(20)]
    assert not np.array(found).any()


def test_regions_at_rest_stay_the_same_object_and_one_that_leaves_the_frame_is_empty():
    square = Region("a", RegionKind.TARGET, ((1, 1), (4, 1), (4, 3), (1, 3)))
    pixels = RegionPixels((square,), (6, 8))
    assert pixels.shift(np.zeros((1, 2), np.int64)) is pixels
    shown = np.arange(48).reshape(6, 8)
    totals, *_ = pixels.shift(np.array([[3, 2]])).sums(shown)
    assert totals == [int(shown[3:6, 4:8].sum())]
    assert pixels.shift(np.array([[4, 0]])).pixels.tolist() == [0]


@pytest.mark.parametrize("redrawn", [1, 7])
def test_a_region_drawn_later_is_where_it_was_drawn(redrawn):
    scene = sand_slopes(motion=Motion(jump_px=(6.0, 0.0)))
    follower = RegionFollower()
    for minute, columns in ((0, [0]), (90, [0]), (91, [0, redrawn])):
        time_ns = scene.start_ns + minute * MINUTE_NS
        counts = np.rint(scene.frame(time_ns, minute) * 100.0).astype(np.uint16)
        steps = follower.update(counts, np.array(columns))
    assert steps is not None
    assert steps.tolist() == [[6, 0], [0, 0]]
