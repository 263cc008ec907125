"""A bed that shades another one in the afternoon: the horizon between them keeps the slope."""

from dataclasses import replace

import numpy as np

from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.samples import Quality
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.horizon import MINUTE_EDGE_DEG, Horizon, horizon_of_neighbours, sunlit_share
from fieldkit.physics.sun import sun_vectors
from fieldkit.recording.predict import field_history
from fieldkit.simulation.facets import GROUND
from fieldkit.simulation.scene import ALAMOSA_NOON_NS, BEDS
from fieldkit.simulation.scene_series import EXCHANGE, SceneModel
from fieldkit.simulation.sky import ClearSky
from fieldkit.weather import packaged_day

MINUTES, START_NS = 210, ALAMOSA_NOON_NS + 30 * MINUTE_NS
BED = np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0], [0.4, 0.4, 0.0], [0.0, 0.4, 0.0]])
NEIGHBOUR = BED * [0.4, 0.4, 1.0] + [-2.1, -3.3, 1.9]
"""Narrower, 4 m to the south-west and 1.9 m higher."""


def last_tilt_deg(horizon: Horizon, known: Horizon) -> float:
    """Of the shaded bed of 15 degrees, where the estimator is given the horizon `known`."""
    beds = tuple(replace(bed, horizon=horizon if bed.name == "b15" else ()) for bed in BEDS)
    scene = SceneModel(packaged_day().site, ClearSky(), beds, GROUND, EXCHANGE, (), 3.0)
    history = field_history(scene, START_NS, MINUTES)
    flags = history.region_flags.copy()
    flags[sunlit_share(known, history.sun, MINUTE_EDGE_DEG) < 1.0, 2] |= int(Quality.SHADED)
    settings = EstimatorSettings(model="paper", horizons={"b15": known} if known else {})
    chain = SlopeChain([bed.region() for bed in beds], settings)
    return chain.at(replace(history, region_flags=flags)).slopes[1].tilt_deg


def test_the_horizon_of_a_neighbour_keeps_the_slope_of_a_bed():
    horizon = horizon_of_neighbours(BED, [NEIGHBOUR])
    times_ns = START_NS + np.arange(MINUTES) * MINUTE_NS
    hidden = np.flatnonzero(sunlit_share(horizon, sun_vectors(times_ns, packaged_day().site)) == 0.0)
    assert 15 < hidden.size < 80
    in_the_sun = last_tilt_deg((), horizon)  # the same minutes excluded, and nothing in the way
    assert abs(last_tilt_deg(horizon, horizon) - in_the_sun) <= 0.1
    assert abs(in_the_sun - last_tilt_deg((), ())) <= 0.5
    assert not abs(last_tilt_deg(horizon, ()) - in_the_sun) < 1.0  # another slope, or none
