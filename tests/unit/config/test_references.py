from dataclasses import replace
from datetime import UTC, datetime

import pytest

from fieldkit.calibration.calibration_record import CalibrationRecord, save
from fieldkit.config import ConfigMistakesError, changed_config, config_from_text, load_config
from fieldkit.config.references import load_horizon, with_horizons
from fieldkit.model.errors import ConfigError
from tests.harness.next_steps import at

SITE = "[site]\nlatitude_deg = 35.5\nlongitude_deg = 139.4\n"
REGIONS = (
    '[[region]]\nname = "flat"\nkind = "reference"\npoints_px = [[0, 0], [9, 0], [9, 9]]\n'
    '[[region]]\nname = "b15"\npoints_px = [[0, 0], [9, 0], [9, 9]]\noffset_k = "@cardboard"\n'
)


def record(kind, name, value, sd=0.01, day=10, **more):
    date = datetime(2026, 12, day, 1, 30, tzinfo=UTC)
    return CalibrationRecord(kind, name, date, value, sd, "1", "test", **more)


@pytest.fixture
def folder(tmp_path):
    calibration = tmp_path / "calibration"
    save(record("emissivity", "sand", 0.91), calibration)
    save(record("emissivity", "sand", 0.93, day=11), calibration)
    save(record("surface", "beds", 1.12, 0.02), calibration)
    save(record("irradiance", "roof", 0.0091), calibration)
    offsets = {"b15": 0.31}
    save(record("uniformity", "cardboard", 0.31, 0.04, values=offsets), calibration)
    return tmp_path


def load(folder, text, **given):
    file = folder / "fieldkit.toml"
    file.write_text(SITE + text, encoding="utf-8")
    return load_config(file, environment={}, **given)


def test_a_reference_is_the_newest_records_value_and_brings_its_uncertainty(folder):
    config = load(
        folder,
        '[surface]\nemissivity = "@sand"\n[estimator]\nscale = "@beds"\n'
        '[irradiance]\nmodel = "calibrated"\nfactor = "@roof"\n' + REGIONS,
    )
    settings = config.estimator_settings()
    assert settings.surface.emissivity == 0.93
    assert (settings.scale, settings.scale_sd, settings.prior.gain_sd) == (1.12, 0.02, 0.02)
    assert settings.irradiance.factor == 0.0091
    assert (settings.offsets_k, settings.offset_sd_k) == ({"b15": 0.31}, 0.04)
    used = config.calibrations()
    assert settings.emissivity_sd == 0.01
    assert settings.factor_sd == pytest.approx(0.01 / 0.0091)
    assert set(used) == {"surface.emissivity", "estimator.scale", "irradiance.factor", "b15.offset_k"}
    assert used["surface.emissivity"].date.day == 11


def test_broadband_emissivity_is_the_bands_unless_it_is_given(folder):
    assert load(folder, '[surface]\nemissivity = "@sand"\n').surface_parameters().emissivity_broadband == 0.93
    both = load(folder, '[surface]\nemissivity = "@sand"\nemissivity_broadband = 0.9\n').surface_parameters()
    assert (both.emissivity, both.emissivity_broadband) == (0.93, 0.9)


def test_a_session_keeps_value_and_record_and_needs_no_folder(folder, tmp_path):
    stored = load(folder, '[surface]\nemissivity = "@sand"\n').to_toml()
    elsewhere = config_from_text(stored, tmp_path / "other" / "there" / "x.h5")
    assert elsewhere.surface_parameters().emissivity == 0.93
    kept = elsewhere.tables.calibration["surface.emissivity"]
    assert (kept["reference"], kept["file"]) == ("@sand", "20261211T013000Z-sand.toml")
    records = elsewhere.calibrations()["surface.emissivity"], record("emissivity", "sand", 0.93, day=11)
    stored_record, original = (replace(sand, angle_deg=0.0) for sand in records)  # which is NaN
    assert stored_record == original


def test_a_session_is_read_again_under_another_record_or_number(folder):
    stored = load(folder, '[surface]\nemissivity = "@sand"\n').to_toml()
    session = folder / "recordings" / "x.h5"
    session.parent.mkdir()
    other = config_from_text(stored, session, settings=["surface.emissivity=@20261210T013000Z-sand"])
    assert other.surface_parameters().emissivity == 0.91
    assert other.calibrations()["surface.emissivity"].date.day == 10
    number = config_from_text(stored, session, settings=["surface.emissivity=0.95"])
    assert number.calibrations() == {}
    assert other.estimator_settings().emissivity_sd == 0.01
    assert number.estimator_settings().emissivity_sd == 0.0  # the record's went with its value
    again = changed_config(other, ["surface.albedo=0.3"])
    assert repr(again.calibrations()) == repr(other.calibrations())


SAND = {"conductivity_w_m_k": 0.31, "depth_m": 0.042}
PRIOR_SDS = {
    "estimator.scale_sd": 0.05, "prior.gain_sd": 0.05,
    "slab.conductivity_sd": 0.2, "prior.inertia_log_sd": 0.1,
    "prior.depth_log_sd": 0.15, "prior.deep_share": 0.0,
}  # fmt: skip


def test_learnt_sand_is_a_prior_key_by_key(folder):
    save(
        record("surface", "this-sand", 0.97, 0.05, values=SAND, details={"prior_sds": PRIOR_SDS}),
        folder / "calibration",
    )
    config = load(folder, '[slab]\ndepth_m = "@this-sand"\nconductivity_w_m_k = "@this-sand"\n')
    settings = config.estimator_settings()
    assert (settings.slab.depth_m, settings.slab.conductivity_w_m_k) == (0.042, 0.31)
    assert (settings.prior.depth_log_sd, settings.prior.deep_share) == (0.15, 0.0)
    assert (settings.prior.inertia_log_sd, settings.conductivity_sd) == (0.1, 0.2)
    assert (settings.scale, settings.prior.gain_sd) == (1.0, 0.09)  # not named: another light meter
    refilled = changed_config(config, ["slab.depth_m=0.05"])
    assert set(refilled.calibrations()) == {"slab.conductivity_w_m_k"}
    assert refilled.estimator_settings().prior.depth_log_sd == 0.5
    assert refilled.estimator_settings().prior.inertia_log_sd == 0.1


def test_a_region_with_a_record_of_its_own_has_its_own_uncertainty(folder):
    own = REGIONS.replace('offset_k = "@cardboard"', 'emissivity = "@sand"')
    settings = load(folder, own).estimator_settings()
    assert settings.own_emissivity_sd == {"b15": 0.01}
    assert settings.emissivity_sd == 0.0


def test_a_light_meters_uncertainty_counts_only_where_its_factor_does(folder):
    text = '[irradiance]\nmodel = "{}"\nfactor = "@roof"\n'
    assert load(folder, text.format("eq10")).estimator_settings().factor_sd == 0.0
    assert load(folder, text.format("calibrated")).estimator_settings().factor_sd > 0.0


@pytest.mark.parametrize(
    ("text", "place", "values"),
    [
        ('[surface]\nemissivity = "@mud"\n', "5: surface.emissivity", "'mud'"),
        ('[surface]\nemissivity = "@beds"\n', "5: surface.emissivity", "@beds: .*surface, .*emissivity"),
        ('[surface]\nemissivity = "sand"\n', "5: surface.emissivity", "a number"),
        (REGIONS.replace("b15", "b16"), "11: region[1].offset_k", "@cardboard: .*'b16'; .*b15"),
        ('[slab]\ndepth_m = "@beds"\n', "5: slab.depth_m", "@beds: .*estimator.model"),
        ("[calibration]\nsand = 0.9\n", "5: calibration.sand", "records"),
        ('[calibration."surface.emissivity"]\nkind = 5\n', "4: calibration.surface.emissivity", "records"),
    ],
)
def test_a_reference_that_leads_nowhere_is_told_with_its_line(folder, text, place, values):
    with pytest.raises(ConfigMistakesError, match=values, check=at(f"fieldkit.toml:{place}")):
        load(folder, text)


def test_every_bad_reference_is_told_beside_other_mistakes(folder):
    with pytest.raises(ConfigMistakesError) as caught:
        load(folder, '[surface]\nemissivity = "@mud"\nalbedo = 2\n')
    assert len(caught.value.mistakes) == 2


def test_what_is_measured_of_one_sand_may_have_one_name(folder):
    save(record("surface", "sand", 1.2, day=12), folder / "calibration")
    config = load(folder, '[surface]\nemissivity = "@sand"\n[estimator]\nscale = "@sand"\n')
    assert (config.surface_parameters().emissivity, config.estimator_settings().scale) == (0.93, 1.2)


def test_offsets_of_several_records_are_as_uncertain_as_the_worst(folder):
    save(record("uniformity", "lid", 0.1, 0.01, values={"b25": 0.1}), folder / "calibration")
    other = '[[region]]\nname = "b25"\npoints_px = [[0, 0], [9, 0], [9, 9]]\noffset_k = "@lid"\n'
    assert load(folder, REGIONS + other).estimator_settings().offset_sd_k == 0.04


def test_a_value_in_place_of_a_table_is_a_mistake_of_the_file(folder):
    """The record of the scale brings prior.gain_sd as well."""
    with pytest.raises(ConfigMistakesError, match="prior=5"):
        load(folder, "[estimator]\nscale = '@beds'\n", settings=["prior=5"])


@pytest.mark.parametrize("wrong", ["5", "{'prior.gain_sd' = 'narrow'}"])
def test_standard_deviations_of_a_record_that_are_not_numbers_are_a_mistake(folder, wrong):
    file = save(
        record("surface", "learnt", 1.1, details={"prior_sds": {"prior.gain_sd": 0.05}}),
        folder / "calibration",
    )
    text = file.read_text().replace(
        '[details.prior_sds]\n"prior.gain_sd" = 0.05', f"[details]\nprior_sds = {wrong}"
    )
    file.write_text(text)
    with pytest.raises(ConfigMistakesError, match="prior_sds"):
        load(folder, '[estimator]\nscale = "@learnt"\n')


# --- the horizon's file in the configuration


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
