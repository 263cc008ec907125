"""A number that is added to samples leaves the checksums of those without it, and protects those with it."""

import math
import struct
import zlib

import numpy as np
import pytest

from fieldkit.model.samples import Quality
from fieldkit.sessions import sample_fields
from fieldkit.sessions.sample_fields import SampleField, with_stamps, with_stored

STAMPS = (1_000, 2_000_000, 3, 4, 5, Quality.SHUTTER, 300.0)
ROW = {
    "mono_ns": [1_000], "time": [2_000], "device_time": [3], "seq": [4], "device_seq": [5], "flags": [16],
    "fpa_temperature": [300.0],
}  # fmt: skip
COLUMNS = {name: np.array(values) for name, values in ROW.items()}
FIRST = struct.pack("<qqqqqHd", 1_000, 2_000, 3, 4, 5, 16, 300.0)


@pytest.fixture
def added(monkeypatch):
    """One more field behind the others."""
    later = SampleField("housing_temperature", "housing_temperature_k", "d", math.nan, of_frames=True)
    monkeypatch.setattr(sample_fields, "_LATER", (later,))


def test_a_sample_without_the_number_keeps_its_checksum(added):
    assert with_stamps(7, (*STAMPS, math.nan)) == zlib.crc32(FIRST, 7)
    assert with_stored([7], COLUMNS).tolist() == [zlib.crc32(FIRST, 7)]  # a file of before
    assert with_stored([7], {**COLUMNS, "housing_temperature": np.array([math.nan])}) == zlib.crc32(FIRST, 7)


def test_the_number_is_protected_where_it_is_known(added):
    expected = zlib.crc32(b"housing_temperature" + struct.pack("<d", 295.0), zlib.crc32(FIRST, 7))
    assert with_stamps(7, (*STAMPS, 295.0)) == expected
    assert with_stored([7], {**COLUMNS, "housing_temperature": np.array([295.0])}).tolist() == [expected]
