import math

import pytest

from fieldkit.drivers.decoding import Rejected
from fieldkit.drivers.meters.center import Center303, parse_two_probes
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


@pytest.mark.parametrize(
    ("windows", "channels"),
    [(0x00, ("T1-T2", "T1")), (0x40, ("T1-T2", "T2")), (0x80, ("T1", "T2")), (0xC0, ("T2", "T1"))],
)
def test_windows_say_which_value_is_which(windows, channels):
    record = parse_two_probes(bytes([2, 0x80, windows]) + RECORD[3:])
    assert tuple(value.channel for value in record.values) == channels


def test_signs_decimals_and_overloads_belong_to_their_value():
    main, sub = parse_two_probes(bytes([2, 0x80, 0x80 | 0b100_010]) + RECORD[3:]).values
    assert (main.value, sub.value) == (-23.5, 198.0)
    open_probes = parse_two_probes(bytes([2, 0x80, 0x80 | 0b001_001]) + RECORD[3:]).values
    assert all(math.isnan(value.value) for value in open_probes)


def test_digits_that_are_not_decimal_are_rejected():
    assert isinstance(parse_two_probes(RECORD[:4] + b"\x3a" + RECORD[5:]), Rejected)


def test_leading_digits_may_be_blank():
    # B as ehennes775/ginstlog found it on a B&K 710
    record = parse_two_probes(bytes.fromhex("02 80 80 B2 35 BB B8 03"))
    assert [value.value for value in record.values] == [23.5, 0.8]
    assert isinstance(parse_two_probes(bytes.fromhex("02 80 80 2B 35 01 98 03")), Rejected)
    assert isinstance(parse_two_probes(bytes.fromhex("02 80 80 BB BB 01 98 03")), Rejected)


@pytest.mark.parametrize("model", ["300", "302"])
def test_sub_of_a_model_with_one_probe_is_a_timer(wire, model):
    # Voltcraft's sheet for these two: 23.5 °C, and 1:42 on the timer, in minutes
    record = bytes.fromhex("02 80 10 02 35 01 42 03")
    device = opened(wire, record, model.encode())
    assert device.info.channels == ("T1",)
    assert device.read(1.0).values == (pytest.approx(23.5 + 273.15),)
    (value,) = Center303().decode(record, {"model": int(model)}).values
    assert (value.channel, value.value, value.states) == ("T1", 23.5, ())


def test_difference_on_the_display_is_not_recorded(wire):
    device = opened(wire, bytes([2, 0x80, 0x00]) + RECORD[3:])
    first, second = device.read(1.0).values
    assert first == pytest.approx(19.8 + 273.15)
    assert math.isnan(second)


def test_relative_display_has_no_temperature(wire):
    """0.7 degrees against a temperature that the display does not name."""
    device = opened(wire, bytes.fromhex("02 90 80 00 07 01 98 03"))
    reading = device.read(1.0)
    assert all(map(math.isnan, reading.values))
    assert reading.quality == Quality.NO_VALUE
    assert reading.raw == bytes.fromhex("02 90 80 00 07 01 98 03")
    assert device.states == ("relative",)
    assert not is_usable(reading.quality)


@pytest.mark.parametrize(("state", "states"), [(0x20, ("hold",)), (0x01, ("max_min",)), (0x04, ("max_min",))])
def test_held_and_extreme_displays_are_not_the_temperature_of_now(wire, state, states):
    device = opened(wire, bytes([2, 0x80 | state]) + RECORD[2:])
    reading = device.read(1.0)
    assert reading.values == pytest.approx((296.65, 292.95))  # as the display shows it
    assert reading.quality == Quality.STALE
    assert device.states == states
    assert not is_usable(reading.quality)


def test_four_channel_sibling_is_named(wire):
    wire.reply({b"K": b"309\r"})
    with pytest.raises(DeviceNotFoundError) as caught:
        Center303().open(settings(wire), HostClock())
    assert 'driver = "center-309"' in caught.value.fix
