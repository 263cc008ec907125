import numpy as np
import pytest

from fieldkit.estimation.region_check import LARGEST_PX, check_region, check_regions
from fieldkit.model.site import Region, RegionKind


def region(name: str, *corners: tuple[float, float]) -> Region:
    return Region(name, RegionKind.TARGET, corners)


def square(name: str, x: int, side: int) -> Region:
    return region(name, (x, 10), (x + side - 1, 10), (x + side - 1, 9 + side), (x, 9 + side))


def test_a_region_below_100_pixels_is_too_small():
    small, large = check_regions([square("a", 0, 9), square("b", 20, 10)], {"": (120, 160)})
    assert (small.pixels, small.level) == (81, "FAIL")
    assert (large.pixels, large.level) == (100, "ok")


def test_a_region_outside_the_frame_fails():
    (inspection,) = check_regions([square("a", 155, 20)], {"": (120, 160)})
    (failure,) = inspection.failures
    assert "160 x 120" in failure


def test_overlapping_regions_are_reported_with_the_pixels_they_share():
    inspections = check_regions([square("a", 0, 20), square("b", 15, 20)], {"": (120, 160)})
    assert [inspection.level for inspection in inspections] == ["ok", "FAIL"]
    (failure,) = inspections[1].failures
    assert "100 px" in failure
    assert failure.endswith(" a")


def test_without_a_frame_size_regions_are_checked_against_each_other():
    inspections = check_regions([square("a", 0, 20), square("b", 500, 20)], {})
    assert [inspection.level for inspection in inspections] == ["ok", "ok"]
    assert check_regions([], {}) == []


def test_a_region_larger_than_any_frame_fails_before_its_pixels_take_all_memory():
    (inspection,) = check_regions([square("a", 0, 10**9)], {})
    (failure,) = inspection.failures
    assert f"{LARGEST_PX} x {LARGEST_PX}" in failure


def test_a_rim_that_sees_something_else_is_a_warning():
    """A bed of 16 x 16 pixels at 310 K, drawn two pixels too large on ground at 300 K."""
    frame = np.full((60, 60), 300.0)
    frame[12:28, 12:28] = 310.0
    drawn, exact = square("drawn", 10, 20), region("exact", (12, 12), (27, 12), (27, 27), (12, 27))
    too_large, right = check_regions([drawn], {"": frame.shape}, {"": frame}) + check_regions(
        [exact], {"": frame.shape}, {"": frame}
    )
    assert too_large.level == "warn"
    assert too_large.edge_k == pytest.approx(-10.0)
    assert (len(too_large.warnings), too_large.shrink_px) == (1, 2)
    assert right.level == "ok"
    assert right.spread_k == 0.0
    assert (too_large.shrink_px, right.shrink_px) == (2, None)


def test_one_region_alone_gets_the_verdict_that_it_gets_among_the_others():
    frame = 300.0 + np.random.default_rng(2).standard_normal((120, 160))
    drawn = [square("a", 0, 20), square("b", 15, 20), region("c", (70, 20), (120, 31), (96, 88))]
    among = check_regions(drawn, {"": frame.shape}, {"": frame})
    alone = [check_region(one, frame.shape, frame, drawn[:number]) for number, one in enumerate(drawn)]
    assert [one.document() for one in alone] == [one.document() for one in among]


def test_a_region_over_the_whole_frame_is_a_warning():
    whole = Region("all", RegionKind.TARGET, ((0, 0), (159, 0), (159, 119), (0, 119)))
    (inspection,) = check_regions([whole], {"": (120, 160)})
    assert inspection.level == "warn"
    (warning,) = inspection.warnings
    assert "100%" in warning
