"""Predictions of short sessions, and measures that would narrow them."""

import math
from dataclasses import replace
from datetime import datetime, time

import numpy as np
import pytest

from fieldkit.config import load_config
from fieldkit.estimation.learned.inputs import Logged
from fieldkit.estimation.learned.readout import Moments
from fieldkit.estimation.measures import Measure, measures, narrowing
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.clock import utc_ns
from fieldkit.model.errors import NoAnswerError
from fieldkit.model.site import Site
from fieldkit.model.units import MINUTE_NS
from fieldkit.recording import planned_session
from fieldkit.recording.campaign import init_campaign
from fieldkit.recording.plan import PlanOptions, logged_quantities, plan
from fieldkit.recording.planned_session import (
    Expected,
    PlannedSession,
    Prediction,
    _simulated_minutes,
    predict_session,
)
from fieldkit.simulation.sky import ClearSky
from tests.harness.next_steps import at

SITE = Site(35.558675, 139.395232, 9.0, "Asia/Tokyo")
SESSION = PlannedSession(
    SITE,
    ((5.0, 180.0), (25.0, 180.0)),
    utc_ns(datetime.fromisoformat("2026-12-11T11:29+09:00")),
    40,
    ClearSky(air_temperature_k=283.15),
    EstimatorSettings(model="learned", azimuth="known"),
)
KNOWN = "with 25°/180° as a known bed"
PRIOR = EstimatorSettings().prior
NOTHING = Logged(False, False, 0.0, False, 0.0, 0.0, np.zeros((1, 1)))


@pytest.fixture(scope="module")
def prediction():
    return predict_session(SESSION)


def test_a_session_is_predicted_by_the_time_and_its_end_with_each_measure(prediction):
    assert [row.minutes for row in prediction.planned] == [30, 40]
    half_hour, end = (np.array(row.half_region_deg) for row in prediction.planned)
    assert end[0] < half_hour[0]
    with_measures = prediction.rows[2:]
    assert {row.minutes for row in with_measures} == {40}
    for row in with_measures:
        left = np.array(row.half_region_deg) / end
        # listed from a gain of 5 % on, and never wider
        assert np.nanmax(left) <= 0.95
    by_name = {row.name: row.half_region_deg for row in with_measures}
    assert by_name["with an air temperature logged in the shade"][1] < 0.95 * end[1]
    # what is known already is not listed
    assert math.isnan(by_name[KNOWN][1])


def test_the_same_session_is_found_in_the_cache(monkeypatch):
    session = replace(SESSION, minutes=20)
    found = predict_session(session)
    monkeypatch.setattr(planned_session, "_estimated", None)
    assert repr(predict_session(session)) == repr(found)  # with NaN
    with pytest.raises(TypeError):
        predict_session(replace(session, settings=replace(SESSION.settings, confidence=0.8)))


def test_the_linear_step_promises_no_more_than_the_instrument_brings(prediction):
    """Air logged as well: what the whole estimate says of the same simulated minutes."""
    (promised,) = (row for row in prediction.rows if "air temperature" in row.name)
    brought = predict_session(replace(SESSION, logged=frozenset({"air"}))).planned[-1]
    promised_deg, brought_deg = promised.half_region_deg[1], brought.half_region_deg[1]
    assert brought_deg < 1.1 * promised_deg


def test_a_measure_is_conditioned_on_as_it_leaves_its_number():
    """Two numbers of sd 1, correlated by 0.8: known to 0.5, the sd of the other is sqrt(1 - 0.64 x 0.75)."""
    joint = Moments(
        ("tilt0", "air", "gain"), np.zeros(3), np.array([[1, 0.8, 0.1], [0.8, 1, 0], [0.1, 0, 1]])
    )
    offers = [
        Measure("air", {"air": 0.5}),
        Measure("air better known", {"air": 0.1}),
        Measure("no news", {"air": 1.0}),
        Measure("small", {"gain": 0.0001}),
        Measure("itself", {"tilt0": 0.1}),
    ]
    shares = narrowing(joint, "tilt0", offers)
    assert list(shares) == ["air better known", "air"]
    assert shares["air"] == pytest.approx(math.sqrt(1.0 - 0.64 * 0.75))


@pytest.mark.parametrize(
    ("change", "logged", "number"),
    [
        ({}, {"air": True}, "air"),
        ({}, {"diffuse": True}, "diffuse"),
        ({"prior": replace(PRIOR, longwave_sd_w_m2=8.0)}, {}, "longwave"),
        ({"prior": replace(PRIOR, depth_log_sd=0.05)}, {}, "depth"),
        ({"offset_sd_k": 0.02}, {}, "offset1"),
    ],
)
def test_what_is_there_is_no_measure(change, logged, number):
    settings = EstimatorSettings(offset_sd_k=0.25)
    before, after = (
        {known for measure in measures(*both, {0: "b05", 1: "b15"}) for known in measure.known}
        for both in ((settings, NOTHING), (replace(settings, **change), replace(NOTHING, **logged)))
    )
    assert number in before
    assert number not in after


def test_the_table_and_the_frame_have_each_bed(prediction):
    rows = {row[0]: row[2:] for row in prediction.table.rows}
    assert rows[KNOWN][1] == "–"
    # one draw determines a width no finer
    assert all(float(cell.strip("≈°")) * 2.0 % 1.0 == 0.0 for cell in rows["as planned"])
    frame = prediction.to_frame()
    assert len(frame) == 2 * len(prediction.rows)
    assert "as planned" in prediction._repr_html_()
    assert prediction.document["prediction"][0]["half_region_deg"] == prediction.rows[0].half_region_deg


def test_an_azimuth_that_is_not_resolved_has_no_width():
    found = Prediction(SESSION, (Expected("as planned", 20, (math.nan, 2.0)),))
    assert "°" not in found.table.rows[0][2]
    assert "5°/180°" in found.document["verdict"]


def test_beds_of_one_slope_are_several():
    session = replace(SESSION, facets=((15.0, 180.0), (15.0, 180.0)), minutes=20)
    assert [len(row.half_region_deg) for row in predict_session(session).planned] == [2]


def test_a_plan_hands_over_the_best_time_and_what_it_assumes():
    options = PlanOptions(turbidity=4.0, air_c=10.0, noise_k=0.2)
    made = plan(SITE, "2026-12-11", [(15.0, 180.0)], options, estimator=EstimatorSettings(azimuth="known"))
    session = made.session(20)
    best = int(made.day_plan.time_ns[made.day_plan.best_minute(20)])
    assert session.start_ns + 10 * MINUTE_NS == best
    assert session.sky == ClearSky(4.0, 283.15)
    assert (session.settings.model, session.settings.azimuth) == ("learned", "known")
    assert session.settings.noise_k == 0.2
    assert [row.minutes for row in made.prediction(session).planned] == [20]


def test_a_day_without_a_usable_window_has_no_prediction():
    # the sun reaches 3 degrees at noon: north of the plan's limit of 8
    made = plan(Site(63.4, 10.4), "2026-12-21", [(15.0, 180.0)])
    with pytest.raises(NoAnswerError, match="20 min", check=at("2026-12-21")):
        made.prediction()


def test_air_is_logged_where_a_channel_is_named_so(tmp_path):
    init_campaign(tmp_path / "field", simulated=True)
    file = tmp_path / "field" / "fieldkit.toml"
    assert logged_quantities(load_config(file)) == {"air"}
    file.write_text(file.read_text(encoding="utf-8").replace('"air"]', '"T4"]'), encoding="utf-8")
    assert not logged_quantities(load_config(file))


def test_what_no_instrument_measures_is_unknown_and_light_comes_from_the_meter():
    dark, lit = (
        _simulated_minutes(replace(SESSION, logged=frozenset(logged), minutes=5))
        for logged in ((), ("diffuse", "longwave", "air"))
    )
    for name in ("air_k", "dhi_w_m2", "longwave_down_w_m2"):
        assert np.isnan(getattr(dark, name)).all()
        assert np.isfinite(getattr(lit, name)).all()
    # a level meter less 15 % of it, over the cosine of the zenith angle
    ghi = lit.dni_w_m2 * lit.sun[:, 2] + lit.dhi_w_m2
    np.testing.assert_allclose(dark.dni_w_m2, 0.85 * ghi / lit.sun[:, 2], rtol=1e-9)


def test_the_noise_is_that_of_the_settings():
    quiet = replace(SESSION, settings=replace(SESSION.settings, noise_k=1e-9))
    noise = _simulated_minutes(SESSION).temperature_k - _simulated_minutes(quiet).temperature_k
    assert np.std(noise) == pytest.approx(SESSION.settings.noise_k, rel=0.2)


def behind(horizon):
    """The plan of a day on which the horizon of the site is this one."""
    settings = EstimatorSettings(horizon=horizon)
    return plan((37.70, -105.92, 2317.0), "2016-01-01", [(15.0, 180.0)], estimator=settings)


def test_minutes_behind_the_horizon_are_not_planned_with():
    made = behind(((169.9, 0.0), (170.0, 60.0), (220.0, 60.0), (220.1, 0.0)))
    hidden = [row["sun_azimuth_deg"] for row in made.rows if row["verdict"].endswith("hides the sun")]
    assert {170.0 < azimuth_deg < 220.0 for azimuth_deg in hidden} == {True}
    east, north, _ = made.day_plan.sun[made.day_plan.best_minute()]
    assert not 168.0 < np.degrees(np.arctan2(east, north)) % 360.0 < 222.0


def test_a_horizon_above_the_sun_is_named_as_such():
    (warning,) = behind(((0.0, 60.0), (180.0, 60.0))).warnings
    assert "horizon" in warning


def test_a_session_behind_a_ridge_is_predicted_in_its_shadow():
    ridge = ((179.0, 0.0), (180.0, 40.0), (300.0, 40.0), (301.0, 0.0))
    sessions = (behind(horizon).session(60, at=time(14, 0)) for horizon in ((), ridge))
    in_the_sun, shaded = (_simulated_minutes(session).temperature_k[-1] for session in sessions)
    assert (shaded < in_the_sun - 5.0).all()
