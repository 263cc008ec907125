"""The slab against closed solutions of the heat equation.

Carslaw and Jaeger, Conduction of Heat in Solids, 1959.
"""

import itertools

import numpy as np
import pytest
from scipy.linalg import solve_banded

from fieldkit.estimation.balance import conduction
from fieldkit.physics.constants import STEFAN_BOLTZMANN
from fieldkit.physics.energy_balance import balance_temperature
from fieldkit.physics.slab import Slab, SlabStep, conducted_flux, heat_of_step, surface_series

SAND = Slab()


def warm_slab(slab, temperature_k, step_s, *balance):
    """Node temperatures (n,) or (n, m) of beds on equal slabs after one step."""
    step = SlabStep.of([(slab,)], step_s)
    return step.after(np.atleast_2d(temperature_k.T), *balance).T.reshape(temperature_k.shape)


def test_presets_are_dry_silica_sand():
    assert 450.0 < SAND.thermal_inertia < 700.0
    depths = SAND.depths_m()
    assert depths[0] == 0.0
    assert depths[-1] == pytest.approx(0.03)
    assert np.all(np.diff(depths, 2) > 0.0)


def test_slow_wave_over_an_insulated_bottom():
    # q = k l tanh(l d) T with l = sqrt(i omega rho c / k)
    omega = 2.0 * np.pi / 3600.0
    time = np.arange(0.0, 6 * 3600.0 + 1.0, 20.0)
    flux = conducted_flux(SAND, 300.0 + 5.0 * np.sin(omega * time), 20.0)
    wave = np.sqrt(1j * omega * SAND.heat_capacity_j_m3_k / SAND.conductivity_w_m_k)
    gain = SAND.conductivity_w_m_k * wave * np.tanh(wave * SAND.depth_m)
    expected = 5.0 * np.imag(gain * np.exp(1j * omega * time))
    settled = time > 5 * 3600.0
    # the wave is bent between the readings
    assert np.abs(flux - expected)[settled].max() < 2e-3 * 5.0 * abs(gain)


def test_deep_sand_after_a_sudden_step():
    # q = Gamma dT / sqrt(pi t)
    deep = Slab(depth_m=0.5)
    time = np.arange(0.0, 3601.0, 5.0)
    flux = conducted_flux(deep, np.where(time > 0.0, 310.0, 300.0), 5.0)
    late = time > 900.0
    expected = deep.thermal_inertia * 10.0 / np.sqrt(np.pi * (time[late] - 2.5))
    np.testing.assert_allclose(flux[late], expected, rtol=1e-5)


def finite_differences(slab, surface_k, parts=4, cell_m=1e-3):
    """Flux (n,) at the minutes by Crank-Nicolson on a fine even grid, as fieldkit does nowhere."""
    nodes = round(slab.depth_m / cell_m)
    ratio = slab.conductivity_w_m_k / slab.heat_capacity_j_m3_k * (60.0 / parts) / cell_m**2
    bands = np.zeros((3, nodes))
    bands[1], bands[0, 1:], bands[2, :-1] = 1.0 + ratio, -ratio / 2.0, -ratio / 2.0
    bands[2, nodes - 2] = -ratio  # the bottom is a mirror
    steps = np.interp(
        np.arange((surface_k.size - 1) * parts + 1) / parts, np.arange(surface_k.size), surface_k
    )
    below, flux = np.full(nodes, surface_k[0]), [0.0]
    for top, next_top in itertools.pairwise(steps):
        column = np.concatenate([[top], below, [below[-2]]])
        known = below + ratio / 2.0 * (column[:-2] - 2.0 * below + column[2:])
        known[0] += ratio / 2.0 * next_top
        below = solve_banded((1, 1), bands, known)
        slope = (3.0 * next_top - 4.0 * below[0] + below[1]) / (2.0 * cell_m)
        flux.append(slab.conductivity_w_m_k * slope)
    return np.array(flux[::parts])


@pytest.mark.parametrize("depth_m", [0.03, 0.20, 0.30])
def test_three_days_of_weather_are_not_forgotten_by_deep_sand(depth_m):
    """Within 0.3 W/m2 of an independent solution: what 30 cm took in is given off for days."""
    hours = np.arange(3 * 1440) / 60.0
    surface = (
        20.0 * np.sin(2.0 * np.pi * hours / 24.0) + 5.0 * np.sin(2.0 * np.pi * hours / 3.0) + hours / 9.0
    )
    slab = Slab(depth_m=depth_m)
    expected = finite_differences(slab, surface)
    flux = conducted_flux(slab, surface, 60.0)
    assert np.abs(flux - expected)[60:].max() < 0.3
    by_minute = conduction(np.arange(hours.size), surface[:, np.newaxis], slab)[:, 0]
    assert np.abs(by_minute - expected)[60:].max() < 0.3


def test_heat_of_a_step_is_the_same_by_both_series():
    # the deep layer's law and the Fourier series meet where one gives way to the other
    time = 0.01 * SAND.heat_capacity_j_m3_k * SAND.depth_m**2 / SAND.conductivity_w_m_k
    before, behind = heat_of_step(SAND, [time * (1.0 - 1e-12), time * (1.0 + 1e-12)])
    assert behind == pytest.approx(before, rel=2e-12)
    assert heat_of_step(SAND, 0.0) == 0.0
    assert heat_of_step(SAND, 1e9) == pytest.approx(SAND.depth_m * SAND.heat_capacity_j_m3_k, rel=1e-12)


def test_flux_in_is_heat_stored():
    time = np.arange(0.0, 6 * 3600.0, 60.0)
    warming = 300.0 + 10.0 * np.minimum(time / 1800.0, 1.0)
    taken = np.trapezoid(conducted_flux(SAND, warming, 60.0), time)
    assert taken == pytest.approx(SAND.depth_m * SAND.heat_capacity_j_m3_k * 10.0, rel=1e-3)


def test_operator_is_linear_over_regions():
    surfaces = 300.0 + np.random.default_rng(5).normal(size=(50, 3)).cumsum(axis=0)
    together = conducted_flux(SAND, surfaces, 60.0)
    difference = conducted_flux(SAND, surfaces[:, 1] - surfaces[:, 0], 60.0)
    np.testing.assert_allclose(together[:, 1] - together[:, 0], difference, atol=1e-8)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_what_has_not_lasted_a_step_has_no_flux(count):
    assert conducted_flux(SAND, np.full(count, 300.0), 60.0).tolist() == [0.0] * count


def test_sand_left_alone_reaches_the_steady_balance():
    temperature = np.full(SAND.layers + 1, 290.0)
    for _ in range(80):
        temperature = warm_slab(SAND, temperature, 900.0, 900.0, 18.15, 295.0, 0.9)
    steady = balance_temperature(900.0 + 18.15 * 295.0, 18.15, 0.9)
    np.testing.assert_allclose(temperature, steady, atol=1e-3)


def test_what_the_surface_takes_in_is_stored():
    temperature = np.full(SAND.layers + 1, 290.0)
    later = warm_slab(SAND, temperature, 30.0, 900.0, 18.15, 295.0, 0.9)
    depths = SAND.depths_m()
    stored = np.trapezoid(later - temperature, depths) * SAND.heat_capacity_j_m3_k
    taken = 900.0 - 0.9 * STEFAN_BOLTZMANN * later[0] ** 4 - 18.15 * (later[0] - 295.0)
    assert stored == pytest.approx(30.0 * taken, rel=1e-9)


def test_beds_side_by_side_do_not_disturb_each_other():
    alone = warm_slab(SAND, np.full(17, 290.0), 30.0, 700.0, 18.15, 295.0, 0.9)
    beside = warm_slab(SAND, np.full((17, 2), 290.0), 30.0, np.array([700.0, 100.0]), 18.15, 295.0, 0.9)
    np.testing.assert_allclose(beside[:, 0], alone, rtol=1e-14)
    assert beside[0, 1] < beside[0, 0]


def test_two_layers_under_a_steady_flux_warm_together():
    """Every depth warms at q / (C1 d1 + C2 d2); across a layer of flux q0 above and q1 below, the difference
    is d (q0 + q1) / (2 k) (Carslaw and Jaeger 3.8, layer by layer).
    """
    dry, damp = Slab(0.01, 0.25, 1.3e6), Slab(0.04, 1.0, 2.2e6)
    step, before, flux, no_loss = SlabStep.of([(dry, damp)], 300.0), np.full((1, 33), 290.0), 100.0, 1e-9
    for _ in range(200):
        before, last = step.after(before, flux, 0.0, 0.0, no_loss), before
    rate = flux / (1.3e6 * 0.01 + 2.2e6 * 0.04)
    np.testing.assert_allclose((before - last) / 300.0, rate, rtol=1e-6)
    below = flux - 1.3e6 * 0.01 * rate
    surface, contact, bottom = before[0, [0, 16, 32]]
    assert surface - contact == pytest.approx(0.01 * (flux + below) / (2.0 * 0.25), rel=0.01)
    assert contact - bottom == pytest.approx(0.04 * below / (2.0 * 1.0), rel=0.01)


def test_a_series_takes_the_steps_of_one_bed_to_a_microkelvin():
    random = np.random.default_rng(3)
    steps = random.choice([30.0, 60.0, 120.0], 199)
    absorbed, exchange, air = (
        random.uniform(low, high, 200) for low, high in ((250.0, 1200.0), (3.0, 20.0), (270.0, 300.0))
    )
    layers, expected = np.full(SAND.layers + 1, 288.0), [288.0]
    for row, step in enumerate(steps.tolist(), start=1):
        layers = warm_slab(SAND, layers, step, absorbed[row], exchange[row], air[row], 0.95)
        expected.append(layers[0])
    found = surface_series((SAND,), 288.0, steps, absorbed, exchange, air, 0.95)
    np.testing.assert_allclose(found, expected, atol=1e-6)
