"""One reading that contradicts its neighbours moves no slope; weather stays as it was measured."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fieldkit.estimation.instruments import LEAST_READINGS, without_spikes

RNG = np.random.default_rng(3)


@pytest.mark.parametrize("count", [6, 12, 60, 600])
@pytest.mark.parametrize("value", [1600.0, 0.0, 5000.0])
def test_one_reading_between_two_that_agree_is_excluded_wherever_it_stands(count, value):
    clear = 900.0 + RNG.normal(0.0, 1.0, count)
    for place in range(count):
        light = clear.copy()
        light[place] = value
        kept = without_spikes(light, is_temperature=False)
        assert np.flatnonzero(np.isnan(kept)).tolist() == [place]
        assert np.nanmean(kept) == pytest.approx(clear.mean(), rel=0.001)


@pytest.mark.parametrize(
    "light",
    [
        np.repeat([900.0, 300.0], 30),  # a cloud's edge
        np.where((np.arange(60) >= 20) & (np.arange(60) < 30), 200.0, 900.0),  # ten seconds of cloud
        np.where((np.arange(60) >= 20) & (np.arange(60) < 22), 200.0, 900.0),  # two readings of it
        900.0 * RNG.uniform(0.2, 1.1, 60),  # broken clouds
        900.0 + RNG.normal(0.0, 20.0, 60),  # scintillation of 2 %
        np.full(60, 900.0),
        np.linspace(100.0, 900.0, 60),
    ],
)
def test_weather_stays(light):
    assert np.array_equal(without_spikes(light, is_temperature=False), light)


def test_a_thermometer_of_coarse_steps_keeps_every_step():
    air = np.array([290.0, 290.0, 290.5, 290.0, 290.0, 290.0, 290.9, 290.0])
    assert np.array_equal(without_spikes(air, is_temperature=True), air)
    air[3] = 325.0
    assert np.flatnonzero(np.isnan(without_spikes(air, is_temperature=True))).tolist() == [3]


@given(st.lists(st.floats(-1e6, 1e6) | st.just(float("nan")), max_size=LEAST_READINGS - 1))
def test_few_readings_are_returned_as_they_are(values):
    given_values = np.array(values)
    assert np.array_equal(without_spikes(given_values, is_temperature=False), given_values, equal_nan=True)


def test_readings_without_a_value_have_no_place_in_the_order():
    light = np.array([900.0, np.nan, 900.5, 1600.0, np.nan, 900.2, 899.9, 900.1, 900.0])
    assert np.flatnonzero(np.isnan(without_spikes(light, is_temperature=False))).tolist() == [1, 3, 4]
