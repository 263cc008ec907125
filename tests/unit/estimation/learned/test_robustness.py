"""What a field does to a recording must end in a state with a reason, never in an exception or a NaN."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.drawn_worlds import BROKEN_CLOUD, CLEAR, regions
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.learned.learner import Learner
from fieldkit.model.samples import Quality
from fieldkit.model.slope import CERTAIN, TARGET_HALF_WIDTH_DEG, SlopeState, is_too_wide
from tests.harness.drawn import drawn_world

AZIMUTHS = ["known", pytest.param("free", marks=pytest.mark.slow)]
WITH_A_SLOPE = {SlopeState.OK, SlopeState.WIDE, SlopeState.FLAT, SlopeState.NOT_RESOLVED}


@cache
def world(minutes=20, day=CLEAR, seed=1, **options):
    drawn = drawn_world(seed, day, minutes=minutes, **options)
    return replace(drawn, settings=replace(drawn.settings, model="learned"))


def last(history, beds, settings):
    return SlopeChain(beds, settings).at(history)


def with_nan(history, rows, *names, columns=slice(None)):
    changed = {}
    for name in names:
        values = getattr(history, name).copy()
        values[(rows, columns) if values.ndim == 2 else rows] = np.nan
        changed[name] = values
    return replace(history, **changed)


def without(history, rows):
    """A history in which some minutes have no bin."""
    return history.at(np.setdiff1d(np.arange(len(history)), rows))


def assert_sound(estimated, tilt_limit_deg=45.0):
    """Every slope has numbers that belong together, or a state with a reason."""
    for one in estimated.slopes:
        if one.state not in WITH_A_SLOPE:
            assert one.reason
            continue
        numbers = (one.tilt_deg, one.azimuth_deg, one.tilt_low_deg, one.tilt_high_deg)
        assert all(math.isfinite(number) for number in numbers), one
        assert 0.0 <= one.tilt_low_deg <= one.tilt_deg <= one.tilt_high_deg
        assert one.tilt_high_deg <= max(tilt_limit_deg, one.tilt_deg)
        if one.state == SlopeState.OK:
            assert not is_too_wide(one.tilt_deg, one.tilt_half_width_deg, TARGET_HALF_WIDTH_DEG)
            assert not one.reason
        else:
            assert one.reason
        assert math.isnan(one.second_tilt_deg) == (one.state != SlopeState.NOT_RESOLVED)
    if estimated.learnt is not None:
        for parameter in estimated.learnt.parameters:
            assert math.isfinite(parameter.value), parameter
            assert 0.0 <= parameter.share_of_prior <= 1.0


def assert_has_slopes(estimated, **options):
    assert {one.state for one in estimated.slopes} <= WITH_A_SLOPE
    assert_sound(estimated, **options)


HURTS = {
    "frames of a target": lambda h: with_nan(h, slice(8, 14), "temperature_k", columns=2),
    "frames of the reference": lambda h: with_nan(h, slice(8, 14), "temperature_k", columns=0),
    "all frames at the end": lambda h: with_nan(h, slice(15, None), "temperature_k"),
    "all light for ten minutes": lambda h: with_nan(h, slice(6, 16), "dni_w_m2", "dhi_w_m2"),
    "diffuse light": lambda h: with_nan(h, slice(None), "dhi_w_m2"),
    "longwave": lambda h: with_nan(h, slice(None), "longwave_down_w_m2"),
    "air at first": lambda h: with_nan(h, slice(0, 9), "air_k"),
    "air": lambda h: with_nan(h, slice(None), "air_k"),
    "half an hour": lambda h: without(h, range(8, 38)),
    "five hours": lambda h: replace(
        h, **{name: getattr(h, name) + (np.arange(len(h)) >= 30) * step for name, step in FIVE_HOURS.items()}
    ),
}
FIVE_HOURS = {"minute": 300, "time_ns": 300 * 60 * 10**9}


SELDOM_MISSING = ("all frames at the end", "diffuse light", "longwave", "air at first", "five hours")
"""The same of less; after five hours the chain begins anew, see below."""


@pytest.mark.parametrize("azimuth", AZIMUTHS)
@pytest.mark.parametrize(
    "missing", [pytest.param(one, marks=[pytest.mark.slow] * (one in SELDOM_MISSING)) for one in HURTS]
)
def test_what_is_missing_leaves_slopes(missing, azimuth):
    drawn = world(42 if missing in ("half an hour", "five hours") else 20)
    settings = replace(drawn.settings, azimuth=azimuth)
    hurt = HURTS[missing](drawn.history)
    chain = SlopeChain(drawn.regions, settings)
    for row in (4, 10, 14):
        assert_sound(chain.at(hurt.until(row)))
    assert_has_slopes(chain.at(hurt))


def test_after_a_gap_of_more_than_two_hours_the_chain_begins_anew():
    drawn = world(42)
    gap = HURTS["five hours"](drawn.history)
    as_alone = last(gap.since(30), drawn.regions, drawn.settings)
    for one, alone in zip(last(gap, drawn.regions, drawn.settings).slopes, as_alone.slopes, strict=True):
        assert one.tilt_deg == pytest.approx(alone.tilt_deg, abs=1e-9)
        assert one.window_start_ns == gap.time_ns[30]


@pytest.mark.parametrize(
    ("names", "columns", "reason"),
    [
        (("dni_w_m2", "dhi_w_m2"), slice(None), "irradiance"),
        (("temperature_k",), slice(None), "reference"),
        (("temperature_k",), 3, "all regions"),
    ],
)
def test_what_never_comes_is_named(names, columns, reason):
    drawn = world(8)
    never = with_nan(drawn.history, slice(None), *names, columns=columns)
    found = last(never, drawn.regions, drawn.settings)
    assert {slope.state for slope in found.slopes} == {SlopeState.NO_DATA}
    assert all(reason in slope.reason for slope in found.slopes)
    assert found.learnt is None


def test_light_that_comes_late_starts_the_chain_then():
    drawn = world(16)
    late = with_nan(drawn.history, slice(0, 6), "dni_w_m2", "dhi_w_m2")
    found = last(late, drawn.regions, drawn.settings)
    assert_has_slopes(found)
    assert {one.window_start_ns for one in found.slopes} == {int(late.time_ns[6])}
    assert {one.n_bins for one in found.slopes} == {10}


def test_before_any_minute_and_with_few():
    drawn = world(6)
    none = last(drawn.history.until(0), drawn.regions, drawn.settings)
    assert {(slope.state, slope.n_bins) for slope in none.slopes} == {(SlopeState.NO_DATA, 0)}
    few = last(drawn.history.until(4), drawn.regions, drawn.settings)
    reasons = {(slope.state, slope.reason[:6]) for slope in few.slopes}
    assert reasons == {(SlopeState.TOO_FEW, "4 of 5")}


def test_no_reference_no_target_one_target():
    drawn = world(8)
    flat, bed, *_ = drawn.regions
    bare, alone = (drawn.history.only(np.array([column])) for column in (1, 0))
    assert last(bare, [bed], drawn.settings).slopes[0].reason.startswith("no reference")
    assert last(alone, [flat], drawn.settings).slopes == ()
    assert_has_slopes(last(drawn.history.only(np.arange(2)), [flat, bed], drawn.settings))


@pytest.mark.parametrize("azimuth", AZIMUTHS)
def test_sunset_within_the_session(azimuth):
    """Into the dusk of the packaged winter day, which ends at 16:58."""
    drawn = world(60, start_h=15.9)
    settings = replace(drawn.settings, azimuth=azimuth)
    chain = SlopeChain(drawn.regions, settings)
    for row in (30, 45, 60):
        found = chain.at(drawn.history.until(row))
        assert_has_slopes(found)
    assert drawn.history.sun[-1, 2] < 0.0
    assert all(math.isnan(one.kelvin_per_degree) for one in found.slopes)


def test_a_night_alone_has_slopes_without_end():
    """Ground as warm as by day says nothing of slopes without any light: no `ok`, and a reason."""
    drawn = world(20)
    night = replace(drawn.history, sun=drawn.history.sun * [1.0, 1.0, -1.0])
    found = last(night, drawn.regions, drawn.settings)
    assert_sound(found)
    assert SlopeState.OK not in {one.state for one in found.slopes}


def test_clouds_the_whole_time():
    drawn = world(30, BROKEN_CLOUD)
    dull = replace(drawn.history, dni_w_m2=np.zeros(30), dhi_w_m2=0.2 * drawn.history.dhi_w_m2)
    assert_has_slopes(last(dull, drawn.regions, drawn.settings))


@pytest.mark.parametrize("azimuth", AZIMUTHS)
def test_beds_in_their_own_shade(azimuth):
    """30 degrees north in the evening of a low sun: no direct light on the beds, sun on the reference."""
    drawn = world(20)
    beds = regions([(30.0, 0.0), (30.0, 10.0), (30.0, 350.0)])
    height = np.radians(12.0)
    sun = np.tile([0.0, -np.cos(height), np.sin(height)], (20, 1))
    cold = drawn.history.temperature_k.copy()
    cold[:, 1:] = cold[:, :1] - 12.0 + 0.05 * np.random.default_rng(1).standard_normal((20, 3))
    shaded = replace(drawn.history, sun=sun, temperature_k=cold)
    found = last(shaded, beds, replace(drawn.settings, azimuth=azimuth))
    assert_sound(found)
    # a bed that dries is as cold as one without sun: none is relied on
    assert not {one.state for one in found.slopes} & set(CERTAIN)


@pytest.mark.parametrize("azimuth", AZIMUTHS)
def test_a_slope_beyond_the_tilt_limit_is_not_relied_on(azimuth):
    """Beds of 5, 15 and 25 degrees where only up to 10 is possible."""
    drawn = world(20)
    settings = replace(drawn.settings, azimuth=azimuth, tilt_limit_deg=10.0)
    found = SlopeChain(drawn.regions, settings).at_once(drawn.history)
    assert_sound(found, tilt_limit_deg=10.0)
    assert found.slopes[0].state in WITH_A_SLOPE
    steep = found.slopes[2]
    assert steep.state is SlopeState.NO_INTERSECTION
    assert "10°" in steep.reason


def test_temperatures_of_another_world_are_survived():
    """A lens cap on and off, a camera in degrees Celsius: 60 K up and down at once."""
    drawn = world(20)
    mad = drawn.history.temperature_k.copy()
    mad[8:12] -= 60.0
    mad[14, 1] += 80.0
    assert_sound(last(replace(drawn.history, temperature_k=mad), drawn.regions, drawn.settings))


def shaded(history, columns, rows, found_at=None):
    """With a board over beds, told at once or found at a later minute."""
    flags = np.zeros_like(history.region_flags)
    flags[rows, columns] = int(Quality.SHADED)
    if found_at is None:
        return replace(history, region_flags=flags)
    cells = np.argwhere(flags)
    known = np.full(len(cells), history.minute[found_at])
    entries = np.column_stack([known, history.minute[cells[:, 0]], cells[:, 1]])
    return replace(history, region_flags=0 * flags, shade_ledger=entries)


def test_shade_found_afterwards_counts_as_if_flagged_from_the_start():
    """The chain takes its minutes anew, before the first draw with the same hypotheses."""
    drawn = world(12, shade_test=False)
    rows = slice(1, 3)
    afterwards = SlopeChain(drawn.regions, drawn.settings)
    later = shaded(drawn.history, 2, rows, found_at=4)
    at_once = SlopeChain(drawn.regions, drawn.settings)
    flagged = shaded(drawn.history, 2, rows)
    for row in range(1, 13):
        one, other = afterwards.at(later.until(row)), at_once.at(flagged.until(row))
        if row in (3, 4):  # not found yet
            continue
        for found, told in zip(one.slopes, other.slopes, strict=True):
            if row >= 5:  # normals are found from other starts
                assert found.tilt_deg == pytest.approx(told.tilt_deg, abs=1e-6)
                assert found.tilt_high_deg == pytest.approx(told.tilt_high_deg, abs=1e-6)


def test_a_failing_solution_is_a_state_not_an_exception(monkeypatch):
    """A matrix that is not positive definite must not end the slopes of a recording."""
    drawn = world(9)
    chain = SlopeChain(drawn.regions, drawn.settings)
    chain.at(drawn.history.until(6))

    def fails(*_):
        raise np.linalg.LinAlgError("Matrix is not positive definite")

    with monkeypatch.context() as patched:
        patched.setattr(Learner, "add", fails)  # no measured values are known that do
        found = chain.at(drawn.history.until(7))
    assert {one.state for one in found.slopes} == {SlopeState.NO_DATA}
    assert all("failed numerically" in one.reason for one in found.slopes)
    assert_sound(chain.at(drawn.history))


def test_a_bed_of_uncertain_emissivity_has_a_wider_region():
    drawn = world()
    beds = (*drawn.regions[:-1], replace(drawn.regions[-1], emissivity=0.90))
    uncertain = replace(drawn.settings, own_emissivity_sd={beds[-1].name: 0.02})
    before, after = (
        SlopeChain(beds, settings).at_once(drawn.history).slopes for settings in (drawn.settings, uncertain)
    )
    widths = [[one.tilt_high_deg - one.tilt_low_deg for one in slopes] for slopes in (before, after)]
    assert widths[1][-1] > widths[0][-1] + 1.0
    assert widths[1][0] == pytest.approx(widths[0][0], abs=0.5)
