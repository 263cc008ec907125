import math

import pytest

from fieldkit.clock import HostClock
from fieldkit.device import DeviceSettings
from fieldkit.drivers.meters.center_303 import Center303, take
from fieldkit.drivers.records import Rejected
from fieldkit.errors import DeviceNotFoundError

RECORD = bytes.fromhex("02 80 80 02 35 01 98 03")


def settings(wire):
    return DeviceSettings("t", "center-303", port=wire.path, every_s=0.02)


@pytest.mark.parametrize(
    ("windows", "channels"),
    [(0x00, ("T1-T2", "T1")), (0x40, ("T1-T2", "T2")), (0x80, ("T1", "T2")), (0xC0, ("T2", "T1"))],
)
def test_windows_say_which_value_is_which(windows, channels):
    record = take(bytes([2, 0x80, windows]) + RECORD[3:])
    assert tuple(value.channel for value in record.values) == channels


def test_signs_decimals_and_overloads_belong_to_their_value():
    main, sub = take(bytes([2, 0x80, 0x80 | 0b100_010]) + RECORD[3:]).values
    assert (main.value, sub.value) == (-23.5, 198.0)
    main, sub = take(bytes([2, 0x80, 0x80 | 0b001_001]) + RECORD[3:]).values
    assert math.isnan(main.value)
    assert math.isnan(sub.value)


def test_digits_that_are_not_decimal_are_rejected():
    assert isinstance(take(RECORD[:4] + b"\x3a" + RECORD[5:]), Rejected)


def test_difference_on_the_display_is_not_recorded(wire):
    wire.answer({b"K": b"303\r", b"A": bytes([2, 0x80, 0x00]) + RECORD[3:]})
    device = Center303().open(settings(wire), HostClock())
    first, second = device.read(1.0).values
    assert first == pytest.approx(19.8 + 273.15)
    assert math.isnan(second)
    device.close()


def test_four_channel_sibling_is_named(wire):
    wire.answer({b"K": b"309\r"})
    with pytest.raises(DeviceNotFoundError) as caught:
        Center303().open(settings(wire), HostClock())
    assert caught.value.fix == 'driver = "center-309"'
