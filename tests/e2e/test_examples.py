"""The campaigns under ``examples/`` run as they stand."""

import json
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

from fieldkit.cli import main
from fieldkit.config import load_config
from fieldkit.drivers import registry

EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("*/fieldkit.toml"))
SIMULATED = [file for file in EXAMPLES if 'port = "simulated"' in file.read_text(encoding="utf-8")]


@pytest.fixture(autouse=True)
def no_user_configuration(tmp_path, monkeypatch):
    (tmp_path / "home").mkdir()
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "home"))


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.parent.name)
def test_an_example_is_valid_and_its_drivers_exist(file):
    config = load_config(file, environment={})
    assert {device.name for device in config.devices} == {"camera", "lux", "thermometer"}
    assert {device.driver for device in config.devices} <= set(registry.names())


@pytest.mark.parametrize("file", SIMULATED, ids=lambda file: file.parent.name)
def test_a_simulated_example_records_and_gives_a_slope_for_every_bed(file, tmp_path):
    folder = tmp_path / "campaign"
    shutil.copytree(file.parent, folder, ignore=shutil.ignore_patterns("recordings", "reports"))
    result = CliRunner().invoke(
        main, ["record", "-C", str(folder), "--for", "12m", "--set", "simulation.speed=max", "--json"]
    )
    assert result.exit_code == 0, result.output
    slopes = {one["region"]: one for one in json.loads(result.stdout)["estimates"]}
    beds = [region for region in load_config(file, environment={}).regions if region.tilt_deg > 0]
    assert set(slopes) == {bed.name for bed in beds}
    assert all(abs(slopes[bed.name]["tilt_deg"] - bed.tilt_deg) < 10 for bed in beds)
