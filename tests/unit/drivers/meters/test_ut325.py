import pytest

from fieldkit.drivers.meters.ut325 import Ut325, characters, parse
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import DeviceNotFoundError
from tests.harness.conformance import conforms
from tests.harness.usb_bus import Instrument

RECORD = bytes.fromhex("30 3A 32 35 33 31 30 30 30 30 30 30 30 30 30 30 31 0D 0A")


def test_reports_of_the_bridge_say_how_much_they_carry():
    assert characters(bytes([0xF3, 1, 2, 3, 0, 0, 0, 0])) == b"\x01\x02\x03"
    assert characters(bytes([0xF0, 1, 2, 3, 0, 0, 0, 0])) == b""
    assert characters(bytes([0x03, 1, 2, 3])) == b""
    assert characters(b"") == b""


def test_nothing_before_the_line_end_is_kept_of_a_record_that_is_none():
    assert parse(RECORD[:5] + b"4" + RECORD[6:]).length == 19
    assert parse(RECORD[15:] + RECORD[:15]).length == 4
    assert parse(RECORD[:17] + b"??").length == 1


# --- the driver and its HID bridge over real pyusb, against a CH9325 with the meter behind it
#
# The bridge as sigrok describes it: a feature report of five bytes sets the speed, reports of eight bytes
# carry up to seven characters after F0 plus their number; one sent to it begins with the number alone.


# instruments' own layout: 25.3 °C
T1 = bytes.fromhex("30 3A 32 35 33 31 30 30 30 30 30 30 30 30 30 30 31 0D 0A")
T2 = bytes.fromhex("30 3B 3A 35 32 31 30 30 30 30 30 30 30 31 30 30 31 0D 0A")  # -5.2 °C


class Ch9325(Instrument):
    ids = (0x1A86, 0xE008)
    strings = ("WCH", "HID", "")
    endpoints = ((0, 0, ((0x82, 3), (0x02, 3))),)

    def __init__(self, port=2):
        super().__init__(port)
        self.claimed_by_kernel = True  # usbhid takes it when it is plugged in
        self.speed, self.live, self.turn, self.characters = 0, False, 0, b""
        self.meter_is_on = True

    def control(self, kind, request, value, index, data):
        if (kind, request, value, index) != (0x21, 0x09, 0x0300, 0):
            return None
        self.speed = int.from_bytes(data[:2], "little")
        return b""

    def written(self, endpoint, data):
        assert (endpoint, len(data), data[0]) == (0x02, 8, 1)
        self.live = {1: True, 2: False}[data[1]]

    def pending(self, endpoint):
        if self.speed != 2400 or not (self.live and self.meter_is_on):
            return b""
        if not self.characters:
            self.characters = (T1, T2)[self.turn % 2]
            self.turn += 1
        given, self.characters = self.characters[:7], self.characters[7:]
        return bytes([0xF0 + len(given)]) + given.ljust(7, b"\0")


@pytest.fixture
def bridge(usb_bus):
    bridge = Ch9325()
    usb_bus(bridge)
    return bridge


def opened(**given):
    return Ut325().open(DeviceSettings("t", "ut325", **given), HostClock())


def test_bridge_is_found_by_its_identity(bridge):
    (found,) = Ut325().find()
    assert (found.identity, found.port) == ("1a86:e008", "usb:1-2")
    assert found.caveat


def test_readings_come_through_the_bridge(bridge):
    device = opened()
    readings = [device.read(1.0) for _ in range(4)]
    assert {reading.raw for reading in readings} == {T1, T2}
    found = sorted(value for reading in readings for value in reading.values if value == value)
    assert found == pytest.approx([273.15 - 5.2] * 2 + [273.15 + 25.3] * 2)
    assert (device.info.serial_number, device.info.identity, bridge.speed) == ("", "1a86:e008", 2400)
    device.close()
    device.close()


def test_two_alike_are_told_apart_by_their_socket(usb_bus):
    usb_bus(Ch9325(2), Ch9325(3))
    with pytest.raises(DeviceNotFoundError, match="2 USB instruments"):
        opened()
    assert opened(identity="1-3").info.port == "usb:1-3"


def test_driver_conforms_on_its_bridge(bridge):
    conforms(Ut325(), DeviceSettings("t", "ut325"), bridge)
