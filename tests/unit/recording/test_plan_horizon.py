"""A plan behind a ridge."""

from datetime import time

import numpy as np

from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.recording.plan import plan
from fieldkit.recording.planned_session import _simulated_minutes


def test_minutes_behind_the_horizon_are_not_planned_with():
    horizon = ((169.9, 0.0), (170.0, 60.0), (220.0, 60.0), (220.1, 0.0))
    settings = EstimatorSettings(horizon=horizon)
    made = plan((37.70, -105.92, 2317.0), "2016-01-01", [(15.0, 180.0)], estimator=settings)
    hidden = {
        170.0 < row["sun_azimuth_deg"] < 220.0
        for row in made.rows
        if row["verdict"].endswith("hides the sun")
    }
    assert hidden == {True}
    best = made.day_plan.best_minute()
    assert best is not None
    east, north, _ = made.day_plan.sun[best]
    assert not 168.0 < np.degrees(np.arctan2(east, north)) % 360.0 < 222.0


def test_a_horizon_above_the_sun_is_named_as_such():
    settings = EstimatorSettings(horizon=((0.0, 60.0), (180.0, 60.0)))
    made = plan((37.70, -105.92, 2317.0), "2016-01-01", [(15.0, 180.0)], estimator=settings)
    (warning,) = made.warnings
    assert "horizon" in warning


def test_a_session_behind_a_ridge_is_predicted_in_its_shadow():
    ridge = ((179.0, 0.0), (180.0, 40.0), (300.0, 40.0), (301.0, 0.0))
    found = []
    for horizon in ((), ridge):
        settings = EstimatorSettings(horizon=horizon)
        made = plan((37.70, -105.92, 2317.0), "2016-01-01", [(15.0, 180.0)], estimator=settings)
        session = made.session(60, at=time(14, 0))
        found.append(_simulated_minutes(session).temperature_k[-1])
    in_the_sun, behind = found
    assert (behind < in_the_sun - 5.0).all()
