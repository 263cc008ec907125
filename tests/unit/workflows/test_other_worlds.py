"""A simulated session on Mars, from the cable to the slope; what a configuration of another world refuses."""

from datetime import UTC, datetime

import pytest

from fieldkit.config import load_config
from fieldkit.config.template import SIMULATED
from fieldkit.config.validation import ConfigMistakesError
from fieldkit.model.site import Site
from fieldkit.model.slope import SlopeState
from fieldkit.sessions.reader import open_session
from fieldkit.workflows.campaign import create_campaign
from fieldkit.workflows.plan import plan
from fieldkit.workflows.record import record

JEZERO = {"latitude_deg": 18.44, "longitude_deg": 77.45, "elevation_m": -2600.0, "body": "mars"}
MORNING = datetime(2024, 6, 1, 17, 50, tzinfo=UTC)  # 11 h of local true solar time


def campaign(folder, **tables):
    document = {
        **SIMULATED,
        "site": JEZERO,
        "irradiance": {"model": "efficacy", "efficacy_lm_w": 108.0},
        "estimator": {"azimuth": "known"},
        "simulation": {"start": MORNING, "speed": "max"},
        **tables,
    }
    return create_campaign(folder, document)


def test_slopes_of_a_simulated_hour_on_mars_lie_in_their_regions(tmp_path):
    session = record(campaign(tmp_path), duration="1h", name="jezero")
    with open_session(session.path) as stored:
        assert stored.site.body == "mars"
        assert "mars" in stored.header.config_toml
    slopes = session.estimate().final  # from the file alone: the body comes with the session
    for slope, truth in zip(slopes.values(), (5, 15, 25), strict=True):
        assert slope.tilt_low_deg <= truth <= slope.tilt_high_deg


def test_twenty_minutes_of_a_simulated_noon_on_the_moon_say_that_they_say_little(tmp_path):
    equator = {"latitude_deg": 0.0, "longitude_deg": 77.4, "body": "moon"}
    noon = {"start": datetime(2024, 6, 14, 1, 20, tzinfo=UTC), "speed": "max"}
    made = campaign(tmp_path, site=equator, simulation=noon)
    slopes = record(made, duration="20m", name="moon").estimate().final
    for slope, truth in zip(slopes.values(), (5, 15, 25), strict=True):
        assert slope.state is SlopeState.UNCERTAIN
        assert slope.tilt_low_deg <= truth <= slope.tilt_high_deg


def test_surface_and_air_default_to_those_of_the_world(tmp_path):
    settings = campaign(tmp_path).config.estimator_settings()
    assert settings.body == "mars"
    assert settings.surface.exchange_w_m2_k == pytest.approx(1.0)
    assert settings.slab.thermal_inertia == pytest.approx(250.0)
    own = load_config(tmp_path / "fieldkit.toml", settings=["surface.albedo=0.31"])
    assert own.surface_parameters().albedo == 0.31


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("site.body=venus", "venus"),
        ("site.timezone=Asia/Tokyo", "time zones belong to the Earth"),
        ("simulation.weather=alamosa-2016-01-01", "measured weather belongs to the Earth"),
    ],
)
def test_what_another_world_does_not_have_is_refused_by_name(tmp_path, setting, words):
    campaign(tmp_path)
    with pytest.raises(ConfigMistakesError, match=words):
        load_config(tmp_path / "fieldkit.toml", settings=[setting])


def test_a_plan_on_mars_has_the_noon_of_mars_in_its_middle():
    made = plan(Site(**JEZERO), "2024-06-01", [(15.0, 180.0)])
    elevation = made.day_plan.elevation_deg
    assert abs(int(elevation.argmax()) - elevation.size / 2) < 60
    assert made.irradiance == "clear season of Mars"
    assert made.day_plan.dni_w_m2.max() < 590.0
