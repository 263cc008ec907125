import json
import os
import pty

import pytest

from fieldkit.cli import main
from fieldkit.config import load_config
from fieldkit.model.site import RegionKind, Site
from tests.harness.command_line import fieldkit
from tests.harness.connected import plugged_in


@pytest.fixture
def init(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: fieldkit("init", *arguments)


def test_a_new_campaign_passes_its_own_check_and_has_its_folders(init, tmp_path):
    assert init("sandslope").exit_code == 0
    folder = tmp_path / "sandslope"
    assert load_config(folder / "fieldkit.toml", environment={}).regions == ()
    assert sorted(path.name for path in folder.iterdir()) == [
        ".gitignore",
        "calibration",
        "fieldkit.toml",
        "recordings",
        "reports",
        "results",
    ]
    assert "/recordings/" in (folder / ".gitignore").read_text()


def test_the_site_comes_from_the_command_line(init, tmp_path):
    # the site of the paper's experiments
    assert init("here", "--site", "35.558675,139.395232,9", "--zone", "Asia/Tokyo").exit_code == 0
    config = load_config(tmp_path / "here" / "fieldkit.toml", environment={})
    assert config.site == Site(35.558675, 139.395232, 9.0, "Asia/Tokyo")


@pytest.mark.parametrize(("place", "zone"), [("35.56,139.4,9", "Etc/GMT-9"), ("51.5,-0.1", "UTC")])
def test_without_a_time_zone_it_is_that_of_the_longitude_and_told(init, tmp_path, place, zone):
    assert f"the time zone is {zone}, by longitude" in init("here", "--site", place).stderr
    config = load_config(tmp_path / "here" / "fieldkit.toml", environment={})
    assert config.site.timezone == zone


def test_a_folder_is_meant_from_the_one_that_was_named(init, tmp_path):
    (tmp_path / "below").mkdir()
    assert init("-C", "below", "here").exit_code == 0
    assert (tmp_path / "below" / "here" / "fieldkit.toml").exists()
    assert init("-C", "below").exit_code == 0
    assert (tmp_path / "below" / "fieldkit.toml").exists()


def test_the_demos_campaign_too_is_below_the_folder_that_was_named(tmp_path):
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / "fieldkit.toml").write_text("schema = no number")
    done = fieldkit("demo", "-C", tmp_path, "--out", "here")
    assert done.exit_code == 3
    assert str(tmp_path / "here" / "fieldkit.toml") in done.stderr


def test_what_to_do_next_works_where_one_stands(init, tmp_path):
    assert "next: cd here && fieldkit record" in init("here", "--simulated").stderr
    assert "'my sand'" in init("my sand").stderr
    assert "next: fieldkit devices" in init(str(tmp_path)).stderr


@pytest.mark.parametrize(
    ("typed", "following"), [(b"n\n", "fieldkit devices --add"), (b"y\n", "fieldkit doctor")]
)
def test_on_a_terminal_it_offers_to_add_what_is_connected(monkeypatch, tmp_path, capsys, typed, following):
    monkeypatch.setattr("fieldkit.drivers.registry.names", list)  # no driver looks for its own
    plugged_in(monkeypatch)
    near, far = pty.openpty()
    with os.fdopen(far) as terminal, monkeypatch.context() as patch:
        patch.setattr("sys.stdin", terminal)  # click's runner has none
        os.write(near, typed)
        main(["init", str(tmp_path / "here")], standalone_mode=False)
    os.close(near)
    said = capsys.readouterr().err
    assert "add what is connected now?" in said
    assert f"&& {following}, then fieldkit roi add" in said


def test_without_a_site_it_says_that_the_papers_stands_there(init):
    assert "put yours under [site]" in init("here").stderr


def test_simulated_has_three_beds_and_a_flat_reference_on_simulated_devices(init, tmp_path):
    assert init("--simulated", "here").exit_code == 0
    config = load_config(tmp_path / "here" / "fieldkit.toml", environment={})
    assert [device.port for device in config.devices] == ["simulated"] * 3
    assert [(r.name, r.kind, r.tilt_deg, r.azimuth_deg) for r in config.regions] == [
        ("flat", RegionKind.REFERENCE, 0.0, 0.0),
        ("b05", RegionKind.TARGET, 5.0, 180.0),
        ("b15", RegionKind.TARGET, 15.0, 180.0),
        ("b25", RegionKind.TARGET, 25.0, 180.0),
    ]
    assert config.simulation is not None
    assert config.simulation.weather == "alamosa-2016-01-01"


def test_a_campaign_is_never_overwritten(init, tmp_path):
    init("here")
    file = tmp_path / "here" / "fieldkit.toml"
    file.write_text("precious")
    assert init("here").exit_code == 9
    assert file.read_text() == "precious"


def test_a_gitignore_that_is_there_is_kept(init, tmp_path):
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / ".gitignore").write_text("mine")
    init("here")
    assert (tmp_path / "here" / ".gitignore").read_text() == "mine"


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("--site", "35,139", "--zone", "Asia/Tokio"), 3, "did you mean Asia/Tokyo?"),
        (("--site", "35,400"), 2, "longitude within -180..180"),
        (("--zone", "Asia/Tokyo"), 2, "needs --site"),
        (("--simulated", "--site", "35,139"), 2, "brings its own site"),
    ],
)
def test_what_makes_no_campaign_writes_nothing(init, tmp_path, arguments, code, said):
    result = init("here", *arguments)
    assert result.exit_code == code
    assert said in result.stderr
    assert not (tmp_path / "here").exists()


def test_a_folder_that_cannot_be_made_is_told(init, tmp_path):
    (tmp_path / "here").write_text("a file")
    result = init("here")
    assert result.exit_code == 6
    assert "cannot make a campaign" in result.stderr


def test_the_schema_is_a_json_schema_of_every_table(init):
    schema = json.loads(init("--schema").stdout)
    assert schema["properties"].keys() >= {"site", "camera", "lux", "thermometer", "estimator", "region"}
    assert schema["additionalProperties"] is False


def test_json_names_the_files(init):
    document = json.loads(init("here", "--json").stdout)
    assert document == {"schema": 1, "campaign": "here", "config": "here/fieldkit.toml"}
