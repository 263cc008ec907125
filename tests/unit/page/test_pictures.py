"""Pictures for browsers hold the camera's values: exactly, or to a grey level."""

import json
import struct
import zlib

import cv2
import numpy as np
import pytest

from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import Frame
from fieldkit.page.pictures import picture

LEPTON = StreamInfo("camera", "brightness_temperature", "K", (120, 160), 0.01)
RAW = StreamInfo("camera", "counts", "counts", (120, 160), float("nan"), float("nan"))
NOTHING = np.zeros((0, 160), np.uint16)


def frame(counts: np.ndarray) -> Frame:
    return Frame("camera", 1, 1_451_674_801_264_369_000, counts.astype(np.uint16), NOTHING)


def smooth() -> np.ndarray:
    x, y = np.meshgrid(np.linspace(0, 3, 160), np.linspace(0, 3, 120))
    return 29_000 + 800 * np.sin(x) + 500 * y


def taken_apart(message: bytes) -> tuple[dict, bytes]:
    (size,) = struct.unpack("<H", message[:2])
    return json.loads(message[2 : 2 + size]), message[2 + size :]


def counts_of(body: bytes, header: dict) -> np.ndarray:
    """As a browser does it: inflate, then add up each row."""
    differences = np.frombuffer(zlib.decompress(body), "<u2").reshape(header["rows"], header["cols"])
    return np.cumsum(differences, axis=1, dtype=np.uint16)


@pytest.mark.parametrize("counts", [smooth(), np.random.default_rng(1).integers(0, 65_536, (120, 160))])
def test_exact_pictures_lose_nothing(counts):
    sent = frame(counts)
    header, body = taken_apart(picture(sent, LEPTON, "exact", 5))
    np.testing.assert_array_equal(counts_of(body, header), sent.counts)
    kelvin = header["scale"] * sent.counts + header["offset"] + 273.15
    np.testing.assert_allclose(kelvin, sent.counts * 0.01, atol=1e-9)
    assert (header["seq"], header["time_ms"]) == (5, 1_451_674_801_264.369)


def test_grey_levels_are_temperatures_between_the_ends_of_the_header():
    sent = frame(smooth())
    header, body = taken_apart(picture(sent, LEPTON, "jpeg", 1))
    grey = cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_UNCHANGED)
    assert grey.shape == (120, 160)
    span = header["high_c"] - header["low_c"]
    celsius = header["low_c"] + grey / 255.0 * span
    inside = np.clip(sent.counts * 0.01 - 273.15, header["low_c"], header["high_c"])
    assert np.abs(celsius - inside).max() < 0.03 * span  # of JPEG at quality 80
    assert np.abs(celsius - inside).mean() < 0.005 * span


def test_a_defect_pixel_does_not_take_the_grey_levels():
    counts = smooth()
    counts[0, 0], counts[5, 5] = 0, 65_535
    header, _ = taken_apart(picture(frame(counts), LEPTON, "jpeg", 1))
    assert (header["low_c"], header["high_c"]) == (17, 40)  # of 16.85 to 39.85 °C, nearly all


def test_a_camera_without_a_scale_shows_counts():
    sent = frame(smooth())
    header, body = taken_apart(picture(sent, RAW, "exact", 1))
    assert (header["unit"], header["scale"], header["offset"]) == ("counts", 1.0, 0.0)
    np.testing.assert_array_equal(counts_of(body, header), sent.counts)


def test_a_uniform_frame_has_a_scale():
    header, _ = taken_apart(picture(frame(np.full((120, 160), 29_315)), LEPTON, "jpeg", 1))
    assert header["high_c"] - header["low_c"] >= 2.0


def test_sizes_are_those_of_a_slow_network():
    rng = np.random.default_rng(0)
    noisy = frame(smooth() + rng.normal(0, 5, (120, 160)))  # a Lepton's 50 mK
    assert len(picture(noisy, LEPTON, "jpeg", 1)) * 9 < 25_000
    assert len(picture(noisy, LEPTON, "exact", 1)) * 9 < 250_000
