import json
from datetime import UTC, datetime

import cv2
import numpy as np
import pytest

from fieldkit.calibration.calibration_record import CalibrationRecord, save
from fieldkit.config import ConfigMistakesError, load_config
from fieldkit.model.errors import ConfigError
from fieldkit.model.site import Region, RegionKind
from fieldkit.simulation.facets import FRAME_SHAPE
from fieldkit.simulation.scene import BEDS
from tests.harness.command_line import document, fieldkit, invoke, succeed
from tests.harness.field_page_journey import empty_campaign
from tests.harness.next_steps import at
from tests.harness.toml_text import toml_keys


@pytest.fixture
def roi(tmp_path):
    succeed("init", tmp_path)
    file = tmp_path / "fieldkit.toml"
    camera = '\n[camera]\ndriver = "purethermal"\nwidth_px = 160\nheight_px = 120\n'
    file.write_text(file.read_text() + camera, encoding="utf-8")
    return lambda *arguments: succeed("roi", arguments[0], "-C", tmp_path, *arguments[1:])


@pytest.fixture
def refused(roi, tmp_path):
    """A command that changes no region: its exit code and its message."""

    def result(*arguments):
        before = (tmp_path / "fieldkit.toml").read_bytes()
        done = fieldkit("roi", arguments[0], "-C", tmp_path, *arguments[1:])
        assert (tmp_path / "fieldkit.toml").read_bytes() == before
        return done.exit_code, done.stderr

    return result


def regions(tmp_path):
    return load_config(tmp_path / "fieldkit.toml", environment={}).regions


def test_regions_are_added_by_rectangle_and_by_corners(roi, tmp_path):
    roi("add", "flat", "--reference", "--rect", "6,30,32,61")
    corners = ("--points", "82,30", "113,30", "113,90.5", "82,90")
    roi("add", "b15", *corners, "--tilt", "15", "--azimuth", "180", "--emissivity", "0.93")
    outline = ((6, 30), (37, 30), (37, 90), (6, 90))
    drawn = (
        Region("flat", RegionKind.REFERENCE, outline, 0.0, 0.0),
        Region("b15", RegionKind.TARGET, ((82, 30), (113, 30), (113, 90.5), (82, 90)), 15.0, 180.0, 0.93),
    )
    assert repr(regions(tmp_path)) == repr(drawn)  # with NaN, which equals nothing


LOOKING_DOWN = toml_keys(
    crs="EPSG:32613", east_m=500000.0, north_m=4172000.0, height_m=2327.0, yaw_deg=0.0, pitch_deg=-90.0,
    hfov_deg=53.13010235415598, range_m=50.0, ground_m=2317.0,
)  # fmt: skip
"""From 10 m above, on the meridian of its zone: 160 pixels of focal length, 16 pixels to the metre."""
ON_THE_GROUND = ("--points", "500001,4172001", "500003,4172001", "500003,4171999", "500001,4171999")
BEYOND = ("--points", "500001,4172001", "500009,4172001", "500003,4171999")


def test_corners_on_the_ground_are_drawn_where_the_pose_sees_them(roi, tmp_path):
    (tmp_path / "pose.toml").write_text(LOOKING_DOWN)
    roi("add", "b15", "--rect", "1,1,20,20")
    roi("add", "flat", "--reference", "--pose", tmp_path / "pose.toml", *ON_THE_GROUND)
    assert regions(tmp_path)[1].points_px == ((95.5, 43.5), (127.5, 43.5), (127.5, 75.5), (95.5, 75.5))
    with pytest.raises(ConfigError, check=at("500009,4172001")):
        invoke("roi", "add", "b16", "-C", tmp_path, "--pose", tmp_path / "pose.toml", *BEYOND)
    assert len(regions(tmp_path)) == 2


def test_a_region_stays_on_the_ground_of_the_campaigns_pose(roi, refused, tmp_path):
    with (tmp_path / "fieldkit.toml").open("a") as file:
        file.write(f"\n[camera.pose]\n{LOOKING_DOWN}")
    roi("add", "flat", "--reference", "--ground", *ON_THE_GROUND)
    (flat,) = regions(tmp_path)
    assert flat.points_px == ((95.5, 43.5), (127.5, 43.5), (127.5, 75.5), (95.5, 75.5))
    assert flat.points_m[0] == (500001.0, 4172001.0, 2317.0)
    roi("edit", "flat", "--shrink", "2")
    assert regions(tmp_path)[0].points_m == ()
    code, message = refused("add", "b15", "--ground", *BEYOND)
    assert code == 3
    assert "region[1].points_m: 500009,4172001: " in message


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("b15",), 3, "--points or --rect"),
        (("b15", "--rect", "1,1,9,9", "--points", "1,1"), 3, "--points or --rect"),
        (("b15", "--rect", "1,1,9,1"), 2, "at least 2 pixels"),
        (("b15", "--rect", "1,1,9,9", "--ground"), 2, "--pose and --ground are for --points"),
        (("b15", "--ground", "--points", "1,1", "2,2", "3,1"), 3, "camera.pose"),
        (("b15", "--points", "1,1", "2,x", "3,3"), 2, "expected X,Y"),
        (("b15", "--rect", "150,100,32,61"), 3, "160 x 120"),
    ],
)
def test_what_is_no_region_is_not_added(refused, arguments, code, said):
    exit_code, message = refused("add", *arguments)
    assert exit_code == code
    assert said in message


@pytest.mark.parametrize(("rect", "said"), [("6,30,6,30", "7 x 7"), ("70,40,32,61", "1000 px with b15")])
def test_a_region_that_cannot_be_used_is_told_when_it_is_added(roi, tmp_path, rect, said):
    assert "check" not in roi("add", "b15", "--reference", "--rect", "82,40,20,50").stderr
    warning = roi("add", "b20", "--rect", rect).stderr
    assert said in warning
    assert "roi check" in warning
    assert len(regions(tmp_path)) == 2


def test_list_prints_one_line_per_region_and_json(roi):
    roi("add", "flat", "--reference", "--rect", "6,30,32,61")
    assert "flat  reference  0/0           6,30 37,30 37,90 6,90" in roi("list").stdout
    assert f"{32 * 61} px" in roi("check").stdout
    (flat,) = json.loads(roi("list", "--json").stdout)["regions"]
    assert (flat["kind"], flat["emissivity"]) == ("reference", None)
    assert flat["points_px"] == [[6, 30], [37, 30], [37, 90], [6, 90]]


def test_a_removed_region_is_gone_and_an_empty_list_says_what_to_type(roi, refused):
    roi("add", "flat", "--reference", "--rect", "6,30,32,61")
    roi("remove", "flat")
    result = roi("list")
    assert result.stdout == ""
    assert "roi add" in result.stderr
    assert refused("remove", "flat")[0] == 3


def test_what_is_missing_of_the_regions_together_is_reported_with_each_change(roi, tmp_path):
    assert "no reference" in roi("add", "b15", "--rect", "82,30,32,61").stderr
    check = fieldkit("roi", "check", "-C", tmp_path)
    assert check.exit_code == 3
    assert "no reference" in check.stdout
    assert not roi("add", "flat", "--reference", "--rect", "6,30,32,61").stderr.count("warning")
    assert "no reference" in roi("remove", "flat").stderr


def test_a_region_is_changed_and_the_file_keeps_its_comments(roi, tmp_path):
    roi("add", "b15", "--reference", "--rect", "82,30,32,61", "--tilt", "15", "--azimuth", "180")
    file = tmp_path / "fieldkit.toml"
    file.write_text(file.read_text().replace("\n[[region]]", "\n[[region]]  # wet"), encoding="utf-8")
    roi("edit", "b15", "--shrink", "4", "--tilt", "15.5")
    (changed,) = regions(tmp_path)
    assert changed.points_px == ((86, 34), (109, 34), (109, 86), (86, 86))
    assert (changed.tilt_deg, changed.azimuth_deg) == (15.5, 180.0)
    assert "[[region]]  # wet" in file.read_text()
    assert "7 x 7" not in roi("edit", "b15", "--shrink", "8").stderr
    assert "7 x 7" in roi("edit", "b15", "--shrink", "2").stderr


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("b15",), 3, "nothing is to change"),
        (("b16", "--shrink", "2"), 3, "b15"),
        (("b15", "--shrink", "16"), 3, "b15: "),
        (("flat", "--tilt", "15"), 3, "azimuth"),
    ],
)
def test_a_change_that_is_none_or_wrong_leaves_the_file_alone(roi, refused, arguments, code, said):
    roi("add", "b15", "--rect", "82,30,32,61")
    roi("add", "flat", "--reference", "--rect", "6,30,32,61")
    exit_code, message = refused("edit", *arguments)
    assert exit_code == code
    assert said in message


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
    succeed("import", pictures, "-C", tmp_path, *names, "-o", session)
    roi("add", "flat", "--reference", "--rect", "6,30,32,61")
    result = fieldkit("roi", "check", "-C", tmp_path, "--session", session, "--json")
    assert result.exit_code == code
    if code:
        assert str(session) in result.stderr
    else:
        (inspection,) = json.loads(result.stdout)["regions"]
        assert (inspection["level"], inspection["spread_k"], inspection["edge_k"]) == ("ok", 0.0, 0.0)


def test_an_offset_is_given_as_kelvin_or_by_the_name_of_its_record(roi, refused, tmp_path):
    roi("add", "flat", "--reference", "--rect", "6,30,32,61")
    roi("add", "b15", "--rect", "82,30,32,61")
    date, values = datetime(2026, 12, 10, tzinfo=UTC), {"b15": 0.31}
    record = CalibrationRecord("uniformity", "board", date, 0.31, 0.06, "K", "a board", values=values)
    save(record, tmp_path / "calibration")
    roi("edit", "b15", "--offset", "@board")
    assert 'offset_k = "@board"' in (tmp_path / "fieldkit.toml").read_text()
    assert load_config(tmp_path / "fieldkit.toml").estimator_settings().offsets_k == {"b15": 0.31}
    roi("edit", "b15", "--offset", "-0.2")
    assert load_config(tmp_path / "fieldkit.toml").estimator_settings().offsets_k == {"b15": -0.2}
    code, message = refused("edit", "b15", "--emissivity", "@sand")
    assert code == 3
    assert "'sand'" in message
    assert refused("edit", "b15", "--offset", "warm")[0] == 2


def test_a_region_that_crosses_itself_is_refused_with_what_to_do(roi, tmp_path):
    file = tmp_path / "fieldkit.toml"
    before = file.read_text(encoding="utf-8")
    corners = ("6,30", "37,90", "37,30", "6,90")
    with pytest.raises(ConfigMistakesError, match="order", check=at("flat: region[0].points_px")):
        invoke("roi", "add", "-C", tmp_path, "flat", "--reference", "--points", *corners)
    assert file.read_text(encoding="utf-8") == before
    tie = (
        '[[region]]\nname = "flat"\nkind = "reference"\npoints_px = [[6, 30], [37, 90], [37, 30], [6, 90]]\n'
    )
    file.write_text(before + tie, encoding="utf-8")
    checked = fieldkit("roi", "check", "-C", tmp_path)
    assert checked.exit_code == 3
    assert "in order" in checked.stdout


def test_suggested_regions_are_listed_then_accepted_by_name(tmp_path):
    """They lie inside the beds of the scene."""
    empty_campaign(tmp_path / "field")
    suggest = ("roi", "suggest", "-C", tmp_path / "field")
    listed = document(*suggest)
    assert listed["added"] == []
    assert "flat" in [suggestion["name"] for suggestion in listed["suggestions"]]
    with pytest.raises(ConfigError, check=at("nowhere")):
        invoke(*suggest, "flat", "nowhere")
    assert "spirit level" in succeed(*suggest, "flat").stderr
    (flat,) = load_config(tmp_path / "field" / "fieldkit.toml").regions
    assert flat.kind is RegionKind.REFERENCE
    inside = flat.mask(FRAME_SHAPE)
    beds = [Region(bed.name, RegionKind.TARGET, bed.points_px).mask(FRAME_SHAPE) for bed in BEDS]
    assert [bool(bed[inside].all()) for bed in beds] == [True, False, False, False]
