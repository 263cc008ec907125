"""Modes of a layer against closed solutions of the heat equation and steps of a fine grid.

Carslaw and Jaeger, Conduction of Heat in Solids, 1959: 2.9 (half-space), 3.8 (layer), both with a given flux.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import erfc

from fieldkit.physics.layer_modes import MODES, RATES_PER_S, layer_modes, surface_warming
from fieldkit.physics.slab import Slab, SlabStep, heat_of_step

SAND = Slab()
CAPACITY = SAND.heat_capacity_j_m3_k
STATED = 0.0115
"""Largest relative error, stated as 1.1 %."""
MINUTES_S = 60.0 * np.geomspace(0.5, 600.0, 40)
GAMMA, DEPTH_M = (grid.ravel() for grid in np.meshgrid([300.0, 450.0, 570.0, 900.0], [0.015, 0.03, 0.1, 0.6]))


def from_modes(inertia, depth_m, time_s):
    """Warming (p, n) after a unit step: one resistance and the stores filled since."""
    modes = layer_modes(inertia, depth_m, CAPACITY)
    fills = [time_s if rate == 0.0 else (1.0 - np.exp(-rate * time_s)) / rate for rate in RATES_PER_S]
    return modes.resistance[:, np.newaxis] + modes.weights @ np.array(fills)


def test_stores_warm_a_surface_within_the_stated_share_of_the_series():
    """`ierfc` images of 2.9 (a mirror at the bottom): a series of its own, not that of the code."""

    def ierfc(x):
        return np.exp(-(x**2)) / np.sqrt(np.pi) - x * erfc(x)

    images = np.arange(1, 400)[:, np.newaxis]
    for gamma, depth_m, found in zip(GAMMA, DEPTH_M, from_modes(GAMMA, DEPTH_M, MINUTES_S), strict=True):
        diffusivity = (gamma / CAPACITY) ** 2
        width_m = np.sqrt(diffusivity * MINUTES_S)
        terms = 1.0 / np.sqrt(np.pi) + 2.0 * ierfc(images * depth_m / width_m).sum(axis=0)
        expected = 2.0 * np.sqrt(MINUTES_S) / gamma * terms
        np.testing.assert_allclose(found, expected, rtol=STATED)
        assert surface_warming([gamma], [depth_m], CAPACITY, MINUTES_S)[0] == pytest.approx(
            expected, rel=1e-9
        )


@pytest.mark.parametrize("depth_m", [0.015, 0.03, 0.3])
def test_warming_and_heat_of_a_step_of_temperature_undo_each_other(depth_m):
    """A step's response to flux convolved with that to temperature is the time: the two are inverses."""
    time_s = np.linspace(0.0, 7200.0, 2881)[1:]
    sand = replace(SAND, depth_m=depth_m)
    warming = surface_warming([sand.thermal_inertia], [depth_m], CAPACITY, time_s)[0]
    middles = time_s - 0.5 * time_s[0]
    heat = heat_of_step(sand, np.concatenate([[0.0], time_s]))
    whole = np.convolve(np.diff(heat), np.interp(middles, np.append(0.0, time_s), np.append(0.0, warming)))
    late = time_s > 600.0
    np.testing.assert_allclose(whole[: time_s.size][late], time_s[late], rtol=0.005)


@pytest.mark.parametrize("depth_m", [0.015, 0.03, 0.10])
def test_stores_follow_a_fine_grid_under_a_changing_flux(depth_m):
    """A morning with clouds of five minutes into black sand without losses, stepped by `SlabStep`."""
    second = np.arange(0.0, 4.0 * 3600.0, 5.0)
    flux = 200.0 * np.sin(np.pi * second / 14400.0) * np.where(second // 300.0 % 4.0 == 1.0, 0.3, 1.0)
    step = SlabStep.of([(replace(SAND, depth_m=depth_m, layers=60, growth=1.05),)], 5.0)
    nodes, surface = np.zeros(61), []
    for each in flux:
        nodes = step.coasting[0] @ nodes + step.response[0] * each
        surface.append(nodes[0])
    response = np.diff(np.append(0.0, from_modes([SAND.thermal_inertia], [depth_m], second + 5.0)[0]))
    found = np.convolve(flux, response)[: flux.size]
    # less than 30 s apart neither is exact: backward Euler smears, the resistance acts at once
    smooth = np.ones(12) / 12.0
    found, expected = (np.convolve(series, smooth, "valid") for series in (found, surface))
    np.testing.assert_allclose(found, expected, atol=STATED * np.max(surface))


def test_layers_do_not_influence_each_other():
    alone = layer_modes(GAMMA[3:4], DEPTH_M[3:4], CAPACITY)
    together = layer_modes(GAMMA, DEPTH_M, CAPACITY)
    assert together.weights.shape == (GAMMA.size, MODES)
    assert alone.resistance[0] == pytest.approx(together.resistance[3], rel=1e-12)
    np.testing.assert_allclose(alone.weights[0], together.weights[3], rtol=1e-9)
