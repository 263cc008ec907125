import math

import pytest

from fieldkit.drivers.meters.center import Center303
from fieldkit.drivers.opening import open_with
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import DeviceNotFoundError
from fieldkit.model.samples import Quality, is_usable

RECORD = bytes.fromhex("02 80 80 02 35 01 98 03")


def settings(wire):
    return DeviceSettings("t", "center-303", port=wire.path, every_s=0.02)


def opened(wire, record, model=b"303"):
    wire.reply({b"K": model + b"\r", b"A": record})
    return wire.open(Center303(), settings(wire))


@pytest.mark.parametrize("model", ["300", "302"])
def test_sub_of_a_model_with_one_probe_is_a_timer(wire, model):
    # Voltcraft's sheet for these two: 23.5 °C, and 1:42 on the timer, in minutes
    record = bytes.fromhex("02 80 10 02 35 01 42 03")
    device = opened(wire, record, model.encode())
    assert device.info.channels == ("T1",)
    assert device.read(1.0).values == (pytest.approx(23.5 + 273.15),)


def test_difference_on_the_display_is_not_recorded(wire):
    device = opened(wire, bytes([2, 0x80, 0x00]) + RECORD[3:])
    first, second = device.read(1.0).values
    assert first == pytest.approx(19.8 + 273.15)
    assert math.isnan(second)


@pytest.mark.parametrize(
    ("state", "values", "quality", "states"),
    [
        (0x10, (math.nan, math.nan), Quality.NO_VALUE, ("relative",)),
        (0x20, (296.65, 292.95), Quality.STALE, ("hold",)),
    ],
)
def test_relative_and_held_displays_are_not_the_temperature_of_now(wire, state, values, quality, states):
    record = bytes([2, 0x80 | state]) + RECORD[2:]
    device = opened(wire, record)
    reading = device.read(1.0)
    assert reading.values == pytest.approx(values, nan_ok=True)
    assert (reading.quality, reading.raw, device.states) == (quality, record, states)
    assert not is_usable(reading.quality)


def test_four_channel_sibling_is_named(wire):
    wire.reply({b"K": b"309\r"})
    with pytest.raises(DeviceNotFoundError) as caught:
        open_with(Center303(), settings(wire), HostClock())
    assert 'driver = "center-309"' in caught.value.fix
