import numpy as np
import pytest
from pvlib import irradiance

from fieldkit.physics.facet import normal
from fieldkit.simulation.facets import Facet
from fieldkit.simulation.scene_series import (
    FacetRadiation,
    fine_times,
    lag,
    longwave_leaving_ground,
    surface_temperatures,
)
from fieldkit.simulation.sky import SkyState

EXCHANGE_W_M2_K, AIR_K, LONGWAVE_W_M2 = 18.15, 303.15, 400.0


def warm_up(facet, shortwave_w_m2, time_s):
    """Curve of a bed under constant light, started in the dark balance."""
    shape = time_s.shape
    absorbed = np.where(time_s > 0, 0.8 * shortwave_w_m2, 0.0) + 0.9 * LONGWAVE_W_M2
    exchange, air = np.full(shape, EXCHANGE_W_M2_K), np.full(shape, AIR_K)
    return surface_temperatures([facet], time_s, absorbed[np.newaxis], exchange, air)[0]


@pytest.mark.parametrize(
    ("shortwave_w_m2", "expected_k"), [(200.0, 306.866938), (640.0, 321.248030), (900.0, 329.507531)]
)
def test_bed_settles_where_the_paper_has_it(shortwave_w_m2, expected_k):
    """Eq. (7) with the paper's Table 1, T_a 303.15 K, 400 W/m² from the sky."""
    curve = warm_up(Facet("bed", ()), shortwave_w_m2, np.arange(0.0, 8 * 3600.0, 10.0))
    assert curve[0] == pytest.approx(300.160661, abs=1e-5), "before the light"
    assert curve[-1] == pytest.approx(expected_k, abs=1e-3)


def test_thin_layer_follows_with_its_own_time_constant():
    """tau = rho c d / (4 e sigma T³ + h): 1.3e6 * 0.002 / 24.2 = 107 s for 2 mm."""
    time_s = np.arange(0.0, 3600.0, 1.0)
    curve = warm_up(Facet("bed", (), depth_m=0.002), 100.0, time_s)
    reached = (curve - curve[0]) / (curve[-1] - curve[0])
    assert np.interp(1 - np.exp(-1), reached, time_s) == pytest.approx(107.0, rel=0.05)


def test_equal_layers_warm_alike_and_a_thin_one_ahead_of_a_thick_one():
    time_s = np.arange(0.0, 3600.0, 10.0)
    beds = [Facet("a", (), depth_m=0.01), Facet("b", (), depth_m=0.03), Facet("c", (), depth_m=0.01)]
    absorbed = np.full((3, time_s.size), 700.0)
    absorbed[:, 100:] = 900.0
    exchange, air = np.full(time_s.size, EXCHANGE_W_M2_K), np.full(time_s.size, AIR_K)
    series = surface_temperatures(beds, time_s, absorbed, exchange, air)
    np.testing.assert_array_equal(series[0], series[2])
    assert series[0, 160] > series[1, 160] + 0.5, "the thin layer is ahead"


def test_times_are_dense_where_the_light_breaks():
    times = fine_times(0.0, 600.0, np.array([100.0]))
    assert 100.0 in times
    steps = np.diff(times)
    assert steps.max() <= 10.0
    assert steps[np.searchsorted(times, 100.0)] == pytest.approx(0.02)
    assert (times[0], times[-1]) == (0.0, 600.0)


def test_sensor_of_first_order_lags_a_ramp_by_its_time_constant():
    time_s = np.concatenate([np.arange(0.0, 10.0, 0.3), np.arange(10.0, 100.0, 7.0)])
    answer = lag((0.5 * time_s)[np.newaxis], time_s, 3.0)[0]
    exact = 0.5 * (time_s - 3.0 * (1 - np.exp(-time_s / 3.0)))
    np.testing.assert_allclose(answer, exact, atol=1e-12)


def test_sunlight_on_a_tilted_bed_is_pvlibs_in_plane_irradiance():
    zenith, azimuth, dni_w_m2, dhi_w_m2, top = 55.0, 140.0, 850.0, 90.0, 1400.0
    ghi = dni_w_m2 * np.cos(np.radians(zenith)) + dhi_w_m2
    theirs = irradiance.get_total_irradiance(
        25.0, 180.0, zenith, azimuth, dni_w_m2, ghi, dhi_w_m2, dni_extra=top, albedo=0.19, model="haydavies"
    )["poa_global"]
    one = np.ones(1)
    sky_state = SkyState(dni_w_m2 * one, dhi_w_m2 * one, 0.0 * one, 280.0 * one, 1.0 * one)
    light = FacetRadiation(sky_state, normal([zenith], [azimuth]), top * one, 0.19)
    absorbed = light.absorbed_w_m2(Facet("bed", (), 25.0, 180.0, albedo=0.3), 0.0 * one)
    assert absorbed[0] == pytest.approx(0.7 * float(theirs), rel=1e-6)


def test_longwave_of_the_ground_is_emitted_and_mirrored():
    """Kirchhoff: what is not emitted of a black body's is mirrored of the sky's."""
    one = np.ones(1)
    sky_state = SkyState(0.0 * one, 0.0 * one, 300.0 * one, 280.0 * one, 1.0 * one)
    ground = Facet("ground", (), emissivity_broadband=0.95)
    expected = 0.95 * 5.670374419e-8 * 310.0**4 + 0.05 * 300.0
    assert longwave_leaving_ground(310.0 * one, ground, sky_state)[0] == pytest.approx(expected)
