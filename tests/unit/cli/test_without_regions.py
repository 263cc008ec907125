"""Sessions of which nobody has drawn regions yet, such as one just imported."""

import json
import warnings

import pytest

from fieldkit.config import load_config
from fieldkit.model.errors import CalibrationError, ConfigError
from fieldkit.model.next_step import Action
from fieldkit.recording.regions import read_regions
from fieldkit.recording.simulated_scene import scene_of
from fieldkit.simulation.scene import BEDS
from tests.harness.command_line import fieldkit, invoke, succeed
from tests.harness.field_page_journey import empty_campaign
from tests.harness.next_steps import steps


@pytest.fixture
def session(tmp_path):
    campaign = tmp_path / "c"
    succeed("init", campaign, "--site=-33.86,151.2,20")
    log = tmp_path / "log.csv"
    rows = [f"2024-01-05T10:{minute}:{second}+11:00,80000" for minute in range(10, 20) for second in (10, 40)]
    log.write_text("\n".join(["time,lux [lx]", *rows]) + "\n")
    succeed("import", log, "-C", campaign)
    (path,) = (campaign / "recordings").glob("*.h5")
    return path


@pytest.mark.parametrize("arguments", [("estimate",), ("sweep", "--set", "surface.albedo=0.1,0.2")])
def test_what_needs_beds_says_how_to_draw_them_and_writes_nothing(session, tmp_path, arguments):
    verb, *options = arguments
    with pytest.raises(ConfigError, match=session.name) as error:
        invoke(verb, session, *options, "-j", 1, "-o", tmp_path / "results" / "r")
    assert Action.ADD_REGION() in steps(error.value)
    assert not (tmp_path / "results").exists()


def test_the_light_can_be_reported_and_replayed_without_beds(session):
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        found = fieldkit("report", session)
    assert found.exit_code == 0, found.output
    replayed = succeed("replay", session, "--speed", "max")
    assert "target" in replayed.stderr


def test_a_scale_without_a_known_bed_is_refused_without_a_warning(session):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(CalibrationError):
            invoke("calibrate", "surface", session, "--set", "estimator.model=paper")


@pytest.fixture
def undrawn(tmp_path):
    """A simulated campaign before anybody has drawn a region."""
    return empty_campaign(tmp_path / "undrawn")


def draw(folder, names=("flat", "b05", "b15", "b25")):
    for bed in (bed.region() for bed in BEDS if bed.name in names):
        first, *more = (f"{x},{y}" for x, y in bed.points_px)
        words = ["--reference"] if bed.name == "flat" else ["--tilt", bed.tilt_deg, "--azimuth", 180]
        succeed("roi", "add", bed.name, "-C", folder, "--points", first, *more, *words)


def test_from_a_recording_without_regions_to_slopes_as_the_tutorial_says(undrawn):
    fast = ("--set", "simulation.speed=max")
    made = succeed("record", "-C", undrawn, "--for", "6m", "--name", "look", *fast)
    assert "warning: " in made.stderr
    assert "roi add" in made.stderr
    assert " 12:05 MST  S " in made.stderr  # the light of each minute is shown all the same
    (path,) = (undrawn / "recordings").glob("*.h5")
    succeed("report", path)
    page = (undrawn / "reports" / f"{path.stem}.html").read_text(encoding="utf-8")
    assert "160 x 120" in page
    for tick in range(0, 160, 20):
        assert f">{tick}</text>" in page
    draw(undrawn)
    succeed("roi", "check", "-C", undrawn, "--session", path)
    estimated = succeed("estimate", path, "--campaign", "--set", "estimator.azimuth=known", "--json")
    for slope in json.loads(estimated.stdout)["slopes"]:
        assert slope["tilt_region_deg"][0] < slope["true_tilt_deg"] < slope["tilt_region_deg"][1]


def test_the_picture_to_find_pixels_in_says_that_it_is_enlarged(undrawn, tmp_path):
    found = succeed("live", "-C", undrawn, "--png", tmp_path / "p.png", "--set", "simulation.speed=max")
    assert "160 x 120" in found.stderr


def test_the_simulated_field_shows_its_beds_before_and_while_they_are_drawn(undrawn):
    def beds():
        scene = scene_of(load_config(undrawn / "fieldkit.toml"), 60.0)
        return {facet.name: facet for facet in scene.facets}

    assert list(beds()) == [f"undrawn {bed.name}" for bed in BEDS]
    assert [bed.points_px for bed in beds().values()] == [bed.points_px for bed in BEDS]
    draw(undrawn, ("flat",))
    assert list(beds()) == ["flat", "undrawn b05", "undrawn b15", "undrawn b25"]
    draw(undrawn, ("b05", "b15", "b25"))
    assert sorted(beds()) == ["b05", "b15", "b25", "flat"]


@pytest.mark.parametrize(
    ("rect", "words", "slope", "left"),
    [
        ("95,30,30,20", (), 25.0, 4),
        ("95,30,30,20", ("--azimuth", 90), 25.0, 4),
        ("95,30,30,20", ("--tilt", 10), 10.0, 4),
        ("95,30,30,20", ("--reference",), 25.0, 4),
        ("74,2,10,20", ("--reference",), 0.0, 5),
        ("74,2,10,20", ("--tilt", 30), 30.0, 1),  # a slope stated off all beds makes another field
        ("60,30,60,20", (), 25.0, 4),  # two beds, more of the second
        ("74,2,10,20", (), None, 4),
    ],
)
def test_a_region_on_the_simulated_field_keeps_the_slope_of_what_it_covers(undrawn, rect, words, slope, left):
    """Unless its own is stated; contact thermometers lie in the same bed, or in the ground."""
    succeed("roi", "add", "drawn", "-C", undrawn, "--rect", rect, *words)
    scene = scene_of(read_regions(undrawn / "fieldkit.toml")[0], 60.0)
    (number,) = scene.probed
    beds = {facet.name: facet.tilt_deg for facet in scene.facets}
    assert (beds.get("drawn"), len(beds)) == (slope, left)
    assert number == (-1 if slope is None else list(beds).index("drawn"))


def test_the_clear_sky_over_the_simulated_field_has_the_usual_air_of_place_and_day(undrawn):
    """Alamosa, whose normals (NOAA, 1991 to 2020) are near -9 °C in January and 18 °C in July."""
    for start, usual_c in (("2016-01-15T12:00:00-07:00", -9.0), ("2016-07-15T12:00:00-06:00", 18.0)):
        settings = ["simulation.weather=clear", f"simulation.start={start}"]
        scene = scene_of(load_config(undrawn / "fieldkit.toml", settings=settings), 60.0)
        assert scene.sky.air_temperature_k - 273.15 == pytest.approx(usual_c, abs=8.0)


def test_the_newest_session_is_the_one_that_began_last_whatever_its_name(session):
    log = session.parent.parent / "later.csv"
    log.write_text("time,lux [lx]\n2025-01-05T10:10:10+11:00,80000\n2025-01-05T10:10:40+11:00,80100\n")
    later = session.parent / "0.h5"
    succeed("import", log, "-C", session.parent.parent, "-o", later)
    shown = json.loads(fieldkit("show", "-C", session.parent.parent, "--json").stdout)
    assert shown["session"] == str(later)
    # ISO 8601, with the offset of the campaign's zone, which is of its longitude
    assert shown["start"] == "2025-01-05T09:10:10+10:00"
    listed = json.loads(fieldkit("ls", "-C", session.parent.parent, "--json").stdout)["sessions"]
    assert [one["start"] for one in listed] == ["2025-01-05T09:10:10+10:00", "2024-01-05T09:10:10+10:00"]
    assert [one["end"] for one in listed] == ["2025-01-05T09:10:40+10:00", "2024-01-05T09:19:40+10:00"]
