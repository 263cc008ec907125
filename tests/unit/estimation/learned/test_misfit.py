"""What contradicts the model is said, with the likeliest cause; a world as described is not doubted."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.drawn_worlds import CLEAR
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.learned.bank import Innovation
from fieldkit.estimation.learned.errors import ErrorSums
from fieldkit.model.slope import SlopeState
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.sun import sun_vectors
from tests.harness.drawn import drawn_world

MINUTES = 40


@pytest.fixture(scope="module")
def world():
    drawn = drawn_world(3, CLEAR, minutes=MINUTES, as_configured=True)
    return replace(drawn, settings=replace(drawn.settings, model="learned"))


def estimates(world, history):
    return SlopeChain(world.regions, world.settings).at_once(history).slopes


def with_clock_off(world, hours):
    history = world.history
    time_ns = history.time_ns + round(60 * hours) * MINUTE_NS
    sun = sun_vectors(time_ns, world.settings.site)
    return replace(history, time_ns=time_ns, minute=history.minute + round(60 * hours), sun=sun)


def test_a_world_as_described_is_not_doubted(world):
    for one in estimates(world, world.history):
        assert "standard deviations" not in one.reason
        assert "misfit" not in one.reason


def test_a_clock_seven_hours_early_is_no_certain_slope_and_the_clock_is_asked_for(world):
    """The module whose stamps were 7 h early read "80.8 degrees, ok"."""
    for one in estimates(world, with_clock_off(world, -7.0)):
        assert one.state is not SlopeState.OK
        assert "clock" in one.reason


def test_warming_in_the_night_is_told_from_a_windy_day(world):
    history = with_clock_off(world, -7.0)
    warmer = history.temperature_k + np.linspace(0.0, 8.0, MINUTES)[:, np.newaxis]
    found = estimates(world, replace(history, temperature_k=warmer))
    assert all("the sun" in one.reason for one in found)


def misfit(errors):
    sums = ErrorSums()
    for error in errors[:, np.newaxis]:
        sums = sums.plus(Innovation(error, error, error))
    return sums.under(0).misfit.mean()


def test_misfit_of_correlated_errors_is_the_variance_of_their_mean():
    """AR(1) with r = 0.5 and unit variance: the mean of n varies as if there were n / 3 of them."""
    random = np.random.default_rng(1)
    pushes = random.standard_normal((10_000, 20))
    errors = np.zeros_like(pushes)
    for i in range(1, len(errors)):
        errors[i] = 0.5 * errors[i - 1] + np.sqrt(0.75) * pushes[i]
    assert misfit(errors) == pytest.approx(3.0, rel=0.05)
    assert misfit(pushes) == pytest.approx(1.0, rel=0.05)
