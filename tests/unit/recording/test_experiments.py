"""Experiments on short sessions, one of them with an evening."""

import math
from dataclasses import replace
from datetime import datetime

import numpy as np
import pytest

from fieldkit.config import load_config
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.clock import utc_ns
from fieldkit.model.errors import NoAnswerError
from fieldkit.model.site import Site
from fieldkit.model.units import MINUTE_NS
from fieldkit.recording.campaign import init_campaign
from fieldkit.recording.experiments import (
    Experiment,
    Experiments,
    PlannedSession,
    Run,
    _model,
    _simulated_minutes,
    as_planned,
    measures,
    predict_runs,
)
from fieldkit.recording.plan import PlanOptions, logged_quantities, plan
from fieldkit.simulation.sky import ClearSky
from tests.harness.next_steps import at

SITE = Site(35.558675, 139.395232, 9.0, "Asia/Tokyo")
# 2026-12-11 at Tokyo: the sun sets at 16:29 (NAOJ's almanac for Tokyo: 16:28)
SUNSET_NS = utc_ns(datetime.fromisoformat("2026-12-11T16:29+09:00"))
SESSION = PlannedSession(
    SITE,
    ((5.0, 180.0), (25.0, 180.0)),
    SUNSET_NS - 300 * MINUTE_NS,
    30,
    ClearSky(air_temperature_k=283.15),
    EstimatorSettings(model="learned", azimuth="known"),
)
SHADE, KNOWN, AIR = "with a shade test of each target", "with 25°/180° known", "with air temperature logged"


def named(session: PlannedSession, *names: str) -> list[Run]:
    runs = {run.marks[0][0]: run for run in measures(session)}
    return [runs[name] for name in names]


@pytest.fixture(scope="module")
def found():
    runs = [as_planned(replace(SESSION, minutes=40)), *named(SESSION, SHADE, KNOWN, AIR)]
    return Experiments(SESSION, predict_runs(runs))


def test_a_session_is_predicted_by_the_half_hour_and_at_its_end_with_each_measure(found):
    assert [one.name for one in found.outcomes] == ["as planned", "as planned", SHADE, KNOWN, AIR]
    assert [one.minutes for one in found.outcomes] == [30, 40, 30, 30, 30]
    assert found["as planned"] == found.outcomes[1]
    with pytest.raises(KeyError, match="as planned"):
        found["by moonlight"]


def test_every_measure_that_is_not_there_yet_is_tried():
    keys = [run.marks[0][0].split()[1] for run in measures(replace(SESSION, sunset_ns=SUNSET_NS))]
    assert keys == ["air", "diffuse", "longwave", "depth", "offsets", "a", "25°/180°", "an"]
    (emissivity,) = [
        run
        for run in measures(replace(SESSION, settings=replace(SESSION.settings, emissivity_sd=0.02)))
        if "emissivity" in run.marks[0][0]
    ]
    assert emissivity.session.settings.emissivity_sd == 0.0
    there = replace(SESSION, facets=SESSION.facets[:1], logged=frozenset({"air", "diffuse"}), sunset_ns=None)
    assert [run.marks[0][0].split()[1] for run in measures(there)] == ["longwave", "depth", "offsets", "a"]


def test_what_tells_the_gain_narrows_the_steep_target(found):
    steep = {one.name: one.half_region_deg[1] for one in found.outcomes}
    assert steep[AIR] < 0.8 * steep["as planned"]
    assert math.isnan(steep[KNOWN])
    assert found[KNOWN].known == (False, True)
    # a bed of the same material tells the gain, and other beds have a gain of their own: hardly narrower
    assert found[KNOWN].half_region_deg[0] < 1.1 * found["as planned"].half_region_deg[0]
    assert found.summary[1].startswith("narrowed most with")


def test_minutes_taken_at_once_say_what_one_by_one_do():
    run = Run(replace(SESSION, logged=frozenset({"air"})), (("at once", 30),))
    (once,), (_, one_by_one) = predict_runs([run]), predict_runs([replace(run, marks=(("", 29), ("", 30)))])
    assert once.half_region_deg == pytest.approx(one_by_one.half_region_deg, rel=0.2)


def test_the_table_and_the_frame_have_each_bed(found):
    rows = {row[0]: row[2:] for row in found.table.rows}
    assert rows[KNOWN][1] == "known"
    assert all(cell.startswith("±") for cell in rows["as planned"][:2])
    frame = found.to_frame()
    assert len(frame) == 2 * len(found.outcomes)
    assert frame["half_region_deg"].isna().sum() == 1
    assert "as planned" in found._repr_html_()
    assert found.document["experiments"][0]["half_region_deg"] == found.outcomes[0].half_region_deg


def test_an_azimuth_that_is_not_resolved_has_no_width():
    outcome = Experiment("as planned", 20, (math.nan, 2.0), (False, False), (True, False))
    steep, gentle, note = Experiments(SESSION, (outcome,)).table.rows[0][2:]
    assert "°" not in steep
    assert gentle == "±2.0°"
    assert "5°/180°" in note


def test_a_session_goes_on_until_an_hour_after_sunset():
    start_ns = SUNSET_NS - 25 * MINUTE_NS
    session = replace(SESSION, facets=SESSION.facets[:1], start_ns=start_ns, minutes=20, sunset_ns=SUNSET_NS)
    (evening,) = [run for run in measures(session) if "sunset" in run.marks[0][0]]
    assert evening.marks[0][1] == 85
    over = measures(replace(session, sunset_ns=start_ns))
    assert not [run for run in over if "sunset" in run.marks[0][0]]


def test_a_plan_hands_over_the_best_window_and_what_it_assumes():
    options = PlanOptions(turbidity=4.0, air_c=10.0, noise_k=0.2)
    made = plan(SITE, "2026-12-11", [(15.0, 180.0)], options, estimator=EstimatorSettings(azimuth="known"))
    session = made.session(50)
    best = int(made.day_plan.time_ns[made.day_plan.rows[made.day_plan.best_row]])
    assert session.start_ns + 25 * MINUTE_NS == best + 10 * MINUTE_NS
    assert abs(session.sunset_ns - SUNSET_NS) <= 2 * MINUTE_NS
    assert session.sky == ClearSky(4.0, 283.15)
    assert (session.settings.model, session.settings.azimuth) == ("learned", "known")
    assert session.settings.noise_k == 0.2
    heard = []
    found = made.experiments(
        made.session(20), with_measures=False, on_run=lambda done, of: heard.append((done, of))
    )
    assert heard == [(1, 1)]
    assert [one.minutes for one in found.outcomes] == [20]


def test_a_day_without_a_usable_window_has_no_experiments():
    # the sun reaches 3 degrees at noon: north of the plan's limit of 8
    made = plan(Site(63.4, 10.4), "2026-12-21", [(15.0, 180.0)])
    with pytest.raises(NoAnswerError, match="20 min", check=at("2026-12-21")):
        made.experiments()


def test_air_is_logged_where_a_channel_is_named_so(tmp_path):
    init_campaign(tmp_path / "field", simulated=True)
    file = tmp_path / "field" / "fieldkit.toml"
    assert logged_quantities(load_config(file)) == {"air"}
    file.write_text(file.read_text(encoding="utf-8").replace('"air"]', '"T4"]'), encoding="utf-8")
    assert not logged_quantities(load_config(file))


def test_what_no_instrument_measures_is_unknown_and_light_comes_from_the_meter():
    dark, lit = (
        _simulated_minutes(replace(SESSION, logged=frozenset(logged)), _model(SESSION), 5)
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
    noise = (
        _simulated_minutes(SESSION, _model(SESSION), 30).temperature_k
        - _simulated_minutes(quiet, _model(quiet), 30).temperature_k
    )
    assert np.std(noise) == pytest.approx(SESSION.settings.noise_k, rel=0.2)
