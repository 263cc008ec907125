"""``fieldkit calibrate horizon`` on ground and pixels whose skyline follows from a right-angled triangle."""

from pathlib import Path

import numpy as np
import pytest
import rasterio
from click.testing import Result

from fieldkit.config import load_config
from fieldkit.config.references import load_horizon
from fieldkit.model.errors import ConfigError
from fieldkit.physics.horizon import horizon_elevation
from tests.harness.command_line import fieldkit, invoke, succeed
from tests.harness.toml_text import toml_keys

PLACE = {"crs": "EPSG:32654", "east_m": 500000.0, "range_m": 100.0, "ground_m": 0.0}
POSE = toml_keys(**PLACE, north_m=3936200.0, height_m=2.0, yaw_deg=90.0, pitch_deg=0.0, hfov_deg=90.0)


def calibrate(folder: Path, *words: str) -> Result:
    return succeed("calibrate", "horizon", "-o", folder / "horizon.csv", *words)


def test_a_wall_in_the_east_is_as_high_as_its_triangle(tmp_path):
    heights = np.zeros((201, 201), np.float32)
    heights[:, 150:] = 20.0  # from 49.5 m east of the middle cell on, where the zone's north is true north
    transform = rasterio.Affine(1.0, 0.0, 500000.0 - 100.5, 0.0, -1.0, 3936200.0 + 100.5)
    profile = {"driver": "GTiff", "width": 201, "height": 201, "count": 1, "dtype": "float32"}
    with rasterio.open(tmp_path / "dem.tif", "w", crs="EPSG:32654", transform=transform, **profile) as file:
        file.write(heights, 1)
    place = ("--dem", str(tmp_path / "dem.tif"), "--crs", "EPSG:32654", "--place", "500000", "3936200")
    calibrate(tmp_path, *place)
    azimuths, elevations = np.array(load_horizon(tmp_path / "horizon.csv")).T
    found = dict(zip(azimuths.tolist(), elevations.tolist(), strict=True))
    aside = 20.0 * np.cos(np.radians(30.0)) / 50.0
    expected = [*np.degrees(np.arctan([20.0 / 50.0, aside])), 0.0]
    assert [found[azimuth] for azimuth in (90.0, 120.0, 270.0)] == pytest.approx(expected, abs=0.3)
    calibrate(tmp_path, *place, "--nearest-m", "80")
    far = dict(load_horizon(tmp_path / "horizon.csv"))[90.0]
    assert far == pytest.approx(np.degrees(np.arctan(20.0 / 80.0)), abs=0.3)
    with pytest.raises(ConfigError, match=" 360 of 360 "):
        invoke("calibrate", "horizon", *place, "--nearest-m", "1000")


UP, ASIDE = np.degrees(np.arctan(20.0 / 80.0)), np.degrees(np.arctan(0.5))


@pytest.mark.parametrize(
    ("clicks", "expected"),
    [
        ("79.5,39.5\n119.5,59.5\n39.5,59.5\n", [(90.0 - ASIDE, 0.0), (90.0, UP), (90.0 + ASIDE, 0.0)]),
        ("79.5,59.5\n79.5,39.5\n79.5,39.5\n79.5,49.5\n", [(90.0, UP)]),  # as at a cliff, or tapped twice
    ],
)
def test_the_highest_pixels_of_the_skyline_become_azimuths_and_elevations(tmp_path, clicks, expected):
    """80 px of focal length: the middle row is level, 80 px aside are 45 degrees."""
    (tmp_path / "pose.toml").write_text(POSE)
    (tmp_path / "clicks.csv").write_text("x_px,y_px\n" + clicks)
    files = ("--skyline", str(tmp_path / "clicks.csv"), "--pose", str(tmp_path / "pose.toml"))
    calibrate(tmp_path, *files, "--frame", "160x120")
    np.testing.assert_allclose(load_horizon(tmp_path / "horizon.csv")[1:-1], expected, atol=0.02)


@pytest.mark.parametrize("words", [("--crs", "EPSG:32654"), ("--regions", "--dem", __file__)])
def test_half_of_the_options_or_too_many_are_wrong_usage(words):
    assert fieldkit("calibrate", "horizon", *words).exit_code == 2


CAMPAIGN = f"""schema = 1
[site]
latitude_deg = 35.5
longitude_deg = 141.0
horizon = [[180.0, 1.0], [181.0, 3.0]]
[camera]
driver = "purethermal"
width_px = 160
height_px = 120
[camera.pose]
{toml_keys(**PLACE, north_m=3936190.0, height_m=6.0, yaw_deg=0.0, pitch_deg=-30.0, hfov_deg=60.0)}
# lower
[[region]]
name = "low"
kind = "reference"
points_m = [[500000, 3936200, 0.0], [500001, 3936200, 0.0], [500001, 3936201, 0.0], [500000, 3936201, 0.0]]
[[region]]
name = "high"
points_m = [[499998, 3936200, 0.5], [499999, 3936200, 0.5], [499999, 3936201, 0.5], [499998, 3936201, 0.5]]
"""


def test_a_higher_bed_is_the_horizon_of_the_lower_one(tmp_path):
    """Half a metre above it, a metre to the west, where the zone's north is true north; and the site's."""
    file = tmp_path / "fieldkit.toml"
    file.write_text(CAMPAIGN)
    done = succeed("calibrate", "horizon", "-C", tmp_path, "--regions")
    assert "26.6° at azimuth 270°" in done.output
    assert "\n# lower\n" in file.read_text()
    known = load_config(file).estimator_settings()
    assert set(known.horizons) == {"low"}
    rise = 0.5 * 0.9996  # per metre on the ground: the grid is shorter by 0.04 % in the middle of its zone
    expected = [*np.degrees(np.arctan([rise, rise * np.cos(np.radians(30.0))])), 2.23, 3.0]
    found = horizon_elevation(known.horizon_of("low"), [270.0, 300.0, 320.0, 181.0])
    np.testing.assert_allclose(found, expected, atol=0.01)
