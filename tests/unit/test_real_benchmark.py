"""Slopes from measured data: the way from irradiance to a normal, and what a run says of others' planes."""

import math
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from benchmarks import one_image, real
from fieldkit.estimation.table import TemperatureTable, as_part, slopes_of_part
from fieldkit.model.slope import SlopeEstimate, SlopeState
from fieldkit.physics.energy_balance import surface_temperature
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
    (found,) = slopes_of_part(as_part("", table, real.TWIN_SITE, settings))
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
    assert len(rows) == 7
    assert all(math.isnan(row.value) and row.note.startswith("skipped: no ") for row in rows)


def test_vertical_pyranometers_are_within_their_regions_and_under_an_isotropic_sky_within_the_goals():
    shared("data/real/twinhouse-o5-2013-aug-sep.csv")
    rows = list(real.twin())
    assert len(rows) == 2 * 2 * len(real.TWIN_PLANES)
    assert min(row.value for row in rows if "inside" in row.name and not math.isnan(row.value)) >= 85.0
    found = {row.name: row.value for row in rows}
    for side in ("east", "west"):
        name = f"vertical pyranometer facing {side}, isotropic sky: error of the normal, median"
        assert found[name] <= 9.0


def test_a_hill_under_the_papers_balance_is_mapped_from_another_one():
    """Temperatures by the paper's eq. (7): one hill's gain and level give the next one's slopes."""
    settings, sun = real.settings_of("forest"), normal(60.0, 160.0)

    def hill(seed: int) -> one_image.Scene:
        random = np.random.default_rng(seed)
        y, x = np.mgrid[:40, :40]
        waves = zip(*random.uniform(-0.2, 0.2, (2, 3)), random.uniform(0.0, 6.0, 3), strict=True)
        height_m = 20.0 * sum(np.sin(a * x + b * y + phase) for a, b, phase in waves)
        scene = one_image.Scene.of(np.zeros((40, 40)), height_m, 30.0, 1)
        lit = 800.0 * scene.normals @ sun
        kelvin = surface_temperature(lit, 300.0, 280.0, settings.surface) - 0.005 * scene.height_m
        return replace(scene, kelvin=kelvin + 0.1 * random.standard_normal(kelvin.shape))

    found = one_image.Components.of([hill(1)], hill(2), sun, settings)
    assert found.guess_deg() > 4.0
    assert found.error_deg() < 1.2
    assert found.covered().value >= 85.0
    assert found.with_prior().error_deg() < 1.5


def test_leafless_ridges_are_measured_and_leaves_refused():
    path = shared("data/real/landsat-west-half.npz")
    rows = {row.name: row for row in one_image.ridges(path, real.settings_of("forest"))}
    assert abs(rows["  predicted warming by slope less measured"].value) <= 15.0
    assert rows["  component along the sun, and its spread of slopes"].value <= 2.8
    assert rows["ridges in july: NDVI, median"].note.startswith("refused")
    assert sum("component along" in name for name in rows) == 2


def test_a_module_and_a_wall_are_within_their_regions_beside_a_level_surface_by_the_weather():
    shared("data/real/twinhouse-o5-2013-aug-sep.csv")
    for rows in (list(real.wall()), list(islice(real.pv(), 2))):
        assert rows[1].value >= 85.0
        assert "refused 14" not in rows[0].note
        assert "refused 20" not in rows[0].note
