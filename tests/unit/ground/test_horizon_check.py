"""Minutes in which shadows contradict a horizon, on an hour that was made by hand."""

import math

import pytest

from fieldkit.estimation.estimator import Minute
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.errors import NoAnswerError
from fieldkit.model.samples import Event, EventKind, Quality
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.units import MINUTE_NS
from fieldkit.results.check import horizon_findings
from fieldkit.results.slope_map import slope_map

SQUARE = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))
REGIONS = (Region("flat", RegionKind.REFERENCE, SQUARE), Region("b15", RegionKind.TARGET, SQUARE))
# hides the sun, at 30 degrees and one degree of azimuth a minute from 150 on, between minutes 20 and 40
HORIZON = ((169.9, 0.0), (170.0, 60.0), (190.0, 60.0), (190.1, 0.0))


def minute(number: int, b15_k: float, phase: str = "") -> Minute:
    data = {"shaded": "b15", "phase": phase}
    events = (Event(EventKind.ESTIMATOR, 0, number * MINUTE_NS, "shade", data=data),) if phase else ()
    kelvin, light = {"flat": 300.0, "b15": b15_k}, (math.nan, 800.0, "")
    return Minute(
        number * MINUTE_NS, (), kelvin, {}, {}, *light, 60.0, 150.0 + number, (), Quality.GOOD, events
    )


def hour(fall_k: float, phases: dict[int, str]) -> list[Minute]:
    return [minute(n, 305.0 - (fall_k if 20 <= n <= 40 else 0.0), phases.get(n, "")) for n in range(60)]


@pytest.mark.parametrize(
    ("minutes", "horizon", "expected"),
    [
        (hour(5.0, {20: "begin", 41: "end"}), HORIZON, []),
        (hour(0.0, {}), HORIZON, ["b15: sunlit although its horizon hides the sun: 00:21-00:39Z"]),
        (
            hour(0.0, {5: "begin", 9: "end"}),
            ((0.0, 5.0),),
            ["b15: shaded although its horizon leaves the sun visible: 00:05-00:08Z"],
        ),
        (hour(5.0, {20: "begin", 41: "end"}), (), ["b15: shaded: 00:20-00:40Z"]),
        ([], HORIZON, []),
    ],
)
def test_contradictions_are_named_by_their_minutes(minutes, horizon, expected):
    settings = EstimatorSettings(horizons={"b15": horizon} if horizon else {})
    found = horizon_findings(minutes, REGIONS, settings)
    assert [f"{one.what}: {one.text}" for one in found] == expected


def test_a_shadow_on_all_regions_cannot_be_compared():
    assert list(horizon_findings(hour(0.0, {}), REGIONS, EstimatorSettings(horizon=HORIZON))) == []


# --- a map of a session below its horizon


def test_minutes_behind_the_horizon_enter_no_map(sessions):
    assert slope_map(sessions[0], "all", settings=["site.horizon=[[0, 1.0]]"]).minutes > 5
    with pytest.raises(NoAnswerError, match="window='all'"):
        slope_map(sessions[0], "all", settings=["site.horizon=[[0, 89.0]]"])
