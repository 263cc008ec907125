"""Beds found in frames whose truth the scene has, and none where there is none."""

import gzip
import struct

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from benchmarks.suggested_regions import Score, drawn_frame, score
from fieldkit.estimation.region_check import CameraView, check_region
from fieldkit.estimation.region_suggestions import find_beds
from fieldkit.model.errors import NoAnswerError
from fieldkit.model.site import Region, RegionKind
from fieldkit.recording.suggesting import suggestions_in
from tests.shared_data import shared

NOTHING = Score(0, 0, 0, 0, 0, 0)


def field(*rectangles: tuple[int, int, int, int, float]) -> np.ndarray:
    """Ground at 290 K with 0.05 K of noise, and rectangles (left, top, right, bottom) so much warmer."""
    frame = np.zeros((120, 160), np.float32)
    for left, top, right, bottom, warmer in rectangles:
        frame[top:bottom, left:right] = warmer
    noise = 0.05 * np.random.default_rng(1).standard_normal(frame.shape)
    return 290.0 + cv2.GaussianBlur(frame, (0, 0), 0.7).astype(np.float64) + noise


def test_nearly_all_that_is_suggested_lies_inside_a_bed():
    """Four of the benchmark's frames: as the field stands, moved, cluttered, and noisy too."""
    total = sum((score(drawn_frame(seed)) for seed in range(4)), start=NOTHING)
    assert total.inside >= 0.95 * total.suggested
    assert total.found >= 0.6 * total.beds


def test_hills_and_ridges_are_no_beds():
    """Smooth relief for even seeds, sharp crests for odd ones, of 3 K."""
    for seed in range(4):
        relief = gaussian_filter(np.random.default_rng(seed).standard_normal((120, 160)), 4.0 + seed)
        relief *= 3.0 / relief.std()
        with pytest.raises(NoAnswerError):
            find_beds(290.0 + (np.abs(relief) if seed % 2 else relief))


def test_beds_are_in_reading_order_inset_and_usable_as_regions():
    frame = field((90, 60, 140, 100, 3.0), (20, 20, 60, 50, -2.0), (20, 60, 60, 100, 1.0))
    beds = find_beds(frame)
    assert [bed.points_px[0][0] > 75 for bed in beds] == [False, False, True]
    assert [round(bed.contrast_k) for bed in beds] == [2, 1, 3]
    xs, ys = zip(*beds[0].points_px, strict=True)
    np.testing.assert_allclose((min(xs), min(ys), max(xs), max(ys)), (23, 23, 56, 46), atol=2.0)
    for bed in beds:
        region = Region("bed", RegionKind.TARGET, bed.points_px)
        assert check_region(region, CameraView(frame.shape, frame)).level == "ok"


def test_beds_beside_a_reference_are_numbered_from_one():
    flat = Region("flat", RegionKind.REFERENCE, ((22, 62), (58, 62), (58, 98), (22, 98)), tilt_deg=0.0)
    frame = field((90, 60, 140, 100, 3.0), (20, 20, 60, 50, -2.0), (20, 60, 60, 100, 1.0))
    found = {suggestion.region.name: suggestion.region.kind for suggestion in suggestions_in(frame, [flat])}
    assert found == {"bed-1": RegionKind.TARGET, "bed-2": RegionKind.TARGET}


def test_a_larger_frame_has_the_same_beds_in_its_own_pixels():
    frame = field((20, 20, 60, 50, 2.0))
    large = np.kron(frame, np.ones((4, 4)))
    small, bed = find_beds(frame)[0], find_beds(large)[0]
    np.testing.assert_allclose(np.array(bed.points_px), 4.0 * np.array(small.points_px) + 1.5, atol=4.0)


def test_what_is_much_smaller_than_the_beds_lies_beside_them():
    assert len(find_beds(field((20, 20, 70, 60, 2.0), (100, 80, 116, 94, 5.0)))) == 1


@pytest.mark.parametrize(
    ("frame", "words"),
    [
        (field(), "no even area with four straight edges"),
        (field((20, 20, 60, 50, 0.4)), r"most distinct by 0\.[34] K, a bed by 0.5 K"),
        (np.full((120, 160), np.nan), "no known temperature"),
    ],
)
def test_none_is_explained_with_the_next_step(frame, words):
    with pytest.raises(NoAnswerError, match=words) as raised:
        find_beds(frame)
    assert "draw them" in str(raised.value.fix)


def test_pixels_without_a_temperature_hide_no_bed():
    frame = field((20, 20, 60, 50, 2.0))
    frame[::17, ::13] = np.nan
    assert len(find_beds(frame)) == 1


def test_no_bed_is_seen_in_a_room_with_a_person():
    """Every 20th frame of a PureThermal 3 (CC BY 4.0, see the folder's README), kelvin x 100."""
    source = shared("data/frames/purethermal3/thermal_20260512_151542.raw.y16.gz")
    raw = gzip.decompress(source.read_bytes())
    begin = 12 + struct.unpack("<I", raw[8:12])[0]
    for number in range(0, 82, 20):
        counts = np.frombuffer(raw, "<u2", 19_200, begin + number * 38_424 + 24).reshape(120, 160)
        with pytest.raises(NoAnswerError):
            find_beds(counts / 100.0)


@pytest.mark.parametrize("name", ["face_raw", "face_cal", "floor_raw", "floor_cal"])
def test_no_bed_is_seen_in_faces_and_floors(name):
    """Of a Seek Compact (CC0), whose blind pixels are 0; about 0.02 K to the count."""
    counts = np.load(shared(f"data/frames/seek_compact/{name}.npy")).astype(np.float64)
    with pytest.raises(NoAnswerError):
        find_beds(np.where(counts == 0, np.nan, 0.02 * counts))


def test_no_bed_is_seen_in_frames_of_larger_cameras():
    """640x512 and 320x240 of FLIR (MIT)."""
    core = cv2.imread(str(shared("data/frames/flir_file/example_radiometric.tiff")), cv2.IMREAD_UNCHANGED)
    with pytest.raises(NoAnswerError):
        find_beds(0.04 * core.astype(np.float64))
