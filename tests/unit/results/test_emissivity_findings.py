"""Beds warmer or colder than an emissivity's record was made at."""

import math
from dataclasses import replace
from datetime import UTC, datetime

import pytest

from fieldkit.calibration.calibration_record import CalibrationRecord
from fieldkit.estimation.estimator import Minute
from fieldkit.model.samples import Quality
from fieldkit.model.site import Region, RegionKind
from fieldkit.phrases import Words
from fieldkit.results.check import emissivity_findings

SQUARE = ((0.0, 0.0), (9.0, 0.0), (9.0, 9.0))
SAND = Region("sand", RegionKind.REFERENCE, SQUARE, 0.0)
ROCK = Region("rock", RegionKind.TARGET, SQUARE, emissivity=0.93)
FOIL = Region("foil", RegionKind.FOIL, SQUARE)
RECORD = CalibrationRecord(
    "emissivity", "dry", datetime(2026, 1, 1, tzinfo=UTC), 0.9, 0.01, "1", "test",
    details={"temperature_range_c": [5.0, 20.0]},
)  # fmt: skip


def found(celsius: dict[str, float], key: str = "surface.emissivity", record: CalibrationRecord = RECORD):
    kelvin = {name: value + 273.15 for name, value in celsius.items()}
    nan = math.nan
    minutes = [Minute(0, (), kelvin, {}, {}, nan, nan, "", nan, nan, (), Quality.GOOD, ())]
    return [finding.text for finding in emissivity_findings(minutes, (SAND, ROCK, FOIL), {key: record})]


@pytest.mark.parametrize(
    ("celsius", "key", "warns"),
    [
        ({"sand": 24.0}, "surface.emissivity", False),
        ({"sand": 26.0}, "surface.emissivity", True),
        ({"sand": -1.0}, "surface.emissivity", True),
        ({"sand": 10.0, "rock": 40.0, "foil": -30.0}, "surface.emissivity", False),  # not of this record
        ({"sand": 40.0, "rock": 10.0}, "rock.emissivity", False),
        ({"sand": 10.0, "rock": 40.0}, "rock.emissivity", True),
        ({"sand": math.nan}, "surface.emissivity", False),
    ],
)
def test_a_record_is_used_beyond_its_temperatures(celsius, key, warns):
    assert bool(found(celsius, key)) is warns


def test_the_warning_has_both_ranges():
    (text,) = found({"sand": 26.0})
    assert isinstance(text, Words)
    assert text.data == {"record": "dry", "low": "5", "high": "20", "coldest": "26", "warmest": "26"}
    assert found({"sand": 26.0}, record=replace(RECORD, details={})) == []
