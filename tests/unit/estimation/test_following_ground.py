"""Regions on the ground in frames of a camera whose pose is known, against the ground that they show."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from fieldkit.estimation.binner import Binner
from fieldkit.estimation.bins import History
from fieldkit.estimation.estimator import Estimator
from fieldkit.estimation.following import GroundFollower
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import EventKind, Frame, Quality
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.model.slope import SlopeState
from fieldkit.physics.camera_geometry import Camera, project, quaternion_of_angles
from fieldkit.physics.trajectory import CameraPath, Trajectory, homography_over_level
from fieldkit.simulation.camera_frame import Motion
from fieldkit.simulation.scene import sand_slopes
from tests.harness.nadir_camera import EAST_M, LENS, NORTH_M, on_ground, pose

SECOND_NS = 1_000_000_000
SHAPE = (120, 160)
MAP_PX_M = 0.05
MAP = np.random.default_rng(2)
GROUND = 30_000.0 + 400.0 * gaussian_filter(MAP.standard_normal((800, 1600)), 6.0) / 0.047
"""Blotches half a metre wide and some hundredths of a kelvin deep, 80 m to the east and 40 m to the north."""


def frame(camera: Camera) -> np.ndarray:
    """What the camera sees of the map, with a detector's noise."""
    above = Camera((40.0, 20.0, 1000.0), 0.0, -90.0, 0.0, 90.0, (800, 1600))
    zoom = 1000.0 / above.focal_px / MAP_PX_M
    scaled = np.diag([zoom, zoom, 1.0])
    scaled[:2, 2] = (1.0 - zoom) * np.array([799.5, 399.5])
    onto = homography_over_level(above, camera, 0.0) @ np.linalg.inv(scaled)
    seen = cv2.warpPerspective(GROUND.astype(np.float32), onto, SHAPE[::-1])
    return np.rint(seen + 5.0 * MAP.standard_normal(SHAPE)).astype(np.uint16)


def sample(time_ns: int, counts: np.ndarray | int, camera: str = "camera") -> Frame:
    """A frame of a detector, or one that is the same everywhere: nothing in it speaks against a pose."""
    none = np.empty((0, SHAPE[1]), np.uint16)
    return Frame(camera, time_ns, time_ns, np.full(SHAPE, counts, np.uint16), none)


def drive(error_deg: float) -> tuple[list[Camera], CameraPath]:
    """Twelve metres ahead and 15 degrees to the left in 30 frames; and as it is known, wrong by an error."""
    true = [
        Camera((10.0 + 12.0 * share, 18.0 + 2.0 * share, 6.0), 90.0 - 15.0 * share, -35.0, 0.0, 50.0, SHAPE)
        for share in np.linspace(0.0, 1.0, 30)
    ]
    known = [
        Rotation.from_quat(quaternion_of_angles(one.yaw_deg, one.pitch_deg, 0.0))
        * Rotation.from_rotvec(np.radians(error_deg * MAP.standard_normal(3)))
        for one in true
    ]
    times = tuple(range(0, 30 * SECOND_NS, SECOND_NS))
    turned = tuple(tuple(one.as_quat().tolist()) for one in known)
    return true, CameraPath(Trajectory(times, tuple(one.position_m for one in true), turned), 50.0)


def region(*corners: tuple[float, float]) -> Region:
    return Region("bed", RegionKind.TARGET, (), points_m=tuple((*corner, 0.0) for corner in corners))


BED = region((27.0, 19.0), (29.0, 19.0), (29.0, 22.0), (27.0, 22.0))
ONE = np.array([0])


@pytest.mark.parametrize(("error_deg", "off_px"), [(0.0, 1e-6), (0.2, 2.0)])
def test_a_region_on_the_ground_is_followed_through_a_drive(error_deg, off_px):
    """0.2 degrees are 0.6 px about each axis, one standard deviation."""
    true, path = drive(error_deg)
    follower = GroundFollower(path)
    for number, camera in enumerate(true):
        found = follower.update(frame(camera), number * SECOND_NS, [BED], ONE)
        assert found is not None, number
        x, y, _ = project(camera, BED.points_m)
        wrong = np.array(found[0].points_px) - np.column_stack([x, y])
        assert np.abs(wrong.mean(axis=0)).max() < off_px
    assert follower.shift_px > 25.0


def test_a_region_that_is_not_wholly_in_the_frame_has_no_corners_and_a_time_without_pose_is_lost():
    true, path = drive(0.0)
    near = region((15.0, 18.0), (16.0, 18.0), (16.0, 19.0))
    follower = GroundFollower(path)
    (seen,), (left,) = (follower.update(frame(true[n]), n * SECOND_NS, [near], ONE) or () for n in (0, 12))
    assert len(seen.points_px) == 3
    assert left.points_px == ()
    assert follower.update(frame(true[12]), 31 * SECOND_NS, [near], ONE) is None
    assert not follower.has_pose


def test_a_kick_is_lost_with_the_horizon_in_the_frame():
    """By 12 degrees, of a camera that is driven aside by 0.3 m a frame."""
    places = [(10.0, 18.0 + 0.3 * number, 2.0) for number in range(5)]
    true = [Camera(place, 90.0, -10.0, 0.0, 50.0, SHAPE) for place in places]
    turned = tuple(quaternion_of_angles(90.0, -10.0, 0.0))
    times = tuple(range(0, 5 * SECOND_NS, SECOND_NS))
    follower = GroundFollower(CameraPath(Trajectory(times, tuple(places), (turned,) * 5), 50.0))
    bed = region((16.0, 19.0), (18.0, 19.0), (18.0, 21.0))
    true[4] = replace(true[4], yaw_deg=102.0)
    found = [follower.update(frame(one), n * SECOND_NS, [bed], ONE) for n, one in enumerate(true)]
    assert [one is None for one in found] == [False] * 4 + [True]


def known_pose(motion: Motion) -> tuple[CameraPath, list[Region]]:
    """The pose of a simulated camera before it moves, and a region of its scene on the ground."""
    position, quaternion = pose(motion, 0.0, np.zeros(3))
    corners = [(29, 29), (66, 28), (66, 53), (24, 56)]
    at = tuple((east, north, 0.0) for east, north in on_ground(corners))
    assert at[0] == (EAST_M - 5.05, NORTH_M + 3.05, 0.0)
    trajectory = Trajectory((0,), (tuple(position),), (tuple(quaternion),))
    return CameraPath(trajectory, LENS["hfov_deg"]), [
        Region("b15", RegionKind.TARGET, tuple(corners), points_m=at)
    ]


def followed(motion: Motion, minutes: range) -> tuple[GroundFollower, Region, list[list[Region] | None]]:
    """The follower of a region of a scene whose camera moves otherwise than it knows, and what it found."""
    scene, (path, regions) = sand_slopes(motion=motion), known_pose(motion)
    follower, found = GroundFollower(path), []
    for minute in minutes:
        time_ns = scene.start_ns + minute * 60 * SECOND_NS
        counts = np.rint(scene.frame(time_ns, minute) * 100.0).astype(np.uint16)
        found.append(follower.update(counts, time_ns, regions, ONE))
    return follower, regions[0], found


def test_a_kick_of_40_pixels_that_the_pose_does_not_know_of_is_lost_at_once():
    follower, drawn, found = followed(Motion(jump_px=(32.0, 24.0)), range(85, 95))
    assert [regions is None for regions in found] == [False] * 5 + [True] * 5
    assert follower.has_pose
    assert found[4][0].points_px == pytest.approx(np.array(drawn.points_px), abs=1e-6)


def test_a_drift_that_the_pose_does_not_know_of_is_corrected_by_whole_pixels():
    _, drawn, found = followed(Motion((8.0, 6.0)), range(0, 180, 6))
    # drawn on the mean of the first ten frames, which had drifted by (1.2, 0.9) of them
    moved = np.array(found[-1][0].points_px) - drawn.points_px
    assert moved == pytest.approx(np.tile([7.0, 5.0], (4, 1)), abs=1e-6)


def path_of_another_time() -> tuple[CameraPath, list[Region]]:
    path, regions = known_pose(Motion())
    poses = path.trajectory
    return CameraPath(Trajectory((1, 2), poses.position_m * 2, poses.quaternion * 2), path.hfov_deg), regions


@pytest.mark.parametrize("model", ["paper", "learned"])
def test_a_trajectory_of_another_time_is_the_reason_for_no_slope(model):
    path, regions = path_of_another_time()
    settings = EstimatorSettings(model=model, camera_path=path)
    flat = Region("flat", RegionKind.REFERENCE, ((10, 80), (40, 80), (40, 110)), 0.0, 0.0)
    camera = StreamInfo("camera", "brightness_temperature", "K", SHAPE, scale=0.01)
    estimator = Estimator(Site(37.7, -105.92), [flat, *regions], (camera,), settings)
    for minute in range(8):
        time_ns = 1_451_674_800 * SECOND_NS + minute * 60 * SECOND_NS
        estimator.add(sample(time_ns, 30_000 + minute))
    (bed,) = estimator.finish()[-1].estimates
    assert bed.state is SlopeState.NO_DATA
    assert bed.flags & Quality.MOVED


def test_a_camera_that_is_lost_leaves_the_regions_of_the_other():
    path, regions = path_of_another_time()
    settings = EstimatorSettings(camera_path=path)
    corners = ((10, 80), (40, 80), (40, 110))
    both = [regions[0], Region("beside", RegionKind.TARGET, corners, camera="second")]
    names = ("camera", "second")
    cameras = [StreamInfo(name, "brightness_temperature", "K", SHAPE, scale=0.01) for name in names]
    binner = Binner(Site(37.7, -105.92), both, cameras, settings)
    for name in names:
        binner.add(sample(1_451_674_800 * SECOND_NS, 30_000, name))
    ((entry, _),) = binner.finish()
    assert [bool(flag & Quality.MOVED) for flag in entry.region_flags] == [True, False]
    history = History.of([entry], 2)
    assert np.isfinite(history.in_place().temperature_k).tolist() == [[False, True]]
    assert [bool(history.last_flags(column) & Quality.MOVED) for column in range(2)] == [True, False]


def test_minutes_in_which_a_region_is_not_in_the_frame_or_no_pose_is_known_are_flagged():
    """A pixel is 0.1 m; the camera goes 0.5 m to the west a minute, for eight minutes."""
    position, quaternion = pose(Motion(), 0.0, np.zeros(3))
    there = (position[0] - 4.0, *position[1:])
    trajectory = Trajectory((0, 480 * SECOND_NS), (tuple(position), there), (tuple(quaternion),) * 2)
    corners = {"middle": [(70, 40), (90, 40), (90, 60)], "right": [(130, 40), (149, 40), (149, 60)]}
    regions = [
        Region(name, RegionKind.TARGET, tuple(at), points_m=tuple((*one, 0.0) for one in on_ground(at)))
        for name, at in corners.items()
    ]
    settings = EstimatorSettings(camera_path=CameraPath(trajectory, LENS["hfov_deg"]))
    camera = StreamInfo("camera", "brightness_temperature", "K", SHAPE, scale=0.01)
    binner, closed = Binner(Site(0.0, 0.0), regions, (camera,), settings), []
    for half in range(20):
        closed += binner.add(sample((30 * half + 1) * SECOND_NS, 30_000 + half))
    closed += binner.finish()
    in_frame = [[bool(np.isfinite(k)) for k in entry.temperature_k] for entry, _ in closed]
    assert in_frame == [[True, True]] * 3 + [[True, False]] * 5 + [[False, False]] * 2
    flagged = [[bool(flag & Quality.MOVED) for flag in entry.region_flags] for entry, _ in closed]
    assert flagged == [[False, False]] * 2 + [[False, True]] * 6 + [[True, True]] * 2
    assert [bool(entry.flags & Quality.MOVED) for entry, _ in closed] == [False] * 8 + [True] * 2
    moved = [event.data for _, events in closed for event in events if event.kind is EventKind.MOVED]
    shifts = [data["shift_px"] for data in moved if data["phase"] == "corrected"]
    assert shifts == pytest.approx([2.5 + 5.0 * minute for minute in range(8)])  # each in mid-minute
    assert [data.get("region") for data in moved if data["phase"] == "lost"] == ["right", None]
