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
from fieldkit.recording import plan as planning
from fieldkit.recording.campaign import init_campaign
from fieldkit.recording.experiments import (
    Experiment,
    Experiments,
    PlannedSession,
    _measured,
    _model,
    experiments,
)
from fieldkit.recording.plan import PlanOptions, logs_air, plan
from fieldkit.simulation.sky import ClearSky

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
NAMES = [
    "as planned",
    "with a shade test of each bed",
    "with 25°/180° known",
    "with air temperature logged",
]


@pytest.fixture(scope="module")
def found() -> Experiments:
    return Experiments(SESSION, tuple(experiments(SESSION)))


def test_each_experiment_is_a_session_at_its_end(found):
    assert [one.name for one in found.outcomes] == NAMES
    assert {one.minutes for one in found.outcomes} == {30}
    assert found["as planned"] == found.outcomes[0]
    with pytest.raises(KeyError, match="as planned"):
        found["by moonlight"]


def test_what_tells_the_gain_narrows_the_steep_bed(found):
    steep = {one.name: one.half_region_deg[1] for one in found.outcomes}
    assert steep["with a shade test of each bed"] < 0.8 * steep["as planned"]
    assert steep["with air temperature logged"] < 0.8 * steep["as planned"]
    assert math.isnan(steep["with 25°/180° known"])
    known = found["with 25°/180° known"]
    assert known.known == (False, True)
    assert known.half_region_deg[0] < found["as planned"].half_region_deg[0]


def test_the_table_and_the_frame_have_each_bed(found):
    pytest.importorskip("pandas")
    rows = {row[0]: row[2:] for row in found.table.rows}
    assert rows["with 25°/180° known"][1] == "known"
    assert all(cell.startswith("±") for cell in rows["as planned"])
    frame = found.to_frame()
    assert len(frame) == 2 * len(NAMES)
    assert frame["half_region_deg"].isna().sum() == 1
    assert "as planned" in found._repr_html_()
    assert found.document[0]["half_region_deg"] == found.outcomes[0].half_region_deg


def test_an_azimuth_that_is_not_resolved_has_no_width():
    outcome = Experiment("as planned", 20, (math.nan, 2.0), (False, False), (True, False))
    assert Experiments(SESSION, (outcome,)).table.rows[0][2:] == ("two slopes fit", "±2.0°")


def test_a_campaign_that_logs_the_air_is_compared_with_one_that_does_not():
    session = replace(SESSION, facets=SESSION.facets[:1], minutes=20, air_logged=True)
    names = [one.name for one in experiments(session)]
    assert names == ["as planned", "with a shade test of each bed", "without air temperature"]


def test_a_session_goes_on_until_an_hour_after_sunset():
    start_ns = SUNSET_NS - 25 * MINUTE_NS
    session = replace(SESSION, facets=SESSION.facets[:1], start_ns=start_ns, minutes=20, sunset_ns=SUNSET_NS)
    *_, sunset, later = experiments(session)
    assert (sunset.name, sunset.minutes) == ("until sunset", 25)
    assert (later.name, later.minutes) == ("until an hour after sunset", 85)
    assert later.half_region_deg != sunset.half_region_deg
    over = replace(session, sunset_ns=start_ns)
    assert "until sunset" not in [one.name for one in experiments(over)]


def test_a_plan_hands_over_the_best_window_and_what_it_assumes(monkeypatch):
    sessions, heard = [], []

    def one_experiment(session):
        sessions.append(session)
        yield Experiment("as planned", session.minutes, (1.0,), (False,), (False,))

    monkeypatch.setattr(planning, "experiments", one_experiment)
    options = PlanOptions(turbidity=4.0, air_c=10.0, noise_k=0.2)
    made = plan(SITE, "2026-12-11", [(15.0, 180.0)], options, estimator=EstimatorSettings(azimuth="known"))
    found = made.experiments(50, on_experiment=heard.append)
    (session,) = sessions
    best = int(made.day_plan.time_ns[made.day_plan.rows[made.day_plan.best_row]])
    assert session.start_ns + 25 * MINUTE_NS == best + 10 * MINUTE_NS
    assert abs(session.sunset_ns - SUNSET_NS) <= 2 * MINUTE_NS
    assert session.sky == ClearSky(4.0, 283.15)
    assert (session.settings.model, session.settings.azimuth) == ("learned", "known")
    assert session.settings.noise_k == 0.2
    assert found.outcomes == tuple(heard)


def test_a_day_without_a_usable_window_has_no_experiments():
    # the sun reaches 3 degrees at noon: north of the plan's limit of 8
    made = plan(Site(63.4, 10.4), "2026-12-21", [(15.0, 180.0)])
    with pytest.raises(NoAnswerError, match="window"):
        made.experiments()


def test_air_is_logged_where_a_channel_is_named_so(tmp_path):
    init_campaign(tmp_path / "field", simulated=True)
    file = tmp_path / "field" / "fieldkit.toml"
    assert logs_air(load_config(file))
    file.write_text(file.read_text(encoding="utf-8").replace('"air"]', '"T4"]'), encoding="utf-8")
    assert not logs_air(load_config(file))


def test_the_noise_is_that_of_the_settings():
    quiet = replace(SESSION, settings=replace(SESSION.settings, noise_k=1e-9))
    noise = (
        _measured(SESSION, _model(SESSION), 30).temperature_k
        - _measured(quiet, _model(quiet), 30).temperature_k
    )
    assert np.std(noise) == pytest.approx(SESSION.settings.noise_k, rel=0.2)
