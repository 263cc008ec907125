"""A ridge that hides the sun from one bed for 40 minutes of three hours, and the same hours without it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.estimator_keys import Model
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.samples import Quality
from fieldkit.model.slope import SOLVED, SlopeEstimate
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.facet import tilt_azimuth
from fieldkit.physics.horizon import MINUTE_EDGE_DEG, Horizon, sunlit_share
from fieldkit.physics.sun import sun_vectors
from fieldkit.recording.field_history import field_history
from fieldkit.simulation.facets import GROUND
from fieldkit.simulation.scene import ALAMOSA_NOON_NS, BEDS
from fieldkit.simulation.scene_series import EXCHANGE, SceneModel
from fieldkit.simulation.sky import ClearSky
from fieldkit.weather import packaged

MINUTES, HIDDEN, TILT_DEG = 180, (80, 120), 15.0
START_NS = ALAMOSA_NOON_NS - MINUTES // 2 * MINUTE_NS


def ridge() -> Horizon:
    """A pillar as wide as the sun moves in 40 minutes."""
    times = START_NS + np.array(HIDDEN) * MINUTE_NS
    first, last = tilt_azimuth(sun_vectors(times, packaged().site))[1]
    return ((first - 0.05, -5.0), (first, 60.0), (last, 60.0), (last + 0.05, -5.0))


def last_estimate(model: Model, horizon: Horizon, known: Horizon) -> SlopeEstimate:
    """Of the bed behind the ridge, at the end; `known` is the horizon that the estimator is given."""
    beds = tuple(replace(bed, horizon=horizon if bed.name == "b15" else ()) for bed in BEDS)
    scene = SceneModel(packaged().site, ClearSky(), beds, GROUND, EXCHANGE, (), 3.0)
    history = field_history(scene, START_NS, MINUTES)
    is_hidden = sunlit_share(known, history.sun, MINUTE_EDGE_DEG) < 1.0
    flags = history.region_flags.copy()
    flags[is_hidden, 2] |= int(Quality.SHADED)
    settings = EstimatorSettings(model=model, horizons={"b15": known} if known else {})
    chain = SlopeChain([bed.region() for bed in beds], settings)
    return chain.at(replace(history, region_flags=flags)).slopes[1]


@pytest.mark.parametrize("model", [pytest.param("paper", marks=pytest.mark.slow), "full", "learned"])
def test_with_the_horizon_a_ridge_adds_no_bias(model: Model) -> None:
    """Its shadow, with the estimator's own error of that day beside it."""
    undisturbed = abs(last_estimate(model, (), ()).tilt_deg - TILT_DEG)
    assert abs(last_estimate(model, ridge(), ridge()).tilt_deg - TILT_DEG) <= undisturbed + 0.1
    # without it: another slope, or none
    untold = last_estimate(model, ridge(), ())
    assert untold.state not in SOLVED or abs(untold.tilt_deg - TILT_DEG) >= undisturbed + 5.0
