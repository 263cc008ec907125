import math

import pytest

from fieldkit.drivers.decoding import Rejected
from fieldkit.drivers.meters.pce_174 import ASK_LIVE, Pce174, parse
from fieldkit.model.device import DeviceSettings
from fieldkit.model.samples import Quality

RECORD = bytes.fromhex("AA DD 00 26 06 11 21 10 15 30 09 57 09 57 80 00 00 00")


def changed(**offsets):
    record = bytearray(RECORD)
    for name, value in offsets.items():
        record[int(name[1:])] = value
    return bytes(record)


@pytest.mark.parametrize(
    ("state", "unit", "value"),
    [
        *((state, "lx", value) for state, value in enumerate((98700, 98.7, 987, 9870))),
        *((state, "fc", value) for state, value in ((4, 9870), (5, 9.87), (7, 987))),
    ],
)
def test_unit_and_range_scale_the_value(state, unit, value):
    (found,) = parse(changed(_14=state)).values
    assert (found.unit, found.value) == (unit, pytest.approx(value))


def test_relative_mode_has_no_value():
    """The program of philpagel/PCE174-communication takes bytes 10-11, its protocol.md bytes 12-13."""
    (found,) = parse(changed(_10=0, _11=5, _14=6 << 3)).values
    assert math.isnan(found.value)
    assert found.flags == ["no_value", "relative"]


@pytest.mark.parametrize(
    ("state", "flags"),
    [  # the whole byte, and the mode that philpagel/PCE174-communication (protocol.md) names
        (0x91, ["stale", "peak_minimum"]),
        (0x99, ["stale", "peak_maximum"]),
        (0xA1, ["stale", "maximum"]),
        (0xA9, ["stale", "minimum"]),
        (0xB1, ["no_value", "relative"]),
        (0x81, []),
    ],
)
def test_modes_are_told_and_extremes_are_not_the_light_of_now(state, flags):
    (found,) = parse(changed(_14=state)).values
    assert found.flags == flags


def test_minus_and_low_battery_are_read():
    (found,) = parse(changed(_15=0x30)).values
    assert (found.value, found.flags) == (-98700, ["low_battery"])


def test_end_of_range_is_flagged():
    (found,) = parse(changed(_10=39, _11=99)).values
    assert found.quality == Quality.OVERRANGE


@pytest.mark.parametrize("wrong", [{"_2": 1}, {"_3": 0x2A}, {"_10": 100}, {"_13": 200}])
def test_what_the_layout_forbids_is_rejected(wrong):
    assert isinstance(parse(changed(**wrong)), Rejected)


def test_meter_is_polled(wire):
    wire.reply({ASK_LIVE: RECORD})
    device = wire.open(Pce174(), DeviceSettings("lux", "pce-174", port=wire.path, every_s=0.02))
    assert device.read(1.0).values == (98700.0,)
