"""Layers on the ground: an oblique view of a ridge, a crater and a plain, against the heights themselves."""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import rasterio

from fieldkit.calibrate.horizon import horizon_from_dem
from fieldkit.config.ground import Ground
from fieldkit.config.pose import load_pose, read_pose
from fieldkit.estimation.pixel_slopes import SlopeMap
from fieldkit.ground.on_ground import ground_view, write_on_ground
from fieldkit.ground.terrain_products import Layer
from fieldkit.model.errors import ConfigError, NoAnswerError
from fieldkit.model.site import Site
from fieldkit.physics.camera_geometry import Grid, horizon_of_ground, project
from fieldkit.physics.facet import tilt_azimuth
from fieldkit.results.slope_map import MappedSession
from fieldkit.sessions.formats import geotiff
from tests.harness.next_steps import at
from tests.harness.toml_text import toml_keys

LENS = {"crs": "EPSG:32654", "hfov_deg": 50.0, "range_m": 90.0}
PLACE = {"east_m": 354600.0, "north_m": 3936200.0, "height_m": 112.0}
POSE = {**LENS, **PLACE, "yaw_deg": 10.0, "pitch_deg": -25.0}
SHAPE = (120, 160)


def terrain(east, north):
    ridge = 3.0 * np.exp(-(((north - 3936236.0) / 3.0) ** 2))
    return 100.0 + ridge - 1.5 * np.exp(-((east - 354606.0) ** 2 + (north - 3936222.0) ** 2) / 8.0)


@pytest.fixture
def dem(tmp_path):
    """200 x 200 cells of half a metre."""
    centre = 0.5 * (np.arange(200) + 0.5)
    heights = terrain(*np.meshgrid(354550.0 + centre, 3936290.0 - centre))
    half_metres = rasterio.Affine(0.5, 0.0, 354550.0, 0.0, -0.5, 3936290.0)
    return write_dem(tmp_path / "dem.tif", heights, transform=half_metres)


def pose_of(folder, keys=POSE, time_ns=0, **changes):
    (folder / "pose.toml").write_text(toml_keys(**{**keys, **changes}))
    return load_pose(folder / "pose.toml", time_ns)


def test_cells_hold_what_lies_on_them(tmp_path, dem):
    """Each pixel carries its ground coordinates: at a cell they are the cell's within half of one."""
    view = ground_view(pose_of(tmp_path, dem="dem.tif"), SHAPE, 1.0)
    east, north, up = np.moveaxis(view.points_m, -1, 0)
    assert up[np.isfinite(up)] == pytest.approx(terrain(east, north)[np.isfinite(up)], abs=0.05)
    layers = [
        Layer(name, name, "m", (values - origin).astype(np.float32))
        for name, values, origin in (("east", east, 354550.0), ("north", north, 3936200.0))
    ]
    flat = np.zeros(SHAPE, np.float32)
    slopes = SlopeMap(flat, flat, flat, flat, np.zeros(SHAPE, np.uint8))
    tif, maps = write_on_ground(tmp_path / "map", view, layers, slopes, 10**18)
    assert maps.stat().st_size > 1000
    with rasterio.open(tif) as file:
        assert file.crs == rasterio.crs.CRS.from_epsg(32654)
        assert file.descriptions == ("east", "north", "state", "height", "misclosure")
        assert file.transform.e == -1.0
        found = file.read()
        at_east = file.bounds.left + 0.5 + np.arange(file.width)
        at_north = file.bounds.top - 0.5 - np.arange(file.height)[:, np.newaxis]
    seen = np.isfinite(found[2])
    assert seen.sum() > 500
    off_east = np.abs(found[0] + 354550.0 - at_east)[seen]
    off_north = np.abs(found[1] + 3936200.0 - at_north)[seen]
    near = np.broadcast_to(at_north, seen.shape)[seen] < 3936232.0  # farther a pixel covers more than a cell
    assert off_east[near].max() < 0.5
    assert off_north[near].max() < 0.5


def write_dem(
    path, band, crs="EPSG:32654", west=354550.0, north=3936290.0, gain=1.0, offset=0.0, unit="", **profile
):
    """Cells of a metre, unless they have another transform."""
    rows, cols = band.shape
    profile = {"transform": rasterio.Affine(1.0, 0.0, west, 0.0, -1.0, north), **profile}
    profile = {"driver": "GTiff", "width": cols, "height": rows, "count": 1, "dtype": band.dtype, **profile}
    with rasterio.open(path, "w", crs=crs, **profile) as file:
        file.write(band, 1)
        file.scales, file.offsets = (gain,), (offset,)
        if unit:
            file.set_band_unit(1, unit)
    return path


@pytest.mark.parametrize(
    ("raw", "stored", "metres"),
    [
        (1000.0, {}, 1000.0),
        (1000.0, {"unit": "Metre"}, 1000.0),
        (1000.0, {"unit": "ft"}, 304.8),  # international foot: 0.3048 m
        (1000.0, {"unit": "feet"}, 304.8),
        (3937.0, {"unit": "US survey foot"}, 1200.0),  # 1200/3937 m
        (3937.0, {"unit": "Foot_US"}, 1200.0),
        (3937.0, {"crs": "EPSG:32654+6360"}, 1200.0),  # NAVD88 height (ftUS)
        (1000.0, {"crs": "EPSG:32654+8228"}, 304.8),  # NAVD88 height (ft)
        (1000.0, {"crs": "EPSG:32654+5773"}, 1000.0),  # EGM96 height
        (12.0, {"crs": "EPSG:32654+5715"}, -12.0),  # MSL depth, positive downwards
        (4000.0, {"gain": 0.1, "offset": -100.0}, 300.0),  # 4000 x 0.1 - 100
        (4000.0, {"gain": 0.1, "offset": 600.0, "unit": "ft"}, 304.8),  # (4000 x 0.1 + 600) ft
        (25.0, {"unit": "cm"}, 0.25),
    ],
)
def test_heights_are_in_metres_by_the_bands_scale_offset_and_unit(tmp_path, raw, stored, metres):
    path = write_dem(tmp_path / "dem.tif", np.full((4, 4), raw), **stored)
    found = geotiff.read_heights(path, geotiff.projected_crs("EPSG:32654"), 1.0)
    assert found.heights_m == pytest.approx(np.full((4, 4), metres), rel=1e-9)


def test_whole_numbers_with_a_scale_keep_their_declared_gaps(tmp_path):
    band = np.array([[4000, -9999], [4010, 4020]], np.int16)
    path = write_dem(tmp_path / "dem.tif", band, gain=0.1, nodata=-9999)
    found = geotiff.read_heights(path, geotiff.projected_crs("EPSG:32654"), 1.0).heights_m
    assert found == pytest.approx(np.array([[400.0, np.nan], [401.0, 402.0]]), nan_ok=True)


@pytest.mark.parametrize(
    ("raw", "stored", "words"),
    [
        (100.0, {"unit": "degC"}, "heights in 'degC'.*--units m"),
        (-9999.0, {}, "holds -9999, which is no height.*--nodata -9999"),
        (-32768.0, {"gain": 0.1}, "holds -32768, "),
        (65535.0, {"gain": 0.1}, "holds 65535, "),
        (-3.4028234663852886e38, {}, "--nodata -3.4028234663852886e[+]38"),
        (np.inf, {}, "holds inf"),
        (100.0, {"gain": 1000.0}, "correct scale, offset and unit"),
        (100.0, {"crs": "EPSG:4326", "west": 139.0, "north": 35.0}, "in EPSG:4326, the pose in"),
        (100.0, {"crs": "EPSG:3857"}, "-t_srs EPSG:32654 -r bilinear"),
        (100.0, {"crs": "EPSG:2227"}, "in EPSG:2227"),  # US survey feet on the grid, too
        (100.0, {"crs": None}, "no reference system"),
    ],
)
def test_a_dem_that_holds_no_heights_in_the_poses_system_says_what_to_do(tmp_path, raw, stored, words):
    band = np.full((4, 4), 100.0)
    band[1, 1] = raw
    path = write_dem(tmp_path / "dem.tif", band, **stored)
    with pytest.raises(ConfigError) as error:
        geotiff.read_heights(path, geotiff.projected_crs("EPSG:32654"), 1.0)
    assert re.search(words, f"{error.value.message} {error.value.fix}")


def test_a_tile_that_ends_at_the_place_gives_no_level_horizon(tmp_path):
    """On its western edge nothing is known of the ground to the west, which may be a mountain."""
    write_dem(tmp_path / "dem.tif", np.zeros((120, 220)), west=354500.0, north=3936260.0)
    with pytest.raises(ConfigError, match=r"\d+ of 360", check=at(tmp_path / "dem.tif")):
        horizon_from_dem(tmp_path / "dem.tif", "EPSG:32654", 354500.5, 3936200.5)


def test_a_wall_in_feet_is_as_high_for_every_reader(tmp_path):
    """20 m high from 97.5 m to the east on: 11.6 degrees, where 65.6 taken for metres gave 34."""
    band = np.zeros((120, 220))
    band[:, 160:] = 20.0 / 0.3048
    write_dem(tmp_path / "dem.tif", band, west=354500.0 - 62.0, north=3936260.0, unit="ft")
    level = {"east_m": 354500.5, "height_m": 5.0, "yaw_deg": 90.0, "pitch_deg": 0.0, "range_m": 150.0}
    view = ground_view(pose_of(tmp_path, dem="dem.tif", **level), SHAPE)
    horizon = dict(horizon_from_dem(tmp_path / "dem.tif", "EPSG:32654", 354500.5, 3936200.5))
    assert horizon[90.0] == pytest.approx(11.6, abs=0.15)
    pose = read_pose(tmp_path / "pose.toml")
    assert Ground(pose, SHAPE).with_heights([(354610.0, 3936200.0)])[0][2] == pytest.approx(20.0)
    assert np.nanmax(view.points_m[..., 2]) == pytest.approx(20.0, abs=0.5)


STRETCHED = "+proj=tmerc +lat_0=35.5 +lon_0=139.4 +k=1.008 +x_0=0 +y_0=0 +datum=WGS84 +units=m +type=crs"
"""1.008 m on the grid per metre on the ground at its origin, where its north is true north."""
MOON = "+proj=stere +lat_0=-90 +R=1737400 +units=m +type=crs"
ABOVE = {**LENS, "crs": STRETCHED, "east_m": 0.0, "north_m": 0.0, "height_m": 10.0, "yaw_deg": 0.0}


@pytest.mark.parametrize(
    ("crs", "east_m", "north_m", "true_north_deg", "scale"),
    [
        ("EPSG:32654", 500000.0, 3936200.0, 0.0, 0.9996),  # UTM's on its central meridian
        # k = k0 (1 + (E - 500 km)^2 / (2 k0^2 M N)), Snyder (8-11); M N = (6371 km)^2 near 35.5 degrees
        ("EPSG:32654", 354600.0, 3936200.0, 0.94, 0.9996 * (1.0 + 145.4**2 / (2.0 * 6371.0**2))),
        ("EPSG:3857", 0.0, 0.0, 0.0, 1.00336),  # 1 to the east, a / M = 1 / (1 - e^2) = 1.00674 to the north
        (MOON, 10_000.0, 0.0, 90.0, 1.0),  # the south pole lies in the west: north is the grid's east
        (STRETCHED, 0.0, 0.0, 0.0, 1.008),
    ],
)
def test_a_grid_has_its_projections_scale_and_convergence(crs, east_m, north_m, true_north_deg, scale):
    found = geotiff.grid_at(geotiff.projected_crs(crs), east_m, north_m)
    assert found.true_north_deg == pytest.approx(true_north_deg, abs=0.02)
    assert found.scale == pytest.approx(scale, abs=2e-5)


@pytest.mark.parametrize(
    ("crs", "east_m", "north_m", "words"),
    [
        # at 37.7 N, on the ellipsoid: a / (N cos) = 1.2623 to the east, a / (M cos) = 1.2676 to the north
        ("EPSG:3857", 15_696_000.0, 4_537_000.0, "[+]26.8%.*convergence [+]0.00°.*EPSG:32654"),
        ("EPSG:3031", 0.0, 1_200_000.0, "-1.8%.*EPSG:32731"),  # true to scale at 71 S
        ("EPSG:6933", 1e6, 3e6, "[+]5.3%"),  # of equal areas, the mean scale is 1
        ("EPSG:32654", 1e9, 1e9, "lies outside EPSG:32654"),
    ],
)
def test_a_projection_that_stretches_the_site_is_refused(crs, east_m, north_m, words):
    with pytest.raises(ConfigError) as error:
        geotiff.grid_at(geotiff.projected_crs(crs), east_m, north_m)
    assert re.search(words, f"{error.value.message} {error.value.fix}")


@pytest.mark.parametrize(
    ("crs", "east_m", "north_m", "lies_at"),
    [
        ("EPSG:32653", 354_600.0, 3_936_200.0, "latitude 35.5588, longitude 133.3957"),  # a zone is 6° wide
        ("EPSG:32654", 3_936_200.0, 354_600.0, None),  # exchanged
        ("EPSG:32754", 354_600.0, 3_936_200.0, None),  # the southern half
        ("EPSG:32654", 35_460.0, 3_936_200.0, None),  # a digit is missing
    ],
)
def test_a_pose_that_is_not_at_the_site_is_refused(crs, east_m, north_m, lies_at):
    site = Site(35.5587, 139.3952, 9.0)
    at_home = geotiff.projected_crs("EPSG:32654")
    geotiff.require_near(site, at_home, 354_600.0, 3_936_200.0)
    with pytest.raises(ConfigError, match=r"35\.5587, 139\.3952") as error:
        geotiff.require_near(site, geotiff.projected_crs(crs), east_m, north_m)
    assert lies_at is None or lies_at in error.value.message


@pytest.mark.parametrize("ground", [{"ground_m": 0.0}, {"dem": "dem.tif"}])
def test_the_projections_scale_is_corrected_where_a_pixel_meets_the_ground(tmp_path, ground):
    """The middle of the frame, 45 degrees down from 10 m: 10 m ahead on the ground, 10.08 m on the grid."""
    write_dem(tmp_path / "dem.tif", np.zeros((120, 120)), crs=STRETCHED, west=-60.0, north=100.0)
    view = ground_view(pose_of(tmp_path, ABOVE, pitch_deg=-45.0, **ground), (121, 161))
    assert view.points_m[60, 80] == pytest.approx([0.0, 10.08, 0.0], abs=2e-3)
    assert view.distances_m[60, 80] == pytest.approx(200.0**0.5, abs=2e-3)
    x, y, away = project(view.camera, [0.0, 10.08, 0.0])
    assert (x, y, away) == pytest.approx((80.0, 60.0, 200.0**0.5), abs=1e-3)


def test_slopes_and_horizons_are_those_on_the_ground(tmp_path):
    """A ramp that rises 1 m per 1.008 m on the grid to the east: 45 degrees, and so is its horizon."""
    band = np.tile((np.arange(120) + 0.5) / 1.008, (120, 1))
    path = write_dem(tmp_path / "dem.tif", band, crs=STRETCHED, west=-60.0, north=60.0)
    ramp = geotiff.read_heights(path, geotiff.projected_crs(STRETCHED), 1.008)
    assert tilt_azimuth(ramp.normals(0.0, 0.0)) == pytest.approx((45.0, 270.0))
    assert horizon_of_ground(ramp, 0.0, 0.0, np.array([90.0]), 0.0) == pytest.approx(45.0)
    assert dict(horizon_from_dem(path, STRETCHED, 0.0, 0.0))[90.0] == pytest.approx(45.0, abs=0.01)


def test_relief_rises_by_the_distance_on_the_ground(tmp_path):
    """Slopes of 45 degrees everywhere, towards north: each cell to the south is its side / 1.008 higher."""
    view = ground_view(pose_of(tmp_path, ABOVE, pitch_deg=-90.0, ground_m=0.0), SHAPE, 0.1)
    tilt, north = np.full(SHAPE, 45.0, np.float32), np.zeros(SHAPE, np.float32)
    heights, _ = view.relief(SlopeMap(tilt, north, north, north, north.astype(np.uint8)))
    rise = np.diff(heights, axis=0)
    assert rise[np.isfinite(rise)] == pytest.approx(0.1 / 1.008, rel=1e-3)


def test_ground_behind_the_ridge_is_unknown(tmp_path, dem):
    view = ground_view(pose_of(tmp_path, height_m=102.0, pitch_deg=-2.0, dem="dem.tif"), SHAPE, 1.0)
    north = view.points_m[..., 1]
    assert np.nanmax(north[:, 60:100]) < 3936237.0


def test_slopes_on_level_ground_give_its_relief(tmp_path):
    """Slopes of a hump that is known in closed form, with azimuths from true north as a map has them."""
    view = ground_view(pose_of(tmp_path, ground_m=100.0), SHAPE, 0.5)
    centre = 354606.0, 3936222.0

    def hump(east, north):
        return 0.8 * np.exp(-((east - centre[0]) ** 2 + (north - centre[1]) ** 2) / 18.0)

    east, north = view.points_m[..., 0], view.points_m[..., 1]
    height = hump(east, north)
    normals = np.stack([height * (east - centre[0]) / 9.0, height * (north - centre[1]) / 9.0], axis=-1)
    tilt, azimuth = tilt_azimuth(np.concatenate([normals, np.ones((*SHAPE, 1))], axis=-1))
    tilt, azimuth = (one.astype(np.float32) for one in (tilt, (azimuth - view.grid.true_north_deg) % 360.0))
    nothing = np.zeros(SHAPE, np.float32)
    heights, misclosure = view.relief(SlopeMap(tilt, azimuth, nothing, nothing, nothing.astype(np.uint8)))
    known = np.isfinite(heights)
    rows, cols = heights.shape
    at_east = view.ground.west_m + 0.5 * (np.arange(cols) + 0.5)
    at_north = view.ground.north_m - 0.5 * (np.arange(rows) + 0.5)
    off = (heights - 100.0 - hump(*np.meshgrid(at_east, at_north)))[known]
    assert np.std(off) < 0.05 * 0.8
    assert np.nanmedian(misclosure) < 1.0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, "either ground_m"),
        ({"hfov_deg": None, "ground_m": 0}, "hfov_deg"),
        ({"crs": "EPSG:1", "ground_m": 0.0}, "unknown coordinate reference system"),
        ({"crs": "EPSG:4326", "ground_m": 0.0}, "not a projected system"),
        ({"crs": "EPSG:32653", "dem": "dem.tif"}, "gdalwarp"),
        ({"dem": "none.tif"}, "cannot read the DEM"),
        ({"north_m": 3836200.0, "dem": "dem.tif"}, "dem.tif: no pixel"),
        ({"pitch_deg": 40.0, "ground_m": 100.0}, "level ground at"),
    ],
)
def test_poses_that_lead_nowhere_say_why(tmp_path, dem, changes, words):
    with pytest.raises((ConfigError, NoAnswerError)) as error:
        ground_view(pose_of(tmp_path, **changes), SHAPE)
    assert words in f"{error.value.message} {error.value.fix}"


TURNED = {**LENS, **PLACE, "ground_m": 100.0}


def test_a_pose_by_quaternion_is_the_same_as_by_angles(tmp_path):
    """Level to the east in ROS's optical frame, REP 103."""
    lens = [-0.3, 0.1, 0.0, 0.0, 0.0]
    pose = pose_of(tmp_path, TURNED, quaternion=[-0.5, 0.5, -0.5, 0.5], distortion=lens)
    assert (pose.yaw_deg, pose.pitch_deg, pose.roll_deg) == pytest.approx((90.0, 0.0, 0.0), abs=1e-9)
    assert pose.camera(SHAPE, Grid()).distortion == tuple(lens)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"quaternion": [0.5, 0.5, 0.5]}, "four numbers"),
        ({"quaternion": [0.0, 0.0, 0.0, 0.5]}, "length is 0.5, not 1"),
        ({"quaternion": [0.0, 0.0, 0.0, 1.0], "roll_deg": 3.0}, "both quaternion and roll_deg"),
        ({"yaw_deg": 1.0, "pitch_deg": 0.0, "distortion": [0.1]}, "distortion"),
    ],
)
def test_a_wrong_quaternion_or_lens_is_named(tmp_path, changes, words):
    with pytest.raises(ConfigError, match=words):
        pose_of(tmp_path, TURNED, **changes)


def test_a_map_of_a_camera_that_moved_is_not_put_on_the_ground():
    with pytest.raises(NoAnswerError, check=at(Path("a.h5"))):
        MappedSession.on_ground(SimpleNamespace(has_moved=True, path=Path("a.h5")), None)


MOVING = {**LENS, "ground_m": 100.0}
TUM = """# timestamp tx ty tz qx qy qz qw
1451674800.0 354600.0 3936200.0 112.0 -0.5 0.5 -0.5 0.5
1451674810.0 354610.0 3936220.0 112.0 0.0 0.70710678 -0.70710678 0.0
"""
CSV = """time,east_m,north_m,height_m,yaw_deg,pitch_deg,roll_deg
2016-01-01T19:00:00Z,354600.0,3936200.0,112.0,90.0,0.0,0.0
2016-01-01T20:00:10+01:00,354610.0,3936220.0,112.0,180.0,0.0,0.0
"""
START_NS = 1_451_674_800_000_000_000


@pytest.mark.parametrize(("name", "text"), [("run.tum", TUM), ("run.csv", CSV)])
def test_a_pose_of_a_trajectory_is_turned_evenly_between_its_poses(tmp_path, name, text):
    """A quarter of the way from a view to the east to one to the south."""
    (tmp_path / name).write_text(text)
    pose = pose_of(tmp_path, MOVING, START_NS + 2_500_000_000, trajectory=name)
    assert pose.position_m == pytest.approx((354602.5, 3936205.0, 112.0))
    assert (pose.yaw_deg, pose.pitch_deg, pose.roll_deg) == pytest.approx((112.5, 0.0, 0.0), abs=1e-5)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("run.tum", "\n".join([*TUM.splitlines()[::-1]]), "run.tum:2: its time is not after"),
        ("run.tum", TUM.replace("0.5 -0.5 0.5", "0.5 -0.5 0.9"), "run.tum:2: quaternion: its length"),
        ("run.tum", "1.0 2.0 3.0", "run.tum:1: no height_m"),
        ("run.tum", "noon 1 2 3 0 0 0 1", "run.tum:1: "),
        ("run.tum", "", "holds 0 poses"),
        ("run.csv", CSV.replace("00Z", "00"), "run.csv:2: .* has no time zone"),
        ("run.csv", CSV.replace("3936200.0", "nan"), "run.csv:2: a value is not finite"),
        ("run.csv", CSV.replace("yaw_deg", "heading"), "run.csv:2: no qx"),
        ("run.csv", CSV.replace("354600.0", ""), "run.csv:2: could not convert"),
    ],
)
def test_a_wrong_trajectory_is_named_with_its_line(tmp_path, name, text, words):
    (tmp_path / name).write_text(text)
    with pytest.raises(ConfigError, match=words):
        pose_of(tmp_path, MOVING, START_NS, trajectory=name)


@pytest.mark.parametrize("off_ns", [-1_000_000_000, 11_000_000_000])
def test_a_time_outside_the_trajectory_has_no_pose(tmp_path, off_ns):
    (tmp_path / "run.tum").write_text(TUM)
    with pytest.raises(ConfigError, match="2016-01-01T19:00:00Z to 2016-01-01T19:00:10Z"):
        pose_of(tmp_path, MOVING, START_NS + off_ns, trajectory="run.tum")


def test_a_pose_is_given_once(tmp_path):
    with pytest.raises(ConfigError, match="trajectory and east_m"):
        pose_of(tmp_path, MOVING, east_m=1.0, trajectory="run.tum")
