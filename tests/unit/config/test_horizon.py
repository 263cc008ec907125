"""The horizon's file in the configuration."""

import pytest

from fieldkit.config.load import load_config
from fieldkit.config.references import load_horizon, with_horizons
from fieldkit.model.errors import ConfigError


def test_a_file_becomes_its_pairs(tmp_path):
    (tmp_path / "ridge.csv").write_text("azimuth_deg,elevation_deg\n0,5\n90,12.5\n", encoding="utf-8")
    values = {"region": [{"name": "b15", "horizon": "ridge.csv"}]}
    assert with_horizons(values, tmp_path / "fieldkit.toml") == []
    assert values["region"][0]["horizon"] == [[0.0, 5.0], [90.0, 12.5]]


@pytest.mark.parametrize("rows", ["", "0,5\n360,5\n", "0,nan\n", "0\n", "400,5\n", "0,90\n"])
def test_a_bad_file_is_named(tmp_path, rows):
    (tmp_path / "ridge.csv").write_text("azimuth_deg,elevation_deg\n" + rows, encoding="utf-8")
    with pytest.raises(ConfigError, match=r"ridge\.csv"):
        load_horizon(tmp_path / "ridge.csv")


def test_a_missing_file_is_a_mistake_of_its_key(tmp_path):
    (mistake,) = with_horizons({"site": {"horizon": "none.csv"}}, tmp_path / "fieldkit.toml")
    assert mistake.path == ("site", "horizon")


def test_pairs_in_the_configuration_are_checked(tmp_path):
    site = "[site]\nlatitude_deg = 0.0\nlongitude_deg = 0.0\nhorizon = "
    file = tmp_path / "fieldkit.toml"
    file.write_text(f"{site}[[0, 5], [90, 12.5]]\n", encoding="utf-8")
    assert load_config(file, environment={}).estimator_settings().horizon == ((0.0, 5.0), (90.0, 12.5))
    elevation, azimuth = "a number above -90 and below 90", "a number from 0 to 360"
    for pairs, words in (
        ("[[0, 95]]", rf"\[0\]\[1\]: got 95, expected {elevation}"),
        ("[[0, 5], [400, 5]]", rf"\[1\]\[0\]: got 400, expected {azimuth}"),
        ("[[0]]", rf"\[0\]\[1\]: missing; expected {elevation}"),
        ("[[0, 5, 1]]", r"\[0\]: got \[0, 5, 1\], expected a list of 2 values"),
        ("3", ": got 3, expected a list"),
        ("[[0, 5], [360, 7]]", ": every azimuth may stand once"),
    ):
        file.write_text(f"{site}{pairs}\n", encoding="utf-8")
        with pytest.raises(ConfigError, match=rf"site\.horizon{words}"):
            load_config(file, environment={})
