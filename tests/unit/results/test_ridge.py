"""A ridge, or a bed beside it, hides the sun from a bed for some of its minutes, and the same without it."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.estimator_keys import Model
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.samples import Quality
from fieldkit.model.slope import SOLVED, SlopeEstimate
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.facet import tilt_azimuth
from fieldkit.physics.horizon import MINUTE_EDGE_DEG, Horizon, horizon_of_neighbours, sunlit_share
from fieldkit.physics.sun import sun_vectors
from fieldkit.recording.predict import field_history
from fieldkit.simulation.facets import GROUND, Facet
from fieldkit.simulation.scene import ALAMOSA_NOON_NS, BEDS
from fieldkit.simulation.scene_series import EXCHANGE, SceneModel
from fieldkit.simulation.sky import ClearSky
from fieldkit.weather import packaged_day

TILT_DEG = 15.0


class Hours(NamedTuple):
    """Minutes, their beginning, the beds, and which minutes the ridge hides."""

    minutes: int
    start_ns: int
    beds: tuple[Facet, ...]
    hidden: tuple[int, ...] = ()


THREE = Hours(180, ALAMOSA_NOON_NS - 90 * MINUTE_NS, BEDS, (80, 120))
FLAT_AND_B15 = tuple(bed for bed in BEDS if bed.name in ("flat", "b15"))
TWO = Hours(120, ALAMOSA_NOON_NS - 60 * MINUTE_NS, FLAT_AND_B15, (50, 80))
AFTERNOON = Hours(210, ALAMOSA_NOON_NS + 30 * MINUTE_NS, BEDS)


def ridge(hours: Hours) -> Horizon:
    """A pillar as wide as the sun moves while it is hidden."""
    times = hours.start_ns + np.array(hours.hidden) * MINUTE_NS
    first, last = tilt_azimuth(sun_vectors(times, packaged_day().site))[1]
    return ((first - 0.05, -5.0), (first, 60.0), (last, 60.0), (last + 0.05, -5.0))


def last_estimate(model: Model, hours: Hours, horizon: Horizon, known: Horizon) -> SlopeEstimate:
    """Of the bed behind the ridge, at the end; `known` is the horizon that the estimator is given."""
    beds = tuple(replace(bed, horizon=horizon if bed.name == "b15" else ()) for bed in hours.beds)
    scene = SceneModel(packaged_day().site, ClearSky(), beds, GROUND, EXCHANGE, (), 3.0)
    history = field_history(scene, hours.start_ns, hours.minutes)
    is_hidden = sunlit_share(known, history.sun, MINUTE_EDGE_DEG) < 1.0
    flags = history.region_flags.copy()
    flags[is_hidden, [bed.name for bed in beds].index("b15")] |= int(Quality.SHADED)
    settings = EstimatorSettings(model=model, horizons={"b15": known} if known else {})
    chain = SlopeChain([bed.region() for bed in beds], settings)
    take = chain.at_once if hours is TWO else chain.at
    return next(one for one in take(replace(history, region_flags=flags)).slopes if one.region == "b15")


@pytest.mark.parametrize(
    ("model", "hours"),
    [
        pytest.param("paper", THREE, marks=pytest.mark.slow),
        ("full", THREE),
        pytest.param("learned", THREE, marks=pytest.mark.slow),
        ("learned", TWO),
    ],
)
def test_with_the_horizon_a_ridge_adds_no_bias(model, hours):
    """Its shadow, with the estimator's own error of that day beside it."""
    undisturbed = abs(last_estimate(model, hours, (), ()).tilt_deg - TILT_DEG)
    behind = ridge(hours)
    assert abs(last_estimate(model, hours, behind, behind).tilt_deg - TILT_DEG) <= undisturbed + 0.1
    # without it: another slope, or none
    untold = last_estimate(model, hours, behind, ())
    assert untold.state not in SOLVED or abs(untold.tilt_deg - TILT_DEG) >= undisturbed + 5.0


BED = np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0], [0.4, 0.4, 0.0], [0.0, 0.4, 0.0]])
NEIGHBOUR = BED * [0.4, 0.4, 1.0] + [-2.1, -3.3, 1.9]
"""Narrower, 4 m to the south-west and 1.9 m higher."""


def test_the_horizon_of_a_neighbour_keeps_the_slope_of_a_bed():
    horizon = horizon_of_neighbours(BED, [NEIGHBOUR])
    times_ns = AFTERNOON.start_ns + np.arange(AFTERNOON.minutes) * MINUTE_NS
    hidden = np.flatnonzero(sunlit_share(horizon, sun_vectors(times_ns, packaged_day().site)) == 0.0)
    assert 15 < hidden.size < 80

    def tilt_deg(horizon: Horizon, known: Horizon) -> float:
        return last_estimate("paper", AFTERNOON, horizon, known).tilt_deg

    in_the_sun = tilt_deg((), horizon)  # the same minutes excluded, and nothing in the way
    assert abs(tilt_deg(horizon, horizon) - in_the_sun) <= 0.1
    assert abs(in_the_sun - tilt_deg((), ())) <= 0.5
    assert not abs(tilt_deg(horizon, ()) - in_the_sun) < 1.0  # another slope, or none
