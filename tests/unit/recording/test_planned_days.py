"""Half widths that a plan predicts beside those reached in drawn worlds, which no setting was chosen with."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.drawn_worlds import CLEAR
from fieldkit.estimation.chain import SlopeChain
from fieldkit.model.arrays import FloatArray
from fieldkit.recording.planned_session import PlannedSession, predict_session
from fieldkit.simulation.sky import ClearSky
from fieldkit.weather import packaged_day
from tests.harness.drawn import drawn_world

WITHIN = 0.3


def reached_over_predicted(seeds: range, minutes: int) -> FloatArray:
    """Ratios (worlds, targets); the plan knows site, day, beds and settings of a world, not its truth."""
    reached = []
    for seed in seeds:
        world = drawn_world(seed, CLEAR, minutes=minutes)
        settings = replace(world.settings, model="learned")
        slopes = SlopeChain(world.regions, settings).at(world.history).slopes
        reached.append([0.5 * (one.tilt_high_deg - one.tilt_low_deg) for one in slopes])
    history = world.history
    session = PlannedSession(
        site=packaged_day().site,
        facets=tuple((one.tilt_deg, one.azimuth_deg) for one in world.regions[1:]),
        start_ns=int(history.time_ns[0]),
        minutes=minutes,
        sky=ClearSky(air_temperature_k=float(np.mean(history.air_k))),
        settings=settings,
        logged=frozenset({"air", "diffuse", "longwave"}),
    )
    return np.array(reached) / predict_session(session).planned[-1].half_region_deg


def test_two_days_reach_what_was_planned():
    np.testing.assert_allclose(reached_over_predicted(range(2000, 2002), 30), 1.0, atol=WITHIN)


@pytest.mark.slow
@pytest.mark.parametrize("minutes", [60, 180])
def test_twenty_days_reach_what_was_planned(minutes):
    ratios = reached_over_predicted(range(2000, 2020), minutes)
    print(minutes, np.median(ratios, axis=0).round(2), np.abs(ratios - 1.0).max(axis=1).round(2))
    np.testing.assert_allclose(np.median(ratios, axis=0), 1.0, atol=WITHIN)
    assert np.mean(np.abs(ratios - 1.0) <= WITHIN) >= 0.85
