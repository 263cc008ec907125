import numpy as np
import pytest

from fieldkit.physics.illumination import diffuse_fraction_erbs, perez_efficacy
from fieldkit.physics.sky import extraterrestrial


def test_erbs_at_the_joints_of_the_correlation():
    # Erbs, Klein and Duffie 1982, eq. (1): 1 - 0.09 k; polynomial; 0.165
    found = diffuse_fraction_erbs([0.0, 0.22, 0.5, 0.80001, 1.1])
    np.testing.assert_allclose(found, [1.0, 0.9802, 0.6592, 0.165, 0.165], atol=5e-4)


def test_erbs_agrees_with_pvlib():
    irradiance = pytest.importorskip("pvlib.irradiance", reason="pvlib comes with the [lab] extra")
    zenith = np.linspace(5.0, 75.0, 15)
    flat = np.linspace(80.0, 900.0, 15)
    theirs = irradiance.erbs(flat, zenith, 180, min_cos_zenith=0.01, max_zenith=89)["dhi"] / flat
    top = irradiance.get_extra_radiation(180)
    ours = diffuse_fraction_erbs(flat / (top * np.cos(np.radians(zenith))))
    np.testing.assert_allclose(ours, theirs, atol=1e-9)


def perez(zenith_deg, water_cm, brightness, direct=900.0):
    cosine, top = np.cos(np.radians(zenith_deg)), 1361.0
    return perez_efficacy(direct, brightness * top * cosine, cosine, top, water_cm)


def test_perez_under_a_clear_sky():
    # Perez et al. 1990, worked examples: 27 degrees, 3 cm of water, brightness 0.1
    of_global, of_direct = perez(27.0, 3.0, 0.1)
    assert of_global == pytest.approx(108.5, abs=1.0)
    assert of_direct == pytest.approx(105.0, abs=1.0)


def test_low_winter_sun_is_redder():
    # 76 degrees in dry air: 87 lm/W of direct light
    _, of_direct = perez(76.0, 0.5, 0.1, direct=700.0)
    assert of_direct == pytest.approx(87.0, abs=2.5)


def test_perez_says_nothing_with_the_sun_down():
    assert np.isnan(perez_efficacy(0.0, 10.0, -0.1, 1361.0)).all()


def test_distance_of_the_sun_over_the_year():
    # perihelion on 3-5 January, aphelion on 3-6 July; ratio of the squares is 1.0689 (Astronomical Almanac)
    days = np.array(["2026-01-04", "2026-07-05"], dtype="datetime64[ns]").astype(np.int64)
    near, far = extraterrestrial(days)
    assert near / far == pytest.approx(1.0689, abs=0.002)
    assert np.sqrt(near * far) == pytest.approx(1361.0, rel=0.002)
