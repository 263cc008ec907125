import numpy as np
import pytest

from fieldkit.drivers.cameras import boson
from fieldkit.drivers.cameras.boson import Boson, BosonSerial, decode, pack, parse, unpack
from fieldkit.drivers.decoding import Rejected
from fieldkit.drivers.opening import open_with
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import ConfigError, DeviceError, DeviceTimeoutError
from fieldkit.model.next_step import Action
from fieldkit.model.samples import Quality
from tests.harness.next_steps import at


def frame(count=29515, rows=512, seed=0):
    return (count + np.random.default_rng(seed).integers(-9, 9, (rows, 640))).astype("<u2").tobytes()


def opened(source, **options):
    return open_with(Boson(), DeviceSettings("ir", "boson", source=source, options=options), HostClock())


def test_frame_is_escaped_and_taken_apart_again():
    frame = pack(0x8E9EAE, 0x00050030, bytes([0x8E, 0x9E, 0xAE, 0x81]))
    assert frame[0] == 0x8E
    assert frame[-1] == 0xAE
    assert not {0x8E, 0xAE} & set(frame[1:-1])
    assert unpack(frame) == (0x8E9EAE, 0x00050030, 0xFFFFFFFF, bytes([0x8E, 0x9E, 0xAE, 0x81]))


def test_question_is_laid_out_as_published():
    # 8E, channel, sequence 1, function, FFFFFFFF; CRC-16 with start 1D0F, whose check value is E5CC
    assert pack(1, 0x00050007)[:14] == bytes.fromhex("8E 00 00000001 00050007 FFFFFFFF")


def test_damaged_frame_is_rejected():
    frame = bytearray(pack(1, 0x00050007))
    frame[5] ^= 1
    rejected = parse(bytes(frame))
    assert isinstance(rejected, Rejected)
    assert rejected.length == len(frame)


def answering(function, payload, sequence=1, status=0):
    return pack(sequence, function, payload, status)


@pytest.mark.parametrize(
    "late",
    [
        answering(0x00050030, (999).to_bytes(2, "big"), sequence=77),
        answering(0x0005000C, (2).to_bytes(4, "big")),  # from before it was opened again: numbers begin anew
    ],
)
def test_answer_belongs_to_its_question(wire, late):
    wire.reply({pack(1, 0x00050030): late + answering(0x00050030, (251).to_bytes(2, "big"))})
    serial = BosonSerial(wire.path, HostClock())
    assert serial.fpa_temperature_k() == pytest.approx(298.25)
    serial.close()


def test_refusal_and_silence_are_errors(wire):
    wire.reply({pack(1, 0x0005000C): answering(0x0005000C, b"", status=0x0161)})
    serial = BosonSerial(wire.path, HostClock())
    with pytest.raises(DeviceError, match="0x0005000c", check=at(wire.path)):
        serial.is_shutter_running()
    with pytest.raises(DeviceTimeoutError, check=at(wire.path, Action.DOCTOR())):
        serial.is_shutter_running()
    serial.close()


@pytest.mark.parametrize(
    ("options", "unit", "quality"),
    [({}, "counts", Quality.NO_VALUE), ({"kelvin_per_count": 0.01}, "K", Quality.GOOD)],
)
def test_a_plain_boson_gives_counts_and_a_radiometric_one_kelvin_times_100(reel, options, unit, quality):
    camera = opened(reel(frame(), frame(seed=1)), **options)
    assert (camera.info.unit, camera.info.shape) == (unit, (512, 640))
    assert camera.info.settings["commands"] == "not reachable"
    assert camera.read(1.0).quality == quality


def test_two_more_rows_are_kept():
    told = decode(frame(rows=514), 0.01)
    assert told.counts.shape == (512, 640)
    assert told.metadata_rows.shape == (2, 640)


class Serial:
    """The serial side's answers."""

    def __init__(self):
        self.asked, self.running, self.gain = [], False, "high"

    def make_radiometric(self):
        self.asked.append("radiometric")

    def facts(self):
        return {"serial_number": "4711", "model": "20640A", "gain": self.gain}

    def fpa_temperature_k(self):
        return 298.25

    def is_shutter_running(self):
        return self.running

    def request(self, function):
        self.asked.append(function)

    def close(self):
        self.asked.append("close")


@pytest.fixture
def serial(monkeypatch):
    serial = Serial()
    # a pseudo-terminal has no USB identity by which a camera finds its serial side
    monkeypatch.setattr(boson, "serial_side", lambda *_: serial)
    return serial


def test_serial_side_tells_sensor_and_shutter(reel, serial):
    camera = opened(reel(*(frame(seed=seed) for seed in range(14))), radiometric=True)
    assert (camera.info.scale, camera.info.serial_number) == (0.01, "4711")
    first = camera.read(1.0)
    assert first.fpa_temperature_k == 298.25
    assert first.quality == Quality.GOOD
    serial.running = True
    assert [camera.read(1.0).quality for _ in range(11)][-1] == Quality.SHUTTER
    assert camera.run_shutter()
    camera.close()
    assert serial.asked == ["radiometric", 0x00050007, "close"]


@pytest.mark.parametrize("gain", ["low", "automatic", "dual", "manual", "unknown"])
def test_a_gain_that_is_or_may_become_low_needs_its_scale_told(reel, serial, gain):
    serial.gain = gain
    with pytest.raises(DeviceError, match=f"{gain} gain") as caught:
        opened(reel(frame()), radiometric=True)
    assert "kelvin_per_count" in str(caught.value.fix)


def test_low_gain_has_the_scale_it_is_told(reel, serial):
    serial.gain = "low"
    hot = frame(count=14757)  # 295.15 K x 50
    camera = opened(reel(hot, hot), radiometric=True, kelvin_per_count=0.02)
    assert (camera.info.scale, camera.info.settings["gain"]) == (0.02, "low")


def test_silent_commands_do_not_cost_the_frames(reel, wire, monkeypatch):
    # as in `serial`, but the real side, with nothing at its end
    monkeypatch.setattr(boson, "serial_side", lambda *_: BosonSerial(wire.path, HostClock()))
    camera = opened(reel(frame(), frame(seed=1)), kelvin_per_count=0.01)
    assert wire.path in camera.info.settings["commands"]
    assert camera.read(1.0).quality == Quality.GOOD


def test_frames_from_before_the_switch_to_temperatures_are_let_go(reel, serial):
    """The kernel has buffered frames while the commands were sent; counts at 8192 are 82 K by TLinear."""
    camera = opened(reel(frame(8192), frame(8192, seed=1), frame(seed=2), frame(seed=3)), radiometric=True)
    assert camera.info.unit == "K"
    assert camera.read(1.0).quality == Quality.GOOD


def test_radiometric_that_gives_no_temperatures_is_refused(reel, serial):
    source = reel(frame(count=8000))
    with pytest.raises(DeviceError, match="no temperatures"):
        opened(source, radiometric=True)
    assert source.closed
    with pytest.raises(ConfigError):
        opened(source, radiometric="yes")
