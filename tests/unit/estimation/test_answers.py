from dataclasses import replace

from fieldkit.estimation.answers import answer_of, answers_of
from fieldkit.site import Region, RegionKind
from fieldkit.slope import SlopeEstimate, SlopeState

BED = Region("b", RegionKind.TARGET, ())
OTHER = Region("c", RegionKind.TARGET, ())
FLAT = Region("flat", RegionKind.REFERENCE, ())


def said(*states: SlopeState) -> list[SlopeEstimate]:
    return [SlopeEstimate(minute, "b", state) for minute, state in enumerate(states)]


def test_the_last_slope_that_was_said_stands_for_the_session():
    few, ok, low = SlopeState.TOO_FEW, SlopeState.OK, SlopeState.LOW_SUN
    assert answer_of(said(few, ok, ok, low)).time_ns == 2
    assert answer_of(said(ok, SlopeState.HELD_CLOUD)).state == SlopeState.HELD_CLOUD
    assert answer_of(said(ok, SlopeState.NO_INTERSECTION)).time_ns == 0


def test_without_any_slope_the_last_reason_stands():
    assert answer_of(said(SlopeState.TOO_FEW, SlopeState.NO_DATA)).state == SlopeState.NO_DATA
    assert answer_of([]) is None


def test_answers_come_in_the_order_of_the_regions_and_only_for_targets():
    estimates = [*(replace(one, region="c") for one in said(SlopeState.OK)), *said(SlopeState.FLAT)]
    assert list(answers_of(estimates, (FLAT, BED, OTHER))) == ["b", "c"]
    assert answers_of([], (FLAT, BED)) == {}
