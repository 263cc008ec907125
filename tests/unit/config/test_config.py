import math
import tomllib
from dataclasses import asdict, fields

import pytest

from fieldkit.config import load_config
from fieldkit.estimation.prior import Prior
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.device import DeviceSettings
from fieldkit.model.site import RegionKind, Site
from fieldkit.physics.energy_balance import SurfaceParameters
from fieldkit.physics.irradiance import IrradianceModel
from fieldkit.physics.slab import Slab

SITE = '[site]\nlatitude_deg = 35.5\nlongitude_deg = 139.4\ntimezone = "Asia/Tokyo"\n'


@pytest.fixture
def config(tmp_path):
    def load(text: str = ""):
        file = tmp_path / "fieldkit.toml"
        file.write_text(SITE + text, encoding="utf-8")
        return load_config(file, environment={})

    return load


def same(one: object, other: object) -> bool:
    """Equal, where NaN equals NaN and numbers may differ in the last digit."""
    if isinstance(one, float) and isinstance(other, float):
        return one == pytest.approx(other, rel=1e-12, nan_ok=True)
    if isinstance(one, IrradianceModel):
        return all(same(getattr(one, field.name), getattr(other, field.name)) for field in fields(one))
    return one == other


def test_an_empty_configuration_gives_the_estimators_own_defaults(config):
    """Those of surface, slab, air and light are written down for the file and for Python: they must agree."""
    ours, theirs = config().estimator_settings(), EstimatorSettings()
    unlike = [f.name for f in fields(ours) if not same(getattr(ours, f.name), getattr(theirs, f.name))]
    assert unlike == ["site"]


ESTIMATOR = """
method = "contours"\nmodel = "full"\nwindow_s = 900.0\nazimuth = "known"\ntilt_limit_deg = 30.0
refraction = true\nnoise_k = 0.1\nlow_sun_deg = 5.0\nsettle_s = 60.0\nmin_minutes = 9
contour_tolerance_w_m2 = 5.0\ncontour_threshold = 0.6\nscale = 1.1\nscale_sd = 0.02\nexchange_sd = 0.2
offset_sd_k = 0.1\ndrift_sd_k_per_h = 0.3\nsky = "isotropic"\nground_albedo = 0.3
longwave_down_w_m2 = 250.0\ndiffuse_fraction = 0.2\nconfidence = 0.8\ntarget_half_width_deg = 3.0
reference = "weather"\nair = "model"
"""
"""Keys whose values are those of the estimator's settings of the same name."""


def test_every_setting_of_the_estimator_can_be_configured(config):
    prior = {name: value / 2 for name, value in asdict(Prior()).items()}
    given = config(
        f"[estimator]{ESTIMATOR}"
        '[surface]\nkind = "rock"\nsame = true\nalbedo = 0.3\nemissivity = 0.91\n'
        "emissivity_broadband = 0.92\nreflected_temperature_c = -20\nemissivity_sd = 0.02\n"
        "[air]\nheat_capacity_j_kg_k = 1005\ndensity_kg_m3 = 1.0\nexchange_m_s = 0.02\n"
        '[irradiance]\nmeasures = {sun = "ghi"}\nstream = "sun"\n'
        'model = "calibrated"\nfactor = 0.0091\nfactor_sd = 0.00091\nmounting = "in-plane"\n'
        "plane_tilt_deg = 5\n"
        'plane_azimuth_deg = 180\ndiffuse = "erbs"\npar_fraction = 1.0\nefficacy_lm_w = 110\n'
        "diffuse_fraction = 0.1\n"
        "[slab]\ndepth_m = 0.05\nconductivity_w_m_k = 0.3\nheat_capacity_j_m3_k = 1.5e6\n"
        "conductivity_sd = 0.3\ncapacity_sd = 0.05\n"
        "[limits]\nprobe_temperature_c = [-80, 250]\n"
        "[prior]\n"
        + "".join(f"{name} = {value}\n" for name, value in prior.items())
        + '[[region]]\nname = "flat"\nkind = "reference"\noffset_k = -0.2\nlevel_sd_deg = 0.5\n'
        'emissivity = 0.93\nemissivity_sd = 0.03\nprobes = ["thermometer:T1", "logger:2"]\n'
        "horizon = [[0, 5], [90, 12.5]]\n"
        "points_px = [[0, 0], [1, 0], [1, 1]]\n"
        '[[region]]\nname = "rocks"\nsurface_kind = "soil"\npoints_px = [[4, 0], [5, 0], [5, 1]]\n'
    ).estimator_settings()
    assert given == EstimatorSettings(
        **tomllib.loads(ESTIMATOR),
        kind="rock",
        kinds={"rocks": "soil"},
        same=True,
        level_sds_deg={"flat": 0.5},
        site=Site(35.5, 139.4, timezone="Asia/Tokyo"),
        surface=SurfaceParameters(0.3, 0.91, 0.92, 1005.0, 1.0, 0.02),
        irradiance=IrradianceModel(
            "calibrated", 1.0, 110.0, 0.0091, "in-plane", 5.0, 180.0, "erbs", 0.1, 0.3
        ),
        light_stream="sun",
        measures={"sun": "ghi"},
        limits={"probe_temperature": (pytest.approx(193.15), pytest.approx(523.15))},
        probes={"flat": ("thermometer:T1", "logger:2")},
        horizons={"flat": ((0.0, 5.0), (90.0, 12.5))},
        reflected_temperature_k=pytest.approx(253.15),
        offsets_k={"flat": -0.2},
        emissivity_sd=0.02,
        own_emissivity_sd={"flat": 0.03},
        factor_sd=pytest.approx(0.1),
        slab=Slab(0.05, 0.3, 1.5e6),
        conductivity_sd=0.3,
        capacity_sd=0.05,
        prior=Prior(**prior),
    )
    default = EstimatorSettings()
    alike = [f.name for f in fields(given) if getattr(given, f.name) == getattr(default, f.name)]
    assert alike == ["horizon", "body", "camera_path"]  # they come with the site and the camera


def test_site_and_regions_speak_the_language_of_the_other_rooms(config):
    given = config(
        '[[region]]\nname = "flat"\nkind = "reference"\npoints_px = [[0, 0], [9, 0], [9, 9]]\n'
        '[[region]]\nname = "b15"\ntilt_deg = 15\nazimuth_deg = 180\n'
        "points_px = [[10, 0], [19, 0.5], [19, 9]]\n"
        '[[region]]\nname = "hill"\npoints_px = [[20, 0], [29, 0], [29, 9]]\nemissivity = 0.93\n'
    )
    assert given.site == Site(35.5, 139.4, 0.0, "Asia/Tokyo")
    flat, b15, hill = given.regions
    assert (flat.kind, flat.tilt_deg, flat.azimuth_deg) == (RegionKind.REFERENCE, 0.0, 0.0)
    assert (b15.kind, b15.tilt_deg, b15.azimuth_deg) == (RegionKind.TARGET, 15.0, 180.0)
    assert b15.points_px == ((10.0, 0.0), (19.0, 0.5), (19.0, 9.0))
    assert math.isnan(b15.emissivity)
    assert math.isnan(hill.tilt_deg)
    assert hill.emissivity == 0.93


def test_devices_come_in_order_with_their_drivers_options(config):
    given = config(
        '[device.second-lux]\ndriver = "lutron"\nport = "/dev/ttyUSB3"\n'
        '[lux]\ndriver = "lutron"\nidentity = "0403:6001:A50285BI"\nevery_s = 2\nrange_max_lx = 100000\n'
        '[camera]\ndriver = "purethermal"\n[camera.options]\ngain = "high"\n'
    )
    assert given.devices == (
        DeviceSettings("camera", "purethermal", options={"gain": "high"}),
        DeviceSettings(
            "lux", "lutron", identity="0403:6001:A50285BI", every_s=2.0, options={"range_max_lx": 100000.0}
        ),
        DeviceSettings("second-lux", "lutron", port="/dev/ttyUSB3"),
    )


def test_what_a_session_keeps_of_its_configuration_reads_back_as_the_same(config, tmp_path):
    given = config(
        '[camera]\ndriver = "purethermal"\n[simulation]\nstart = 2016-01-01T12:00:00-07:00\n'
        '[[region]]\nname = "flat"\nkind = "reference"\npoints_px = [[0, 0], [9, 0], [9, 9]]\n'
    )
    kept = tmp_path / "kept.toml"
    kept.write_text(given.to_toml(), encoding="utf-8")
    assert tomllib.loads(given.to_toml())["surface"]["albedo"] == 0.2
    assert load_config(kept, environment={}).tables == given.tables


def test_the_folders_of_a_campaign_stand_beside_its_configuration(config, tmp_path):
    given = config()
    assert given.recordings == tmp_path / "recordings"
    assert given.results == tmp_path / "results"
    assert given.reports == tmp_path / "reports"
