import struct

import numpy as np
import pytest

from fieldkit.drivers.cameras import p2pro
from fieldkit.drivers.cameras.p2pro import Commands, P2Pro, decode
from fieldkit.drivers.identity import UsbIdentity
from fieldkit.drivers.opening import open_with
from fieldkit.model.clock import HostClock
from fieldkit.model.device import Buffer, DeviceSettings
from fieldkit.model.errors import ConfigError, DeviceAccessError, DeviceError
from fieldkit.model.samples import NO_COUNTER, Quality
from tests.harness.next_steps import at

GREY = np.full((192, 256), 0x8020, "<u2")


def frame(counts=None, seed=0):
    """A grey image over temperatures of 22 °C with the noise of a clean camera."""
    noise = np.random.default_rng(seed).integers(-4, 5, (192, 256))
    return GREY.tobytes() + (18890 + noise if counts is None else counts).astype("<u2").tobytes()


def opened(source, **options):
    return open_with(P2Pro(), DeviceSettings("ir", "p2pro", source=source, options=options), HostClock())


def test_lower_half_is_kelvin_times_64():
    counts = 18890 + np.arange(192 * 256).reshape(192, 256) % 7
    counts[147, 157], counts[1, 116] = 20332, 18508  # 44.54 and 16.04 °C, as a public TC001 frame has them
    decoded = decode(frame(counts))
    assert decoded.counts.shape == (192, 256)
    kelvin = decoded.counts * decoded.scale
    assert kelvin[147, 157] - 273.15 == pytest.approx(44.5375)
    assert kelvin[1, 116] - 273.15 == pytest.approx(16.0375)
    assert decoded.quality == Quality.GOOD


@pytest.mark.parametrize(
    "row",
    [
        0x8000,  # at start-up
        18890 + 160 * (-1) ** np.arange(256),  # neighbours differ by 320 before the first correction
        0x8020,  # exchanged halves: chroma 0x80 would read as 512 K
    ],
)
def test_what_is_no_temperature_has_no_value(row):
    assert decode(frame(np.tile(row, (192, 256 // np.size(row))))).quality & Quality.NO_VALUE


@pytest.mark.parametrize("rows", [1, 96, 191, 193, 288, 383])
def test_halves_out_of_step_have_no_value(rows):
    whole = np.frombuffer(frame(), "<u2").reshape(384, 256)
    assert decode(np.roll(whole, rows, axis=0).tobytes()).quality & Quality.NO_VALUE


def test_frame_that_stands_still_betrays_the_shutter(reel):
    still, moving = frame(seed=1), [frame(seed=seed) for seed in range(2, 300)]
    frames = [moving[0], moving[1], still, still, still, *moving[2:]]
    camera = opened(reel(*frames, interval_ns=40_000_000))
    flags = [camera.read(1.0).quality for _ in range(290)]
    assert flags[:2] == [Quality.GOOD] * 2
    assert flags[2] == Quality.DUPLICATE
    assert flags[3] == Quality.DUPLICATE | Quality.SHUTTER
    assert set(flags[4:252]) == {Quality.SHUTTER}  # ten seconds of settling
    assert flags[260] == Quality.GOOD


def test_the_kernels_number_stands_in_for_the_counter_the_camera_lacks_and_shows_a_loss(reel):
    numbers = (0, 1, 2, 4, 5, -1)  # the first frame is spent on the opening; OpenCV tells no number
    buffers = [Buffer(frame(seed=n), n * 40_000_000, number) for n, number in enumerate(numbers)]
    camera = opened(reel(*buffers))
    frames = [camera.read(1.0) for _ in numbers[1:]]
    assert [frame.device_seq for frame in frames] == [1, 2, 4, 5, NO_COUNTER]
    flagged = [Quality.DROPPED_BEFORE in frame.quality for frame in frames]
    assert flagged == [False, False, True, False, False]


class Camera:
    """The far end of the control endpoint, as the public program drives it."""

    def __init__(self):
        self.written, self.statuses, self.tables = [], [], {0x8514: {5: 1}, 0x8214: {0: 1}}
        self.refuses = ()
        self.reply = b""

    @property
    def properties(self):
        return self.tables[0x8514]

    def ctrl_transfer(self, kind, request, value, index, data):
        assert value == 0x78
        if (kind, request) == (0xC1, 0x44):
            if index == 0x0200:
                return [self.statuses.pop(0) if self.statuses else 0]
            return list(self.reply[:data])
        assert (kind, request) == (0x41, 0x45)
        self.written.append((index, bytes(data)))
        if index == 0x9D00:
            code, item, number = struct.unpack("<H", data[:2]) + struct.unpack(">HI", data[2:])
            table = self.tables.get(code & ~0x4000, {})
            if code & 0x4000 and item not in self.refuses:
                table[item] = number
            self.reply = table.get(item, 0).to_bytes(2, "big")
        return None


@pytest.fixture
def far():
    return Camera()


@pytest.fixture
def commands(far):
    return Commands(far, "in the test", HostClock())


def test_information_is_asked_with_a_big_endian_length(far, commands):
    far.reply = b"20220808"
    assert commands.information(1, 8) == b"20220808"
    assert far.written == [(0x1D00, bytes.fromhex("0584 01000000 0008"))]


def test_property_is_written_and_read_back(far, commands):
    assert commands.set(p2pro.PROPERTIES, p2pro.GAIN, 0) == 0
    assert far.written[:2] == [
        (0x9D00, bytes.fromhex("14c5 0005 00000000")),
        (0x1D08, bytes.fromhex("00000000 00000000")),
    ]
    assert far.written[3] == (0x1D08, bytes.fromhex("00000000 00000002"))


def test_busy_camera_is_waited_for_and_a_refusal_is_an_error(far, commands):
    far.statuses = [1, 1, 0]
    commands.calibrate()
    far.statuses = [0x0A]
    with pytest.raises(DeviceError, match="0x0a"):
        commands.calibrate()


USB = UsbIdentity(0x0BDA, 0x5830, "", "1-2")


def connected(far, monkeypatch, **options):
    # the camera's commands go by vendor requests; which device they go to is found by pyusb
    monkeypatch.setattr(p2pro, "usb_instruments", lambda kinds: [(far, USB)])
    return p2pro.connect(
        USB, HostClock(), p2pro.requested_settings(DeviceSettings("ir", "p2pro", options=options))
    )


def test_camera_tells_what_it_is_and_takes_a_gain(far, monkeypatch):
    channel, facts = connected(far, monkeypatch, gain="low")
    assert channel is not None
    assert (facts["gain"], far.properties[5]) == ("low", 0)


# Codes and byte orders as P2Pro-Viewer sends them (P2Pro_cmd.py: code little-endian with 0x4000 to
# set, the rest big-endian); counts per metre and of emissivity 1 as in the maker's header.
@pytest.mark.parametrize(
    ("options", "sent"),
    [
        ({"gain": "high"}, "14c5 0005 00000001"),
        ({"emissivity": 1.0}, "14c5 0003 00000080"),
        ({"emissivity": 0.95}, "14c5 0003 0000007a"),
        ({"distance_m": 25}, "14c5 0000 00000c80"),
        ({"auto_shutter": True}, "14c2 0000 00000001"),
    ],
)
def test_settings_are_written_as_the_public_program_does(far, monkeypatch, options, sent):
    connected(far, monkeypatch, **options)
    assert far.written[:2] == [(0x9D00, bytes.fromhex(sent)), (0x1D08, bytes(8))]


def test_camera_whose_shutter_must_not_run_by_itself_is_calibrated_once(far, monkeypatch):
    _, facts = connected(far, monkeypatch, auto_shutter=False)
    assert far.written[0] == (0x9D00, bytes.fromhex("14c2 0000 00000000"))
    assert (0x1D00, bytes.fromhex("0dc1 00000000 0000")) in far.written
    assert facts["auto_shutter"] == 0


def test_setting_the_firmware_ignores_is_an_error(far, monkeypatch):
    far.refuses = (0,)
    with pytest.raises(DeviceError, match=r"3\.0: .* 384, .* 0\b", check=at("distance_m")):
        connected(far, monkeypatch, distance_m=3)


def test_emissivity_may_be_read_back_one_count_lower(far, monkeypatch):
    far.properties[3], far.refuses = 127, (3,)  # as by the reading that 127 is 1
    assert connected(far, monkeypatch, emissivity=1.0)[1]["camera_emissivity_counts"] == 127


@pytest.mark.parametrize(("counts", "applied"), [(128, 1.0), (127, 1.0), (122, 0.9531), (64, 0.5)])
def test_the_emissivity_that_the_camera_applies_is_reported(far, monkeypatch, counts, applied):
    """128 counts are 1 by the maker's header, 127 by the public program: neither is a correction."""
    far.properties[3] = counts
    assert connected(far, monkeypatch)[1]["emissivity"] == applied
    far.properties[3] = 0  # no reply
    assert "emissivity" not in connected(far, monkeypatch)[1]


@pytest.mark.parametrize(
    "options", [{"gain": "medium"}, {"emissivity": 95}, {"distance_m": -1}, {"auto_shutter": "off"}]
)
def test_settings_no_camera_has_are_refused_before_it_is_opened(reel, options):
    source = reel(frame())
    with pytest.raises(ConfigError, match=next(iter(options))):
        opened(source, **options)
    assert len(source.buffers) == 1


def test_unreachable_commands_are_a_fact_unless_a_setting_is_wanted(reel):
    camera = opened(reel(frame()))
    assert camera.info.settings["commands"] == "not reachable"
    assert camera.run_shutter() is False
    source = reel(frame())
    with pytest.raises(DeviceAccessError, check=at("gain")):
        opened(source, gain="low")
    assert source.closed


def test_a_scene_with_edges_and_one_as_hot_as_a_stove_are_temperatures():
    """Neighbours that differ by 50 counts, 0.8 K; and 516 K, beyond the grey values a frame may have."""
    for row in (18_890 + 25 * (-1) ** np.arange(256), 33_100 + np.arange(256) % 7):
        assert decode(frame(np.tile(row, (192, 1)))).quality == Quality.GOOD
