"""When a slope is relied on, and what a known azimuth excludes."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.drawn_worlds import CLEAR, SOUTH, drawn_world
from fieldkit.estimation.chain import MOST_UNLIKE, SlopeChain, stays_at_melting
from fieldkit.model.slope import CERTAIN, SlopeState
from fieldkit.model.units import CELSIUS_ZERO_K


@pytest.fixture(scope="module")
def world():
    return drawn_world(1, CLEAR, SOUTH, minutes=62)


def slopes(world, regions=None, **settings):
    changed = replace(world.settings, model="learned", **settings)
    return SlopeChain(regions or world.regions, changed).at_once(world.history.until(20)).slopes


def test_an_azimuth_that_is_wrong_is_asked_for_and_bends_no_other_bed(world):
    right = slopes(world)
    reference, gentle, middle, steep = world.regions
    turned = replace(steep, azimuth_deg=(steep.azimuth_deg + 180.0) % 360.0)
    *others, wrong = slopes(world, (reference, gentle, middle, turned))
    assert wrong.state is SlopeState.WIDE
    assert wrong.tilt_low_deg == 0.0
    assert wrong.tilt_deg < 1.0 < 0.1 * steep.tilt_deg < wrong.tilt_half_width_deg
    assert wrong.tilt_half_width_deg == pytest.approx(right[2].tilt_half_width_deg, abs=0.01)
    assert wrong.reason
    for before, after in zip(right[:2], others, strict=True):
        assert after.tilt_deg == pytest.approx(before.tilt_deg, abs=0.01)


def test_the_purpose_decides_what_is_narrow_enough_and_changes_no_number(world):
    strict, generous = slopes(world, target_half_width_deg=0.1), slopes(world, target_half_width_deg=11.0)
    assert {slope.state for slope in strict} == {SlopeState.WIDE}
    assert {slope.state for slope in generous} <= set(CERTAIN)
    assert [slope.tilt_deg for slope in strict] == [slope.tilt_deg for slope in generous]


def test_a_free_azimuth_widens_a_tilt_as_its_region_does(world):
    for slope in slopes(
        world, azimuth="free"
    ):  # of the gentle bed the interval along its azimuth is narrower
        assert slope.tilt_half_width_deg >= 0.5 * (slope.tilt_high_deg - slope.tilt_low_deg) - 1e-9


def test_at_most_half_of_the_priors_width_is_relied_on(world):
    prior = replace(world.settings.prior, normal_horizontal_sd=0.02)
    found = slopes(world, target_half_width_deg=11.0, prior=prior)
    assert SlopeState.WIDE in {slope.state for slope in found}


def test_beds_that_change_by_themselves_are_not_relied_on(world):
    kelvin = world.history.temperature_k.copy()
    kelvin[:, 1:] += 0.4 * np.random.default_rng(2).standard_normal(kelvin[:, 1:].shape).cumsum(axis=0)
    restless = replace(world, history=replace(world.history, temperature_k=kelvin))
    assert not {slope.state for slope in slopes(restless, target_half_width_deg=11.0)} & set(CERTAIN)
    assert MOST_UNLIKE == 1.0


@pytest.mark.parametrize(
    ("celsius", "up", "melts"),
    [
        (np.full(61, 0.5), np.ones(61), True),
        (np.full(61, 0.5), np.zeros(61), False),  # at night
        (np.full(61, 1.5), np.ones(61), False),
        (np.linspace(-5.0, 5.0, 61), np.ones(61), False),
        (np.where(np.arange(61) % 7, 0.2, np.nan), np.ones(61), True),  # minutes without a frame
        (np.where(np.arange(61) == 30, 5.0, 0.2), np.ones(61), False),
    ],
)
def test_melting_takes_an_hour_of_sun_at_0_degrees(celsius, up, melts):
    assert stays_at_melting(celsius + CELSIUS_ZERO_K, up, np.arange(61)) is melts


@pytest.mark.parametrize("model", ["full", "learned"])
def test_a_bed_or_a_reference_that_melts_is_named_and_not_relied_on(world, model):
    settings = replace(world.settings, model=model, target_half_width_deg=20.0)
    beds = ((1, {"bed0"}), (0, {"bed0", "bed1", "bed2"}))
    for column, names in beds if model == "full" else beds[:1]:  # melting is judged before any model
        kelvin = world.history.temperature_k.copy()
        kelvin[:, column] = CELSIUS_ZERO_K
        history = replace(world.history, temperature_k=kelvin)
        found = SlopeChain(world.regions, settings).at_once(history).slopes
        named = {slope.region for slope in found if world.regions[column].name in slope.reason}
        assert named == names
        assert not {slope.state for slope in found if slope.region in names} & set(CERTAIN)
