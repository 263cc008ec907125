import re
from pathlib import Path

import pytest

from fieldkit.config import (
    ConfigMistakesError,
    NoCampaignError,
    config_from_text,
    find_campaign,
    load_config,
    read_config,
)
from fieldkit.config.load import ignored_keys
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Action, Argument
from tests.harness.next_steps import at, steps

SITE = "[site]\nlatitude_deg = 35.5\nlongitude_deg = 139.4\n"
FLAT = '[[region]]\nname = "flat"\nkind = "reference"\npoints_px = [[0, 0], [9, 0], [9, 9]]\n'
PROBED = 'probes = ["t:1"]\n'
NARROW = '[camera]\ndriver = "purethermal"\nwidth_px = 9\n'


@pytest.fixture
def user(tmp_path, monkeypatch):
    """The user's own configuration file, absent at first."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "home"))
    file = tmp_path / "home" / "fieldkit" / "config.toml"
    file.parent.mkdir(parents=True)
    return file


@pytest.fixture
def campaign(tmp_path, user):
    """Writes a fieldkit.toml and gives its path."""

    def write(text: str) -> Path:
        file = tmp_path / "fieldkit.toml"
        file.write_text(text, encoding="utf-8")
        return file

    return write


def mistakes(file: Path, **given) -> tuple[str, ...]:
    with pytest.raises(ConfigMistakesError) as caught:
        load_config(file, environment={}, **given)
    return caught.value.mistakes


def test_every_mistake_is_told_at_once_with_its_line(campaign):
    # line numbers are counted by hand in this text
    file = campaign(
        "[site]\n"
        "latitude_deg = 139.4\n"
        "longitude_deg = 35.5\n"
        'timezone = "Asia/Tokio"\n'
        "[surface]\n"
        'albedo = "0.2"\n'
        "[estimator]\n"
        'methode = "unit-norm"\n'
        "[lux]\n"
        'driver = "lutrn"\n'
        "[[region]]\n"
        'name = "flat"\n'
        "points_px = [[0, 0], [9, 9]]\n"
        'kind = "reference"\n'
    )
    for mistake, expected in zip(
        mistakes(file),
        [
            "2: site.latitude_deg: .*-90 to 90",
            "4: site.timezone: .*Asia/Tokyo",
            "6: surface.albedo: .*0 and below 1",
            "8: estimator.methode: .*method[?]",
            "10: lux.driver: .*'lutrn'.*lutron[?]",
            r"13: region\[0\]\.points_px: .*3 values",
        ],
        strict=True,
    ):
        assert re.match(f"fieldkit.toml:{expected}", mistake), mistake


def test_a_session_may_name_a_driver_that_is_not_installed_here(campaign):
    text = SITE + '[device.net]\ndriver = "of-another-package"\n'
    with pytest.raises(ConfigError, match="purethermal", check=at("fieldkit.toml:5: device.net.driver")):
        load_config(campaign(text), environment={})
    assert config_from_text(text, Path("session.h5")).devices[0].driver == "of-another-package"


@pytest.mark.parametrize(
    ("table", "line", "meant"),
    [
        ("[surface]", "reflected_temperature_k = 233", "reflected_temperature_c, in degrees Celsius?"),
        ("[irradiance]", "plane_tilt_rad = 0.1", "plane_tilt_deg, in degrees?"),
        ("[record]", "every_min = 1", "every_s, in seconds?"),
        ("[record]", "every = 60", "every_s, in seconds?"),
        ("[record]", "colour = 1", "sampling, every_s, burst_frames, shutter_before_burst"),
        ("[surfaces]", "albedo = 0.2", "surface?"),
        ("[site]", "latitud_deg = 35.5", "latitude_deg?"),  # and is not missing as well
    ],
)
def test_an_unknown_key_is_refused_with_the_one_that_was_meant(campaign, table, line, meant):
    text = f"{SITE}{table}\n{line}\n" if table != "[site]" else SITE.replace("latitude_deg = 35.5", line)
    (mistake,) = mistakes(campaign(text))
    assert "unknown key" in mistake
    assert meant in mistake


@pytest.mark.parametrize(
    ("text", "key", "values"),
    [
        (FLAT.replace("reference", "target"), "region", "no reference"),
        (FLAT + FLAT.replace("flat", "FLAT"), "region[1].name", "'flat'"),
        (FLAT + 'probes = ["T1"]\n', "region[0].probes[0]", "(stream:channel"),
        (FLAT + PROBED + FLAT.replace("flat", "b05") + PROBED, "region[1].probes", "'flat'"),
        (FLAT + "tilt_deg = 5\n", "region[0].tilt_deg", "azimuth"),
        (f"{FLAT}{NARROW}height_px = 120\n", "region[0].points_px", "(9, 0) is outside"),
        (NARROW, "camera", "width_px and height_px"),
        ('[device.lux]\ndriver = "lutron"\n', "device.lux", "[lux]"),
        ('[irradiance]\nmodel = "calibrated"\n', "irradiance.model", "irradiance.factor"),
        ('[estimator]\nmethod = "contours"\n', "estimator.method", 'model = "paper" or "full"'),
        ("[estimator]\nwindow_s = 5\n", "estimator.window_s", 'to 86400 or "weather"'),
        ("[surface]\nalbedo = nan\n", "surface.albedo", "nan"),
        ("[record]\nburst_frames = 2.5\n", "record.burst_frames", "whole number"),
        ("[simulation]\nstart = 2016-01-01T12:00:00\n", "simulation.start", "offset from UTC"),
        *(
            (f"[simulation]\nstart = {year}-01-01T12:00:00Z\n", "simulation.start", "1971..2250")
            for year in ("0001", "1500", "1969", "9999")
        ),
        ("schema = 2\n", "schema", "1"),
    ],
)
def test_what_does_not_fit_is_refused(campaign, text, key, values):
    (mistake,) = mistakes(campaign(text + SITE if text.startswith("schema") else SITE + text))
    assert f": {key}: " in mistake
    assert values in mistake


def test_a_missing_site_is_told(campaign):
    with pytest.raises(ConfigMistakesError, check=at("fieldkit.toml: site")):
        load_config(campaign("schema = 1\n"), environment={})


def test_text_that_is_not_toml_is_told_with_its_line(campaign):
    file = campaign("[site]\nlatitude_deg = \n")
    with pytest.raises(ConfigError, match="line 2", check=at(file)):
        load_config(file)


def test_a_byte_order_mark_is_passed_over(campaign):
    file = campaign("")
    file.write_bytes(b"\xef\xbb\xbf" + SITE.encode())
    assert load_config(file, environment={}).site.latitude_deg == 35.5


def test_a_file_that_cannot_be_read_is_told(campaign, tmp_path):
    campaign("").write_bytes(b"title = \xff")
    for name, reason in (("absent.toml", "No such file"), ("fieldkit.toml", "UTF-8")):
        with pytest.raises(ConfigError, match=reason, check=at(tmp_path / name)):
            load_config(tmp_path / name)


def test_command_line_beats_environment_beats_campaign_beats_user_beats_default(campaign, user):
    keys = ("albedo", "emissivity", "emissivity_broadband", "reflected_temperature_c")
    user.write_text("[surface]\n" + "".join(f"{key} = 0.1\n" for key in keys[:3]))
    file = campaign(SITE + "[surface]\nalbedo = 0.2\nemissivity = 0.2\n")
    surface = load_config(
        file, environment={"FIELDKIT_SURFACE__ALBEDO": "0.3"}, settings=["surface.albedo=0.4"]
    ).tables.surface
    assert [getattr(surface, key) for key in keys] == [0.4, 0.2, 0.1, -40.0]
    assert load_config(file, environment={"FIELDKIT_SURFACE__ALBEDO": "0.3"}).tables.surface.albedo == 0.3


def test_a_setting_is_written_as_in_toml_and_text_may_go_without_quotes(campaign):
    file = campaign(SITE)
    config = load_config(
        file,
        environment={},
        settings=["record.sampling=all", "estimator.refraction=true", 'campaign.title="a = b"'],
    )
    assert config.tables.record.sampling == "all"
    assert config.tables.estimator.refraction is True
    assert config.tables.campaign.title == "a = b"


@pytest.mark.parametrize(
    ("setting", "place"),
    [("surface.albedo", "surface.albedo"), ("=3", "=3"), ("site.latitude_deg.x=3", "site.latitude_deg.x")],
)
def test_a_setting_without_key_or_value_is_refused(campaign, setting, place):
    with pytest.raises(ConfigError, check=at(f"setting {place}")):
        load_config(campaign(SITE), environment={}, settings=[setting])


def test_environment_variables_without_double_underscore_are_not_settings(campaign):
    assert load_config(campaign(SITE), environment={"FIELDKIT_NONSENSE": "1", "HOME": "/"})


def test_a_campaign_is_found_from_a_folder_inside_it(campaign, tmp_path):
    file = campaign(SITE)
    inside = tmp_path / "recordings" / "deep"
    inside.mkdir(parents=True)
    assert find_campaign(inside) == file.resolve()


def test_no_campaign_is_told_with_what_to_do(tmp_path):
    with pytest.raises(NoCampaignError, check=at(tmp_path, Action.CREATE_CAMPAIGN())):
        find_campaign(tmp_path)


def test_mistakes_between_keys_leave_a_configuration_to_look_at(campaign):
    config, told = read_config(campaign(SITE + FLAT.replace("reference", "target")), environment={})
    assert config is not None
    assert [region.name for region in config.regions] == ["flat"]
    assert [mistake.key for _, mistake in told] == ["region"]


def test_keys_of_a_later_version_are_ignored_in_a_sessions_own_configuration():
    text = SITE + "[surface]\nsheen = 1\nalbedo = 0.3\n[drone]\nheight_m = 3\n"
    assert config_from_text(text, Path("x.h5")).tables.surface.albedo == 0.3
    assert ignored_keys(text, Path("x.h5")) == ["surface.sheen", "drone"]
    with pytest.raises(ConfigMistakesError, match="sheen"):
        config_from_text(SITE, Path("x.h5"), settings=["surface.sheen=2"])


def test_a_sessions_own_configuration_heeds_settings_but_neither_environment_nor_user(user, monkeypatch):
    user.write_text("[surface]\nalbedo = 0.7\n")
    monkeypatch.setenv("FIELDKIT_SURFACE__EMISSIVITY", "0.7")
    config = config_from_text(SITE, Path("x.h5"), settings=["surface.emissivity_broadband=0.8"])
    surface = config.tables.surface
    assert (surface.albedo, surface.emissivity, surface.emissivity_broadband) == (0.2, 0.9, 0.8)
    with pytest.raises(ConfigMistakesError, match=r"surface\.albedo=2"):
        config_from_text(SITE, Path("x.h5"), settings=["surface.albedo=2"])


def test_what_is_wrong_on_the_command_line_is_corrected_there_not_in_the_file(campaign):
    file = campaign(SITE)
    key = "surface.albedo"
    with pytest.raises(ConfigError, match="got 9", check=at(f"setting {key}=9: {key}")) as caught:
        load_config(file, settings=["surface.albedo=9"], environment={})
    assert steps(caught.value) == [Argument("settings")]
    with pytest.raises(ConfigError, match="got 9", check=at(f"FIELDKIT_SURFACE__ALBEDO: {key}")) as caught:
        load_config(file, environment={"FIELDKIT_SURFACE__ALBEDO": "9"})
    assert "FIELDKIT_SURFACE__ALBEDO" in caught.value.fix
    file.write_text(file.read_text() + "[surface]\nalbedo = 9\n")
    with pytest.raises(ConfigError, match="got 9") as caught:
        load_config(file, settings=["surface.emissivity=0.9"], environment={})
    assert caught.value.fix == f"edit {file}"


@pytest.mark.parametrize(
    ("setting", "meant"), [("albedo=0.3", "surface.albedo"), ("latitude=35", "site.latitude_deg")]
)
def test_a_key_without_its_table_is_answered_with_the_whole_one(campaign, setting, meant):
    with pytest.raises(ConfigError, match=rf" {meant}\?"):
        load_config(campaign(SITE), settings=[setting], environment={})
