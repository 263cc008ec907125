import errno
import math
import os
import tomllib
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

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
    records_of,
    save,
    to_toml,
    validity,
)
from fieldkit.calibration.uncertainty import Contribution
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError, StorageError
from fieldkit.model.next_step import Argument
from tests.harness.next_steps import at, steps

DATE = datetime(2026, 12, 10, 1, 30, tzinfo=UTC)
SAND = CalibrationRecord(
    "emissivity", "dry-silica-sand", DATE, 0.915, 0.015, "1", "contact thermometer (ASTM E1933)",
    degrees_of_freedom=4, band="8-14 um, flat", angle_deg=25.0, expires=expiry("emissivity", DATE),
    budget=(Contribution("probe to skin temperature", 0.5, "K", "B", -0.012),),
    instrument=Instrument("camera", "Lepton 3.5", "0012", "high"),
    sources=(Source("20261210T010000Z-sand.h5", "ab" * 32),),
    details={"temperature_range_c": [41.2, 58.3], "pairs": 5}, settings={"region": "sand"},
    remarks=("a doubt",), software="fieldkit 0.1.0",
)  # fmt: skip


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
    assert document["budget"][0]["name"] == SAND.budget[0].name


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


@pytest.mark.parametrize(("kind", "name"), [("emissivity", "sample"), ("surface", "name")])
def test_a_record_is_never_overwritten_but_may_be_saved_again_as_it_is(tmp_path, kind, name):
    record = replace(SAND, kind=kind)
    path = save(record, tmp_path)
    assert save(record, tmp_path) == path
    with pytest.raises(StorageError, match="never changed") as refused:
        save(replace(record, value=0.9), tmp_path)
    assert steps(refused.value) == [Argument(name)]
    assert from_toml(path.read_text(), "x") == record


def test_the_newest_of_a_name_is_found_and_an_older_one_by_its_file(tmp_path):
    newer = replace(SAND, date=DATE.replace(day=11), value=0.93)
    other = replace(SAND, date=DATE.replace(day=12), name="wet-dry-silica-sand", value=0.96)
    for record in (SAND, newer, other):
        save(record, tmp_path)
    assert find("dry-silica-sand", tmp_path)[0].value == 0.93
    assert find("20261210T013000Z-dry-silica-sand", tmp_path)[0].value == 0.915
    with pytest.raises(ConfigError, match="'sand'", check=at(tmp_path)) as missing:
        find("sand", tmp_path)
    assert "dry-silica-sand" in (missing.value.fix or "")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("schema = 2", "layout 2"),
        ("schema =", "not valid TOML"),
        ("schema = 1\nname = 'x'", "not a calibration record"),
        (to_toml(SAND).replace('"emissivity"', '"colour"', 1), "kind: Input should be 'emissivity'"),
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
BARE = CalibrationRecord("surface", "beds", EARLIER, 1.1, 0.02, "1", "test")
OF_CAMERA = CalibrationRecord(
    "emissivity", "sand", EARLIER, 0.9, 0.01, "1", "test",
    instrument=instrument_of(CAMERA), expires=expiry("emissivity", EARLIER),
)  # fmt: skip


def test_a_fresh_record_of_this_camera_is_not_doubted():
    assert record_warnings(OF_CAMERA, [LUX, CAMERA], EARLIER + timedelta(days=364)) == []
    assert record_warnings(BARE, [CAMERA], EARLIER) == []  # which was made with no instrument


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


def test_a_scale_of_another_surface_model_or_for_other_light_is_a_warning():
    """kappa holds for one surface model and one irradiance: eq. (10) and a calibrated meter differ by 2 %."""
    details = {"model": "paper", "irradiance": "eq10 /0.44, diffuse 15%, horizontal"}
    scale = replace(BARE, details=details)
    assert model_warnings(scale, "paper", details["irradiance"]) == []
    for model, light, names in (
        ("learned", details["irradiance"], ("paper", "learned")),
        ("paper", "pyranometer", (details["irradiance"], "pyranometer")),
    ):
        (warning,) = model_warnings(scale, model, light)
        assert warning.startswith("beds ")
        assert all(name in warning for name in names)
    assert model_warnings(BARE, "learned", "") == []  # a record need not state it


def test_a_light_meter_under_another_name_is_compared_with_light_meters_alone():
    """It was said to be made with the light meter where the camera is."""
    of_lux = replace(BARE, kind="irradiance", name="roof", instrument=instrument_of(LUX))
    assert record_warnings(of_lux, [CAMERA, replace(LUX, name="light")], EARLIER) == []
    (told,) = record_warnings(of_lux, [CAMERA], EARLIER)
    assert told.startswith("roof ")
    assert "LX-1128SD" in told


@pytest.mark.parametrize(
    ("written", "by_hand", "key"),
    [
        ("value = 0.915", "value = nan", "value"),
        ("value = 0.915", 'value = "0,915"', "value"),
        ("value = 0.915\n", "", "value"),
        ("standard_uncertainty = 0.015", "standard_uncertainty = -0.015", "standard_uncertainty"),
        ("standard_uncertainty = 0.015", "standard_uncertainty = inf", "standard_uncertainty"),
        ("date = 2026-12-10T01:30:00Z", "date = 2026-12-10T01:30:00", "date"),  # without its zone
        ("expires = 2027-12-10T01:30:00Z", "expires = 365", "expires"),
        ("pairs = 5", "pairs = 5\n[values]\nb15 = nan", "values.b15"),
        ('serial_number = "0012"', "serial_number = 12", "instrument.serial_number"),
        ('kind = "B"', 'kind = "C"', "budget.0.kind"),
    ],
)
def test_a_record_changed_by_hand_names_the_key_that_cannot_be(written, by_hand, key):
    text = to_toml(SAND)
    assert written in text
    with pytest.raises(ConfigError, match=rf": {key}: ", check=at("sand.toml")) as refused:
        from_toml(text.replace(written, by_hand, 1), "sand.toml")
    assert key in str(refused.value.fix)


def test_of_a_kind_the_latest_of_a_name_is_found(tmp_path):
    """The slope of a sand may be measured after its emissivity."""
    for record in (SAND, replace(SAND, kind="surface", date=DATE.replace(day=11))):
        save(record, tmp_path)
    assert [find(SAND.name, tmp_path, kind)[0].kind for kind in ("emissivity", "surface", None, "clock")] == [
        "emissivity", "surface", "surface", "surface"
    ]  # fmt: skip


def test_a_record_saved_by_an_editor_with_a_byte_order_mark_is_read(tmp_path):
    path = save(SAND, tmp_path)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert find(SAND.name, tmp_path)[0] == SAND


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    (tmp_path / "20261210T013000Z-latin.toml").write_bytes(b"name = '\xe9t\xe9'")
    (tmp_path / "20261210T013000Z-folder.toml").mkdir()
    for name, said in (("latin", "not UTF-8"), ("folder", "cannot read")):
        with pytest.raises(ConfigError, match=said):
            find(name, tmp_path)


def test_a_disk_that_is_full_leaves_no_part_of_a_record(tmp_path, monkeypatch):
    """A part would be the latest of its name, and in the way of the whole."""

    def half(path, data):
        with path.open("wb") as file:
            file.write(data[: len(data) // 2])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as full:
        full.setattr(Path, "write_bytes", half)
        full.setattr(Path, "write_text", lambda path, text, **_: half(path, text.encode()))
        with pytest.raises(StorageError, match="space", check=at(tmp_path / SAND.file_name)) as refused:
            save(SAND, tmp_path)
    assert refused.value.fix
    assert not any(tmp_path.iterdir())
    assert from_toml(save(SAND, tmp_path).read_text(), "x") == SAND


def test_a_record_holds_for_a_surface_temperatures_and_a_year():
    of_surface = replace(SAND, details={**SAND.details, "surface": "sand, region flat"})
    assert validity(of_surface) == "dry-silica-sand (sand, region flat), 41.2 to 58.3 °C, until 2027-12-10"
    assert validity(replace(SAND, details={}, expires=None)) == "dry-silica-sand"


def test_records_are_found_by_their_session_and_a_damaged_one_is_skipped(tmp_path):
    path = save(SAND, tmp_path)
    save(replace(SAND, name="other", sources=(Source("other.h5", "cd" * 32),)), tmp_path)
    (tmp_path / "damaged.toml").write_text("no = ", encoding="utf-8")
    assert [file for _, file in records_of("20261210T010000Z-sand.h5", tmp_path)] == [path]
    assert not list(records_of("20261210T010000Z-sand.h5", tmp_path / "absent"))
