import struct

import numpy as np
import pytest

from fieldkit.drivers.cameras.thermal_master import Assembler, ThermalMaster, command, decode
from fieldkit.drivers.decoding import Rejected
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.samples import Quality

LENGTH = 2 * 386 * 256


def frame(seed=0):
    rows = np.full((386, 256), 0x8020, "<u2")
    rows[194:] = 18890 + np.random.default_rng(seed).integers(-4, 5, (192, 256))
    return rows.tobytes()


def marked(counter, third, seed=0, end=None):
    begin = struct.pack("<BBIIH", 12, 0x8C + counter % 2, counter, 0, third)
    close = struct.pack("<BBIIH", 12, 0x8E + counter % 2, counter if end is None else end, 0, third)
    return begin + frame(seed) + close


@pytest.mark.parametrize(
    ("built", "published"),
    [
        (command(b"\x01\x36", 0x43), "0136430000000000000000000000 0000cd0b"),
        (command(b"\x01\x01", 0x81, 7, 64), "010181000700000000000000 40000000104c"),
        (command(b"\x01\x2f", 0x41, 1), "012f41000100000000000000 000000004939"),
    ],
)
def test_commands_are_the_published_bytes(built, published):
    assert built == bytes.fromhex(published)


def test_temperatures_stand_below_frame_and_metadata():
    decoded = decode(frame())
    assert decoded.counts.shape == (192, 256)
    assert decoded.metadata_rows.shape == (2, 256)
    assert (decoded.counts * decoded.scale).mean() == pytest.approx(295.15, abs=0.1)
    assert decoded.quality == Quality.GOOD


def test_small_sibling_is_known_by_its_byte_count():
    assert decode(bytes(2 * 242 * 160)).counts.shape == (120, 160)


def test_markers_must_agree():
    assert decode(marked(7, 280)).device_seq == 7
    assert "disagree" in decode(marked(7, 280, end=8)).reason
    assert isinstance(decode(marked(7, 280)[:-1]), Rejected)
    assert "no markers" in decode(bytes(LENGTH + 24)).reason


def test_frame_may_be_kept_with_the_marker_before_it_alone():
    kept = marked(7, 280)[:-12]  # what one transfer of a P3 holds, as the public programs write it
    decoded = decode(kept)
    assert (decoded.device_seq, decoded.quality) == (7, Quality.GOOD)
    assert np.array_equal(decoded.counts, decode(frame()).counts)
    assert len(ThermalMaster().decode(2 * kept, {}).values) == 6


def test_frames_are_assembled_from_transfers_and_losses_counted():
    assembler = Assembler(LENGTH)
    stream = b"\x0c\x0c\x8cnoise" + marked(1, 40) + marked(2, 80, 1) + marked(5, 200, 2)
    found = []
    for start in range(0, len(stream), 16_384):
        frame = assembler.feed(stream[start : start + 16_384])
        if frame:
            found.append((decode(frame).device_seq, assembler.sequence))
    assert found == [(1, 0), (2, 1), (5, 4)]


def test_third_counter_may_wrap():
    assembler = Assembler(LENGTH)
    for number, third in enumerate((2000, 2040, 32, 72)):
        assert assembler.feed(marked(number, third, number))
        assert assembler.sequence == number


def test_video_member_is_recorded_through_its_source(reel):
    camera = ThermalMaster().open(
        DeviceSettings("ir", "thermal-master", source=reel(frame(), frame(1))), HostClock()
    )
    assert (camera.info.shape, camera.info.metadata_shape, camera.info.scale) == (
        (192, 256),
        (2, 256),
        1 / 64,
    )
    assert camera.read(1.0).quality == Quality.GOOD
    assert camera.run_shutter() is False
