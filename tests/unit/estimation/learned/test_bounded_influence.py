"""One reading of the light, or one mark, decides nothing: slopes move by a small part of their half-width."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.drawn_worlds import BROKEN_CLOUD, CLEAR
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.learned.light_gaps import WAIT_MIN, light_at, settled
from fieldkit.model.samples import Quality
from tests.harness.drawn import drawn_world

MINUTES = 40


@pytest.fixture(scope="module", params=[CLEAR, BROKEN_CLOUD])
def world(request):
    drawn = drawn_world(3, request.param, minutes=MINUTES)
    return replace(drawn, settings=replace(drawn.settings, model="learned"))


@pytest.fixture(scope="module")
def undisturbed(world):
    return SlopeChain(world.regions, world.settings).at_once(world.history).slopes


def moved(world, undisturbed, **changed):
    """Largest change of a tilt over half the width of its region."""
    history = replace(world.history, **changed)
    slopes = SlopeChain(world.regions, world.settings).at_once(history).slopes
    return max(
        abs(slope.tilt_deg - before.tilt_deg) / (0.5 * (before.tilt_high_deg - before.tilt_low_deg))
        for slope, before in zip(slopes, undisturbed, strict=True)
    )


@pytest.mark.parametrize("row", [10, 21])
def test_a_minute_without_light_moves_no_slope(world, undisturbed, row):
    light = world.history.dni_w_m2.copy()
    light[row] = np.nan
    assert moved(world, undisturbed, dni_w_m2=light) <= 0.25


def test_a_marked_shade_that_cools_nothing_moves_no_slope(world, undisturbed):
    flags = world.history.region_flags.copy()
    flags[20:25, 2] |= int(Quality.SHADED)
    assert moved(world, undisturbed, region_flags=flags) <= 0.25


def test_light_without_a_reading_waits_and_lies_on_a_line(world):
    light = np.linspace(800.0, 839.0, MINUTES)
    light[20:23] = np.nan
    history = replace(world.history, dni_w_m2=light)
    assert [settled(history.until(rows)) for rows in (20, 21, 23, 24)] == [20, 20, 20, 24]
    between = light_at(history, 21)
    assert between.direct_w_m2 == pytest.approx(821.0)
    # the light of the log is a straight line: only its usual error is left, a fifth of a reading
    assert 0.0 < between.error_w_m2 < 0.05 * 839.0


def test_light_that_does_not_come_back_is_held_after_the_wait(world):
    light = np.where(np.arange(MINUTES) < 20, 800.0, np.nan)
    history = replace(world.history, dni_w_m2=light)
    assert settled(history.until(20 + WAIT_MIN)) == 20
    assert settled(history.until(21 + WAIT_MIN)) == 21
    assert light_at(history, 25).direct_w_m2 == 800.0
