"""Uncertainty budgets against a linear combination worked out by hand with the GUM's formula."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.drawn_worlds import CLEAR
from fieldkit.estimation.bins import RegionColumns
from fieldkit.estimation.budget import NUMERICAL, REST, budget_of
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.learned.inputs import recorded_session
from fieldkit.estimation.learned.layout import Layout
from fieldkit.estimation.learned.learner import ROUND, Learner
from fieldkit.estimation.learned.readout import LEVEL, Moments, moments
from tests.harness.drawn import drawn_world


def test_shares_are_those_of_jcgm_100_eq_13():
    # y = 2 a - 3 b + e with u(a) = 1, u(b) = 0.5, r(a, b) = 0.6, u(e) = 1.5:
    # u2(y) = 4 + 2.25 + 2 x 2 x (-3) x 0.3 + 2.25 = 4.9; a: 2 x (2 - 0.9) / 4.9, b: -3 x (0.6 - 0.75) / 4.9
    covariance = np.array([[1.0, 1.1, 0.3], [1.1, 4.9, -0.15], [0.3, -0.15, 0.25]])
    found = Moments(("gain", "tilt0", "offset0"), np.zeros(3), covariance)
    terms = {one.name: one for one in budget_of(found, "tilt0", "offset0", {"gain": 4.0, "offset": 0.6})}
    assert [terms[name].sensitivity for name in ("gain", "offset")] == pytest.approx([2.0, -3.0])
    shares = [terms[name].share for name in ("gain", "offset", REST)]
    assert shares == pytest.approx([2.2 / 4.9, 0.45 / 4.9, 2.25 / 4.9])
    assert [terms[name].uncertainty for name in ("gain", "offset", REST)] == pytest.approx([1.0, 0.5, 1.5])
    # the gain is known four times better than before, the offset hardly better
    assert [terms[name].kind for name in ("gain", "offset", REST)] == ["A", "B", "A"]
    assert list(terms) == [REST, "gain", "offset"]


def test_the_budget_of_a_session_adds_up():
    world = drawn_world(2000, CLEAR, minutes=15)
    chain = SlopeChain(world.regions, world.settings)
    assert chain.budgets(world.history.until(0)) == {}
    chain.at_once(world.history)
    budgets = chain.budgets(world.history)
    assert list(budgets) == ["bed0", "bed1", "bed2"]
    for terms in budgets.values():
        assert sum(one.share for one in terms) == pytest.approx(1.0)
        known = {one.name: one for one in terms}
        # a few dozen hypotheses scatter a mean by a fraction of its deviation
        assert 0.0 < known[NUMERICAL].share < 0.05
        # fifteen minutes say nothing of the offset: its standard uncertainty stays that of the settings
        assert known["offset"].uncertainty == pytest.approx(world.settings.offset_sd_k, rel=0.1)
        assert known["offset"].kind == "B"
        assert [known[name].kind for name in LEVEL] == ["B", "B"]
        # beds to the south, whose reference leans to the north by as much as they come out flatter
        assert known[LEVEL[1]].sensitivity < -0.5


def joint_of(world, reference):
    """Joint moments of one bed and what is learned beside this reference."""
    layout = Layout.of(RegionColumns((reference, *world.regions[1:])), np.array([1]), world.settings)
    session = recorded_session(world.history, 0, len(world.history), layout, world.regions, world.settings)
    return moments(Learner(layout, world.settings, [session], ROUND))


def test_a_reference_off_level_moves_a_slope_as_its_row_states():
    """Numerical derivative of the tilt by the reference's lean, with what else the minutes teach by it."""
    world = drawn_world(2000, CLEAR, minutes=30)
    joint, to_the_north, to_the_south = (
        joint_of(world, replace(world.regions[0], tilt_deg=tilt_deg, azimuth_deg=azimuth_deg))
        for tilt_deg, azimuth_deg in ((0.0, 0.0), (0.3, 0.0), (0.3, 180.0))
    )
    tilt, level = (joint.names.index(name) for name in ("tilt0", LEVEL[1]))
    # `level_sd_deg`: one reference shows nothing of its own level
    assert joint.sd(LEVEL[1]) == pytest.approx(0.3, rel=0.01)
    derivative = joint.covariance[tilt, level] / joint.covariance[level, level]
    assert derivative == pytest.approx((to_the_north.mean[tilt] - to_the_south.mean[tilt]) / 0.6, rel=0.1)
