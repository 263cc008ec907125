import math

import pytest

from fieldkit.drivers.decoding import Record, Rejected
from fieldkit.drivers.meters.center import Center309, parse
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import ConfigError, DeviceNotFoundError, DeviceTimeoutError
from fieldkit.model.samples import Quality

RECORD = bytes.fromhex("02 80 80 00 00 00 00 00 FD FF CC 03 ED 7F FF" + "00" * 24 + "08 00 00 00 00 03")

EVERY_S = 0.06  # a record is 47 ms on the wire


def settings(wire, every_s=EVERY_S, **given):
    return DeviceSettings("thermometer", "center-309", port=wire.path, every_s=every_s, **given)


def opened(wire, record=RECORD, **given):
    wire.reply({b"K": b"309\r", b"A": record})
    return wire.open(Center309(), settings(wire, **given))


@pytest.fixture
def device(wire):
    return opened(wire, options={"labels": ["reference", "b05", "b15"]})


def test_model_and_channels_are_declared(device):
    assert device.info.model == "309"
    assert device.info.channels == ("reference", "b05", "b15")
    assert (device.info.quantity, device.info.unit, device.info.shape) == ("temperature", "K", (3,))


def test_more_names_than_probes_are_refused_before_anything_is_recorded(wire):
    with pytest.raises(ConfigError, match=r"5 names .* 4 channels"):
        opened(wire, options={"labels": ["a", "b", "c", "d", "e"]})


def test_a_record_has_every_field():
    record = parse(RECORD)
    assert Record(*record) == record


def test_readings_are_kelvin_and_keep_their_bytes(device):
    reading = device.read(1.0)
    assert reading.values == pytest.approx((298.45, 267.95, 373.65))
    assert reading.raw == RECORD
    assert reading.quality == Quality.GOOD


class Sleepy(HostClock):
    """Its time passes in sleep alone, and every sleep lasts a tenth of a second too long."""

    now_ns = 0

    def mono_ns(self):
        return self.now_ns

    def sleep(self, seconds):
        self.now_ns += int(seconds * 1e9) + 100_000_000


def test_late_wakings_do_not_add_up_and_missed_turns_are_not_made_up_for(wire):
    wire.reply({b"K": b"309\r", b"A": RECORD})
    clock = Sleepy()
    device = wire.open(Center309(), settings(wire, every_s=1.0), clock)
    asked_s = []
    for away_s in (0, 0, 0, 5, 0):
        clock.now_ns += away_s * 1_000_000_000
        assert device.read(2.0) is not None
        asked_s.append(clock.now_ns / 1e9)
    assert asked_s == pytest.approx([0.0, 1.1, 2.1, 7.1, 8.2])


def test_turn_that_is_not_due_is_none(wire):
    device = opened(wire, every_s=60)
    assert device.read(1.0) is not None
    assert device.read(0.01) is None


def test_open_probe_leaves_the_others_good(wire):
    reading = opened(wire).read(1.0)
    assert math.isnan(reading.values[3])
    assert reading.quality == Quality.GOOD


def test_lowest_number_is_no_temperature():
    # 8000 is -OL on an HH309A, by ehennes775/ginstlog
    values = parse(RECORD[:9] + b"\x80\x00" + RECORD[11:]).values
    assert [value.value for value in values[::2]] == [25.3, 100.5]
    assert math.isnan(values[1].value)


def test_held_display_is_stale(wire):
    device = opened(wire, RECORD[:1] + b"\xa0" + RECORD[2:])
    assert device.read(1.0).quality == Quality.STALE


@pytest.mark.parametrize(("state", "word"), [(0x10, "relative"), (0x02, "maximum"), (0x04, "minimum")])
def test_what_the_display_shows_does_not_change_the_temperatures_of_now(wire, state, word):
    """The record has those of REL, MIN and MAX apart, at offsets 15-38."""
    device = opened(wire, RECORD[:1] + bytes([0x80 | state]) + RECORD[2:])
    reading = device.read(1.0)
    assert reading.values[0] == pytest.approx(25.3 + 273.15)
    assert reading.quality == Quality.GOOD
    assert word in device.states


def test_sibling_of_another_record_is_named(wire):
    wire.reply({b"K": b"303\r"})
    with pytest.raises(DeviceNotFoundError, match="Center 303") as caught:
        Center309().open(settings(wire), HostClock())
    assert 'driver = "center-303"' in caught.value.fix


@pytest.mark.usefixtures("impatient")
def test_silent_thermometer_says_what_to_do(wire):
    with pytest.raises(DeviceTimeoutError, match="nothing received"):
        Center309().open(settings(wire), HostClock())


@pytest.mark.parametrize(("offset", "value"), [(0, 3), (44, 2), (7, 0x7F), (9, 0x80)])
def test_record_that_no_thermocouple_can_give_is_rejected(offset, value):
    broken = bytearray(RECORD)
    broken[offset] = value
    assert isinstance(parse(bytes(broken)), Rejected)
