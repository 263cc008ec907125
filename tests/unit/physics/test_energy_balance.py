"""Eqs. (1) to (7) with Table 1 of the paper; golden values computed with sigma = 5.670374419e-8."""

import numpy as np
import pytest

from fieldkit.physics.energy_balance import (
    SurfaceParameters,
    balance,
    balance_temperature,
    direct_irradiance,
    emitted_longwave,
    irradiance_difference,
    irradiance_per_kelvin,
    sensible_heat,
    surface_temperature,
)

TABLE_1 = SurfaceParameters()


def test_constants_of_equation_6():
    assert TABLE_1.alpha == pytest.approx(6.379171221375e-8, rel=1e-12)
    assert TABLE_1.beta == pytest.approx(22.6875, rel=1e-12)


@pytest.mark.parametrize(
    ("target", "reference", "difference"),
    [(320.0, 315.0, 154.274363), (310.0, 312.5, -75.954067), (330.0, 310.0, 621.139453)],
)
def test_irradiance_difference(target, reference, difference):
    assert irradiance_difference(target, reference, TABLE_1) == pytest.approx(difference, abs=1e-6)


@pytest.mark.parametrize(
    ("shortwave", "temperature"),
    [(0.0, 300.160661), (200.0, 306.866938), (640.0, 321.248030), (900.0, 329.507531)],
)
def test_surface_temperature(shortwave, temperature):
    assert surface_temperature(shortwave, 400.0, 303.15, TABLE_1) == pytest.approx(temperature, abs=1e-6)


@pytest.mark.parametrize(("kelvin", "expected"), [(295.0, 29.2), (315.0, 30.7), (325.0, 31.5)])
def test_watts_per_kelvin(kelvin, expected):
    assert irradiance_per_kelvin(kelvin, TABLE_1) == pytest.approx(expected, abs=0.06)


def test_equations_2_to_5_close_equation_1_at_the_temperature_of_equation_7():
    sunlight = direct_irradiance(800.0, np.array([0.9, 0.4, 0.0, -0.3]))
    longwave, air = 350.0, 290.0
    ground = surface_temperature(sunlight, longwave, air, TABLE_1)
    left = balance(
        sunlight,
        longwave,
        emitted_longwave(ground, TABLE_1.emissivity_broadband),
        TABLE_1.albedo * sunlight,
        (1.0 - TABLE_1.emissivity_broadband) * longwave,
        sensible_heat(ground, air, TABLE_1),
    )
    np.testing.assert_allclose(left, 0.0, atol=1e-9)


def test_facet_turned_away_from_the_sun_gets_none():
    assert direct_irradiance(800.0, -0.2) == 0.0


def test_moisture_and_ground_flux_are_outputs():
    assert balance(500.0, 300.0, 400.0, 100.0, 30.0, 150.0, 70.0, 50.0) == 0.0


def test_no_air_and_a_cold_sky_need_no_starting_value():
    # without exchange the balance is sigma T^4 = supply
    cold = balance_temperature(np.array([1e-6, 5.670374419]), 0.0, 1.0)
    np.testing.assert_allclose(cold, [(1e-6 / 5.670374419e-8) ** 0.25, 100.0], rtol=1e-12)


def test_missing_weather_gives_no_temperature():
    assert np.isnan(surface_temperature(np.nan, 400.0, 303.15, TABLE_1))
    assert np.isnan(balance_temperature(-1.0, 18.0, 0.9))


@pytest.mark.parametrize("wrong", [{"albedo": 1.0}, {"emissivity": 0.0}, {"emissivity_broadband": 1.2}])
def test_impossible_surfaces_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        SurfaceParameters(**wrong)
