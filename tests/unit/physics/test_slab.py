"""The slab against closed solutions of the heat equation.

Carslaw and Jaeger, Conduction of Heat in Solids, 1959.
"""

import numpy as np
import pytest

from fieldkit.physics.slab import Slab, conducted_flux, warm_slab
from fieldkit.physics.surface import STEFAN_BOLTZMANN, balance_temperature

SAND = Slab()


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
    flux = conducted_flux(SAND, 300.0 + 5.0 * np.sin(omega * time), time)
    wave = np.sqrt(1j * omega * SAND.heat_capacity_j_m3_k / SAND.conductivity_w_m_k)
    gain = SAND.conductivity_w_m_k * wave * np.tanh(wave * SAND.depth_m)
    expected = 5.0 * np.imag(gain * np.exp(1j * omega * (time - 10.0)))
    settled = time > 4 * 3600.0
    assert np.abs(flux - expected)[settled].max() < 0.02 * 5.0 * abs(gain)


def test_deep_sand_after_a_sudden_step():
    # q = Gamma dT / sqrt(pi t)
    deep = Slab(depth_m=0.5, layers=60, growth=1.08)
    time = np.arange(0.0, 3601.0, 5.0)
    flux = conducted_flux(deep, np.where(time > 0.0, 310.0, 300.0), time)
    late = time > 900.0
    expected = deep.thermal_inertia * 10.0 / np.sqrt(np.pi * (time[late] - 2.5))
    np.testing.assert_allclose(flux[late], expected, rtol=0.02)


def test_flux_in_is_heat_stored():
    time = np.arange(0.0, 6 * 3600.0, 60.0)
    warming = 300.0 + 10.0 * np.minimum(time / 1800.0, 1.0)
    taken = np.sum(conducted_flux(SAND, warming, time)[1:] * 60.0)
    assert taken == pytest.approx(SAND.depth_m * SAND.heat_capacity_j_m3_k * 10.0, rel=1e-3)


def test_operator_is_linear_over_regions():
    rng = np.random.default_rng(5)
    time = np.cumsum(rng.uniform(30.0, 90.0, 50))
    surfaces = 300.0 + rng.normal(size=(50, 3)).cumsum(axis=0)
    together = conducted_flux(SAND, surfaces, time)
    difference = conducted_flux(SAND, surfaces[:, 1] - surfaces[:, 0], time)
    np.testing.assert_allclose(together[:, 1] - together[:, 0], difference, atol=1e-8)


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


def test_the_two_uses_of_the_slab_agree():
    # heat the surface by balance, then ask what went in from the surface temperatures alone
    temperature, surface, taken = np.full(17, 290.0), [290.0], [0.0]
    for step in range(120):
        absorbed = 700.0 + 200.0 * np.sin(step / 15.0)
        temperature = warm_slab(SAND, temperature, 60.0, absorbed, 18.15, 295.0, 0.9)
        surface.append(temperature[0])
        taken.append(
            absorbed - 0.9 * STEFAN_BOLTZMANN * temperature[0] ** 4 - 18.15 * (temperature[0] - 295.0)
        )
    flux = conducted_flux(SAND, surface, 60.0 * np.arange(121))
    np.testing.assert_allclose(flux, taken, atol=1e-6)
