import math
from dataclasses import replace

import pytest

from fieldkit.estimation.carried import carry_over, keys
from fieldkit.estimation.learned.prior_state import DAY_TO_DAY
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.learnt import Learnt, LearntParameter
from fieldkit.physics.slab import Slab

SETTINGS = EstimatorSettings(model="learned")
PRIOR = SETTINGS.slab.thermal_inertia, SETTINGS.prior.inertia_log_sd


def learnt(name: str, value: float, log_sd: float) -> tuple[EstimatorSettings, Learnt]:
    factor = math.exp(1.645 * log_sd)
    one = LearntParameter(name, "", value, value, value, value, value / factor, value * factor, 1.0)
    return SETTINGS, Learnt((one,))


def inertia(*sessions: tuple[float, float]) -> tuple[float, float]:
    found = carry_over(SETTINGS, [learnt("thermal_inertia", *one) for one in sessions])["thermal_inertia"]
    return found.value, found.log_sd


def test_without_sessions_the_prior_is_left_as_it_is_but_for_the_change_of_a_day():
    value, log_sd = inertia()
    assert value == pytest.approx(PRIOR[0])
    assert log_sd == pytest.approx(math.hypot(PRIOR[1], 0.08))


def test_a_session_that_taught_nothing_changes_nothing():
    assert inertia(PRIOR, PRIOR) == pytest.approx(inertia())


def test_one_session_shifts_the_prior_by_its_data_alone():
    # by hand: data of precision 1/0.01 - 1/0.0625 = 84 widen by 0.08^2 to 1 / (1/84 + 0.0064) = 54.630;
    # the data alone say (100 x 0.1 - 16 x 0) / 84 = 0.11905 above the prior's logarithm; with the prior
    # 54.630 x 0.11905 / 70.630 = 0.09208, sd sqrt(1/70.630 + 0.0064) = 0.14338
    value, log_sd = inertia((PRIOR[0] * math.exp(0.1), 0.1))
    assert math.log(value / PRIOR[0]) == pytest.approx(0.09208, abs=1e-5)
    assert log_sd == pytest.approx(0.14338, abs=1e-5)


def test_many_sessions_leave_the_change_of_a_day():
    value, log_sd = inertia(*[(450.0, 0.05)] * 100)
    assert value == pytest.approx(450.0, rel=0.02)
    assert DAY_TO_DAY["thermal_inertia"] < log_sd < 0.082


def test_the_prior_of_a_session_is_not_counted_as_data():
    # learnt with a wrong prior that was not moved: nothing to carry
    wrong = replace(SETTINGS, slab=Slab(conductivity_w_m_k=0.5))
    session = wrong, learnt("thermal_inertia", wrong.slab.thermal_inertia, PRIOR[1])[1]
    assert carry_over(SETTINGS, [session])["thermal_inertia"].value == pytest.approx(PRIOR[0])


def test_weather_is_not_carried_over():
    assert set(carry_over(SETTINGS, [learnt("exchange", 20.0, 0.05)])) == set(DAY_TO_DAY)


def test_the_keys_are_those_of_the_prior():
    known = carry_over(SETTINGS, [])
    found = keys(known, SETTINGS)
    slab = Slab(depth_m=found["slab.depth_m"], conductivity_w_m_k=found["slab.conductivity_w_m_k"])
    assert slab.thermal_inertia == pytest.approx(PRIOR[0])
    assert found["prior.inertia_log_sd"] == found["slab.conductivity_sd"] / 2.0
    assert found["estimator.scale"] == 1.0
    assert found["prior.gain_sd"] == pytest.approx(math.hypot(0.09, 0.03))
