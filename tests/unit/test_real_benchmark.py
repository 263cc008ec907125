"""Slopes from measured data: the way from irradiance to a normal, and what a run says of others' planes."""

import math

import numpy as np
import pytest

from benchmarks import real
from fieldkit.estimation.table import TemperatureTable, slopes_of_table
from fieldkit.model.slope import SlopeEstimate, SlopeState
from fieldkit.physics.facet import angle_between_deg, normal
from fieldkit.physics.sun import sun_vectors
from tests.shared_data import shared

NOON_NS = int(np.datetime64("2013-08-28T11:15", "ns").astype(np.int64))
DNI, DHI, ALBEDO = 800.0, 90.0, 0.2


def test_a_pyranometer_in_a_known_plane_gives_that_plane():
    """Its light is that of Liu and Jordan (1963): beam, sky of one radiance, and level ground."""
    time_ns = NOON_NS + 600_000_000_000 * np.arange(-24, 25)
    sun = sun_vectors(time_ns, real.TWIN_SITE)
    tilt, azimuth = 45.0, 150.0
    cos_tilt = math.cos(math.radians(tilt))
    ghi = DNI * sun[:, 2] + DHI
    plane = DNI * np.maximum(sun @ normal(tilt, azimuth), 0.0)
    plane += DHI * (1 + cos_tilt) / 2 + ALBEDO * ghi * (1 - cos_tilt) / 2
    light = {"irradiance_w_m2": np.full(49, DNI), "diffuse_w_m2": np.full(49, DHI)}
    table = TemperatureTable(time_ns, real.LIGHT_K + ghi, {"plane": real.LIGHT_K + plane}, **light)
    settings = real.of_light(sky="isotropic", ground_albedo=ALBEDO)
    (found,) = slopes_of_table(table, real.TWIN_SITE, settings)
    away_deg = angle_between_deg(normal(found.tilt_deg, found.azimuth_deg), normal(tilt, azimuth))
    assert away_deg < 0.05


def estimate(state, tilt, low, high):
    return SlopeEstimate(0, "plane", state, tilt, 180.0, tilt_low_deg=low, tilt_high_deg=high), (40.0, 180.0)


def test_refused_days_count_in_neither_error_nor_coverage_and_are_named():
    found = [
        estimate(SlopeState.OK, 41.0, 38.0, 44.0),
        estimate(SlopeState.UNCERTAIN, 35.0, 31.0, 39.0),
        estimate(SlopeState.NO_INTERSECTION, 5.0, 4.0, 6.0),
    ]
    error, covered = real.Case("plate", found, "<= 9", ">= 85").rows()
    assert (error.value, error.must, covered.value, covered.must) == (
        pytest.approx(3.0),
        "<= 9",
        50.0,
        ">= 85",
    )
    assert "3 estimates, refused 1 (1 no_intersection), 1 uncertain" in error.note
    nothing, _ = real.Case("plate", found[2:]).rows()
    assert math.isnan(nothing.value)


def test_without_the_data_one_row_each_says_what_is_missing(tmp_path, monkeypatch):
    monkeypatch.setattr(real, "SHARED", tmp_path)  # the folder may be there
    rows = real.run()
    assert len(rows) == 4
    assert all(math.isnan(row.value) and row.note.startswith("skipped: no ") for row in rows)


def test_vertical_pyranometers_are_found_within_the_goals_under_an_isotropic_sky():
    shared("data/real/twinhouse-o5-2013-aug-sep.csv")
    rows = list(real.twin())
    assert len(rows) == 2 * 2 * len(real.TWIN_PLANES)
    found = {row.name: row.value for row in rows}
    for side in ("east", "west"):
        name = f"vertical pyranometer facing {side}, isotropic sky: error of the normal, median"
        assert found[name] <= 9.0
