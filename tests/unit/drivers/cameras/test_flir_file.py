import json
import struct

import cv2
import numpy as np
import pytest
from imagecodecs import jpegls_encode

from fieldkit.drivers.cameras import flir_file
from fieldkit.drivers.cameras.flir_file import frame_length, frames
from fieldkit.model.errors import DecodeError
from fieldkit.physics.camera_laws import planck
from tests.harness.foreign_files import fff
from tests.shared_data import shared

NAMES = ("frame_000000.fff", "frame_000000_le.fff")


@pytest.fixture(params=NAMES)
def recorded(request):
    data = shared(f"data/frames/flir_file/{request.param}").read_bytes()
    expected = json.loads(shared("data/frames/expected.json").read_text())[f"flir_file/{request.param}"]
    return data, expected


def test_public_files_give_their_stated_counts_and_temperatures(recorded):
    data, expected = recorded
    (frame,) = frames(data)
    counts, celsius = frame.counts, frame.temperature_k() - 273.15
    assert list(counts.shape) == expected["shape"]
    assert (counts.min(), counts.max(), np.median(counts)) == tuple(
        expected[key] for key in ("raw_min", "raw_max", "raw_median")
    )
    assert counts[:5, 0].tolist() == expected["raw_first_column"]
    for figure, key in ((celsius.min(), "min"), (celsius.mean(), "mean"), (celsius.max(), "max")):
        assert figure == pytest.approx(expected[f"celsius_{key}"], abs=expected["tolerance"])


def test_sequence_is_walked_by_its_directories(recorded):
    data, _ = recorded
    assert frame_length(data) == len(data)
    found = list(frames(data * 3))
    assert len(found) == 3
    assert all((one.counts == found[0].counts).all() for one in found)


def test_marker_bytes_inside_the_pixels_do_no_harm(recorded):
    data, _ = recorded
    (frame,) = frames(data)
    place = data.index(frame.counts.tobytes())
    disguised = data[:place] + b"FFF\0" + data[place + 4 :]
    assert len(list(frames(disguised * 2))) == 2


def test_radiometric_jpeg_carries_the_same_file_in_parts(recorded):
    data, _ = recorded
    parts = [data[start : start + 60_000] for start in range(0, len(data), 60_000)]
    jpeg = b"\xff\xd8\xff\xe0\0\x04JF"
    for number, part in reversed(list(enumerate(parts))):  # the order of segments is not the order of parts
        body = b"FLIR\0\x01" + bytes([number, len(parts) - 1]) + part
        jpeg += b"\xff\xe1" + struct.pack(">H", len(body) + 2) + body
    (frame,) = frames(jpeg + b"\xff\xda")
    (plain,) = frames(data)
    assert (frame.counts == plain.counts).all()


def test_frame_stored_as_png_is_unswapped(recorded):
    data, _ = recorded
    (plain,) = frames(data)
    pixels = plain.counts.tobytes()
    _, png = cv2.imencode(".png", plain.counts.byteswap())
    body = png.tobytes().ljust(len(pixels), b"\0")
    (frame,) = frames(data.replace(pixels, body))
    assert (frame.counts == plain.counts).all()


@pytest.mark.parametrize("padding", [0, 3, 16, 100, 4096, 60_000])
@pytest.mark.parametrize("fill", [b"\0", b"\xff", b"F"])
def test_frames_of_a_csq_are_jpeg_ls_with_any_padding(padding, fill):
    """16-bit JPEG-LS (ITU-T T.87), as ExifTool's FLIR.pm and public readers describe the record."""
    counts = np.random.default_rng(1).integers(0, 65_536, (3, 24, 32)).astype(np.uint16)
    data = b"".join(
        fff(frame, 1_480_000_000, packed=jpegls_encode(frame)) + fill * padding for frame in counts
    )
    assert [frame.counts.tolist() for frame in frames(data)] == counts.tolist()
    broken = fff(counts[0], 0, packed=jpegls_encode(counts[0])[:200])
    other = fff(counts[0], 0, packed=jpegls_encode(counts[0, :8]))
    for wrong in (broken, other):
        with pytest.raises(DecodeError, match="JPEG-LS"):
            list(frames(wrong))


def test_stream_settings_give_brightness_temperature_without_the_cameras_emissivity(recorded):
    data, _ = recorded
    (frame,) = frames(data)
    settings = flir_file.settings(frame)
    assert settings["camera_emissivity"] == frame.constants.emissivity
    brightness = planck(frame.counts, frame.counts[:0], settings)
    warmer = frame.temperature_k() > frame.constants.reflected_k
    assert (brightness[warmer] < frame.temperature_k()[warmer]).all()


@pytest.mark.parametrize("length", [0, 3, 63, 70, 500, -1])
def test_cut_files_are_refused(recorded, length):
    data, _ = recorded
    if length == 0:
        assert list(frames(b"")) == []
        return
    with pytest.raises(DecodeError):
        list(frames(data[:length]))


def test_jpeg_without_thermal_data_is_refused():
    with pytest.raises(DecodeError, match="without FLIR"):
        list(frames(b"\xff\xd8\xff\xe0\0\x04JF\xff\xda"))
