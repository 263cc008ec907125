"""The layout and scale are those of AronNovak/PyThermalCamera, docs/TC002C-DUO.md."""

import numpy as np
import pytest

from fieldkit.drivers.cameras.tc002c import LENGTH, Tc002c, decode
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.samples import Quality


def frame(kelvin=295.0):
    """Row r, column c of the sensor is `kelvin` + r/16 K; telemetry 1, image white-hot grey."""
    words = np.full((484, 512), 0x8040, "<u2")
    sensor = np.rint(16 * kelvin) + np.arange(192)[:, None] + np.zeros(256)
    words[:96] = sensor.reshape(96, 512)
    words[96:98] = 1
    return words.tobytes()


def test_two_rows_of_the_sensor_stand_in_each_row_of_the_frame():
    decoded = decode(frame())
    assert decoded.counts.shape == (192, 256)
    assert (decoded.counts[[0, 1, 191], [0, 255, 7]] * decoded.scale).tolist() == [295.0, 295.0625, 306.9375]
    assert (decoded.metadata_rows == 1).all()
    assert decoded.metadata_rows.shape == (2, 512)
    assert decoded.quality == Quality.GOOD


def test_the_image_in_place_of_temperatures_is_no_value():
    grey = np.full(LENGTH // 2, 0x8040, "<u2").tobytes()
    assert decode(grey).quality & Quality.NO_VALUE


def test_it_is_opened_as_brightness_temperature(reel):
    source = reel(frame(), frame(296.0))
    device = Tc002c().open(DeviceSettings("ir", "tc002c", source=source), HostClock())
    assert (device.info.unit, device.info.shape, device.info.metadata_shape) == ("K", (192, 256), (2, 512))
    assert device.read(1.0).counts[0, 0] * device.info.scale == pytest.approx(296.0)
