import math

import pytest

from fieldkit.drivers.meters.center import Center309
from fieldkit.drivers.opening import open_with
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import ConfigError, DeviceNotFoundError
from fieldkit.model.samples import Quality

RECORD = bytes.fromhex("02 80 80 00 00 00 00 00 FD FF CC 03 ED 7F FF" + "00" * 24 + "08 00 00 00 00 03")

EVERY_S = 0.06  # a record is 47 ms on the wire


def settings(wire, every_s=EVERY_S, **given):
    return DeviceSettings("thermometer", "center-309", port=wire.path, every_s=every_s, **given)


def opened(wire, record=RECORD, **given):
    wire.reply({b"K": b"309\r", b"A": record})
    return wire.open(Center309(), settings(wire, **given))


def test_model_and_channels_are_declared(wire):
    device = opened(wire, options={"labels": ["reference", "b05", "b15"]})
    assert device.info.model == "309"
    assert device.info.channels == ("reference", "b05", "b15")
    assert (device.info.quantity, device.info.unit, device.info.shape) == ("temperature", "K", (3,))


def test_more_names_than_probes_are_refused_before_anything_is_recorded(wire):
    with pytest.raises(ConfigError, match=r"5 names .* 4 channels"):
        opened(wire, options={"labels": ["a", "b", "c", "d", "e"]})


def test_readings_are_kelvin_keep_their_bytes_and_are_good_where_one_probe_is_open(wire):
    reading = opened(wire).read(1.0)
    assert reading.values == pytest.approx((298.45, 267.95, 373.65, math.nan), nan_ok=True)
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


def test_sibling_of_another_record_is_named(wire):
    wire.reply({b"K": b"303\r"})
    with pytest.raises(DeviceNotFoundError, match="Center 303") as caught:
        open_with(Center309(), settings(wire), HostClock())
    assert 'driver = "center-303"' in caught.value.fix
