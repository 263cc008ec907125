import gzip
import json
import re
import struct

import numpy as np
import pytest

from fieldkit.drivers.cameras.purethermal import PureThermal, decode
from fieldkit.drivers.decoding import Rejected
from fieldkit.drivers.opening import open_with
from fieldkit.model.clock import HostClock
from fieldkit.model.device import Buffer, Camera, DeviceSettings
from fieldkit.model.errors import DecodeError, DeviceTimeoutError
from fieldkit.model.samples import Quality
from tests.shared_data import shared

ROOM = 29515  # 22 °C in hundredths of a kelvin


def frame(counts=None, **words):
    """A frame of a Lepton 3.5 with telemetry; words by number as `w20=...`."""
    noise = np.random.default_rng(words.get("w20", 0)).integers(-20, 20, (120, 160))
    rows = np.zeros(320, "<u2")
    usual = {"w0": 14, "w1": 60_000, "w3": 0x30, "w20": 27, "w24": 30015, "w26": 29815, "w30": 5_000}
    for name, value in {**usual, "w208": 1, "w209": 1, **words}.items():
        rows[int(name[1:])] = value
    return (ROOM + noise if counts is None else counts).astype("<u2").tobytes() + rows.tobytes()


def opened(source, **options):
    settings = DeviceSettings("ir", "purethermal", source=source, options=options)
    return open_with(PureThermal(), settings, HostClock())


def test_telemetry_documents_every_frame():
    told = decode(frame(w1=0x0002, w2=0x0001, w20=7, w21=2))
    assert told.counts.shape == (120, 160)
    assert told.metadata_rows.shape == (2, 160)
    assert told.device_time == 0x10002
    assert told.device_seq == 0x20007
    assert told.fpa_temperature_k == pytest.approx(300.15)
    assert told.housing_temperature_k == pytest.approx(298.15)
    assert told.gain == "high"
    assert told.scale == 0.01
    assert told.quality == Quality.GOOD


def test_emissivity_that_the_camera_applied_is_recorded(reel):
    # 8028 in word 99 of danjulio/lepton's agc_off.tjsn: 0.98
    told = [opened(reel(frame(w99=word))).info.settings for word in (8028, 8192, 0)]
    assert [settings.get("emissivity") for settings in told] == [0.98, 1.0, None]


def test_rows_of_ones_tell_nothing():
    told = decode(frame()[: 2 * 120 * 160] + b"\xff" * 640)
    assert told.quality & Quality.NO_VALUE
    assert told.shutter is None
    assert np.isnan(told.fpa_temperature_k)


def test_lepton_2_has_three_telemetry_rows_of_eighty_words():
    data = frame()
    counts, rows = data[: 2 * 80 * 60], data[2 * 120 * 160 :][: 2 * 3 * 80]
    told = decode(counts + rows)
    assert told.counts.shape == (60, 80)
    assert told.metadata_rows.shape == (3, 80)
    assert told.scale == 0.01


@pytest.mark.parametrize(
    ("count", "words", "scale", "quality"),
    [
        (2952, {"w209": 0}, 0.1, Quality.GOOD),
        (8192, {"w208": 0}, np.nan, Quality.NO_VALUE),  # without TLinear
        (2952, {"w209": 1}, 0.01, Quality.NO_VALUE),  # a 0.1 K stream read as 0.01 K gives about -243 °C
    ],
)
def test_scale_is_read_from_the_telemetry_and_one_that_cannot_be_is_doubted(count, words, scale, quality):
    decoded = decode(frame(np.full((120, 160), count), **words))
    assert decoded.scale == pytest.approx(scale, nan_ok=True)
    assert decoded.quality == quality


@pytest.mark.parametrize(
    ("words", "shutter"),
    [
        ({"w3": 0x00}, False),  # never
        ({"w3": 0x10}, False),  # imminent
        ({"w3": 0x20}, True),  # running
        ({"w3": 0x30, "w30": 51_000}, True),  # done 9 s ago
        ({"w3": 0x30, "w30": 49_000}, False),  # done 11 s ago
        ({"w0": 8, "w3": 0x10}, True),  # running, as old Leptons count
        ({"w0": 8, "w3": 0x20, "w30": 49_000}, False),  # done, as old Leptons count
    ],
)
def test_shutter_is_what_the_status_bits_say(words, shutter):
    assert decode(frame(**words)).shutter is shutter


@pytest.mark.parametrize(
    ("count", "quality"),
    [(0x2000, Quality.NO_VALUE), (0x3FFF, Quality.NO_VALUE | Quality.SATURATED), (29515, Quality.NO_VALUE)],
)
def test_without_tlinear_the_end_is_that_of_14_bits_unless_there_are_more(count, quality):
    assert decode(np.full((120, 160), count, "<u2").tobytes()).quality == quality


@pytest.mark.parametrize("size", [0, 1, 38399, 38401, 39039])
def test_other_byte_counts_are_rejected_with_the_right_ones(size):
    rejected = decode(bytes(size))
    assert isinstance(rejected, Rejected)
    assert re.findall(r"\d{4,}", rejected.reason)[-4:] == ["9600", "10080", "38400", "39040"]


def test_stream_is_declared_by_the_first_frame(reel):
    controls = {(4, 8): b"500-0771-01\0".ljust(32, b"\0"), (6, 3): (123456).to_bytes(8, "little")}
    camera = opened(reel(frame(), frame(w20=30), controls=controls))
    assert isinstance(camera, Camera)
    info = camera.info
    assert (info.quantity, info.unit, info.scale) == ("brightness_temperature", "K", 0.01)
    assert (info.shape, info.metadata_shape) == ((120, 160), (2, 160))
    assert (info.model, info.serial_number) == ("500-0771-01", "123456")
    assert (info.settings["backend"], info.settings["gain"]) == ("reel", "high")
    decoded = camera.read(1.0)
    assert decoded.device_seq == 30
    assert decoded.mono_ns == 10**9 + 111_111_111
    assert decoded.quality == Quality.GOOD


def test_scale_without_telemetry_is_asked_of_the_camera(reel):
    bare = frame()[: 2 * 120 * 160]
    controls = {(0x15, 18): (1).to_bytes(4, "little"), (0x15, 19): (1).to_bytes(4, "little")}
    assert opened(reel(bare, controls=controls)).info.scale == 0.01
    silent = opened(reel(bare, bare))
    assert np.isnan(silent.info.scale)
    assert silent.info.unit == "counts"
    assert silent.read(1.0).quality & Quality.NO_VALUE
    assert opened(reel(bare), kelvin_per_count=0.01).info.unit == "K"


def test_other_resolution_than_declared_has_no_value(reel):
    camera = opened(reel(frame(), frame(np.full((120, 160), 2952), w209=0, w20=30)))
    assert camera.read(1.0).quality == Quality.NO_VALUE


STILL = np.arange(120 * 160).reshape(120, 160) % 50 + ROOM


@pytest.mark.parametrize(
    "frames",
    [
        [frame(), frame(w20=30, w1=60_100), frame(w20=30, w1=60_100)],  # by the counter
        [frame(STILL, w20=count, w1=60_000 + count) for count in (27, 30, 33)],  # by the pixels
    ],
)
def test_repeated_frame_is_a_duplicate(reel, frames):
    camera = opened(reel(*frames))
    assert camera.read(1.0).quality == Quality.GOOD
    assert camera.read(1.0).quality == Quality.DUPLICATE


def test_frame_that_stands_still_for_three_seconds_is_frozen(reel):
    camera = opened(reel(*[frame()] * 32))
    flags = [camera.read(1.0).quality for _ in range(31)]
    assert flags[27] == Quality.DUPLICATE  # 27 frames, 2.999... s
    assert flags[28] == Quality.DUPLICATE | Quality.FROZEN


def test_gap_made_by_skipping_is_no_loss(reel):
    camera = opened(reel(*(frame(w20=count, w1=count) for count in range(1, 20))))
    camera.read(1.0)
    camera.skip_until(2 * 10**9)
    assert camera.read(1.0).quality == Quality.GOOD


def test_damaged_and_short_buffers_are_rejected_and_counted(reel):
    damaged = Buffer(frame(), 2, 2, error=True)
    camera = opened(reel(frame(), damaged, frame()[:-2]))
    assert camera.read(1.0) is None
    assert camera.read(1.0) is None
    assert camera.rejected == 2


def test_shutter_runs_through_the_extension_unit_and_flags_what_follows(reel):
    source = reel(frame())
    camera = opened(source)
    assert camera.run_shutter() is True
    assert source.written == [(6, 17, b"\x01")]
    source.buffers.append(Buffer(frame(w20=30, w1=61_000), HostClock().mono_ns(), 1))
    assert camera.read(1.0).quality == Quality.SHUTTER


def test_camera_without_controls_says_so(reel):
    assert opened(reel(frame(), refuses=True)).run_shutter() is False


def test_silent_camera_and_other_frames_are_explained_and_closed(reel):
    silent, other = reel(), reel(bytes(640 * 480 * 2))
    with pytest.raises(DeviceTimeoutError, match="no frame"):
        opened(silent)
    with pytest.raises(DecodeError, match="614400 bytes"):
        opened(other)
    assert (silent.closed, other.closed) == (1, 1)


def recorded_frames():
    """Bytes and arrival times of the public recording: index, seconds, milliseconds, 120x160 words each."""
    data = gzip.decompress(shared("data/frames/purethermal3/thermal_20260512_151542.raw.y16.gz").read_bytes())
    assert data[:8] == b"PTY16V1\n"
    (header,) = struct.unpack_from("<I", data, 8)
    start, size = 12 + header, 24 + 2 * 120 * 160
    for begin in range(start, len(data), size):
        yield data[begin + 24 : begin + size], struct.unpack_from("<d", data, begin + 8)[0]


def test_public_recording_of_a_purethermal_3(reel):
    expected = json.loads(shared("data/frames/expected.json").read_text())
    expected = expected["purethermal3/thermal_20260512_151542.raw.y16.gz"]
    recorded = list(recorded_frames())
    assert len(recorded) == expected["frames"]
    buffers = [Buffer(data, int(seconds * 1e9), index) for index, (data, seconds) in enumerate(recorded)]
    camera = opened(reel(buffers[0], *buffers), kelvin_per_count=expected["scale_kelvin_per_count"])
    frames = [camera.read(1.0) for _ in buffers]
    assert (frames[-1].mono_ns - frames[0].mono_ns) / 1e9 == pytest.approx(expected["span_s"], abs=1e-4)
    assert sum(bool(frame.quality & Quality.DUPLICATE) for frame in frames) == expected["duplicates"]
    assert min(frame.counts.min() for frame in frames) == expected["raw_min"]
    assert max(frame.counts.max() for frame in frames) == expected["raw_max"]
    for number, told in ((0, expected["frame_0"]), (81, expected["frame_81"])):
        counts = frames[number].counts
        assert (counts.min(), counts.max()) == (told["raw_min"], told["raw_max"])
        assert counts.mean() == pytest.approx(told["raw_mean"], abs=5e-5)
        assert (counts[60, 80], counts[0, 0]) == (told["raw_60_80"], told["raw_0_0"])
        assert np.unravel_index(counts.argmax(), counts.shape) == tuple(told["hottest"])
    kelvin = frames[0].counts * camera.info.scale
    assert kelvin.mean() - 273.15 == pytest.approx(22.760, abs=0.001)
    assert camera.info.shape == tuple(expected["shape"])


def test_a_damaged_first_frame_declares_nothing(reel):
    """Cut before its telemetry and marked so by the kernel, it has the length of a frame without."""
    cut = Buffer(frame()[: 2 * 120 * 160], 10**9, 0, error=True)
    camera = opened(reel(cut, frame(w20=28), frame(w20=29)))
    assert (camera.info.metadata_shape, camera.info.scale) == ((2, 160), 0.01)


@pytest.mark.parametrize(
    "other", [bytes(2 * 80 * 63), frame()[: 2 * 120 * 160]], ids=["80x60", "no telemetry"]
)
def test_frames_of_another_size_than_declared_are_none_so_that_the_camera_is_opened_again(reel, other):
    camera = opened(reel(frame(), other, frame(w20=30)))
    assert camera.read(1.0) is None
    assert camera.rejected == 1
    assert camera.read(1.0).counts.shape == camera.info.shape
