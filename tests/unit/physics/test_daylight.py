import math

import numpy as np
import pytest
from pvlib import atmosphere, clearsky, irradiance

from benchmarks.harsh_worlds import perez_diffuse
from fieldkit.physics.daylight import (
    air_mass,
    clear_sky,
    diffuse_fraction_erbs,
    diffuse_fraction_of_beam,
    extraterrestrial,
    perez_efficacy,
)


def test_erbs_share_is_found_from_the_direct_light_that_it_leaves():
    clearness = np.array([0.1, 0.35, 0.6, 0.75, 0.9])
    share = diffuse_fraction_erbs(clearness)
    assert diffuse_fraction_of_beam(clearness * (1.0 - share)) == pytest.approx(share, abs=2e-3)


def test_erbs_agrees_with_pvlib():
    zenith = np.linspace(5.0, 75.0, 15)
    flat = np.linspace(80.0, 900.0, 15)
    theirs = irradiance.erbs(flat, zenith, 180, min_cos_zenith=0.01, max_zenith=89)["dhi"] / flat
    top = irradiance.get_extra_radiation(180)
    ours = diffuse_fraction_erbs(flat / (top * np.cos(np.radians(zenith))))
    np.testing.assert_allclose(ours, theirs, atol=1e-9)


def test_perez_says_nothing_with_the_sun_down():
    assert np.isnan(perez_efficacy(0.0, 10.0, -0.1, 1361.0)).all()


def test_distance_of_the_sun_over_the_year():
    # perihelion on 3-5 January, aphelion on 3-6 July; ratio of the squares is 1.0689 (Astronomical Almanac)
    days = np.array(["2026-01-04", "2026-07-05"], dtype="datetime64[ns]").astype(np.int64)
    near, far = extraterrestrial(days)
    assert near / far == pytest.approx(1.0689, abs=0.002)
    assert np.sqrt(near * far) == pytest.approx(1361.0, rel=0.002)


# Sky clearness up to, then a, b, c, d of global and of direct light: table 4 of Perez et al. 1990 as Radiance
# has it (gendaylit.c, `glob_h_effi_PEREZ` and `direct_n_effi_PEREZ`).
TABLE_4 = (
    (1.065, (96.63, -0.47, 11.50, -9.16), (57.20, -4.55, -2.98, 117.12)),
    (1.230, (107.54, 0.79, 1.79, -1.19), (98.99, -3.46, -1.21, 12.38)),
    (1.500, (98.73, 0.70, 4.40, -6.95), (109.83, -4.90, -1.71, -8.81)),
    (1.950, (92.72, 0.56, 8.36, -8.31), (110.34, -5.84, -1.99, -4.56)),
    (2.800, (86.73, 0.98, 7.10, -10.94), (106.36, -3.97, -1.75, -6.16)),
    (4.500, (88.34, 1.39, 6.06, -7.60), (107.19, -1.25, -1.51, -26.73)),
    (6.200, (78.63, 1.47, 4.93, -11.37), (105.75, 0.77, -1.26, -34.44)),
    (math.inf, (99.65, 1.86, -4.46, -3.15), (101.18, 1.58, -1.10, -8.29)),
)


@pytest.mark.parametrize("zenith_deg", [20.0, 50.0, 70.0])
@pytest.mark.parametrize("place", range(8))
@pytest.mark.parametrize("share", [0.05, 0.95])
def test_perez_in_every_bin_of_sky_clearness(zenith_deg, place, share):
    upper = min(TABLE_4[place][0], 9.0)
    lower = TABLE_4[place - 1][0] if place else 1.0
    wanted = lower + share * (upper - lower)
    zenith, diffuse, top, water_cm = math.radians(zenith_deg), 120.0, 1400.0, 1.5
    cube = 1.041 * zenith**3
    direct = (wanted * (1.0 + cube) - cube - 1.0) * diffuse  # eq. (1): clearness from beam and sky
    _, (a, b, c, d), (e, f, g, h) = TABLE_4[place]
    brightness = diffuse / (math.cos(zenith) * top)
    of_global, of_direct = perez_efficacy(direct, diffuse, math.cos(zenith), top, water_cm)
    assert of_global == pytest.approx(a + b * water_cm + c * math.cos(zenith) + d * math.log(brightness))
    expected = e + f * water_cm + g * math.exp(5.73 * zenith - 5.0) + h * brightness
    assert of_direct == pytest.approx(max(expected, 0.0))


NOON = np.array(["2017-08-30T03:00"], dtype="datetime64[ns]").astype(np.int64)


def test_air_mass_of_kasten_and_young():
    # Kasten and Young 1989, table II: altitudes 90, 30, 10, 5, 0 degrees
    cosines = np.cos(np.radians([0.0, 60.0, 80.0, 85.0, 90.0]))
    np.testing.assert_allclose(air_mass(cosines), [1.0, 1.9943, 5.5841, 10.3058, 37.9196], rtol=2e-3)


@pytest.mark.parametrize("elevation", [0.0, 9.0, 2317.0])
@pytest.mark.parametrize("turbidity", [2.0, 3.5, 6.0])
def test_clear_sky_agrees_with_pvlib(elevation, turbidity):
    zenith = np.array([5.0, 27.0, 60.0, 80.0, 87.0])
    cosines = np.cos(np.radians(zenith))
    theirs = clearsky.ineichen(
        zenith, air_mass(cosines, elevation), turbidity, elevation, float(extraterrestrial(NOON)[0])
    )
    direct, diffuse = clear_sky(cosines, NOON, elevation, turbidity)
    np.testing.assert_allclose(direct, theirs["dni"], rtol=1e-9)
    np.testing.assert_allclose(diffuse, theirs["dhi"], rtol=1e-9)


def test_night_is_dark():
    direct, diffuse = clear_sky([-0.1, -1.0], NOON)
    assert not direct.any()
    assert not diffuse.any()


def test_perez_on_facets_agrees_with_pvlib():
    """All bins of clearness, suns from 6 degrees on, tilts up to 90 degrees; the coefficients of 1990."""
    random = np.random.default_rng(1)
    zenith, azimuth = random.uniform(5.0, 84.0, 2000), random.uniform(0.0, 360.0, 2000)
    dhi, dni, tilt = (random.uniform(*limits, 2000) for limits in ((20, 400), (0, 1000), (0, 90)))
    mass = atmosphere.get_relative_airmass(zenith, "kastenyoung1989")
    expected = irradiance.perez(
        tilt, 180.0, dhi, dni, 1366.0, zenith, azimuth, mass, model="allsitescomposite1990"
    )
    towards = irradiance.aoi_projection(tilt, 180.0, zenith, azimuth)
    cosines = np.cos(np.radians(zenith)), np.cos(np.radians(tilt))
    np.testing.assert_allclose(perez_diffuse(dhi, dni, 1366.0, towards, *cosines), expected, atol=1e-9)
