"""The horizon's file in the configuration."""

import pytest

from fieldkit.config.load import load_config
from fieldkit.config.references import load_horizon, with_horizons
from fieldkit.model.errors import ConfigError
from tests.harness.next_steps import at


def test_a_file_becomes_its_pairs(tmp_path):
    (tmp_path / "ridge.csv").write_text("azimuth_deg,elevation_deg\n0,5\n90,12.5\n", encoding="utf-8")
    values = {"region": [{"name": "b15", "horizon": "ridge.csv"}]}
    assert with_horizons(values, tmp_path / "fieldkit.toml") == []
    assert values["region"][0]["horizon"] == [[0.0, 5.0], [90.0, 12.5]]


@pytest.mark.parametrize("rows", ["", "0,5\n360,5\n", "0,nan\n", "0\n", "400,5\n", "0,90\n"])
def test_a_bad_file_is_named(tmp_path, rows):
    (tmp_path / "ridge.csv").write_text("azimuth_deg,elevation_deg\n" + rows, encoding="utf-8")
    with pytest.raises(ConfigError, check=at(tmp_path / "ridge.csv")):
        load_horizon(tmp_path / "ridge.csv")


def test_a_missing_file_is_a_mistake_of_its_key(tmp_path):
    (mistake,) = with_horizons({"site": {"horizon": "none.csv"}}, tmp_path / "fieldkit.toml")
    assert mistake.path == ("site", "horizon")


def test_pairs_in_the_configuration_are_checked(tmp_path):
    site = "[site]\nlatitude_deg = 0.0\nlongitude_deg = 0.0\nhorizon = "
    file = tmp_path / "fieldkit.toml"
    file.write_text(f"{site}[[0, 5], [90, 12.5]]\n", encoding="utf-8")
    assert load_config(file, environment={}).estimator_settings().horizon == ((0.0, 5.0), (90.0, 12.5))
    for pairs, place, value in (
        ("[[0, 95]]", "[0][1]", "95, .*-90 and below 90"),
        ("[[0, 5], [400, 5]]", "[1][0]", "400, .*0 to 360"),
        ("[[0]]", "[0][1]", "missing; .*-90 and below 90"),
        ("[[0, 5, 1]]", "[0]", r"\[0, 5, 1\], .*2 values"),
        ("3", "", "got 3"),
        ("[[0, 5], [360, 7]]", "", "every azimuth"),
    ):
        file.write_text(f"{site}{pairs}\n", encoding="utf-8")
        with pytest.raises(ConfigError, match=value, check=at(f"fieldkit.toml:4: site.horizon{place}")):
            load_config(file, environment={})
