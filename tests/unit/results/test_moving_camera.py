"""Sessions of a simulated camera that moves, from its bytes to slopes, against the same field at rest."""

from importlib.util import find_spec

import numpy as np
import pytest

from fieldkit.config import FILE_NAME, load_config
from fieldkit.config.template import SIMULATED
from fieldkit.model.samples import EventKind, Quality
from fieldkit.recording.background import RecordOptions
from fieldkit.recording.campaign import create_campaign
from fieldkit.recording.record import prepare
from fieldkit.results.estimate import estimate
from fieldkit.sessions.reader import open_session
from fieldkit.simulation.camera_frame import Motion
from fieldkit.simulation.scene import ALAMOSA_NOON_NS
from tests.harness.nadir_camera import LENS, on_ground, write_trajectory
from tests.harness.simulated import record_simulated

MOVING = ("simulation.drift_px=[-6.0, 8.0]", "simulation.pan_deg=3.0", "simulation.jitter_px=2.0")
MOTION = Motion((-6.0, 8.0), 3.0)
POSE_ERROR_DEG = 0.2


def recorded(folder, minutes, *settings, tables=SIMULATED):
    done = record_simulated(folder, minutes, *settings, tables=tables)
    assert done.summary.failure is None
    return done.path


def on_the_ground(folder, minutes, start_ns=ALAMOSA_NOON_NS):
    """The same beds on the ground, and a trajectory without the shaking, wrong by 0.2 degrees."""
    folder.mkdir()
    write_trajectory(folder / "run.tum", MOTION, start_ns, 60.0 * minutes, POSE_ERROR_DEG)
    regions = [
        {**{key: value for key, value in region.items() if key != "points_px"}, "points_m": corners}
        for region in SIMULATED["region"]
        for corners in [on_ground(region["points_px"])]
    ]
    camera = {**SIMULATED["camera"], "pose": {**LENS, "trajectory": "run.tum"}}
    return {**SIMULATED, "camera": camera, "region": regions}


@pytest.fixture(scope="module", params=[24, pytest.param(180, marks=pytest.mark.slow)])
def sessions(request, tmp_path_factory):
    """At rest; moving, regions in pixels; moving, regions on the ground."""
    folder, minutes = tmp_path_factory.mktemp("moving"), request.param
    found = [recorded(folder / "rest", minutes), recorded(folder / "moves", minutes, *MOVING)]
    if find_spec("rasterio"):
        tables = on_the_ground(folder / "pose", minutes)
        found.append(recorded(folder / "pose", minutes, *MOVING, tables=tables))
    return found


@pytest.mark.parametrize(
    ("model", "within_deg"), [("paper", 0.1), pytest.param("learned", 0.2, marks=pytest.mark.slow)]
)
def test_drift_pan_and_jitter_hardly_change_a_slope(sessions, model, within_deg):
    """Also by a trajectory whose poses are wrong by 0.2 degrees. The goal is 0.1; learned reaches 0.15."""
    rest, *moving = (estimate(path, model=model).final for path in sessions)
    for moves in moving:
        for name, slope in moves.items():
            assert slope.tilt_deg == pytest.approx(rest[name].tilt_deg, abs=within_deg)


def test_a_session_at_rest_reports_no_movement_and_one_that_moves_its_correction(sessions):
    reported = []
    for path in sessions:
        with open_session(path) as session:
            reported.append([one for one in session.events() if one.kind is EventKind.MOVED])
    assert not reported[0]
    assert all({one.data["phase"] for one in some} == {"corrected"} for some in reported[1:])


@pytest.mark.parametrize("number", [1, -1])
def test_estimates_of_a_moving_camera_are_those_made_live(sessions, number):
    again = [one.tilt_deg for one in estimate(sessions[number])]
    with open_session(sessions[number]) as session:
        live = [one.tilt_deg for one in session.estimates()]
    assert len(live) == len(again) > 0
    assert np.allclose(live, again, rtol=0.0, atol=1e-9, equal_nan=True)


def test_a_kick_of_40_pixels_is_lost_within_a_minute(tmp_path):
    path = recorded(tmp_path / "kicked", 24, 'simulation.faults=["moved"]')
    with open_session(path) as session:
        events = [one for one in session.events() if one.kind is EventKind.MOVED]
        flags = [Quality(one.flags) for one in session.minutes()]
        kicked_ns = session.start_ns + 12 * 60 * 10**9
    assert [one.data["phase"] for one in events] == ["lost", "corrected"]
    assert 0 <= events[0].time_ns - kicked_ns <= 60 * 10**9
    assert 0 < sum(bool(one & Quality.MOVED) for one in flags) <= 11


@pytest.mark.parametrize(("late_s", "is_reported"), [(0, False), (600, True), (-900, True), (-2400, True)])
def test_a_trajectory_that_does_not_cover_a_recording_is_reported_before_it(tmp_path, late_s, is_reported):
    tables = on_the_ground(tmp_path / "pose", 20, ALAMOSA_NOON_NS + late_s * 10**9)
    create_campaign(tmp_path / "pose", tables)
    warnings = []
    with prepare(
        load_config(tmp_path / "pose" / FILE_NAME), RecordOptions(duration_s=600.0), warnings.append
    ):
        pass
    lost = [one for one in warnings if "regions on the ground are lost then" in one]
    assert len(lost) == is_reported
