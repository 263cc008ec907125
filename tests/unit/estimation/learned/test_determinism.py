"""The same minutes give the same slopes: however often asked, shared or copied, by any way of a sample."""

import copy
import gc
import weakref
from dataclasses import fields, replace

import numpy as np
import pytest

from benchmarks.drawn_worlds import BROKEN_CLOUD, CLEAR
from fieldkit.estimation.bins import History
from fieldkit.estimation.chain import SlopeChain
from fieldkit.model.slope import SlopeEstimate
from tests.harness.drawn import drawn_world


def assert_equal(ones, others):
    """Slopes and what was learnt, to 1e-9 degrees."""
    for one, other in zip(ones.slopes, others.slopes, strict=True):
        for field in fields(SlopeEstimate):
            value, expected = (getattr(slope, field.name) for slope in (one, other))
            if isinstance(value, float):
                expected = pytest.approx(expected, abs=1e-9, rel=1e-12, nan_ok=True)
            assert value == expected, field.name
    learnt = [[(p.name, p.value, p.low) for p in each.learnt.parameters] for each in (ones, others)]
    for found, expected in zip(*learnt, strict=True):
        assert found[0] == expected[0]
        assert found[1:] == pytest.approx(expected[1:], rel=1e-9)


@pytest.mark.parametrize(
    ("day", "azimuth"), [(CLEAR, "free"), pytest.param(BROKEN_CLOUD, "known", marks=pytest.mark.slow)]
)
def test_it_does_not_matter_when_or_how_often_the_chain_is_asked(day, azimuth):
    world = drawn_world(5, day, minutes=14, shade_test=True)
    settings = replace(world.settings, model="learned", azimuth=azimuth)
    *_, every_minute = SlopeChain(world.regions, settings).series(world.history)
    at_the_end = SlopeChain(world.regions, settings)
    assert_equal(at_the_end.at(world.history), every_minute)
    assert_equal(at_the_end.at(world.history), every_minute)
    copied = SlopeChain(world.regions, settings)
    for rows in (5, 9, 14):
        twice = [copied.at(copy.deepcopy(world.history.until(rows))) for _ in range(2)]
    assert_equal(twice[1], every_minute)


def test_the_chain_keeps_no_history_it_was_given():
    """A view of one row would keep all minutes before it: 25 MB of sun vectors after a day."""
    world = drawn_world(5, CLEAR, minutes=12, shade_test=True)
    chain, given = SlopeChain(world.regions, replace(world.settings, model="learned")), []
    for rows in range(1, 13):
        history = copy.deepcopy(world.history.until(rows))
        given += [weakref.ref(getattr(history, field.name)) for field in fields(History)]
        chain.at(history)
    del history
    gc.collect()
    assert [array().shape for array in given if array() is not None] == []


def test_the_chain_leaves_histories_as_they_are():
    world = drawn_world(5, CLEAR, minutes=8)
    before = copy.deepcopy(world.history)
    SlopeChain(world.regions, replace(world.settings, model="learned")).at(world.history)
    for field in fields(History):
        np.testing.assert_array_equal(getattr(world.history, field.name), getattr(before, field.name))
