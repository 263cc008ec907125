"""Band radiance against the properties of an 8-14 micrometre band computed from Planck's law elsewhere."""

import numpy as np
import pytest

from fieldkit.physics.radiance import (
    band_radiance,
    band_temperature,
    brightness_temperature_k,
    surface_temperature_k,
)

SIGMA = 5.670374419e-8


@pytest.mark.parametrize(("kelvin", "share"), [(233.0, 0.28), (300.0, 0.376), (318.0, 0.386)])
def test_bands_share_of_all_radiation(kelvin, share):
    assert band_radiance(kelvin) / (SIGMA * kelvin**4) == pytest.approx(share, abs=0.005)


@pytest.mark.parametrize(("celsius", "exponent"), [(0.0, 4.95), (20.0, 4.67), (45.0, 4.35), (60.0, 4.19)])
def test_band_radiance_is_no_fourth_power(celsius, exponent):
    warm = np.log(band_radiance(celsius + 273.65) / band_radiance(celsius + 272.65))
    found = warm / np.log((celsius + 273.65) / (celsius + 272.65))
    assert found == pytest.approx(exponent, abs=0.01)


def test_there_and_back():
    kelvin = np.linspace(150.0, 700.0, 20_011)
    np.testing.assert_allclose(band_temperature(band_radiance(kelvin)), kelvin, atol=1e-9)


# apparent temperature of a 45 degree surface with emissivity set to 1 (degrees Celsius)
REFLECTED_C = (-60.0, -40.0, -20.0, 0.0, 20.0)
APPARENT_C = {
    0.85: (35.0, 36.1, 37.5, 39.3, 41.6),
    0.90: (38.4, 39.1, 40.0, 41.2, 42.7),
    0.95: (41.8, 42.1, 42.5, 43.1, 43.9),
}


@pytest.mark.parametrize("emissivity", APPARENT_C)
def test_reflected_sky_cools_the_picture(emissivity):
    reflected = np.array(REFLECTED_C) + 273.15
    apparent = np.array(APPARENT_C[emissivity]) + 273.15
    found = brightness_temperature_k(np.full(5, 318.15), emissivity, reflected)
    np.testing.assert_allclose(found, apparent, atol=0.051)
    np.testing.assert_allclose(surface_temperature_k(found, emissivity, reflected), 318.15, atol=1e-6)


def test_reflection_brighter_than_all_that_was_seen_gives_nothing():
    assert np.isnan(surface_temperature_k(250.0, 0.3, 350.0))


def test_outside_the_table_and_missing_pixels_are_nan():
    assert np.isnan(band_radiance([50.0, 900.0, np.nan])).all()
    assert np.isnan(surface_temperature_k(np.nan, 0.9, 233.15))


@pytest.mark.parametrize("emissivity", [0.0, -0.1, 1.01])
def test_impossible_emissivity_is_refused(emissivity):
    with pytest.raises(ValueError, match=r"\(0, 1\]"):
        surface_temperature_k(300.0, emissivity, 233.15)
