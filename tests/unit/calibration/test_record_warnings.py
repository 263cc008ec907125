from dataclasses import replace
from datetime import UTC, datetime, timedelta

import pytest

from fieldkit.calibration.calibration_record import CalibrationRecord, expiry, instrument_of, record_warnings
from fieldkit.model.device import StreamInfo

DATE = datetime(2026, 12, 10, tzinfo=UTC)
CAMERA = StreamInfo(
    "camera", "brightness_temperature", "K", (120, 160),
    model="Lepton", serial_number="12", settings={"gain": "high"},
)  # fmt: skip
LUX = StreamInfo("lux", "illuminance", "lx", (1,), model="LX-1128SD")
SAND = CalibrationRecord(
    "emissivity", "sand", DATE, 0.9, 0.01, "1", "test",
    instrument=instrument_of(CAMERA), expires=expiry("emissivity", DATE),
)  # fmt: skip


def test_a_fresh_record_of_this_camera_is_not_doubted():
    assert record_warnings(SAND, [LUX, CAMERA], DATE + timedelta(days=364)) == []


@pytest.mark.parametrize(
    ("streams", "days", "said"),
    [
        ([CAMERA], 400, "400 days old and was valid until 2027-12-10"),
        ([CAMERA], -2, "after now"),
        ([replace(CAMERA, serial_number="13")], 1, "made with Lepton serial 12; here is Lepton serial 13"),
        ([replace(CAMERA, name="thermal", model="Boson")], 1, "here is Boson serial 12"),
        ([replace(CAMERA, settings={"gain": "low"})], 1, "in range high; here is low"),
        ([LUX], 1, "which is not connected"),
    ],
)
def test_age_and_mismatch_are_warnings(streams, days, said):
    (told,) = record_warnings(SAND, streams, DATE + timedelta(days=days))
    assert said in told


def test_a_record_without_an_instrument_fits_any():
    bare = CalibrationRecord("surface", "beds", DATE, 1.1, 0.02, "1", "test")
    assert record_warnings(bare, [CAMERA], DATE) == []
