from dataclasses import replace

import numpy as np
import pytest

from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import SlopeEstimate, SlopeState, final_estimates, half_width_deg, is_too_wide

BED = Region("b", RegionKind.TARGET, ())
OTHER = Region("c", RegionKind.TARGET, ())
FLAT = Region("flat", RegionKind.REFERENCE, ())


def final(*states: SlopeState) -> SlopeEstimate | None:
    estimates = [SlopeEstimate(minute, "b", state) for minute, state in enumerate(states)]
    return final_estimates(estimates, [BED]).get("b")


def test_the_last_slope_stands_for_the_session():
    few, ok, low = SlopeState.TOO_FEW, SlopeState.OK, SlopeState.LOW_SUN
    assert final(few, ok, ok, low).time_ns == 2
    assert final(ok, SlopeState.HELD_CLOUD).state == SlopeState.HELD_CLOUD
    assert final(ok, SlopeState.NO_INTERSECTION).time_ns == 0


def test_without_any_slope_the_last_reason_stands():
    assert final(SlopeState.TOO_FEW, SlopeState.NO_DATA).state == SlopeState.NO_DATA
    assert final() is None


@pytest.mark.parametrize(
    ("tilt", "half", "target", "wide"),
    [
        (5.0, 2.0, 2.0, False),
        (5.0, 2.1, 2.0, True),
        (30.0, 4.5, 2.0, False),  # 0.15 of its tilt
        (30.0, 4.6, 2.0, True),
        (30.0, 4.6, 5.0, False),
        (5.0, 2.0, 1.0, True),
        (15.0, np.nan, 2.0, True),
    ],
)
def test_a_slope_is_wide_beyond_the_target_and_a_share_of_its_tilt(tilt, half, target, wide):
    assert bool(is_too_wide(tilt, half, target)) is wide
    assert is_too_wide([tilt, tilt], [half, 0.0], target).tolist() == [wide, False]


@pytest.mark.parametrize(
    ("tilt", "low", "high", "half"),
    [
        (15.0, 13.0, 18.0, 2.5),
        (1.0, 0.0, 4.0, 3.0),  # cut at 0: as if it reached to -2
        (3.0, 0.0, 4.0, 2.0),
    ],
)
def test_half_a_width_is_half_the_width_and_of_a_cut_region_its_upper_half(tilt, low, high, half):
    assert SlopeEstimate(0, "b", SlopeState.OK, tilt, 180.0, low, high).tilt_half_width_deg == half
    assert half_width_deg([tilt], [low], [high]).tolist() == [half]


def test_a_stated_half_width_is_kept():
    slope = SlopeEstimate(0, "b", SlopeState.OK, 1.0, 180.0, 0.0, 4.0, tilt_half_width_deg=3.3)
    assert replace(slope, tilt_deg=2.0).tilt_half_width_deg == 3.3


def test_final_estimates_are_of_targets_in_the_order_of_the_regions():
    estimates = [SlopeEstimate(0, "c", SlopeState.OK), SlopeEstimate(0, "b", SlopeState.FLAT)]
    assert list(final_estimates(estimates, (FLAT, BED, OTHER))) == ["b", "c"]
    assert final_estimates([], (FLAT, BED)) == {}
