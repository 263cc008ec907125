"""``fieldkit map`` on 25 minutes recorded from simulated instruments."""

import base64
import json
import re
import shutil
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
import rasterio
import xarray as xr
from rio_cogeo import cog_validate

from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.errors import NoAnswerError, StorageError
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import SlopeState
from fieldkit.physics.facet import angle_between_deg, normal
from fieldkit.physics.radiance import brightness_temperature_k
from fieldkit.results import slope_map
from fieldkit.sessions.reader import open_session
from tests.harness.command_line import document, fieldkit, invoke, succeed
from tests.harness.simulated import record_simulated
from tests.harness.toml_text import toml_keys


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    return record_simulated(tmp_path_factory.mktemp("campaign"), 25, 'estimator.azimuth="free"').path


@pytest.fixture(scope="module")
def mapped(session, tmp_path_factory):
    return document("map", session, "-o", tmp_path_factory.mktemp("map") / "beds")


def of_region(session_map, name):
    return next(region for region in session_map["regions"] if region["region"] == name)


@pytest.fixture(scope="module")
def slopes(session):
    return document("estimate", session)["slopes"]


@pytest.fixture(scope="module")
def arrays(mapped):
    with h5py.File(next(file for file in mapped["files"] if file.endswith(".nc"))) as file:
        yield file


def test_the_pixels_of_a_bed_agree_with_the_estimate_of_its_region(slopes, mapped):
    assert [estimate["region"] for estimate in slopes] == ["b05", "b15", "b25"]
    for estimate in slopes:
        bed = of_region(mapped, estimate["region"])
        assert bed["states"] == {estimate["state"]: 1.0} == {"wide": 1.0}
        assert bed["tilt_deg"] == pytest.approx(estimate["tilt_deg"], abs=1.0)
        assert bed["tilt_low_deg"] < bed["tilt_deg"] < bed["tilt_high_deg"]
        found = normal(bed["tilt_deg"], bed["azimuth_deg"])
        assert angle_between_deg(found, normal(estimate["tilt_deg"], estimate["azimuth_deg"])) < 1.0
    assert of_region(mapped, "flat")["tilt_deg"] < 1.0
    # half of their regions, as if not cut at 0, is over 2° for most of its pixels
    states = of_region(mapped, "flat")["states"]
    assert states["flat"] + states["wide"] > 0.8


def test_a_pixel_is_as_sure_as_the_region_it_lies_in(slopes, mapped):
    """To first order in the scale, which the region follows further: 22 % more is not 22 % less."""
    for estimate in slopes[:2]:
        low, high = of_region(mapped, estimate["region"])["tilt_region_deg"]
        assert low == pytest.approx(estimate["tilt_region_deg"][0], rel=0.25)
        assert low < estimate["tilt_deg"] < high < 1.1 * estimate["tilt_region_deg"][1]


def test_ground_outside_the_regions_is_not_vouched_for(mapped, arrays):
    assert set(mapped["states"]) == {"flat", "wide"}
    outside = arrays["region"][:] == 0
    assert outside.mean() > 0.5
    assert (arrays["state"][:][outside] == SlopeState.WIDE).all()
    tilt = arrays["tilt_deg"][:]
    assert np.isfinite(tilt[outside]).all()  # what fits is still there, if somebody knows better
    for name in ("tilt_low_deg", "tilt_high_deg", "azimuth_low_deg", "azimuth_high_deg"):
        assert name in arrays["tilt_deg"].attrs["ancillary_variables"].decode().split()
        assert arrays[name].attrs["units"] == b"degree"
    assert (arrays["tilt_low_deg"][:] <= tilt).all()
    assert (tilt <= arrays["tilt_high_deg"][:] + 1e-4).all()


def test_map_of_a_damaged_session_is_made_without_the_damaged_frames(session, mapped, tmp_path):
    path = tmp_path / "a.h5"
    shutil.copy(session, path)
    with h5py.File(path, "r+") as file:
        file["camera/fpa_temperature"][10] += 1.0
        file["camera/counts"][10] += 500  # five kelvin in one frame of its minute
    done = fieldkit("map", path, "-o", tmp_path / "x", "--json")
    assert done.exit_code == 7
    assert "1 frames" in done.stderr
    found = json.loads(done.stdout)
    for name in ("b05", "b15", "b25"):
        tilt_deg = of_region(mapped, name)["tilt_deg"]
        assert of_region(found, name)["tilt_deg"] == pytest.approx(tilt_deg, abs=0.1)


def test_arrays_say_what_they_are_and_where_they_come_from(session, mapped, arrays):
    with open_session(session) as source:
        assert arrays.attrs["session_id"].decode() == source.session_id
        inside = next(region for region in source.regions if region.name == "b15").mask((120, 160))
    tilt = arrays["tilt_deg"]
    assert tilt.shape == arrays["state"].shape == (120, 160)
    for name, standard in (("tilt_deg", "slope_angle"), ("azimuth_deg", "slope_direction")):
        assert arrays[name].attrs["standard_name"].decode() == f"ground_{standard}"
        assert arrays[name].attrs["units"] == b"degree"
    state = arrays["state"].attrs
    meanings = dict(zip(state["flag_meanings"].decode().split(), state["flag_values"], strict=True))
    assert meanings["no_intersection"] == SlopeState.NO_INTERSECTION
    assert [dim[0].name for dim in tilt.dims] == ["/y", "/x"]
    assert arrays.attrs["minutes"] == mapped["minutes"] == 25
    assert (arrays["region"][:][inside] == 3).all()
    assert np.median(tilt[:][inside]) == pytest.approx(of_region(mapped, "b15")["tilt_deg"])
    with xr.open_dataset(arrays.filename, engine="h5netcdf") as data:
        assert (data["tilt_deg"].dims, float(data["latitude"])) == (("y", "x"), 37.7)


def test_beds_steeper_than_the_limit_have_no_slope(session, tmp_path):
    limited = document("map", session, "-o", tmp_path / "x.png", "--set", "estimator.tilt_limit_deg=20")
    assert of_region(limited, "b25")["states"] == {"no_intersection": 1.0}
    assert of_region(limited, "b25")["tilt_deg"] is None
    assert of_region(limited, "b05")["states"] == {"wide": 1.0}
    assert (tmp_path / "x.png").exists()
    assert (tmp_path / "x.nc").exists()


def test_window_chooses_the_minutes(session, tmp_path):
    for window, minutes in (("all", 25), ("5m", 6)):
        assert document("map", session, "-o", tmp_path / window, "--window", window)["minutes"] == minutes


def test_one_minute_maps_the_component_along_the_sun(session, tmp_path):
    """Beds of 5 and 15 degrees towards the sun; one of 25 may as well lie beyond it."""
    base = tmp_path / "one"
    done = fieldkit("map", session, "-o", base, "--window", "1m", "--json")
    assert "the sun" in done.stderr
    minute = json.loads(done.stdout)
    assert (minute["minutes"], minute["states"]) == (1, {"too_few": 1.0})
    *beds, b25 = (of_region(minute, name)["along_sun_deg"] for name in ("flat", "b05", "b15", "b25"))
    assert beds == pytest.approx([0.0, 5.0, 15.0], abs=3.0)
    assert b25 is None
    with h5py.File(f"{base}.nc") as file:
        assert np.isnan(file["tilt_deg"][:]).all()
        along, sd = file["rdir"][:], file["rdir_sd"][:]
        assert "away" in file["rdir"].attrs["long_name"].decode()
    inside = np.isfinite(along)
    assert inside.mean() > 0.9
    assert (sd[inside] > 0.2).all()
    assert sorted(Path(file).name for file in minute["files"]) == ["one.nc", "one.png"]
    shown = fieldkit("map", session, "-o", base, "--window", "1m").stdout
    assert re.search(r"region +tilt towards 18\d °", shown)
    with pytest.raises(NoAnswerError):
        invoke("map", session, "-o", base, "--window", "1m", "--products", "slope")


def test_known_offset_of_a_region_is_taken_from_its_brightness():
    bed = Region("b", RegionKind.TARGET, ((0, 0), (4, 0), (4, 4), (0, 4)), emissivity=0.85)
    flat = Region("flat", RegionKind.REFERENCE, ((0, 0), (1, 0), (0, 1)))
    seen = float(brightness_temperature_k(318.15, 0.85, 233.15)) + 1.0
    settings = EstimatorSettings(model="paper", offsets_k={"b": 1.0})
    surface_k = slope_map.surface_of_pixels((flat, bed), (4, 4), settings)
    assert surface_k(np.full((4, 4), seen)) == pytest.approx(318.15, abs=1e-3)


def test_every_frame_that_is_read_is_reported(session):
    reports = []
    session_map = slope_map.slope_map(session, "all", on_progress=lambda *counts: reports.append(counts))
    assert reports == [(number, len(reports)) for number in range(1, len(reports) + 1)]
    assert len(reports) >= session_map.minutes


def test_what_only_regions_have_is_said(session, tmp_path):
    done = fieldkit("map", session, "-o", tmp_path / "x", "--set", "estimator.azimuth=known")
    assert "azimuth free" in done.stderr


def test_folder_that_cannot_be_made_is_named(session, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError, match=str(tmp_path / "file")):
        invoke("map", session, "-o", tmp_path / "file" / "map")


def copied_twice(session, folder):
    for name in ("a", "b"):
        (folder / "recordings").mkdir(exist_ok=True)
        shutil.copy(session, folder / f"recordings/{name}.h5")
    return folder / "recordings"


def test_many_sessions_are_mapped_by_several_processes_and_a_torn_one_does_not_stop_the_others(
    session, mapped, arrays, tmp_path
):
    folder = copied_twice(session, tmp_path)
    (folder / "torn.h5").write_bytes(session.read_bytes()[:5000])
    done = fieldkit("map", folder, "-j", 2, "-o", tmp_path / "maps", "--json")
    assert done.exit_code == 3
    assert "1 of 3 sessions" in done.stderr
    assert "torn.h5" in done.stderr
    printed = json.loads(done.stdout)
    assert [Path(session_map["session"]).name for session_map in printed["sessions"]] == ["a.h5", "b.h5"]
    assert printed["page"] == str(tmp_path / "maps" / "slope-maps.html")
    page = Path(printed["page"]).read_text(encoding="utf-8")
    shown = re.findall(r'src="data:image/png;base64,([^"]+)" alt="Slope map of (.)"', page)
    assert [name for _, name in shown] == ["a", "b"]
    sizes = [cv2.imdecode(np.frombuffer(base64.b64decode(png), np.uint8), 1).shape for png, _ in shown]
    assert sizes[0] == sizes[1]
    for region in mapped["regions"]:
        assert re.search(rf"<strong>{region['region']}</strong>.*{region['tilt_deg']:.1f} ±", page)
    for session_map in printed["sessions"]:
        assert session_map["regions"] == mapped["regions"]
        with h5py.File(session_map["files"][1]) as file:
            assert file["tilt_deg"][:].tobytes() == arrays["tilt_deg"][:].tobytes()


def test_maps_of_one_name_are_not_written_over_each_other(session, tmp_path):
    other = tmp_path / session.name
    shutil.copy(session, other)
    done = fieldkit("map", session, other, "-o", tmp_path / "maps")
    assert done.exit_code == 2
    assert "one name" in done.stderr


@pytest.fixture(scope="module")
def products(session, tmp_path_factory):
    base = tmp_path_factory.mktemp("products") / "beds"
    products = ("--products", "slope,heading,rdir,ntilt,solar,uvw,ptilt")
    return document("map", session, "-o", base, *products, "--limit-deg", 15, "--drive-deg", 90)["files"]


def test_every_product_is_an_array_with_units_and_an_image(products):
    names = ["slope", "heading", "rdir", "ntilt", "solar", "u", "v", "w", "ptilt", "cvar"]
    assert [Path(file).name for file in products[2:]] == [f"beds-{name}.png" for name in names]
    assert all(cv2.imread(file) is not None for file in products if file.endswith(".png"))
    with h5py.File(products[1]) as file:
        known = np.isfinite(file["tilt_deg"][:])
        for name in names:
            assert (np.isfinite(file[name][:]) == known).all()
            assert file[name].attrs["units"] in (b"degree", b"1")
            assert "state" in file[name].attrs["ancillary_variables"].decode()
        for name in names[:-2]:
            assert f"{name}_sd" in file[name].attrs["ancillary_variables"].decode()
            assert (file[f"{name}_sd"][:] >= 0.0).all()
        assert file["slope"].attrs["standard_name"] == b"ground_slope_angle"


def test_products_follow_from_the_mapped_slope(products):
    with h5py.File(products[1]) as file:
        tilt, azimuth = (np.radians(file[name][:].astype(float)) for name in ("tilt_deg", "azimuth_deg"))
        east, north = np.sin(tilt) * np.sin(azimuth), np.sin(tilt) * np.cos(azimuth)
        assert file["slope"][:] == pytest.approx(file["tilt_deg"][:], abs=1e-4)
        assert file["u"][:] == pytest.approx(east, abs=1e-6)
        assert file["rdir"][:] == pytest.approx(-np.degrees(np.arctan2(east, np.cos(tilt))), abs=1e-4)
        assert file["ntilt"][:] == pytest.approx(np.degrees(np.arctan2(north, np.cos(tilt))), abs=1e-4)
        probability, region = file["ptilt"][:], file["region"][:]
        assert ((probability >= 0.0) & (probability <= 1.0)).all()
        b05, b25 = (np.median(probability[region == number]) for number in (2, 4))
        assert b05 < 0.1
        assert b25 > 0.9
        assert (file["cvar"][:] > file["slope"][:])[region == 3].mean() > 0.9


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--products", "roughness"), "'roughness'"),
        (("--products", "ptilt"), "--limit-deg 20"),
        (("--products", "rdir"), "--drive-deg 90"),
        (("--products", "inertia"), "learned model"),
    ],
)
def test_product_that_cannot_be_made_says_what_is_missing(session, tmp_path, options, words):
    done = fieldkit("map", session, "-o", tmp_path / "x", *options)
    assert done.exit_code != 0
    assert words in done.output
    assert not (tmp_path / "x.nc").exists()


def test_the_learned_model_agrees_with_its_region_and_has_an_inertia_with_its_uncertainty(session, tmp_path):
    """Truth of the scene: the bed of 15 degrees faces south."""
    learned = ("--products", "inertia", "--set", "estimator.model=learned")
    bed = of_region(document("map", session, "-o", tmp_path / "x", *learned), "b15")
    assert bed["tilt_region_deg"][0] < 15.0 < bed["tilt_region_deg"][1]
    with h5py.File(tmp_path / "x.nc") as file:
        assert file.attrs["surface_model"].decode() == "learned, unit-norm"
        inside = file["region"][:] > 0
        assert np.isnan(file["inertia"][:][~inside]).all()
        known = np.isfinite(file["tilt_deg"][:]) & inside
        (value,), (sd,) = (np.unique(file[name][:][known]) for name in ("inertia", "inertia_sd"))
        assert 0.0 < sd < value


MOVING = toml_keys(crs="EPSG:32613", hfov_deg=50.0, range_m=60.0, ground_m=2300.0)
PLACE = toml_keys(east_m=412000.0, north_m=4172000.0, height_m=2305.0, yaw_deg=0.0, pitch_deg=-30.0)
POSE = MOVING + PLACE


def test_map_on_the_ground_before_the_camera(session, tmp_path):
    (tmp_path / "pose.toml").write_text(POSE)
    done = succeed("map", session, "-o", tmp_path / "x", "--pose", tmp_path / "pose.toml", "--cell-m", 0.25)
    # 88 km to the west of the meridian: 0.9996 (1 + 88^2 / (2 x 6371^2)); -1.0 degrees x sin(37.7 degrees)
    assert "convergence -0.61°, scale 0.99970" in done.output
    assert cog_validate(tmp_path / "x.tif", strict=True) == (True, [], [])
    with rasterio.open(tmp_path / "x.tif") as file:
        layers = "slope", "heading", "slope_sd", "heading_sd", "state", "height", "misclosure"
        assert file.descriptions == layers
        assert file.units[0] == "degree"
        assert file.res == (0.25, 0.25)
        known = np.isfinite(file.read(1))
    assert 0.2 < known.mean() < 0.9  # the trapezoid that the camera sees, in its bounding box


def test_map_by_the_pose_of_the_configuration_and_without_ground_where_it_has_none_then(session, tmp_path):
    campaign = session.parents[1]
    (campaign / "pose.toml").write_text(POSE)
    coarse = ("--cell-m", 0.5)
    succeed("map", session, "-o", tmp_path / "x", *coarse, "--set", "camera.pose=pose.toml")
    assert (tmp_path / "x.tif").exists()
    (campaign / "run.tum").write_text(
        "1.0 412000 4172000 2305 -0.5 0.5 -0.5 0.5\n2.0 412000 4172000 2305 -0.5 0.5 -0.5 0.5\n"
    )
    (campaign / "moving.toml").write_text(f'{MOVING}trajectory = "run.tum"')
    done = succeed("map", session, "-o", tmp_path / "y", "--set", "camera.pose=moving.toml")
    assert "1970-01-01T00:00:01Z" in done.stderr
    assert (tmp_path / "y.png").exists()
    assert not (tmp_path / "y.tif").exists()
    # without ground under the first name: what stands there is of the map before
    again = fieldkit("map", session, "-o", tmp_path / "x", "--set", "camera.pose=moving.toml")
    earlier = ", ".join(str(tmp_path / f"x.{ending}") for ending in ("tif", "mcap"))
    assert earlier in again.stderr.replace("\n", " ")
    fresh = fieldkit("map", session, "-o", tmp_path / "x", *coarse, "--set", "camera.pose=pose.toml")
    assert "earlier" not in fresh.stderr


def test_several_sessions_are_mapped_as_each_is_from_python(session, tmp_path):
    folder, maps = copied_twice(session, tmp_path), tmp_path / "maps"
    maps.mkdir()
    (folder / "pose.toml").write_text(POSE)
    (maps / "b-slope-map-pose-pose.toml-rdir.png").write_bytes(b"older")
    words = ("map", folder, "-j", 1, "-o", maps, "--cell-m", 0.5, "--set", "camera.pose=pose.toml")
    done = succeed(*words)
    assert "EPSG:32613" in done.output
    said = done.stderr.replace("\n", " ")
    assert str(maps / "b-slope-map-pose-pose.toml-rdir.png") in said
    wrong = fieldkit(*words[:2], "-j", 2, *words[4:-1], "camera.pose=none.toml")
    assert wrong.exit_code == 3
    assert "none.toml: " in wrong.stderr  # from the workers, whose error arrives whole

    found = slope_map.slope_map(folder / "a.h5", settings={"camera.pose": "pose.toml"})
    written = found.write(tmp_path / "python", cell_m=0.5)
    assert [path.suffix for path in written] == [".png", ".nc", ".png", ".png", ".tif", ".mcap"]
    bands = []
    for path in (maps / "a-slope-map-pose-pose.toml.tif", tmp_path / "python.tif"):
        with rasterio.open(path) as file:
            bands.append((file.descriptions, file.transform, file.read()))
    by_command, by_python = bands
    assert by_command[:2] == by_python[:2]
    np.testing.assert_array_equal(by_command[2], by_python[2])


@pytest.mark.parametrize(
    ("kind", "kinds"),
    [(RegionKind.TARGET, {"rocks": "rock"}), (RegionKind.FOIL, {}), (RegionKind.BLACKBODY, {})],
)
def test_pixels_of_a_region_of_another_kind_are_left_out(kind, kinds):
    """They would be compared with the surface of the reference; a foil and a black body have no slope."""
    rocks = Region("rocks", kind, ((0, 0), (1, 0), (1, 3), (0, 3)))
    bed = Region("bed", RegionKind.TARGET, ((2, 0), (3, 0), (3, 3), (2, 3)))
    settings = EstimatorSettings(kinds=kinds)
    surface_k = slope_map.surface_of_pixels((rocks, bed), (4, 4), settings)
    np.testing.assert_array_equal(np.isnan(surface_k(np.full((4, 4), 290.0))), rocks.mask((4, 4)))
