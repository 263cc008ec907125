import math

import pytest

from fieldkit.drivers.meters.center import Center303, Center309
from fieldkit.drivers.opening import open_with
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import ConfigError, DeviceNotFoundError
from fieldkit.model.samples import Quality, is_usable

RECORD_303 = bytes.fromhex("02 80 80 02 35 01 98 03")
RECORD_309 = bytes.fromhex("02 80 80 00 00 00 00 00 FD FF CC 03 ED 7F FF" + "00" * 24 + "08 00 00 00 00 03")
DRIVERS = {"303": Center303, "309": Center309}
EVERY_S = 0.06  # a record of a 309 is 47 ms on the wire


def settings(wire, driver, every_s=EVERY_S, **given):
    return DeviceSettings("thermometer", driver.name, port=wire.path, every_s=every_s, **given)


def opened(wire, record=RECORD_309, model="309", **given):
    wire.reply({b"K": model.encode() + b"\r", b"A": record})
    driver = DRIVERS.get(model, Center303)
    return wire.open(driver(), settings(wire, driver, **given))


@pytest.mark.parametrize("model", ["300", "302"])
def test_sub_of_a_model_with_one_probe_is_a_timer(wire, model):
    # Voltcraft's sheet for these two: 23.5 °C, and 1:42 on the timer, in minutes
    device = opened(wire, bytes.fromhex("02 80 10 02 35 01 42 03"), model)
    assert device.info.channels == ("T1",)
    assert device.read(1.0).values == (pytest.approx(23.5 + 273.15),)


@pytest.mark.parametrize(
    ("state", "values", "quality", "states"),
    [
        (0x10, (math.nan, math.nan), Quality.NO_VALUE, ("relative",)),
        (0x20, (296.65, 292.95), Quality.STALE, ("hold",)),
    ],
)
def test_relative_and_held_displays_are_not_the_temperature_of_now(wire, state, values, quality, states):
    record = bytes([2, 0x80 | state]) + RECORD_303[2:]
    device = opened(wire, record, "303")
    reading = device.read(1.0)
    assert reading.values == pytest.approx(values, nan_ok=True)
    assert (reading.quality, reading.raw, device.states) == (quality, record, states)
    assert not is_usable(reading.quality)


def test_difference_on_the_display_is_not_recorded(wire):
    first, second = opened(wire, bytes([2, 0x80, 0x00]) + RECORD_303[3:], "303").read(1.0).values
    assert first == pytest.approx(19.8 + 273.15)
    assert math.isnan(second)


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
    assert reading.raw == RECORD_309
    assert reading.quality == Quality.GOOD


class Sleepy(HostClock):
    """Its time passes in sleep alone, and every sleep lasts a tenth of a second too long."""

    now_ns = 0

    def mono_ns(self):
        return self.now_ns

    def sleep(self, seconds):
        self.now_ns += int(seconds * 1e9) + 100_000_000


def test_late_wakings_do_not_add_up_and_missed_turns_are_not_made_up_for(wire):
    wire.reply({b"K": b"309\r", b"A": RECORD_309})
    clock = Sleepy()
    device = wire.open(Center309(), settings(wire, Center309, every_s=1.0), clock)
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


@pytest.mark.parametrize(("driver", "model"), [(Center303, "309"), (Center309, "303")])
def test_sibling_of_another_record_is_named(wire, driver, model):
    wire.reply({b"K": model.encode() + b"\r"})
    with pytest.raises(DeviceNotFoundError, match=f"Center {model}") as caught:
        open_with(driver(), settings(wire, driver), HostClock())
    assert f'driver = "center-{model}"' in caught.value.fix
