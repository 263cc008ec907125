from pathlib import Path

import pytest

from fieldkit.config import ConfigMistakesError, config_from_text, find_campaign, load_config, read_config
from fieldkit.config.load import ignored_keys
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Action, Argument
from tests.harness.next_steps import steps

SITE = "[site]\nlatitude_deg = 35.5\nlongitude_deg = 139.4\n"
FLAT = '[[region]]\nname = "flat"\nkind = "reference"\npoints_px = [[0, 0], [9, 0], [9, 9]]\n'


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
    told = mistakes(file)
    assert [line.split(": ")[:2] for line in told] == [
        ["fieldkit.toml:2", "site.latitude_deg"],
        ["fieldkit.toml:4", "site.timezone"],
        ["fieldkit.toml:6", "surface.albedo"],
        ["fieldkit.toml:8", "estimator.methode"],
        ["fieldkit.toml:10", "lux.driver"],
        ["fieldkit.toml:13", "region[0].points_px"],
    ]
    assert "expected a number from -90 to 90" in told[0]
    assert "did you mean Asia/Tokyo?" in told[1]
    assert "expected a number at least 0 and below 1" in told[2]
    assert "did you mean method?" in told[3]
    assert "unknown driver 'lutrn'; did you mean lutron?" in told[4]
    assert "expected a list of at least 3 values" in told[5]


def test_a_simulated_foil_lies_on_a_region(campaign):
    (told,) = mistakes(campaign(SITE + '[simulation]\nfoil = "nobody"\n'))
    assert "simulation.foil: there is no region 'nobody'" in told


@pytest.mark.parametrize("year", ["0001", "1500", "1969", "9999"])
def test_a_simulated_field_begins_in_years_that_a_session_can_hold(campaign, year):
    (told,) = mistakes(campaign(SITE + f"[simulation]\nstart = {year}-01-01T12:00:00Z\n"))
    assert "simulation.start: got" in told
    assert "the year must lie within 1971..2250" in told


def test_a_session_may_name_a_driver_that_is_not_installed_here(campaign):
    text = SITE + '[device.net]\ndriver = "of-another-package"\n'
    (told,) = mistakes(campaign(text))
    assert "device.net.driver: unknown driver 'of-another-package'; available: purethermal," in told
    assert config_from_text(text, Path("session.h5")).devices[0].driver == "of-another-package"


@pytest.mark.parametrize(
    ("table", "line", "said"),
    [
        (
            "[surface]",
            "reflected_temperature_k = 233",
            "did you mean reflected_temperature_c, in degrees Celsius?",
        ),
        ("[irradiance]", "plane_tilt_rad = 0.1", "did you mean plane_tilt_deg, in degrees?"),
        ("[record]", "every_min = 1", "did you mean every_s, in seconds?"),
        ("[record]", "every = 60", "did you mean every_s, in seconds?"),
        ("[record]", "colour = 1", "known here: sampling, every_s, burst_frames, shutter_before_burst"),
        ("[surfaces]", "albedo = 0.2", "did you mean surface?"),
    ],
)
def test_an_unknown_key_is_refused_with_the_one_that_was_meant(campaign, table, line, said):
    (told,) = mistakes(campaign(f"{SITE}{table}\n{line}\n"))
    assert "unknown key" in told
    assert said in told


@pytest.mark.parametrize(
    ("text", "key", "said"),
    [
        (FLAT.replace("reference", "target"), "region", "no reference among the regions"),
        (FLAT + FLAT.replace("flat", "FLAT"), "region[1].name", "duplicate region name 'flat'"),
        (FLAT + 'probes = ["T1"]\n', "region[0].probes[0]", "text (stream:channel, such as thermometer:T1)"),
        (
            FLAT + 'probes = ["t:1"]\n' + FLAT.replace("flat", "b05") + 'probes = ["t:1"]\n',
            "region[1].probes",
            "t:1 is in region 'flat' already",
        ),
        (FLAT + "tilt_deg = 5\n", "region[0].tilt_deg", "a tilted reference also needs azimuth_deg"),
        (
            FLAT + '[camera]\ndriver = "purethermal"\nwidth_px = 9\nheight_px = 120\n',
            "region[0].points_px",
            "corner (9, 0) is outside the frame of 9 x 120 pixels",
        ),
        (
            '[camera]\ndriver = "purethermal"\nwidth_px = 9\n',
            "camera",
            "width_px and height_px belong together",
        ),
        ('[device.lux]\ndriver = "lutron"\n', "device.lux", "this name is reserved for the table [lux]"),
        ('[irradiance]\nmodel = "calibrated"\n', "irradiance.model", "needs irradiance.factor"),
        ('[estimator]\nmethod = "contours"\n', "estimator.method", 'needs model = "paper" or "full"'),
        ("[estimator]\nwindow_s = 5\n", "estimator.window_s", 'a number at least 60 or "weather"'),
        ("[surface]\nalbedo = nan\n", "surface.albedo", "got nan"),
        ("[record]\nburst_frames = 2.5\n", "record.burst_frames", "a whole number"),
        ("[simulation]\nstart = 2016-01-01T12:00:00\n", "simulation.start", "offset from UTC"),
        ("schema = 2\n", "schema", "expected 1"),
    ],
)
def test_what_does_not_fit_is_refused(campaign, text, key, said):
    (told,) = mistakes(campaign(text + SITE if text.startswith("schema") else SITE + text))
    assert f": {key}: " in told
    assert said in told


def test_a_missing_site_is_told(campaign):
    (told,) = mistakes(campaign("schema = 1\n"))
    assert told.startswith("fieldkit.toml: site: missing")


def test_a_misspelled_key_does_not_also_count_as_missing(campaign):
    (told,) = mistakes(campaign("[site]\nlatitud_deg = 35.5\nlongitude_deg = 139.4\n"))
    assert "did you mean latitude_deg?" in told


def test_text_that_is_not_toml_is_told_with_its_line(campaign):
    file = campaign("[site]\nlatitude_deg = \n")
    with pytest.raises(ConfigError, match=r"not valid TOML.*line 2"):
        load_config(file)


def test_a_byte_order_mark_is_passed_over(campaign):
    file = campaign("")
    file.write_bytes(b"\xef\xbb\xbf" + SITE.encode())
    assert load_config(file, environment={}).site.latitude_deg == 35.5


def test_a_file_that_cannot_be_read_is_told(campaign, tmp_path):
    with pytest.raises(ConfigError, match="No such file"):
        load_config(tmp_path / "absent.toml")
    file = campaign("")
    file.write_bytes(b"title = \xff")
    with pytest.raises(ConfigError, match="not UTF-8"):
        load_config(file)


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
    assert config.record.sampling == "all"
    assert config.tables.estimator.refraction is True
    assert config.campaign.title == "a = b"


@pytest.mark.parametrize(
    ("given", "place"),
    [
        ({"settings": ["surface.albedo=2"]}, "setting surface.albedo=2: surface.albedo: got 2"),
        (
            {"environment": {"FIELDKIT_SURFACE__ALBEDO": "2"}},
            "FIELDKIT_SURFACE__ALBEDO: surface.albedo: got 2",
        ),
    ],
)
def test_a_mistake_outside_the_file_is_told_where_it_was_made(campaign, given, place):
    with pytest.raises(ConfigMistakesError) as caught:
        load_config(campaign(SITE), **{"environment": {}, **given})
    assert caught.value.message.startswith(place)


@pytest.mark.parametrize("setting", ["surface.albedo", "=3", "site.latitude_deg.x=3"])
def test_a_setting_without_key_or_value_is_refused(campaign, setting):
    with pytest.raises(ConfigError, match=r"^setting "):
        load_config(campaign(SITE), environment={}, settings=[setting])


def test_environment_variables_without_double_underscore_are_not_settings(campaign):
    assert load_config(campaign(SITE), environment={"FIELDKIT_NONSENSE": "1", "HOME": "/"})


def test_a_campaign_is_found_from_a_folder_inside_it(campaign, tmp_path):
    file = campaign(SITE)
    inside = tmp_path / "recordings" / "deep"
    inside.mkdir(parents=True)
    assert find_campaign(inside) == file.resolve()


def test_no_campaign_is_told_with_what_to_do(tmp_path):
    with pytest.raises(ConfigError, match="no fieldkit") as caught:
        find_campaign(tmp_path)
    assert steps(caught.value) == [Action.CREATE_CAMPAIGN()]


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


def test_what_is_wrong_on_the_command_line_is_corrected_there_not_in_the_file(tmp_path):
    file = tmp_path / "fieldkit.toml"
    file.write_text("[site]\nlatitude_deg = 35\nlongitude_deg = 139\nelevation_m = 9\n")
    with pytest.raises(ConfigError, match="got 9") as caught:
        load_config(file, settings=["surface.albedo=9"], environment={})
    assert steps(caught.value) == [Argument("settings")]
    with pytest.raises(ConfigError, match="got 9") as caught:
        load_config(file, environment={"FIELDKIT_SURFACE__ALBEDO": "9"})
    assert caught.value.fix == "correct FIELDKIT_SURFACE__ALBEDO in the environment"
    file.write_text(file.read_text() + "[surface]\nalbedo = 9\n")
    with pytest.raises(ConfigError, match="got 9") as caught:
        load_config(file, settings=["surface.emissivity=0.9"], environment={})
    assert caught.value.fix == f"edit {file}"


@pytest.mark.parametrize(
    ("setting", "meant"), [("albedo=0.3", "surface.albedo"), ("latitude=35", "site.latitude_deg")]
)
def test_a_key_without_its_table_is_answered_with_the_whole_one(tmp_path, setting, meant):
    file = tmp_path / "fieldkit.toml"
    file.write_text("[site]\nlatitude_deg = 35\nlongitude_deg = 139\nelevation_m = 9\n")
    with pytest.raises(ConfigError, match=rf"did you mean {meant}\?"):
        load_config(file, settings=[setting], environment={})
