"""The camera's pose in the configuration, and regions on its ground."""

import numpy as np
import pytest
import rasterio

from fieldkit.config import ConfigMistakesError, config_from_text, load_config
from fieldkit.config.edit import change_region, editing
from fieldkit.config.pose import load_pose, trajectory_from
from fieldkit.model.errors import ConfigError
from fieldkit.recording.campaign import open_campaign
from tests.harness.next_steps import at

SITE = "[site]\nlatitude_deg = 37.7\nlongitude_deg = -105.9\n"
CAMERA = '[camera]\ndriver = "purethermal"\nwidth_px = 160\nheight_px = 120\n'
LENS = 'crs = "EPSG:32613"\nhfov_deg = 60.0\nrange_m = 50.0\nground_m = 2300.0\n'
LENS_OF_DEM = LENS.replace("ground_m = 2300.0", 'dem = "dem.tif"')
DOWN = "east_m = 500000.0\nnorth_m = 4172000.0\nheight_m = 2310.0\nyaw_deg = 0.0\npitch_deg = -90.0\n"
CORNERS = "[[499999, 4171999], [500001, 4171999], [500001, 4172001]]"
CORNERS_OF_REGION = "region[0].points_m"
REGION = '[[region]]\nname = "flat"\nkind = "reference"\npoints_m = '
RUN = """time,east_m,north_m,height_m,yaw_deg,pitch_deg,roll_deg
2016-01-01T19:00:00Z,500000,4172000,2310,0,-90,0
2016-01-01T20:00:00Z,500002,4172000,2310,0,-90,0
"""


def campaign(folder, pose=LENS + DOWN, region=REGION + CORNERS):
    (folder / "fieldkit.toml").write_text(f"{SITE}{CAMERA}[camera.pose]\n{pose}\n{region}\n")
    return folder / "fieldkit.toml"


def loaded(file, *settings):
    return load_config(file, settings=settings, environment={})


def test_corners_on_level_ground_are_seen_from_above_where_the_pinhole_shows_them(tmp_path):
    """A metre 10 m below is a tenth of the focal length, 80 px / tan(30 degrees) = 138.6 px."""
    (flat,) = loaded(campaign(tmp_path)).regions
    assert flat.points_m[0] == (499999.0, 4171999.0, 2300.0)
    # on the central meridian of zone 13 the grid's north is true north
    assert flat.points_px == ((65.6, 73.4), (93.4, 73.4), (93.4, 45.6))


def test_corners_on_the_ground_are_added_from_python(tmp_path):
    field = open_campaign(campaign(tmp_path, region="").parent)
    corners = [(499999.0, 4171999.0), (500001.0, 4171999.0), (500001.0, 4172001.0)]
    field.add_region("flat", points=corners, is_ground=True, kind="reference")
    assert field.regions[0].points_px == ((65.6, 73.4), (93.4, 73.4), (93.4, 45.6))


def test_a_session_holds_pose_trajectory_and_corners_itself(tmp_path):
    file = campaign(tmp_path, LENS + 'trajectory = "run.tum"')
    remark = '# of the "mast" \\ in TUM\'s format, \t Köln\n'
    rows = [f"{1451674800 + 3600 * hour} {500000 + 2 * hour} 4172000 2310 1 0 0 0" for hour in range(2)]
    (tmp_path / "run.tum").write_text(remark + "\n".join(rows), encoding="utf-8")
    config = loaded(file)
    (tmp_path / "run.tum").unlink()
    again = config_from_text(config.to_toml(), tmp_path / "recordings" / "a.h5")
    assert again.tables == config.tables
    assert repr(again.regions) == repr(config.regions)  # NaN is equal to NaN
    half_past = again.pose.at(1_451_674_800_000_000_000 + 1800 * 10**9)
    assert half_past.position_m == (500001.0, 4172000.0, 2310.0)


def test_a_pose_may_be_a_file_with_the_same_keys_and_is_replaced_by_another(tmp_path):
    file = campaign(tmp_path)
    table = loaded(file).tables.camera.pose
    (tmp_path / "survey").mkdir()
    (tmp_path / "survey" / "pose.toml").write_text(LENS + DOWN)
    of_file = loaded(file, 'camera.pose="survey/pose.toml"').tables.camera.pose
    assert of_file == table == load_pose(tmp_path / "survey" / "pose.toml", 0).table
    stored, session = loaded(file).to_toml(), tmp_path / "recordings" / "a.h5"
    turned = config_from_text(
        stored, session, settings=["camera.pose.yaw_deg=90", "camera.pose.pitch_deg=-45"]
    )
    assert turned.pose.at(0).yaw_deg == pytest.approx(90.0)
    # where the region was drawn while recording stays as it was
    assert repr(turned.regions) == repr(loaded(file).regions)


def test_a_dem_is_found_beside_the_file_that_names_it(tmp_path):
    (tmp_path / "survey").mkdir()
    (tmp_path / "survey" / "pose.toml").write_text(LENS_OF_DEM + DOWN)
    config = loaded(campaign(tmp_path, region=""), 'camera.pose="survey/pose.toml"')
    assert config.pose.at(0).dem == tmp_path / "survey" / "dem.tif"


LOOKING_NORTH = DOWN.replace("-90.0", "-20.0").replace("yaw_deg = 0.0", "yaw_deg = 0.0\nroll_deg = 0.0")


@pytest.fixture
def dem(tmp_path):
    """Cells of 1 m: ground that rises by 0.1 to the north, and a wall of 8 m, 12 m before the camera."""
    heights = np.repeat(2300.0 + 0.1 * np.arange(60.0)[::-1, np.newaxis], 60, axis=1)
    heights[47] += 8.0
    place = rasterio.Affine(1.0, 0.0, 499970.0, 0.0, -1.0, 4172060.0)
    profile = {"driver": "GTiff", "width": 60, "height": 60, "count": 1, "dtype": "float64"}
    with rasterio.open(tmp_path / "dem.tif", "w", crs="EPSG:32613", transform=place, **profile) as file:
        file.write(heights, 1)


@pytest.mark.parametrize(
    ("north", "words"), [(6, ""), (20, "499999,4172020"), (90, "dem.tif: .* 499999, 4172090")]
)
def test_corners_have_the_heights_of_a_dem_and_are_not_seen_behind_a_wall(tmp_path, dem, north, words):
    corners = [[499999, 4172000 + north], [500001, 4172000 + north], [500000, 4172001 + north]]
    pose = LENS_OF_DEM + LOOKING_NORTH
    file = campaign(tmp_path, pose.replace("60.0", "100.0"), REGION + str(corners))
    if words:
        with pytest.raises(ConfigMistakesError, match=rf"region\[0\]\.points_m: {words}"):
            loaded(file)
        return
    (flat,) = loaded(file).regions
    assert [up for _, _, up in flat.points_m] == pytest.approx([2300.55, 2300.55, 2300.65])


@pytest.mark.parametrize(
    ("pose", "region", "place", "values"),
    [
        (LENS + DOWN.replace("2310.0", "nan"), "", "camera.pose.height_m", "nan"),
        (LENS + DOWN.replace("yaw_deg = 0.0", ""), "", "camera.pose.yaw_deg", "missing"),
        (LENS + DOWN.replace("-90.0", "-91.0"), "", "camera.pose.pitch_deg", "-91.0"),
        (LENS + DOWN.split("yaw")[0] + "quaternion = [0, 0, 0, 0]", "", "camera.pose.quaternion", "0, not 1"),
        (LENS + DOWN + 'dem = "dem.tif"', "", "camera.pose.ground_m", "dem"),
        (LENS + 'trajectory = "none.csv"', "", "camera.pose", "none.csv: "),
        (LENS + 'trajectory = "far.csv"', "", "camera.pose", "far.csv:3: .*year"),
        (LENS.replace("32613", "99999") + DOWN, REGION + CORNERS, CORNERS_OF_REGION, "EPSG:99999"),
        (LENS + DOWN.replace("-90.0", "20.0"), REGION + CORNERS, CORNERS_OF_REGION, "499999,4171999"),
        (LENS + DOWN, REGION + CORNERS.replace("500001", "500051"), CORNERS_OF_REGION, "500051,4171999"),
        (LENS + DOWN, REGION + "[[1, 2], [3, 4]]", CORNERS_OF_REGION, "three corners"),
        (LENS_OF_DEM.replace("dem.tif", "no.tif") + DOWN, REGION + CORNERS, CORNERS_OF_REGION, "no.tif"),
    ],
)
def test_a_bad_pose_and_corners_that_it_does_not_see_are_mistakes_of_their_key(
    tmp_path, pose, region, place, values
):
    (tmp_path / "far.csv").write_text(RUN.replace("2016-01-01T20", "3000-01-01T20"))
    with pytest.raises(ConfigMistakesError, match=values) as error:
        loaded(campaign(tmp_path, pose, region))
    assert str(error.value.place).endswith(f": {place}")


@pytest.mark.parametrize("time", ["Infinity", "1e30", "-1e11", "NaN"])
def test_a_pose_of_no_time_that_a_session_can_hold_is_named_with_its_line(time):
    text = f"0 1 2 3 0 0 0 1\n{time} 1 2 3 0 0 0 1\n"
    with pytest.raises(ConfigError, check=at("run.tum:2")):
        trajectory_from(text, "run.tum")


@pytest.mark.parametrize(
    ("camera", "words"),
    [(CAMERA, "camera.pose"), (CAMERA.split("width")[0] + "[camera.pose]\n" + LENS + DOWN, "width_px")],
)
def test_corners_on_the_ground_need_pose_and_frame(tmp_path, camera, words):
    (tmp_path / "fieldkit.toml").write_text(f"{SITE}{camera}\n{REGION}{CORNERS}\n")
    with pytest.raises(ConfigMistakesError, match=rf"region\[0\]\.points_m: .*{words}"):
        loaded(tmp_path / "fieldkit.toml")


def test_a_region_redrawn_in_pixels_no_longer_lies_on_the_ground(tmp_path):
    file = campaign(tmp_path)
    with editing(file) as draft:
        change_region(draft, "flat", {"points_px": [[10, 10], [40, 10], [40, 40]]})
    (flat,) = loaded(file).regions
    assert flat.points_m == ()
    assert flat.points_px[0] == (10.0, 10.0)
