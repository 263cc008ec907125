"""What all cameras' frames share: kelvin by the scale, and every field in its place."""

import numpy as np
import pytest

from fieldkit.drivers.cameras import purethermal, y16
from fieldkit.drivers.cameras.camera import DecodedFrame, kelvin
from fieldkit.model.samples import Quality

COUNTS = np.random.default_rng(5).integers(20_000, 40_000, (48, 64)).astype("<u2")


def frame(counts: np.ndarray, scale: float, offset: float = 0.0) -> DecodedFrame:
    found = y16.decode(counts.tobytes(), counts.shape[1], counts.shape[0], scale, offset)
    assert isinstance(found, DecodedFrame)
    return found


@pytest.mark.parametrize(("scale", "offset"), [(0.01, 0.0), (0.1, 0.0), (1 / 64, 0.0), (0.04, -120.5)])
@pytest.mark.parametrize("counts", [COUNTS, COUNTS * 0, COUNTS * 0 + 0xFFFF], ids=["room", "zeros", "ends"])
def test_kelvin_are_counts_times_scale_and_offset(counts, scale, offset):
    found = kelvin(frame(counts.astype("<u2"), scale, offset))
    assert (found.dtype, found.shape) == (np.float32, counts.shape)
    # single precision: half a step of the last bit up to 6553.5 K
    np.testing.assert_allclose(found, counts.astype(np.float64) * scale + offset, rtol=0, atol=5e-4)


def test_without_a_scale_there_are_no_kelvin():
    assert np.isnan(kelvin(frame(COUNTS, float("nan")))).all()


def test_a_frame_with_telemetry_has_every_field():
    rows = np.zeros(320, "<u2")
    rows[[0, 24, 26, 208, 209]] = 14, 30_015, 29_815, 1, 1
    told = purethermal.decode((COUNTS[0, 0] + np.zeros((120, 160), "<u2")).tobytes() + rows.tobytes())
    assert isinstance(told, DecodedFrame)
    assert DecodedFrame(*told) == told


@pytest.mark.parametrize(("count", "flagged"), [(0, True), (1, False), (0xFFFE, False), (0xFFFF, True)])
def test_a_pixel_at_either_end_of_the_counts_is_saturated(count, flagged):
    counts = COUNTS.copy()
    counts[20, 30] = count
    assert (Quality.SATURATED in frame(counts, 0.01).quality) is flagged
