import math

import pytest

from fieldkit.drivers import registry
from fieldkit.drivers.meters.lutron import Lutron
from fieldkit.model.clock import HostClock
from fieldkit.model.device import Device, DeviceSettings
from fieldkit.model.errors import ConfigError, DecodeError
from fieldkit.model.samples import Quality

LUX = bytes.fromhex("02 34 31 31 35 30 30 30 30 30 39 38 37 36 30 0D")
T2 = bytes.fromhex("02 34 32 30 31 31 31 30 30 30 30 30 31 32 37 0D")
NO_PROBE = bytes.fromhex("02 34 32 30 31 30 31 18 18 18 18 18 18 18 18 0D")


def settings(wire, **options):
    return DeviceSettings("lux", "lutron", port=wire.path, options=options)


@pytest.fixture
def opened(wire):
    def open_with(record, **options):
        wire.talk(record)
        return wire.open(Lutron(), settings(wire, **options))

    return open_with


def test_light_meter_declares_lux_before_its_first_reading(opened):
    device = opened(LUX)
    assert isinstance(device, Device)
    assert (device.info.quantity, device.info.unit, device.info.channels) == ("illuminance", "lx", ("lux",))
    assert device.info.wire_time_s == pytest.approx(0.0167, abs=1e-4)
    reading = device.read(1.0)
    assert (reading.values, reading.raw, reading.quality) == ((98760.0,), LUX, Quality.GOOD)


def test_end_of_range_is_flagged(opened):
    assert opened(LUX, range_max_lx=98760).read(1.0).quality == Quality.OVERRANGE


def test_thermometer_stores_kelvin_per_display(opened):
    device = opened(T2, labels=["reference", "bed"])
    assert (device.info.quantity, device.info.unit) == ("temperature", "K")
    values = device.read(1.0).values
    assert math.isnan(values[0])
    assert values[1] == pytest.approx(273.15 - 12.7)


@pytest.mark.parametrize("turn", [LUX + T2, T2 + LUX], ids=["light first", "temperature first"])
def test_a_light_meter_with_a_thermocouple_is_one_of_light_whatever_comes_first(opened, turn):
    assert opened(turn).info.quantity == "illuminance"


def test_open_probe_is_no_value(opened):
    reading = opened(NO_PROBE, labels=["reference", "bed"]).read(1.0)
    assert all(math.isnan(value) for value in reading.values)
    assert reading.quality == Quality.NO_VALUE
    assert reading.raw == NO_PROBE


def test_record_of_another_quantity_is_rejected(opened):
    device = opened(LUX + T2)
    assert {device.read(0.2).values for _ in range(4)} == {(98760.0,)}
    assert device.rejected >= 1


@pytest.mark.usefixtures("impatient")
def test_other_meter_on_the_line_is_a_decode_error_with_its_bytes(wire):
    wire.talk(b"T1= 23.5 C\r\n")
    with pytest.raises(DecodeError, match=r"\d+ bytes") as caught:
        Lutron().open(settings(wire), HostClock())
    assert b"T1= 23.5 C\r\n" in caught.value.raw


def test_meter_of_neither_light_nor_temperature_is_refused(wire):
    wire.talk(LUX.replace(b"\x3115", b"\x3117"))
    with pytest.raises(DecodeError, match="sends dB"):
        Lutron().open(settings(wire), HostClock())


def test_unknown_option_is_refused_with_the_near_one(wire):
    with pytest.raises(ConfigError, match=r"range_max_lx\?"):
        registry.open_device(settings(wire, range_max_lux=1), HostClock())
