import struct

import numpy as np
import pytest

from fieldkit.drivers.cameras.thermal_master import Assembler, BulkSource, ThermalMaster, command, decode
from fieldkit.drivers.decoding import Rejected
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import DeviceAccessError, DeviceError
from fieldkit.model.next_step import Action
from fieldkit.model.samples import Quality
from tests.harness.conformance import conforms
from tests.harness.next_steps import steps
from tests.harness.usb_bus import Instrument

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
    camera = opened(source=reel(frame(), frame(1)))
    assert (camera.info.shape, camera.info.metadata_shape) == ((192, 256), (2, 256))
    assert camera.info.scale == 1 / 64
    assert camera.read(1.0).quality == Quality.GOOD
    assert camera.run_shutter() is False


# --- the bulk reader over real pyusb, against a P3 as nohous/p3-ir-camera and its kin describe it


TEXTS = {7: b"P3-000042", 6: b"P3-256X192"}


class P3(Instrument):
    """Streams once it is told to, in transfers of 16 KiB; answers registers and the shutter command."""

    ids = (0x3474, 0x45A2)
    strings = ("Thermal Master", "P3", "")
    endpoints = ((0, 0, ()), (1, 0, ()), (1, 1, ((0x81, 2),)))

    def __init__(self, port=2):
        super().__init__(port)
        self.streams, self.number, self.lost, self.shutters, self.busy = False, 0, 0, 0, 0
        self.reply, self.stream, self.gain, self.status = b"", b"", 1, 3
        self.busy_for, self.refuses = 2, False

    def control(self, kind, request, value, index, data):
        if (kind, request, index) == (0x40, 0xEE, 1):
            self.streams = True
            return b""
        if (kind, request) == (0x41, 0x20) and len(data) == 18:
            self.command(data)
            return b""
        if (kind, request) == (0xC1, 0x22):
            self.busy -= 1
            return b"\1" if self.busy >= 0 else bytes([self.status])
        if (kind, request) == (0xC1, 0x21) and self.status == 2:
            self.status = 3
            return self.reply[:data]
        return None

    def command(self, data):
        if self.refuses:  # as a TS2 does
            self.status = 4
            return
        self.busy, self.status = self.busy_for, 3
        register, length = data[4], struct.unpack_from("<H", data, 12)[0]
        if data[:3] == b"\x01\x01\x81":
            self.reply, self.status = TEXTS[register].ljust(length, b"\0"), 2
        if data == bytes.fromhex("012f81000000000000000000010000004930"):
            self.reply, self.status = bytes([self.gain]), 2
        self.shutters += data[:5] == b"\x01\x36\x43\0\0"

    def pending(self, endpoint):
        if not self.streams:
            return b""
        self.stream = self.stream or self.frame()
        said, self.stream = self.stream[:16_384], self.stream[16_384:]
        return said

    def frame(self):
        self.number += 1 + self.lost
        self.lost = 0
        return marked(self.number, 40 * self.number % 2048, seed=self.number)


@pytest.fixture
def camera(usb_bus):
    camera = P3()
    usb_bus(camera)
    return camera


def opened(**given):
    return ThermalMaster().open(DeviceSettings("ir", "thermal-master", **given), HostClock())


def test_camera_is_found_and_tells_who_it_is(camera):
    (found,) = ThermalMaster().find()
    assert (found.identity, found.port) == ("3474:45a2", "usb:1-2")
    device = opened(identity=found.identity)
    assert (device.info.model, device.info.serial_number) == ("P3-256X192", "P3-000042")
    assert (device.info.shape, device.info.scale) == ((192, 256), 1 / 64)
    assert device.info.settings["gain"] == "high"
    device.close()
    device.close()


def test_lost_transfers_are_counted_by_the_cameras_own_counter(camera):
    device = opened()
    first = device.read(1.0)
    camera.lost = 3
    second, third = device.read(1.0), device.read(1.0)
    assert (first.counts * device.info.scale).mean() == pytest.approx(295.15, abs=0.1)
    assert [frame.device_seq - first.device_seq for frame in (second, third)] == [4, 5]
    assert second.quality & Quality.DROPPED_BEFORE
    assert not third.quality & Quality.DROPPED_BEFORE


def test_shutter_is_run_by_its_command(camera):
    device = opened()
    assert device.run_shutter() is True
    assert camera.shutters == 1
    assert device.read(1.0).quality & Quality.SHUTTER


def test_frames_let_go_by_leave_the_stream_alive(camera):
    device = opened()
    device.skip_until(HostClock().mono_ns() + 20_000_000)
    assert device.read(1.0) is not None


def test_camera_without_permission_says_what_to_type(camera):
    camera.forbidden = True
    with pytest.raises(DeviceAccessError, check=lambda error: Action.UDEV_RULES() in steps(error)):
        opened()


@pytest.mark.parametrize(("reply", "gain"), [(0, "low"), (0x35, "unknown (35)")])
def test_gain_is_told_as_the_camera_has_it(camera, reply, gain):
    camera.gain = reply
    device = opened()
    assert device.info.settings["gain"] == gain


def test_refused_command_says_so_at_once(camera):
    source = BulkSource(DeviceSettings("ir", "thermal-master"), HostClock())
    camera.refuses = True
    with pytest.raises(DeviceError, match="status 4"):
        source.run_shutter()


def test_busy_camera_is_an_error_after_a_while(camera, monkeypatch):
    monkeypatch.setattr("fieldkit.drivers.usb.PATIENCE_S", 0.01)  # a shorter wait
    source = BulkSource(DeviceSettings("ir", "thermal-master"), HostClock())
    camera.busy_for = 10**9
    with pytest.raises(DeviceError, match="stays busy"):
        source.run_shutter()


def test_driver_conforms_on_its_camera(camera):
    conforms(ThermalMaster(), DeviceSettings("ir", "thermal-master"), camera)
