"""A value that cannot have been measured is as if it were not there, in tables and in recordings."""

from dataclasses import fields
from itertools import product

import numpy as np
import pytest

from fieldkit.estimation.bins import History
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.table import TemperatureTable, as_part
from fieldkit.model.samples import Reading
from fieldkit.model.site import Site
from fieldkit.model.units import MINUTE_NS
from tests.harness.last_minute import history_of

ROWS = 60
SITE = Site(37.7, -105.9, 2317.0)
START_NS = int(np.datetime64("2015-12-30T19:00", "ns").astype(np.int64))
LIGHT = ("irradiance_w_m2", "diffuse_w_m2", "longwave_w_m2")
OTHERS = ("reference_k", "bed_k", "air_k", "wind_m_s")
CANNOT_BE = {"missing": np.nan, "logger's": -999.0, "overflow": 1e9, "negative": -50.0}


def table(**cells):
    minutes = np.arange(ROWS)
    columns = {
        "reference_k": 300.0 + 0.01 * minutes,
        "irradiance_w_m2": np.full(ROWS, 900.0),
        "diffuse_w_m2": np.full(ROWS, 60.0),
        "longwave_w_m2": np.full(ROWS, 250.0),
        "air_k": 280.0 + 0.01 * minutes,
        "wind_m_s": np.full(ROWS, 2.0),
    }
    bed_k = 303.0 + 0.01 * minutes
    for name, value in cells.items():
        (bed_k if name == "bed_k" else columns[name])[20] = value
    return TemperatureTable(time_ns=START_NS + MINUTE_NS * minutes, targets_k={"bed": bed_k}, **columns)


def same(one: History, other: History) -> bool:
    """Alike in everything but flags, which keep what was wrong, and where regions lie in the frames."""
    names = [
        field.name for field in fields(History) if "flags" not in field.name and field.name != "shift_px"
    ]
    return all(np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True) for name in names)


@pytest.mark.parametrize("column", [*LIGHT, *OTHERS])
def test_a_cell_that_cannot_be_is_an_empty_cell(column):
    def history(value):
        return as_part("", table(**{column: value}), SITE, EstimatorSettings()).history

    empty = history(np.nan)
    assert not same(empty, as_part("", table(), SITE, EstimatorSettings()).history)
    for value in (*CANNOT_BE.values(), *([0.0] if column.endswith("_k") else [])):
        assert same(history(value), empty), value


def test_a_reading_that_cannot_be_is_no_reading(yard):
    samples = yard.samples(3)
    readings = [place for place, sample in enumerate(samples) if isinstance(sample, Reading)]
    for place, value in product(readings[len(readings) // 2 :][:1], CANNOT_BE.values()):
        sample = samples[place]
        bad = [*samples[:place], sample._replace(values=(value,) * len(sample.values)), *samples[place + 1 :]]
        without = [*samples[:place], *samples[place + 1 :]]
        assert same(history_of(yard, bad), history_of(yard, without))
