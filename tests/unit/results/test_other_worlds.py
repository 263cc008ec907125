"""A simulated session on Mars, from the cable to the slope; what a configuration of another world refuses."""

from datetime import UTC, datetime

import numpy as np
import pytest

from fieldkit.calibrate.clock import clock
from fieldkit.config import load_config
from fieldkit.config.template import SIMULATED
from fieldkit.config.validation import ConfigMistakesError
from fieldkit.estimation.learned.inputs import air_unlogged_k, sky_longwave
from fieldkit.ground.terrain_products import suns_of_day
from fieldkit.model.clock import utc_ns
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Action, Argument
from fieldkit.model.site import Site
from fieldkit.model.slope import CERTAIN
from fieldkit.model.units import HOUR_NS
from fieldkit.physics.facet import VERTICAL
from fieldkit.physics.terrain import sunlit_cosine
from fieldkit.recording.campaign import create_campaign
from fieldkit.recording.plan import plan
from fieldkit.recording.planned_session import Prediction, _model
from fieldkit.recording.record import record
from fieldkit.sessions.reader import open_session
from tests.harness.next_steps import at

JEZERO = {"latitude_deg": 18.44, "longitude_deg": 77.45, "elevation_m": -2600.0, "body": "mars"}
MORNING = datetime(2024, 6, 1, 17, 50, tzinfo=UTC)  # 11 h of local true solar time


def campaign(folder, **tables):
    document = {
        **SIMULATED,
        "site": JEZERO,
        "estimator": {"azimuth": "known"},
        "simulation": {"start": MORNING, "speed": "max"},
        **{meter: {**SIMULATED[meter], "every_s": 4} for meter in ("lux", "thermometer")},
        **tables,
    }
    return create_campaign(folder, document)


def test_slopes_of_a_simulated_quarter_of_an_hour_on_mars_lie_in_their_regions(tmp_path):
    session = record(campaign(tmp_path), duration="16m", name="jezero")
    with open_session(session.path) as stored:
        assert stored.site.body == "mars"
        assert "mars" in stored.header.config_toml
    slopes = session.estimate().final  # from the file alone: the body comes with the session
    for slope, truth in zip(slopes.values(), (5, 15, 25), strict=True):
        assert slope.tilt_low_deg <= truth <= slope.tilt_high_deg
    with pytest.raises(
        ConfigError, match="on mars", check=at(session.path, Argument("gps"), Action.HOST_CLOCK())
    ):
        clock(session.path)


def test_ten_minutes_of_a_simulated_noon_on_the_moon_say_that_they_say_little(tmp_path):
    equator = {"latitude_deg": 0.0, "longitude_deg": 77.4, "body": "moon"}
    noon = {"start": datetime(2024, 6, 14, 1, 20, tzinfo=UTC), "speed": "max"}
    made = campaign(tmp_path, site=equator, simulation=noon)
    slopes = record(made, duration="10m", name="moon").estimate().final
    for slope, truth in zip(slopes.values(), (5, 15, 25), strict=True):
        assert slope.state not in CERTAIN
        assert slope.tilt_low_deg <= truth <= slope.tilt_high_deg


def test_surface_and_air_default_to_those_of_the_world(tmp_path):
    settings = campaign(tmp_path).config.estimator_settings()
    assert settings.body == "mars"
    assert settings.surface.exchange_w_m2_k == pytest.approx(1.0)
    assert settings.slab.thermal_inertia == pytest.approx(250.0)
    assert settings.irradiance.label.split(", ") == ["efficacy 97.5 lm/W", "diffuse 42%", "horizontal"]
    own = load_config(tmp_path / "fieldkit.toml", settings=["surface.albedo=0.31"])
    assert own.surface_parameters().albedo == 0.31


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("site.body=venus", "venus"),
        ("site.timezone=Asia/Tokyo", "time zones belong to the Earth"),
        ("simulation.weather=alamosa-2016-01-01", "measured weather belongs to the Earth"),
        ("simulation.drawn=true", "drawn fields have the air of the Earth"),
        ("irradiance.model=eq10", "irradiance.model.*eq10 is a formula of the Earth's daylight"),
        ("irradiance.model=perez", "irradiance.model.*perez is a formula of the Earth's daylight"),
        ("irradiance.diffuse=erbs", "irradiance.diffuse.*erbs is a formula of the Earth's daylight"),
    ],
)
def test_what_another_world_does_not_have_is_refused_by_name(tmp_path, setting, words):
    campaign(tmp_path)
    with pytest.raises(ConfigMistakesError, match=words):
        load_config(tmp_path / "fieldkit.toml", settings=[setting])


@pytest.mark.parametrize(("body", "longwave", "air_k"), [("moon", 0.0, 250.0), ("mars", 50.0, 220.0)])
def test_a_channel_of_air_gives_another_world_no_longwave_of_the_earth(tmp_path, body, longwave, air_k):
    """Swinbank's law made 130 W/m2 of 250 K: 26.4 degrees where 24.8 is right."""
    settings = campaign(tmp_path, site={**JEZERO, "body": body}).config.estimator_settings()
    assert sky_longwave(250.0, settings) == longwave
    assert air_unlogged_k(longwave, settings, 0) == air_k


@pytest.mark.parametrize("hours", [0, 100, 400])
@pytest.mark.parametrize("body", ["moon", "mars", "earth"])
def test_the_mean_light_of_level_ground_is_that_of_the_worlds_own_day(body, hours):
    """On the equator the mean of the positive part of a cosine, 1 / pi, times that of the declination."""
    site = Site(0.0, 20.0, body=body)
    time_ns = utc_ns(MORNING) + hours * HOUR_NS
    found = float(sunlit_cosine(VERTICAL, suns_of_day(site, time_ns)))
    declination_deg = {"moon": 1.4, "mars": -25.1, "earth": 22.3}[body]
    assert found == pytest.approx(np.cos(np.radians(declination_deg)) / np.pi, rel=0.01)


def test_a_plan_on_the_moon_has_its_ground_and_no_air():
    settings = plan(Site(0.0, 0.0, body="moon"), "2024-06-14", [(15.0, 180.0)]).day_plan.settings
    assert settings.surface.exchange_w_m2_k == 0.0
    assert settings.surface.albedo == 0.12
    assert settings.sky_emissivity == 0.0
    assert settings.rising_deg == pytest.approx(-0.267)  # half of the sun's width, without refraction


def test_a_session_planned_on_mars_has_what_is_known_of_mars():
    session = plan(Site(4.5, 137.4, -4500.0, body="mars"), "2026-06-21", [(15.0, 180.0)]).session()
    assert (session.settings.body, session.settings.prior.exchange_w_m2_k) == ("mars", 1.0)
    lull, usual = _model(session).exchange.at(np.array([0.0, session.sky.wind_m_s]))
    assert 0.0 < lull < usual == 1.0
    assert "; measured" in Prediction(session, ()).table.caption


def test_a_plan_on_mars_has_the_noon_of_mars_in_its_middle():
    made = plan(Site(**JEZERO), "2024-06-01", [(15.0, 180.0)])
    elevation = made.day_plan.elevation_deg
    assert abs(int(elevation.argmax()) - elevation.size / 2) < 60
    assert made.irradiance.endswith("Mars")
    assert made.day_plan.dni_w_m2.max() < 590.0
