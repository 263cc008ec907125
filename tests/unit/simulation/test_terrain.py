"""Terrain: a pixel of a slope is a bed of that slope and horizon."""

from dataclasses import replace

import numpy as np
import pytest

from fieldkit.model.units import SECOND_NS
from fieldkit.physics.facet import normal
from fieldkit.physics.horizon import sky_view_factor, sunlit_share
from fieldkit.physics.sun import sun_vectors
from fieldkit.simulation.facets import GROUND, Facet
from fieldkit.simulation.scene import ALAMOSA_NOON_NS
from fieldkit.simulation.scene_series import EXCHANGE, SceneModel
from fieldkit.simulation.sky import ClearSky
from fieldkit.simulation.terrain import Terrain
from fieldkit.weather import packaged_day

WALL = np.where(np.abs(np.arange(36) * 10.0 - 200.0) < 15.0, 40.0, 0.0)
"""From 190 to 210 degrees, level from 180 and 220 on."""


def test_a_pixel_is_as_warm_as_a_bed_of_its_slope_behind_its_horizon():
    horizon = [(10.0 * n, float(up)) for n, up in enumerate(WALL)]
    sand = replace(GROUND, depth_m=0.02)
    beds = [
        Facet("plain", (), 0.0, 180.0, albedo=0.19),
        Facet("steep", (), 20.0, 150.0, albedo=0.19),
        Facet("behind", (), 20.0, 150.0, albedo=0.19, horizon=horizon),
    ]
    model = SceneModel(packaged_day().site, ClearSky(), tuple(beds), sand, EXCHANGE, (), 3.0)
    normals = normal([bed.tilt_deg for bed in beds], [bed.azimuth_deg for bed in beds])
    terrain = Terrain(normals, np.array([np.zeros(36), np.zeros(36), WALL]))
    pixels = model.terrain_series(terrain, ALAMOSA_NOON_NS, 7200.0)
    series = model.series(ALAMOSA_NOON_NS, 7200.0)
    for time_s in (0.0, 1800.0, 3615.0, 7100.0):
        at_ns = ALAMOSA_NOON_NS + round(time_s * SECOND_NS)
        np.testing.assert_allclose(pixels.at(at_ns), series.at(at_ns).brightness_k[:3], atol=0.1)
    steep, behind = pixels.at(ALAMOSA_NOON_NS + 5400 * SECOND_NS)[1:]
    assert steep - behind > 5.0  # the wall hides the sun


def test_light_and_sky_are_those_of_the_same_horizon_as_pairs():
    horizon = [(10.0 * n, float(up)) for n, up in enumerate(WALL)]
    terrain = Terrain(normal([0.0], [0.0]), WALL[np.newaxis])
    times_ns = ALAMOSA_NOON_NS + np.arange(0, 10_800, 30) * SECOND_NS
    sun = sun_vectors(times_ns, packaged_day().site)
    found, expected = terrain.sunlit_share(sun, slice(None))[0], sunlit_share(horizon, sun)
    assert np.abs(found - expected).mean() < 0.01  # on the wall's slanted sides the disc is cut aslant
    assert found.min() == 0.0
    assert found.max() == 1.0
    # cos² of the corners' elevations against cos² in between
    assert terrain.sky_view[0] == pytest.approx(sky_view_factor(horizon), abs=0.02)
    assert terrain.horizon_at(0)[20] == (200.0, 40.0)
