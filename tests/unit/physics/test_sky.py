import numpy as np
import pytest
from pvlib import irradiance

from fieldkit.physics.daylight import (
    ground_reflected,
    hay_davies_diffuse,
    isotropic_diffuse,
    longwave_on_facet,
)


def test_flat_facet_sees_the_whole_sky_and_no_ground():
    assert isotropic_diffuse(90.0, 1.0) == 90.0
    assert ground_reflected(700.0, 0.2, 1.0) == 0.0
    assert longwave_on_facet(300.0, 450.0, 1.0) == 300.0
    assert hay_davies_diffuse(90.0, 850.0, 1361.0, 0.6, 0.6, 1.0) == pytest.approx(90.0)


def test_wall_sees_half_of_each():
    assert isotropic_diffuse(90.0, 0.0) == 45.0
    assert ground_reflected(700.0, 0.2, 0.0) == 70.0
    assert longwave_on_facet(300.0, 450.0, 0.0) == 375.0


def test_hay_davies_agrees_with_pvlib():
    tilt, zenith, azimuth = np.array([0.0, 5.0, 15.0, 25.0, 80.0]), 58.8, 186.6
    theirs = irradiance.haydavies(tilt, 180.0, 90.0, 850.0, 1400.0, zenith, azimuth)
    cos_incidence = np.cos(np.radians(irradiance.aoi(tilt, 180.0, zenith, azimuth)))
    ours = hay_davies_diffuse(
        90.0, 850.0, 1400.0, cos_incidence, np.cos(np.radians(zenith)), np.cos(np.radians(tilt))
    )
    np.testing.assert_allclose(ours, theirs, rtol=1e-12)


def test_facet_in_its_own_shade_has_no_circumsolar_light():
    shaded = hay_davies_diffuse(100.0, 700.0, 1400.0, -0.1, 0.4, 0.5)
    assert shaded == pytest.approx(100.0 * 0.5 * 0.75)


@pytest.mark.parametrize("zenith", [80.0, 86.0, 88.9, 89.6])
def test_circumsolar_light_of_a_low_sun_agrees_with_pvlib(zenith):
    # pvlib holds the ratio of cosines below one degree of elevation, as we do
    theirs = irradiance.haydavies(30.0, 180.0, 40.0, 300.0, 1400.0, zenith, 180.0)
    cos_incidence, cos_tilt = np.cos(np.radians(zenith - 30.0)), np.cos(np.radians(30.0))
    ours = hay_davies_diffuse(40.0, 300.0, 1400.0, cos_incidence, np.cos(np.radians(zenith)), cos_tilt)
    assert float(ours) == pytest.approx(float(theirs), rel=1e-4)
