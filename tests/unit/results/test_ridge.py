"""A ridge that hides the sun from one bed for some of the minutes around noon, and the same without it."""

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
from fieldkit.physics.horizon import MINUTE_EDGE_DEG, Horizon, sunlit_share
from fieldkit.physics.sun import sun_vectors
from fieldkit.recording.predict import field_history
from fieldkit.simulation.facets import GROUND, Facet
from fieldkit.simulation.scene import ALAMOSA_NOON_NS, BEDS
from fieldkit.simulation.scene_series import EXCHANGE, SceneModel
from fieldkit.simulation.sky import ClearSky
from fieldkit.weather import packaged_day

TILT_DEG = 15.0


class Hours(NamedTuple):
    """Minutes around noon, those that the ridge hides, and the beds."""

    minutes: int
    hidden: tuple[int, int]
    beds: tuple[Facet, ...]

    @property
    def start_ns(self) -> int:
        return ALAMOSA_NOON_NS - self.minutes // 2 * MINUTE_NS


THREE = Hours(180, (80, 120), BEDS)
TWO = Hours(120, (50, 80), tuple(bed for bed in BEDS if bed.name in ("flat", "b15")))


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
