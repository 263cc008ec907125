"""Heights from the normals of a terrain that is known in closed form: ridge, crater and flat."""

import numpy as np
import pytest

from fieldkit.physics.terrain import heights_from_normals

CELL_M, SIDE = 0.25, 200
EAST, NORTH = np.meshgrid(CELL_M * np.arange(SIDE), CELL_M * np.arange(SIDE)[::-1])


def gaussian(away, width):
    return np.exp(-0.5 * (away / width) ** 2)


def terrain():
    """Heights and their derivatives towards east and north, in metres and metres per metre."""
    across = (EAST - NORTH) / np.sqrt(2.0)
    ridge = 2.0 * gaussian(across - 5.0, 3.0)
    ridge_slope = -ridge * (across - 5.0) / 9.0 / np.sqrt(2.0)
    away = np.hypot(EAST - 15.0, NORTH - 32.0)
    crater = -1.5 * gaussian(away, 4.0)
    east, north = crater * (EAST - 15.0) / 16.0, crater * (NORTH - 32.0) / 16.0
    return ridge + crater, ridge_slope - east, -ridge_slope - north


def normals_of(towards_east, towards_north):
    return np.stack([-towards_east, -towards_north, np.ones_like(towards_east)], axis=-1)


def test_heights_of_ridge_crater_and_flat():
    heights, towards_east, towards_north = terrain()
    found, misclosure = heights_from_normals(normals_of(towards_east, towards_north), CELL_M)
    off = found - (heights - heights.mean())
    assert np.abs(off).max() < 0.001 * np.ptp(heights)
    assert misclosure.max() < 0.2


def test_noise_of_a_degree_leaves_heights_within_a_twentieth_of_the_relief():
    heights, towards_east, towards_north = terrain()
    noise = np.random.default_rng(1).normal(0.0, np.radians(1.0), (2, SIDE, SIDE))
    found, misclosure = heights_from_normals(
        normals_of(towards_east + noise[0], towards_north + noise[1]), CELL_M
    )
    assert np.sqrt(np.mean((found - heights + heights.mean()) ** 2)) < 0.05 * np.ptp(heights)
    assert 0.1 < np.median(misclosure) < 1.0


def test_ground_that_is_not_seen_is_left_out_and_bridged_by_nothing():
    heights, towards_east, towards_north = terrain()
    normals = normals_of(towards_east, towards_north)
    normals[:, 90:93] = np.nan
    normals[50:80, 20:60] = np.nan
    found, _ = heights_from_normals(normals, CELL_M)
    assert (np.isnan(found) == np.isnan(normals[..., 0])).all()
    for part in (np.s_[:, :90], np.s_[:, 93:]):
        known = np.isfinite(found[part])
        off = (found[part] - heights[part])[known]
        assert np.ptp(off) < 0.002 * np.ptp(heights)
        assert found[part][known].mean() == pytest.approx(0.0, abs=1e-6)


def test_normals_that_no_surface_has_are_told():
    # a field that turns about a point has no potential: its curl is twice the turn, here 2 x 0.02
    towards_east, towards_north = np.zeros((2, SIDE, SIDE))
    patch = np.s_[80:120, 80:120]
    towards_east[patch] = -0.02 * (NORTH[patch] - NORTH[100, 100])
    towards_north[patch] = 0.02 * (EAST[patch] - EAST[100, 100])
    _, misclosure = heights_from_normals(normals_of(towards_east, towards_north), CELL_M)
    assert misclosure[patch].mean() > 10.0 * misclosure[:40].mean()
    assert misclosure[patch].max() > 1.0


def test_a_cell_without_neighbours_has_no_height():
    normals = np.full((5, 5, 3), np.nan)
    normals[2, 2] = 0.0, 0.0, 1.0
    found, misclosure = heights_from_normals(normals, CELL_M)
    assert np.isnan(found).all()
    assert np.isnan(misclosure).all()
