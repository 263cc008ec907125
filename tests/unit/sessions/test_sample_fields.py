"""Every number of a sample is in its checksum, as it is stored."""

import math
import struct
import zlib

import numpy as np
import pytest

from fieldkit.model.samples import Quality
from fieldkit.sessions.sample_fields import with_stamps, with_stored

STAMPS = (1_000, 2_000_000, 3, 4, 5, Quality.SHUTTER | Quality.IMPLAUSIBLE, 300.0)
FLAGS = int(Quality.SHUTTER | Quality.IMPLAUSIBLE)
COLUMNS = {
    "mono_ns": [1_000], "time": [2_000], "device_time": [3], "seq": [4], "device_seq": [5], "flags": [FLAGS],
    "fpa_temperature": [300.0],
}  # fmt: skip


@pytest.mark.parametrize("sensor_k", [300.0, math.nan])
def test_the_checksum_is_over_the_numbers_as_stored(sensor_k):
    expected = zlib.crc32(struct.pack("<qqqqqId", 1_000, 2_000, 3, 4, 5, FLAGS, sensor_k), 7)
    columns = {name: np.array(values) for name, values in COLUMNS.items()}
    assert with_stamps(7, (*STAMPS[:-1], sensor_k)) == expected
    assert with_stored([7], {**columns, "fpa_temperature": np.array([sensor_k])}).tolist() == [expected]


def test_a_meter_has_no_sensor_temperature():
    columns = {name: np.array(values) for name, values in COLUMNS.items() if name != "fpa_temperature"}
    assert with_stored([7], columns).tolist() == [with_stamps(7, (*STAMPS[:-1], math.nan))]
