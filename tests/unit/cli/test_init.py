import json
import os
import pty
from contextlib import nullcontext

import pytest

from fieldkit.cli import main
from fieldkit.config import load_config
from fieldkit.model.errors import ConfigError, RefusedError, StorageError
from fieldkit.model.site import Site
from tests.harness.command_line import document, fieldkit, invoke, succeed
from tests.harness.connected import plugged_in
from tests.harness.next_steps import at


@pytest.fixture
def init(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: succeed("init", *arguments)


def test_a_new_campaign_passes_its_own_check_and_has_its_folders(init, tmp_path):
    init("sandslope")
    folder = tmp_path / "sandslope"
    assert load_config(folder / "fieldkit.toml", environment={}).regions == ()
    folders = {"calibration", "recordings", "reports", "results"}
    assert {path.name for path in folder.iterdir()} == {".gitignore", "fieldkit.toml", *folders}
    assert "/recordings/" in (folder / ".gitignore").read_text()


def test_the_site_comes_from_the_command_line(init, tmp_path):
    # the site of the paper's experiments
    words = ("init", "here", "--site", "35.558675,139.395232,9", "--zone", "Asia/Tokyo")
    assert document(*words) == {"schema": 1, "campaign": "here", "config": "here/fieldkit.toml"}
    config = load_config(tmp_path / "here" / "fieldkit.toml", environment={})
    assert config.site == Site(35.558675, 139.395232, 9.0, "Asia/Tokyo")


@pytest.mark.parametrize(("place", "zone"), [("35.56,139.4,9", "Etc/GMT-9"), ("51.5,-0.1", "UTC")])
def test_without_a_time_zone_it_is_that_of_the_longitude_and_told(init, tmp_path, place, zone):
    assert f" {zone}, by longitude" in init("here", "--site", place).stderr
    config = load_config(tmp_path / "here" / "fieldkit.toml", environment={})
    assert config.site.timezone == zone


def test_a_folder_is_meant_from_the_one_that_was_named(init, tmp_path):
    (tmp_path / "below").mkdir()
    init("-C", "below", "here")
    assert (tmp_path / "below" / "here" / "fieldkit.toml").exists()
    init("-C", "below")
    assert (tmp_path / "below" / "fieldkit.toml").exists()


def test_the_demos_campaign_too_is_below_the_folder_that_was_named(tmp_path):
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / "fieldkit.toml").write_text("schema = no number")
    with pytest.raises(ConfigError, check=at(tmp_path / "here" / "fieldkit.toml")):
        invoke("demo", "-C", tmp_path, "--out", "here")


def test_what_to_do_next_works_where_one_stands(init, tmp_path):
    assert "cd here && " in init("here", "--simulated").stderr
    papers_site = init("my sand").stderr
    assert "'my sand'" in papers_site
    assert "[site]" in papers_site
    assert "fieldkit devices" in init(str(tmp_path)).stderr


QUESTIONS = b"36.1,-112.1,2100\n"  # the place
ALL_DEFAULTS, OTHERS = b"\n\n\n\n", b"n\nn\nlux longwave air\nn\n"


def init_on_a_terminal(typed, *words):
    near, far = pty.openpty()
    with os.fdopen(far) as terminal, pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.stdin", terminal)  # click's runner has none
        os.write(near, typed)
        main(["init", *map(str, words)], standalone_mode=False)
    os.close(near)
    return load_config(words[-1] / "fieldkit.toml", environment={})


@pytest.mark.parametrize(
    ("typed", "same", "prior", "references", "following"),
    [
        (QUESTIONS + ALL_DEFAULTS + b"n\n", True, (0.7, 30.0), 2, "fieldkit devices --add"),
        (QUESTIONS + OTHERS + b"y\n", False, (2.0, 10.0), 1, "fieldkit doctor"),
    ],
)
def test_on_a_terminal_it_asks_what_decides(
    monkeypatch, tmp_path, capsys, typed, same, prior, references, following
):
    monkeypatch.setattr("fieldkit.drivers.registry.names", list)  # no driver looks for its own
    plugged_in(monkeypatch)
    config = init_on_a_terminal(typed, tmp_path / "here")
    shown = capsys.readouterr().err
    assert f"&& {following}, " in shown
    assert shown.count("--reference") == references
    assert config.site == Site(36.1, -112.1, 2100.0, "Etc/GMT+7")
    assert config.tables.surface.same is same
    assert (config.tables.prior.air_sd_k, config.tables.prior.longwave_sd_w_m2) == prior


def test_yes_asks_nothing_even_on_a_terminal(tmp_path):
    assert init_on_a_terminal(b"", "--yes", tmp_path / "here").tables.surface.same is False


@pytest.mark.parametrize("name", ["fieldkit.toml", ".gitignore"])
def test_what_is_there_is_never_overwritten(init, tmp_path, name):
    file = tmp_path / "here" / name
    file.parent.mkdir()
    file.write_text("precious")
    with pytest.raises(RefusedError) if name == "fieldkit.toml" else nullcontext():
        invoke("init", "here")
    assert file.read_text() == "precious"


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("--site", "35,139", "--zone", "Asia/Tokio"), 3, "Asia/Tokyo?"),
        (("--site", "35,400"), 2, "-180 to 180"),
        (("--zone", "Asia/Tokyo"), 3, "--site"),
        (("--simulated", "--site", "35,139"), 3, "brings its own site"),
    ],
)
def test_what_makes_no_campaign_writes_nothing(init, tmp_path, arguments, code, said):
    result = fieldkit("init", "here", *arguments)
    assert result.exit_code == code
    assert said in result.stderr
    assert not (tmp_path / "here").exists()


def test_a_folder_that_cannot_be_made_is_told(init, tmp_path):
    (tmp_path / "here").write_text("a file")
    with pytest.raises(StorageError, match="here"):
        invoke("init", tmp_path / "here")


def test_the_schema_is_a_json_schema_of_every_table(init):
    schema = json.loads(init("--schema").stdout)
    assert schema["properties"].keys() >= {"site", "camera", "lux", "thermometer", "estimator", "region"}
    assert schema["additionalProperties"] is False
