"""Physical priors: complete, positive, and wide enough for what was measured."""

from dataclasses import fields, replace
from math import inf, log, nan

import pytest

from fieldkit.estimation.prior import Prior


@pytest.mark.parametrize("name", [field.name for field in fields(Prior)])
@pytest.mark.parametrize("value", [nan, inf, -0.1])
def test_values_without_meaning_are_refused_by_name(name, value):
    with pytest.raises(ValueError, match=name):
        replace(Prior(), **{name: value})


def test_no_standard_deviation_is_zero_but_a_layer_may_be_known_to_have_a_bottom():
    with pytest.raises(ValueError, match="gain_sd"):
        Prior(gain_sd=0.0)
    assert Prior(deep_share=0.0).deep_share == 0.0


def test_exchange_reaches_from_calm_to_windy_ground():
    """Conduction fitted to a radiometer's ground temperature gives 3 + 1.8 U W m-2 K-1 over cinder and
    4 + 1.7 U over clay, U the wind in m/s: 4 in calm, 35 in a storm; three standard deviations hold both."""
    prior = Prior()
    assert abs(log(4.0 / prior.exchange_w_m2_k)) < 3.0 * prior.exchange_log_sd
    assert abs(log(35.0 / prior.exchange_w_m2_k)) < 3.0 * prior.exchange_log_sd
