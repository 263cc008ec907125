"""Curves made by hand, so that the truth is plain."""

import re
from dataclasses import replace

import numpy as np
import pytest

from fieldkit.calibration.emissivity import is_saturated, refuse_saturated
from fieldkit.calibration.steady_pairs import (
    Readings,
    best_lag_s,
    drift_k_min,
    pairs_of,
    refuse_other_bed,
    refuse_shifted_clocks,
    steady_intervals,
)
from fieldkit.model.errors import CalibrationError
from fieldkit.model.next_step import Argument
from tests.harness.next_steps import at

SECOND = 1_000_000_000
MINUTE = 60 * SECOND


def day(minutes: int, contact, *, apparent=None, noise_k=0.03) -> Readings:
    """A probe every second, three pictures a minute; `contact` and `apparent` are kelvin of the minute."""
    random = np.random.default_rng(1)
    probe_s = np.arange(60 * minutes)
    camera_s = np.sort(np.add.outer(60 * np.arange(minutes), [0, 1, 2]).ravel())
    seen = apparent or (lambda minute: contact(minute) - 5.0)
    level = 0.08 * np.repeat(random.standard_normal(minutes), 3)  # left by each shutter correction
    return Readings(
        camera_s * SECOND,
        seen(camera_s / 60.0) + level,
        np.full(camera_s.size, 233.0),
        probe_s * SECOND,
        contact(probe_s / 60.0) + noise_k * random.standard_normal(probe_s.size),
    )


def steps(minute, middle_min=20):
    """Plateaus at 300, 310 and 320 K of 20 min, the middle one as given, and ramps of 10 min between them."""
    ends = np.array([0, 20, 30, 30 + middle_min, 40 + middle_min, 60 + middle_min])
    return np.interp(minute, ends, [300.0, 300.0, 310.0, 310.0, 320.0, 320.0])


def swing(minute):
    """Two hours up and down by 10 K."""
    return 300.0 + 10.0 * np.sin(np.asarray(minute) * np.pi / 60.0)


def test_only_the_plateaus_give_pairs():
    found = steady_intervals(day(80, steps))
    kelvin = [stretch.contact_k for stretch in found]
    assert {round(one, -1) for one in kelvin} == {300.0, 310.0, 320.0}
    np.testing.assert_allclose(kelvin, np.round(kelvin, -1), atol=0.1)
    assert all(MINUTE <= one.end_ns - one.start_ns <= 5 * MINUTE for one in found)
    for stretch in found:
        assert stretch.apparent_k == pytest.approx(stretch.contact_k - 5.0, abs=0.2)
        assert not any(stretch.start_ns < MINUTE * ramp < stretch.end_ns for ramp in (25, 55))


def test_a_surface_that_moves_under_a_still_probe_is_left_out_and_told():
    readings = day(40, lambda m: 300.0 + 0 * m, apparent=lambda m: 295.0 + 0.5 * m)
    pairs, remarks = pairs_of(steady_intervals(readings))
    assert len(pairs) == 0
    assert "probe" in remarks[0]


def test_a_small_span_is_told():
    assert "spans only" in pairs_of(steady_intervals(day(30, lambda m: 300.0 + 0 * m)))[1][0]


def test_a_gap_ends_a_stretch():
    readings = day(10, lambda m: 300.0 + 0 * m)
    kept = (readings.contact_ns < 4 * MINUTE) | (readings.contact_ns >= 7 * MINUTE)
    holed = replace(readings, contact_ns=readings.contact_ns[kept], contact_k=readings.contact_k[kept])
    assert [(s.start_ns // MINUTE, s.end_ns // MINUTE) for s in steady_intervals(holed)] == [(0, 4), (7, 10)]


@pytest.mark.parametrize("late_min", [-12, -3, 4, 15])
def test_clocks_that_differ_between_logs_are_found(late_min):
    readings = day(120, swing)
    shifted = replace(readings, contact_ns=readings.contact_ns + late_min * MINUTE)
    assert best_lag_s(shifted) == pytest.approx(-60.0 * late_min, abs=30.0)
    with pytest.raises(CalibrationError, match=re.escape(f"shifted by {-late_min:+.1f} min")) as refused:
        refuse_shifted_clocks(shifted)
    assert f"{-60 * late_min:+.0f} s" in str(refused.value.fix)


def test_clocks_that_agree_pass_and_a_still_day_says_nothing():
    assert best_lag_s(day(120, swing)) == 0.0
    assert best_lag_s(day(120, lambda m: 300.0 + 0 * m)) is None
    refuse_shifted_clocks(day(120, lambda m: 300.0 + 0 * m))


def test_a_region_on_another_bed_follows_another_probe():
    readings = day(120, swing, apparent=lambda m: 290.0 + 0.05 * m)
    other = 300.0 + 0.05 * readings.contact_ns / MINUTE
    with pytest.raises(CalibrationError, check=at("T1", Argument("channel", "T2"))):
        refuse_other_bed(readings, {"T2": other}, "T1")
    refuse_other_bed(day(120, swing), {"T2": other}, "T1")
    refuse_other_bed(day(120, swing), {}, "T1")


def test_drift_is_the_slope_of_a_line():
    times = np.arange(0, 120) * SECOND
    assert drift_k_min(times, 300.0 + 0.25 * times / MINUTE) == pytest.approx(0.25)
    assert np.isnan(drift_k_min(times[:2], np.ones(2)))


def test_foil_at_the_end_of_the_range_is_a_bound_and_refused():
    random = np.random.default_rng(2)
    measured = (23_300 + 5 * random.standard_normal(400)).astype(np.uint16)
    assert not is_saturated(measured)
    assert is_saturated(np.maximum(measured, 23_302))
    refuse_saturated(10, 4, 233.15)
    with pytest.raises(CalibrationError, match="-40 °C: saturated"):
        refuse_saturated(10, 5, 233.15)


def test_a_short_plateau_is_steady_whatever_was_before():
    readings = day(66, lambda minute: steps(minute, 6))
    kelvin = {round(interval.contact_k, -1) for interval in steady_intervals(readings)}
    assert kelvin == {300.0, 310.0, 320.0}
