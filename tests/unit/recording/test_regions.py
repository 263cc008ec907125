import numpy as np
import pytest

from fieldkit.estimation.region_check import (
    LARGEST_PX,
    CameraView,
    check_region,
    check_regions,
    pixel_noise_k,
)
from fieldkit.model.site import Region, RegionKind


def region(name: str, *corners: tuple[float, float]) -> Region:
    return Region(name, RegionKind.TARGET, corners)


def square(name: str, x: int, side: int) -> Region:
    return region(name, (x, 10), (x + side - 1, 10), (x + side - 1, 9 + side), (x, 9 + side))


LEPTON = CameraView((120, 160))


@pytest.mark.parametrize("shape", [(12, 16), (24, 32), (60, 80), (120, 160), (240, 320), (512, 640)])
@pytest.mark.parametrize("width", [4, 5, 6, 7, 20])
@pytest.mark.parametrize("height", [4, 5, 6, 7, 20])
def test_a_region_needs_three_by_three_pixels_clear_of_its_rim(shape, width, height):
    """The rim is one pixel wide in frames of fewer than 160 columns, else two; a strip has no such inside."""
    corners = (1, 1), (width, 1), (width, height), (1, height)
    inspection = check_region(region("a", *corners), CameraView(shape))
    is_large = min(width, height) >= (5 if shape[1] < 160 else 7)
    is_inside = width < shape[1] and height < shape[0]
    assert (not inspection.failures) == (is_large and is_inside)


@pytest.mark.parametrize(
    ("noise_k", "side", "needed"),
    [(0.02, 5, ""), (0.5, 5, ""), (0.51, 5, "27 px"), (0.51, 6, ""), (1.0, 9, "100 px")],
)
def test_a_region_needs_pixels_for_a_tenth_of_a_kelvin(noise_k, side, needed):
    """The mean of n pixels has the noise of one over the square root of n."""
    inspection = check_region(square("a", 2, side), CameraView((24, 32), noise_k=noise_k))
    assert needed in "; ".join(inspection.issues)
    assert bool(needed) == bool(inspection.failures)


@pytest.mark.parametrize("noise_k", [0.02, 0.1, 0.5])
@pytest.mark.parametrize("shape", [(12, 16), (24, 32), (120, 160)])
def test_the_noise_of_frames_is_that_of_their_differences(noise_k, shape):
    """Whatever the scene, its warming, and a person who walks through."""
    random = np.random.default_rng(1)
    frames = 290.0 + noise_k * random.standard_normal((25, *shape)) + 5.0 * random.standard_normal(shape)
    frames += 0.1 * np.arange(25)[:, np.newaxis, np.newaxis]
    for number, frame in enumerate(frames):
        frame[:, number % 4] += 10.0
    assert pixel_noise_k(frames) == pytest.approx(noise_k, rel=0.1)
    assert np.isnan(pixel_noise_k(frames[:1]))


def test_a_region_outside_the_frame_fails():
    (inspection,) = check_regions([square("a", 155, 20)], {"": LEPTON})
    (failure,) = inspection.failures
    assert "160 x 120" in failure


def test_overlapping_regions_are_reported_with_the_pixels_they_share():
    inspections = check_regions([square("a", 0, 20), square("b", 15, 20)], {"": LEPTON})
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
    frame = np.full((60, 160), 300.0)
    frame[12:28, 12:28] = 310.0
    drawn, exact = square("drawn", 10, 20), region("exact", (12, 12), (27, 12), (27, 27), (12, 27))
    view = CameraView(frame.shape, frame)
    too_large, right = check_region(drawn, view), check_region(exact, view)
    assert too_large.level == "warn"
    assert too_large.edge_k == pytest.approx(-10.0)
    assert (len(too_large.warnings), too_large.shrink_px) == (1, 2)
    assert right.level == "ok"
    assert right.spread_k == 0.0
    assert (too_large.shrink_px, right.shrink_px) == (2, None)


def test_one_region_alone_gets_the_verdict_that_it_gets_among_the_others():
    frame = 300.0 + np.random.default_rng(2).standard_normal((120, 160))
    drawn = [square("a", 0, 20), square("b", 15, 20), region("c", (70, 20), (120, 31), (96, 88))]
    view = CameraView(frame.shape, frame)
    among = check_regions(drawn, {"": view})
    alone = [check_region(one, view, drawn[:number]) for number, one in enumerate(drawn)]
    assert [one.document() for one in alone] == [one.document() for one in among]


def test_a_region_over_two_beds_is_a_warning():
    """Whose rim is no different from its inside: 20 pixels of 300 K beside 20 of 310 K."""
    frame = np.full((60, 160), 300.0)
    frame[:, 40:] = 310.0
    (warning,) = check_region(
        region("both", (20, 20), (59, 20), (59, 39), (20, 39)), CameraView(frame.shape, frame)
    ).warnings
    assert "5.0 K" in warning


def test_a_region_over_the_whole_frame_is_a_warning():
    whole = Region("all", RegionKind.TARGET, ((0, 0), (159, 0), (159, 119), (0, 119)))
    (inspection,) = check_regions([whole], {"": LEPTON})
    assert inspection.level == "warn"
    (warning,) = inspection.warnings
    assert "100%" in warning
