import math
import tomllib
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from fieldkit.calibration.calibration_record import (
    CalibrationRecord,
    Instrument,
    Source,
    expiry,
    find,
    from_toml,
    instrument_of,
    model_warnings,
    record_warnings,
    save,
    to_toml,
)
from fieldkit.calibration.uncertainty import Contribution
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError, StorageError

DATE = datetime(2026, 12, 10, 1, 30, tzinfo=UTC)
SAND = CalibrationRecord(
    kind="emissivity",
    name="dry-silica-sand",
    date=DATE,
    value=0.915,
    standard_uncertainty=0.015,
    unit="1",
    method="contact thermometer (ASTM E1933)",
    degrees_of_freedom=4,
    budget=(Contribution("probe to skin temperature", 0.5, "K", "B", -0.012),),
    band="8-14 um, flat",
    angle_deg=25.0,
    instrument=Instrument("camera", "Lepton 3.5", "0012", "high"),
    sources=(Source("20261210T010000Z-sand.h5", "ab" * 32),),
    details={"temperature_range_c": [41.2, 58.3], "pairs": 5},
    settings={"region": "sand"},
    remarks=("a doubt",),
    software="fieldkit 0.1.0",
    expires=expiry("emissivity", DATE),
)


def test_a_record_comes_back_as_it_was_written(tmp_path):
    path = save(SAND, tmp_path / "calibration")
    assert path.name == "20261210T013000Z-dry-silica-sand.toml"
    assert from_toml(path.read_text(), "x") == SAND


def test_a_reader_without_fieldkit_finds_value_uncertainty_and_origin():
    document = tomllib.loads(to_toml(SAND))
    assert document["value"] == 0.915
    assert document["expanded_uncertainty"] == pytest.approx(0.030)
    assert document["coverage_factor"] == 2
    assert document["sources"][0]["sha256"] == "ab" * 32
    assert document["budget"][0]["name"] == "probe to skin temperature"


def test_what_is_not_known_is_left_out_and_comes_back_unknown():
    bare = CalibrationRecord("clock", "pi", DATE, np.float64(3.5), 0.1, "s", "phone")
    document = tomllib.loads(to_toml(bare))
    assert not {"angle_deg", "band", "budget", "expires", "degrees_of_freedom"} & document.keys()
    assert math.isnan(from_toml(to_toml(bare), "x").angle_deg)


@pytest.mark.parametrize("unknown", [math.nan, None, math.inf, np.float64("nan")])
def test_what_is_not_known_keeps_its_place_in_a_list(unknown):
    record = replace(SAND, details={"reflected_c": [1.5, unknown, 3.5]})
    first, middle, last = from_toml(to_toml(record), "x").details["reflected_c"]
    assert (first, last) == (1.5, 3.5)
    assert math.isnan(middle)


@pytest.mark.parametrize("field", ["uncertainty", "effect"])
def test_a_budget_with_an_unknown_number_can_be_read_again(field):
    line = replace(SAND.budget[0], **{field: math.nan})
    (read,) = from_toml(to_toml(replace(SAND, budget=(line,))), "x").budget
    assert math.isnan(getattr(read, field))
    assert replace(read, **{field: 0.0}) == replace(line, **{field: 0.0})


def test_a_record_is_never_overwritten_but_may_be_saved_again_as_it_is(tmp_path):
    path = save(SAND, tmp_path)
    assert save(SAND, tmp_path) == path
    with pytest.raises(StorageError, match="never changed"):
        save(replace(SAND, value=0.9), tmp_path)
    assert from_toml(path.read_text(), "x") == SAND


def test_the_newest_of_a_name_is_found_and_an_older_one_by_its_file(tmp_path):
    newer = replace(SAND, date=DATE.replace(day=11), value=0.93)
    other = replace(SAND, date=DATE.replace(day=12), name="wet-dry-silica-sand", value=0.96)
    for record in (SAND, newer, other):
        save(record, tmp_path)
    assert find("dry-silica-sand", tmp_path)[0].value == 0.93
    assert find("20261210T013000Z-dry-silica-sand", tmp_path)[0].value == 0.915
    with pytest.raises(ConfigError, match="no calibration named 'sand'") as missing:
        find("sand", tmp_path)
    assert "dry-silica-sand" in (missing.value.fix or "")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("schema = 2", "layout 2"),
        ("schema =", "not valid TOML"),
        ("schema = 1\nname = 'x'", "not a calibration record"),
        (to_toml(SAND).replace('"emissivity"', '"colour"', 1), "of a known kind"),
        (to_toml(SAND).replace("value = 0.915", "value = true"), "not a calibration record"),
    ],
)
def test_what_is_no_record_is_refused(text, said):
    with pytest.raises(ConfigError, match=said):
        from_toml(text, "file.toml")


@pytest.mark.parametrize(
    ("kind", "days"),
    [("emissivity", 365), ("uniformity", 1), ("irradiance", 90), ("surface", 30), ("clock", 1)],
)
def test_a_calibration_is_good_for_as_long_as_the_reference_says(kind, days):
    """docs/reference/calibration.md."""
    made = datetime(2026, 3, 1, tzinfo=UTC)
    assert expiry(kind, made) - made == timedelta(days=days)


EARLIER = datetime(2026, 12, 10, tzinfo=UTC)
CAMERA = StreamInfo(
    "camera", "brightness_temperature", "K", (120, 160),
    model="Lepton", serial_number="12", settings={"gain": "high"},
)  # fmt: skip
LUX = StreamInfo("lux", "illuminance", "lx", (1,), model="LX-1128SD")
OF_CAMERA = CalibrationRecord(
    "emissivity", "sand", EARLIER, 0.9, 0.01, "1", "test",
    instrument=instrument_of(CAMERA), expires=expiry("emissivity", EARLIER),
)  # fmt: skip


def test_a_fresh_record_of_this_camera_is_not_doubted():
    assert record_warnings(OF_CAMERA, [LUX, CAMERA], EARLIER + timedelta(days=364)) == []


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
    (told,) = record_warnings(OF_CAMERA, streams, EARLIER + timedelta(days=days))
    assert said in told


def test_a_scale_of_another_surface_model_is_a_warning():
    scale = CalibrationRecord("surface", "beds", EARLIER, 1.1, 0.02, "1", "test", details={"model": "paper"})
    (told,) = model_warnings(scale, "learned")
    assert told == "beds is the scale of the paper model, not of learned: calibrate surface again"
    assert model_warnings(scale, "paper") == []
    assert model_warnings(replace(scale, details={}), "learned") == []  # older records do not state it


def test_a_record_without_an_instrument_fits_any():
    bare = CalibrationRecord("surface", "beds", EARLIER, 1.1, 0.02, "1", "test")
    assert record_warnings(bare, [CAMERA], EARLIER) == []
