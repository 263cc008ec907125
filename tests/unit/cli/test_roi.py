import json
from datetime import UTC, datetime

import cv2
import numpy as np
import pytest

from fieldkit.calibration.calibration_record import CalibrationRecord, save
from fieldkit.config import load_config
from fieldkit.model.site import Region, RegionKind
from fieldkit.simulation.facets import FRAME_SHAPE
from fieldkit.simulation.scene import BEDS
from tests.harness.command_line import fieldkit
from tests.harness.field_page_journey import empty_campaign


@pytest.fixture
def roi(tmp_path, monkeypatch):
    (tmp_path / "home").mkdir()
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "home"))
    assert fieldkit("init", tmp_path).exit_code == 0
    file = tmp_path / "fieldkit.toml"
    camera = '\n[camera]\ndriver = "purethermal"\nwidth_px = 160\nheight_px = 120\n'
    file.write_text(file.read_text() + camera, encoding="utf-8")
    return lambda *arguments: fieldkit("roi", arguments[0], "-C", tmp_path, *arguments[1:])


def regions(tmp_path):
    return load_config(tmp_path / "fieldkit.toml", environment={}).regions


def test_regions_are_added_by_rectangle_and_by_corners(roi, tmp_path):
    assert roi("add", "flat", "--reference", "--rect", "6,30,32,61").exit_code == 0
    corners = ("--points", "82,30", "113,30", "113,90.5", "82,90")
    assert (
        roi("add", "b15", *corners, "--tilt", "15", "--azimuth", "180", "--emissivity", "0.93").exit_code == 0
    )
    assert regions(tmp_path) == (
        Region(
            "flat",
            RegionKind.REFERENCE,
            ((6, 30), (37, 30), (37, 90), (6, 90)),
            0.0,
            0.0,
            pytest.approx(float("nan"), nan_ok=True),
        ),
        Region("b15", RegionKind.TARGET, ((82, 30), (113, 30), (113, 90.5), (82, 90)), 15.0, 180.0, 0.93),
    )


LOOKING_DOWN = """
crs = "EPSG:32613"
east_m = 500000.0
north_m = 4172000.0
height_m = 2327.0
yaw_deg = 0.0
pitch_deg = -90.0
hfov_deg = 53.13010235415598
range_m = 50.0
ground_m = 2317.0
"""
"""From 10 m above, on the meridian of its zone: 160 pixels of focal length, 16 pixels to the metre."""


def test_corners_on_the_ground_are_drawn_where_the_pose_sees_them(roi, tmp_path):
    (tmp_path / "pose.toml").write_text(LOOKING_DOWN)
    ground = ("500001,4172001", "500003,4172001", "500003,4171999", "500001,4171999")
    assert roi("add", "b15", "--rect", "1,1,20,20").exit_code == 0
    pose = ("--pose", str(tmp_path / "pose.toml"), "--points", *ground)
    result = roi("add", "flat", "--reference", *pose)
    assert result.exit_code == 0, result.stderr
    assert regions(tmp_path)[1].vertices == ((95.5, 43.5), (127.5, 43.5), (127.5, 75.5), (95.5, 75.5))


def test_a_region_stays_on_the_ground_of_the_campaigns_pose(roi, tmp_path):
    with (tmp_path / "fieldkit.toml").open("a") as file:
        file.write(f"\n[camera.pose]\n{LOOKING_DOWN}")
    ground = ("500001,4172001", "500003,4172001", "500003,4171999", "500001,4171999")
    assert roi("add", "flat", "--reference", "--ground", "--points", *ground).exit_code == 0
    (flat,) = regions(tmp_path)
    assert flat.vertices == ((95.5, 43.5), (127.5, 43.5), (127.5, 75.5), (95.5, 75.5))
    assert flat.points_m[0] == (500001.0, 4172001.0, 2317.0)
    shrunk = roi("edit", "flat", "--shrink", "2")
    assert shrunk.exit_code == 0
    assert regions(tmp_path)[0].points_m == ()
    wrong = roi("add", "b15", "--ground", "--points", "500001,4172001", "500009,4172001", "500003,4171999")
    assert wrong.exit_code == 3
    assert "does not see 500009,4172001" in wrong.stderr


def test_a_corner_on_the_ground_that_the_camera_does_not_see_is_named(roi, tmp_path):
    (tmp_path / "pose.toml").write_text(LOOKING_DOWN)
    ground = ("500001,4172001", "500009,4172001", "500003,4171999")
    result = roi("add", "b15", "--pose", str(tmp_path / "pose.toml"), "--points", *ground)
    assert result.exit_code == 3
    assert "500009,4172001" in result.stderr
    assert regions(tmp_path) == ()


def test_the_first_region_may_be_a_target(roi):
    assert roi("add", "b15", "--rect", "82,30,32,61").exit_code == 0
    assert roi("list").exit_code == 0
    check = roi("check")
    assert check.exit_code == 3
    assert "no reference" in check.stdout


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("b15",), 2, "--points, or a rectangle"),
        (("b15", "--rect", "1,1,9,9", "--points", "1,1"), 2, "--points, or a rectangle"),
        (("b15", "--rect", "1,1,9,1"), 2, "at least 2 pixels"),
        (("b15", "--rect", "1,1,9,9", "--ground"), 2, "--pose and --ground are for --points"),
        (("b15", "--ground", "--points", "1,1", "2,2", "3,1"), 3, "need the pose of the camera"),
        (("b15", "--points", "1,1", "2,2"), 3, "at least 3"),
        (("b15", "--points", "1,1", "2,x", "3,3"), 2, "expected X,Y"),
        (("b15", "--rect", "150,100,32,61"), 3, "outside the frame of 160 x 120"),
        (("b15", "--reference", "--rect", "1,1,9,9", "--tilt", "15"), 3, "also needs azimuth_deg"),
        (("b15", "--rect", "1,1,9,9", "--tilt", "95"), 2, "0<=x<=90"),
    ],
)
def test_what_is_no_region_is_not_added(roi, tmp_path, arguments, code, said):
    result = roi("add", *arguments)
    assert result.exit_code == code
    assert said in result.stderr
    assert regions(tmp_path) == ()


@pytest.mark.parametrize(
    ("rect", "said"), [("6,30,3,3", "too small, needs 100 px"), ("70,40,32,61", "shares 1000 px with b15")]
)
def test_a_region_that_cannot_be_used_is_told_when_it_is_added(roi, tmp_path, rect, said):
    assert "check" not in roi("add", "b15", "--reference", "--rect", "82,40,20,50").stderr
    result = roi("add", "b20", "--rect", rect)
    assert result.exit_code == 0
    assert said in result.stderr
    assert "fieldkit roi check" in result.stderr
    assert len(regions(tmp_path)) == 2


def test_list_prints_one_line_per_region_and_json(roi):
    roi("add", "flat", "--reference", "--rect", "6,30,32,61")
    assert "flat  reference  0/0           6,30 37,30 37,90 6,90" in roi("list").stdout
    (document,) = json.loads(roi("list", "--json").stdout)["regions"]
    assert document["kind"] == "reference"
    assert document["points_px"] == [[6, 30], [37, 30], [37, 90], [6, 90]]
    assert document["emissivity"] is None


def test_an_empty_list_says_what_to_type(roi):
    result = roi("list")
    assert result.stdout == ""
    assert "fieldkit roi add" in result.stderr


def test_a_region_is_removed(roi, tmp_path):
    roi("add", "flat", "--reference", "--rect", "6,30,32,61")
    assert roi("remove", "flat").exit_code == 0
    assert regions(tmp_path) == ()
    assert roi("remove", "flat").exit_code == 3


def test_what_is_missing_of_the_regions_together_is_reported_with_each_change(roi):
    assert "no reference" in roi("add", "b15", "--rect", "82,30,32,61").stderr
    assert not roi("add", "flat", "--reference", "--rect", "6,30,32,61").stderr.count("warning")
    assert "no reference" in roi("remove", "flat").stderr


def test_a_region_is_changed_and_the_file_keeps_its_comments(roi, tmp_path):
    roi("add", "b15", "--reference", "--rect", "82,30,32,61", "--tilt", "15", "--azimuth", "180")
    file = tmp_path / "fieldkit.toml"
    file.write_text(
        file.read_text().replace("\n[[region]]", "\n[[region]]  # sand of Tuesday"), encoding="utf-8"
    )
    assert roi("edit", "b15", "--shrink", "4", "--tilt", "15.5").exit_code == 0
    (changed,) = regions(tmp_path)
    assert changed.vertices == ((86, 34), (109, 34), (109, 86), (86, 86))
    assert (changed.tilt_deg, changed.azimuth_deg) == (15.5, 180.0)
    assert "[[region]]  # sand of Tuesday" in file.read_text()
    told = roi("edit", "b15", "--shrink", "9")
    assert told.exit_code == 0
    assert "too small, needs 100 px" not in told.stderr
    assert "100 px" in roi("edit", "b15", "--shrink", "2").stderr


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("b15",), 2, "give what to change"),
        (("b16", "--shrink", "2"), 3, "the regions are b15, flat"),
        (("b15", "--shrink", "16"), 3, "nothing of region 'b15' is 16 px inside its edge"),
        (("flat", "--tilt", "15"), 3, "also needs azimuth_deg"),
    ],
)
def test_a_change_that_is_none_or_wrong_leaves_the_file_alone(roi, tmp_path, arguments, code, said):
    roi("add", "b15", "--rect", "82,30,32,61")
    roi("add", "flat", "--reference", "--rect", "6,30,32,61")
    before = (tmp_path / "fieldkit.toml").read_bytes()
    result = roi("edit", *arguments)
    assert result.exit_code == code
    assert said in result.stderr
    assert (tmp_path / "fieldkit.toml").read_bytes() == before


def test_check_counts_pixels_and_passes_good_regions(roi):
    roi("add", "flat", "--reference", "--rect", "6,30,32,61")
    result = roi("check")
    assert result.exit_code == 0
    assert f"{32 * 61} px" in result.stdout


@pytest.mark.parametrize(("scale", "code"), [("0.01", 0), ("none", 3)])
def test_check_looks_at_the_pictures_of_a_session(roi, tmp_path, scale, code):
    """Twelve pictures of a bed at 310 K on ground at 300 K, 0.01 K a count, the region drawn on the bed."""
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    counts = np.full((120, 160), 30_000, np.uint16)
    counts[30:91, 6:38] = 31_000
    for minute in range(12):
        cv2.imwrite(str(pictures / f"20260512T12{minute:02}00.tiff"), counts)
    names = ("--time-format", "%Y%m%dT%H%M%S", "--zone", "UTC", "--kelvin-per-count", scale)
    session = tmp_path / "pictures.h5"
    imported = fieldkit("import", pictures, "-C", tmp_path, *names, "-o", session)
    assert imported.exit_code == 0, imported.stderr
    roi("add", "flat", "--reference", "--rect", "6,30,32,61")
    result = roi("check", "--session", str(session), "--json")
    assert result.exit_code == code
    if code:
        assert "no usable frame with temperatures" in result.stderr
    else:
        (inspection,) = json.loads(result.stdout)["regions"]
        assert (inspection["level"], inspection["spread_k"], inspection["edge_k"]) == ("ok", 0.0, 0.0)


def test_an_offset_is_given_as_kelvin_or_by_the_name_of_its_record(roi, tmp_path):
    roi("add", "flat", "--reference", "--rect", "6,30,32,61")
    roi("add", "b15", "--rect", "82,30,32,61")
    record = CalibrationRecord(
        "uniformity", "board", datetime(2026, 12, 10, tzinfo=UTC), 0.31, 0.06, "K", "a board",
        values={"b15": 0.31}, uncertainties={"b15": 0.06},
    )  # fmt: skip
    save(record, tmp_path / "calibration")
    assert roi("edit", "b15", "--offset", "@board").exit_code == 0
    assert 'offset_k = "@board"' in (tmp_path / "fieldkit.toml").read_text()
    assert load_config(tmp_path / "fieldkit.toml").estimator_settings().offsets_k == {"b15": 0.31}
    assert roi("edit", "b15", "--offset", "-0.2").exit_code == 0
    assert load_config(tmp_path / "fieldkit.toml").estimator_settings().offsets_k == {"b15": -0.2}
    unknown = roi("edit", "b15", "--emissivity", "@sand")
    assert unknown.exit_code == 3
    assert "no calibration named 'sand'" in unknown.output
    assert "@sand" not in (tmp_path / "fieldkit.toml").read_text()
    assert roi("edit", "b15", "--offset", "warm").exit_code == 2


def test_a_region_that_crosses_itself_is_refused_with_what_to_do(roi, tmp_path):
    file = tmp_path / "fieldkit.toml"
    before = file.read_text(encoding="utf-8")
    added = roi("add", "flat", "--reference", "--points", "6,30", "37,90", "37,30", "6,90")
    assert added.exit_code == 3
    assert "the outline crosses itself; list the corners in order" in added.stderr
    assert file.read_text(encoding="utf-8") == before
    tie = (
        '[[region]]\nname = "flat"\nkind = "reference"\npoints_px = [[6, 30], [37, 90], [37, 30], [6, 90]]\n'
    )
    file.write_text(before + tie, encoding="utf-8")
    checked = roi("check")
    assert checked.exit_code == 3
    assert "give the corners in order" in checked.stdout


@pytest.fixture
def empty_field(tmp_path):
    """The simulated field without regions, by a command on it."""
    empty_campaign(tmp_path / "field")
    return lambda *arguments: fieldkit("roi", arguments[0], "-C", tmp_path / "field", *arguments[1:])


def test_suggested_regions_are_listed_then_accepted_by_name(empty_field, tmp_path):
    """They lie inside the beds of the scene."""
    listed = json.loads(empty_field("suggest", "--json").stdout)
    assert listed["added"] == []
    names = [one["name"] for one in listed["suggestions"]]
    assert "flat" in names
    assert empty_field("suggest", "flat", "nowhere").exit_code == 3
    accepted = empty_field("suggest", "flat")
    assert accepted.exit_code == 0, accepted.stderr
    assert "spirit level" in accepted.stderr
    (flat,) = load_config(tmp_path / "field" / "fieldkit.toml").regions
    assert flat.kind is RegionKind.REFERENCE
    inside = flat.mask(FRAME_SHAPE)
    beds = [Region(bed.name, RegionKind.TARGET, bed.vertices).mask(FRAME_SHAPE) for bed in BEDS]
    assert [bool(bed[inside].all()) for bed in beds] == [True, False, False, False]
