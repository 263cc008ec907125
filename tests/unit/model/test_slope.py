from dataclasses import replace

import numpy as np
import pytest

from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import (
    SlopeEstimate,
    SlopeState,
    final_estimate,
    final_estimates,
    is_certain,
    is_too_wide,
)

BED = Region("b", RegionKind.TARGET, ())
OTHER = Region("c", RegionKind.TARGET, ())
FLAT = Region("flat", RegionKind.REFERENCE, ())


def said(*states: SlopeState) -> list[SlopeEstimate]:
    return [SlopeEstimate(minute, "b", state) for minute, state in enumerate(states)]


def test_the_last_slope_that_was_said_stands_for_the_session():
    few, ok, low = SlopeState.TOO_FEW, SlopeState.OK, SlopeState.LOW_SUN
    assert final_estimate(said(few, ok, ok, low)).time_ns == 2
    assert final_estimate(said(ok, SlopeState.HELD_CLOUD)).state == SlopeState.HELD_CLOUD
    assert final_estimate(said(ok, SlopeState.NO_INTERSECTION)).time_ns == 0


def test_without_any_slope_the_last_reason_stands():
    assert final_estimate(said(SlopeState.TOO_FEW, SlopeState.NO_DATA)).state == SlopeState.NO_DATA
    assert final_estimate([]) is None


@pytest.mark.parametrize(
    ("tilt", "low", "high", "wide"),
    [
        (17.0, 0.0, 40.2, True),
        (30.4, 13.9, 45.0, True),
        (5.0, 3.5, 6.5, False),  # 3 degrees wide, and gentle
        (5.0, 3.5, 6.6, True),
        (30.0, 27.0, 33.0, False),  # a fifth of its tilt
        (30.0, 27.0, 33.1, True),
        (15.0, np.nan, np.nan, True),
    ],
)
def test_a_slope_is_uncertain_beyond_three_degrees_and_a_fifth_of_its_tilt(tilt, low, high, wide):
    assert bool(is_too_wide(tilt, low, high)) is wide
    assert is_too_wide([tilt, tilt], [low, tilt], [high, tilt]).tolist() == [wide, False]


def test_a_slope_held_over_a_cloud_is_as_certain_as_it_was():
    sure = SlopeEstimate(0, "b", SlopeState.HELD_CLOUD, 15.0, 180.0, 14.0, 16.0)
    assert is_certain(sure)
    assert not is_certain(replace(sure, tilt_high_deg=20.0))
    assert not is_certain(replace(sure, second_tilt_deg=33.0))
    assert not is_certain(replace(sure, state=SlopeState.WIDE))


def test_answers_come_in_the_order_of_the_regions_and_only_for_targets():
    estimates = [*(replace(one, region="c") for one in said(SlopeState.OK)), *said(SlopeState.FLAT)]
    assert list(final_estimates(estimates, (FLAT, BED, OTHER))) == ["b", "c"]
    assert final_estimates([], (FLAT, BED)) == {}
