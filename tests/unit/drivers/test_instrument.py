"""An instrument in the hands of a person: physical values, without the recorder."""

from datetime import UTC, datetime

import numpy as np
import pytest

from fieldkit.drivers.discovery import find_devices
from fieldkit.drivers.identity import UsbIdentity
from fieldkit.drivers.instrument import Instrument, MeasuredReading, open_device
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError, DeviceNotFoundError, DeviceTimeoutError
from fieldkit.model.next_step import Argument
from fieldkit.model.samples import Frame, Quality, Reading
from tests.harness.connected import plugged_in
from tests.harness.next_steps import at

NOON_NS = 1_780_000_000_000_000_000
NO_ROWS = np.empty((0, 0), np.uint16)


class Stub:
    """A device that delivers the samples it is given, then nothing."""

    def __init__(self, info, *samples):
        self.info, self.rejected, self.is_closed = info, 0, False
        self._samples = list(samples)

    def read(self, timeout_s):
        return self._samples.pop(0) if self._samples else None

    def close(self):
        self.is_closed = True


def camera(scale=0.01, law="linear"):
    info = StreamInfo("purethermal", "brightness_temperature", "K", (2, 2), scale, law=law, port="usb:1-1")
    counts = np.array([[29315, 29415], [30000, 31000]], np.uint16)
    return Stub(info, Frame("purethermal", 1, NOON_NS, counts, NO_ROWS, Quality.SHUTTER))


def test_a_frame_gives_kelvin():
    with Instrument(camera()) as opened:
        frame = opened.read()
    assert opened.device.is_closed
    assert repr(opened) == "<purethermal at usb:1-1: brightness_temperature [K], 2x2>"
    assert frame.kelvin.dtype == np.float64
    np.testing.assert_allclose(frame.kelvin, [[293.15, 294.15], [300.0, 310.0]])
    assert frame.counts.dtype == np.uint16
    assert not frame.is_usable
    assert frame.time == datetime.fromtimestamp(NOON_NS / 1e9, UTC)
    assert repr(frame) == "<frame of purethermal: 2x2, 2026-05-28 20:26:40.000 UTC, shutter>"


def test_a_frame_of_unknown_scale_is_nan_in_kelvin():
    assert np.isnan(Instrument(camera(scale=float("nan"))).read().kelvin).all()


def test_a_reading_gives_its_value_and_unit():
    info = StreamInfo("lux", "illuminance", "lx", (1,), channels=("lux",))
    reading = Instrument(Stub(info, Reading("lux", 1, NOON_NS, (98760.0,)))).read()
    assert (reading.value, reading.unit, reading.values) == (98760.0, "lx", {"lux": 98760.0})
    assert reading.is_usable
    assert "lux 98760 lx" in repr(reading)


def test_several_channels_are_read_by_name():
    info = StreamInfo("probes", "temperature", "K", (2,), channels=("T1", "T2"))
    reading = MeasuredReading(Reading("probes", 1, NOON_NS, (293.15, float("nan"))), info)
    assert reading.values["T1"] == 293.15
    with pytest.raises(ValueError, match="several channels"):
        _ = reading.value


def test_a_silent_instrument_is_a_timeout():
    opened = Instrument(camera())
    opened.read()
    with pytest.raises(DeviceTimeoutError, match="usb:1-1"):
        opened.read(0.1)


def test_a_found_device_is_opened_by_identity_whatever_its_number(monkeypatch, tmp_path):
    usb = UsbIdentity(0x1E4E, 0x0100, title="PureThermal")
    plugged_in(monkeypatch, cameras=[("/dev/video0", usb)])
    (found,) = find_devices()
    assert repr(found) == "<PureThermal [1e4e:0100] at /dev/video0: purethermal>"
    plugged_in(monkeypatch, cameras=[(f"{tmp_path}/video2", usb)])
    for given in ((found,), ()):
        with pytest.raises(DeviceNotFoundError, check=at(f"{tmp_path}/video2")):
            open_device(*given)


def test_a_device_that_two_drivers_recognise_needs_a_choice(monkeypatch):
    plugged_in(monkeypatch, serial_ports=[("/dev/ttyUSB0", UsbIdentity(0x10C4, 0xEA60, title="CP2102"))])
    (adapter,) = find_devices()
    assert {"lutron", "pce-174"} <= set(adapter.drivers)
    with pytest.raises(ConfigError, check=at(repr(adapter))):
        open_device(adapter)
    with pytest.raises(DeviceNotFoundError, match="none", check=at(Argument("driver"))):
        open_device()
