"""``fieldkit calibrate pose`` on points projected by OpenCV."""

import cv2
import numpy as np
import pytest
import rasterio.crs

from fieldkit.config.pose import load_pose
from fieldkit.physics.camera_geometry import Camera
from tests.harness.command_line import document, fieldkit, succeed

TRUTH = Camera((354600.0, 3936200.0, 112.0), 20.0, -25.0, 4.0, 50.0, (120, 160))
POINTS = np.array([
    [354602.0, 3936215.0, 100.0], [354608.0, 3936217.0, 101.5], [354606.0, 3936228.0, 100.2],
    [354614.0, 3936232.0, 103.0], [354610.0, 3936221.0, 99.0],
])  # fmt: skip
OPTIONS = ("--crs", "EPSG:32654", "--frame", "160x120", "--ground-m", "100")


def words(folder, text, *options):
    """The words of a calibration by the points of a table."""
    (folder / "points.csv").write_text(text)
    return ("calibrate", "pose", folder / "points.csv", "-o", folder / "pose.toml", *options)


@pytest.fixture
def table():
    intrinsics = np.array([[TRUTH.focal_px, 0, 79.5], [0, TRUTH.focal_px, 59.5], [0, 0, 1]])
    turned = cv2.Rodrigues(TRUTH.axes)[0]
    pixels = cv2.projectPoints(POINTS - TRUTH.position_m, turned, np.zeros(3), intrinsics, None)[0]
    rows = np.column_stack([pixels.reshape(-1, 2), POINTS])
    return "x_px,y_px,east_m,north_m,height_m\n" + "\n".join(",".join(map(str, row)) for row in rows)


def test_pose_file_sees_the_points_where_they_were_marked(tmp_path, table):
    done = succeed(*words(tmp_path, table, *OPTIONS))
    assert " 0.0 px" in done.output
    assert "convergence -0.93°, scale 0.99986" in done.output
    pose = load_pose(tmp_path / "pose.toml", 0)
    assert pose.position_m == pytest.approx(TRUTH.position_m, abs=1e-2)
    # true north lies 0.94 degrees clockwise of the grid's: (longitude - 141) sin(latitude)
    assert pose.yaw_deg == pytest.approx(20.0 - 0.94, abs=0.02)
    assert (pose.pitch_deg, pose.roll_deg, pose.table.hfov_deg) == pytest.approx((-25.0, 4.0, 50.0), abs=1e-2)
    assert "# standard uncertainty" in (tmp_path / "pose.toml").read_text()


def test_marks_twice_as_uncertain_give_a_pose_twice_as_uncertain(tmp_path, table):
    sds = []
    for mark_sd in ("0.5", "1"):
        fit = document(*words(tmp_path, table, *OPTIONS, "--mark-sd-px", mark_sd, "--range-m", "500"))
        sds.append(np.array(list(fit["sd"].values())))
    np.testing.assert_allclose(sds[1], 2.0 * sds[0], rtol=1e-3)
    assert "range_m = 500" in (tmp_path / "pose.toml").read_text()


@pytest.mark.parametrize(
    ("change", "options", "said"),
    [
        (lambda text: text.replace("x_px", "x"), OPTIONS, "x_px,y_px,east_m"),
        (lambda text: "\n".join(text.split("\n")[:4]), OPTIONS, "needs 4 points"),
        (str, (*OPTIONS[:-2],), "--ground-m, --dem"),
        (str, (*OPTIONS, "--frame", "160"), "columns x rows"),
        (str, (*OPTIONS, "--frame", "0x120"), "columns x rows"),
        (lambda text: text.replace("354602.0", "nan"), OPTIONS, "row 2: "),
        (str, (*OPTIONS, "--range-m", "-5"), "range_m"),
        (str, (*OPTIONS[:-1], "500"), "--ground-m 500"),
        (str, (*OPTIONS, "--distortion", "0.1,nan,0,0,0"), "five numbers"),
    ],
)
def test_what_gives_no_pose_is_an_error(tmp_path, table, change, options, said):
    done = fieldkit(*words(tmp_path, change(table), *options))
    assert done.exit_code != 0
    assert said in done.output
    assert not (tmp_path / "pose.toml").exists()


def test_a_pose_file_can_be_read_whatever_names_are_in_it(tmp_path, table):
    """Quotation marks of a CRS in WKT, or of a file, are those of TOML as well."""
    wkt = rasterio.crs.CRS.from_epsg(32654).to_wkt()
    lens = "--distortion=-0.01,0,0,0,0"
    succeed(*words(tmp_path, table, "--crs", wkt, *OPTIONS[2:4], "--dem", 'it\'s "dem".tif', lens))
    found = load_pose(tmp_path / "pose.toml", 0)
    assert (found.table.crs, found.table.dem) == (wkt, 'it\'s "dem".tif')
    assert found.table.distortion == [-0.01, 0.0, 0.0, 0.0, 0.0]
