"""Frames: "GY-MCU90640 Module User Manual V1.0"; texts: the examples of SparkFun and Adafruit."""

import re

import numpy as np
import pytest

from fieldkit.drivers.cameras.mlx90640 import Mlx90640, command, decode
from fieldkit.drivers.decoding import Rejected
from fieldkit.drivers.registry import open_device
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import ConfigError
from fieldkit.model.samples import Quality
from tests.harness.conformance import conforms

EMISSIVITY_095 = bytes.fromhex("5A 5A 5F 13")  # printed in the manual


def frame(celsius=36.94, own=37.25):
    """Words of the manual's example: 0E6E for the first point, 0E8D for the sensor itself, header 0206."""
    words = np.full(772, round(100 * celsius), "<i2")
    words[[0, 1, 770]] = 0x5A5A, 0x0602, round(100 * own)
    words[-1] = np.array(sum(words[:-1].view("<u2").tolist()) & 0xFFFF, "<u2").view("<i2")
    return words.tobytes()


@pytest.mark.parametrize(("celsius", "own"), [(36.94, 37.25), (-12.34, -5.0)])
def test_points_and_own_temperature_are_hundredths_of_a_degree(celsius, own):
    assert frame()[:6] == bytes.fromhex("5A5A 0206 6E0E")
    assert frame()[-4:-2] == bytes.fromhex("8D0E")
    decoded = decode(frame(celsius, own))
    assert decoded.counts.shape == (24, 32)
    assert decoded.counts[23, 31] * decoded.scale == pytest.approx(celsius + 273.15)
    assert decoded.fpa_temperature_k == pytest.approx(own + 273.15)
    assert decoded.quality == Quality.GOOD


def test_a_wrong_sum_is_rejected_and_the_next_frame_found():
    damaged = bytearray(frame())
    damaged[700] ^= 1
    decoded = Mlx90640().decode(bytes(damaged) + EMISSIVITY_095 + frame() + frame()[:9], {})
    assert decoded.notes == ("emissivity 0.95", "frame of 32x24")
    assert [part.length for part in decoded.rejected] == [1544]
    assert decoded.rest == 9


@pytest.mark.parametrize(
    ("sent", "printed"),
    [
        (command(b"\xa5\x35\x02"), "A5 35 02 DC"),
        (command(b"\xa5\x25", 3), "A5 25 03 CD"),
        (command(b"\xa5\x45", 95), "A5 45 5F 49"),
        (command(b"\xa5\x55\x01"), "A5 55 01 FB"),
    ],
)
def test_commands_are_those_of_the_manual(sent, printed):
    assert sent == bytes.fromhex(printed)


def sparkfun(celsius):
    """SparkFun_MLX90640_Arduino_Example, Example2_OutputToProcessing."""
    numbers = [f"{one:.2f}," for one in celsius]
    rows = ["\r\n" + "".join(numbers[start : start + 8]) for start in range(0, 768, 8)]
    return ("".join(rows) + "Read time: 250\r\n").encode()


def adafruit(celsius):
    """Adafruit_MLX90640, MLX90640_simpletest with temperatures."""
    rows = ["".join(f"{one:.1f}, " for one in celsius[start : start + 32]) for start in range(0, 768, 32)]
    return ("\r\n".join([*rows, "", "", "===================================="]) + "\r\n").encode()


def in_one_line(celsius):
    return (",".join(f"{one:.2f}" for one in celsius) + "\r\n").encode()


@pytest.mark.parametrize("printed", [sparkfun, adafruit, in_one_line])
def test_images_as_text_are_read_from_the_middle_on(printed):
    celsius = np.arange(768) / 10 - 20
    text = printed(celsius)
    decoded = Mlx90640().decode(text[4000:] + text + text, {})
    assert [one.value for one in decoded.values] == pytest.approx(
        2 * [253.15, 253.15 + 76.7 / 2, 253.15 + 76.7], abs=0.011
    )
    (beginning,) = decoded.rejected
    assert re.findall(r"\d+", beginning.reason)[-2:] == ["768", "192"]


def test_the_small_sensor_is_known_by_its_count():
    assert decode(in_one_line(np.full(192, 21.5))).counts.shape == (12, 16)
    assert isinstance(decode(in_one_line(np.full(100, 21.5))), Rejected)


def test_a_module_is_opened_with_its_emissivity_and_read(wire):
    wire.talk(EMISSIVITY_095 + frame(21.5) + frame(21.6))
    device = wire.open(Mlx90640(), DeviceSettings("ir", "mlx90640", port=wire.path))
    info = device.info
    assert (info.unit, info.shape, info.settings["emissivity"]) == ("K", (24, 32), 0.95)
    frames = filter(None, (device.read(1.0) for _ in range(8)))
    kelvin = {round(float(one.counts[0, 0]) * info.scale, 2) for one in frames}
    assert kelvin == {294.65, 294.75}
    assert not device.run_shutter()


def test_a_module_conforms_on_its_port(wire):
    wire.talk(EMISSIVITY_095 + frame(21.5) + frame(21.6))
    conforms(Mlx90640(), DeviceSettings("t", "mlx90640", port=wire.path), wire)


def test_wrong_options_say_what_is_expected():
    with pytest.raises(ConfigError, match=r"emissivity = 1\.2 .* 0\.01 to 1\b"):
        open_device(DeviceSettings("ir", "mlx90640", options={"emissivity": 1.2}), HostClock())
