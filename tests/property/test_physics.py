import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from fieldkit.physics.energy_balance import (
    SurfaceParameters,
    irradiance_difference,
    irradiance_per_kelvin,
    surface_temperature,
)
from fieldkit.physics.facet import angle_between_deg, cos_incidence, incidence_deg, normal, tilt_azimuth
from fieldkit.physics.irradiance import IrradianceModel, direct_normal
from fieldkit.physics.radiance import band_radiance

tilts = st.floats(0.0, 90.0)
azimuths = st.floats(0.0, 360.0)
kelvins = st.floats(180.0, 400.0)
surfaces = st.builds(
    SurfaceParameters,
    albedo=st.floats(0.0, 0.8),
    emissivity_broadband=st.floats(0.5, 1.0),
    exchange_m_s=st.floats(0.001, 0.05),
)


@given(tilts, azimuths)
def test_angles_survive_the_normal(tilt, azimuth):
    found_tilt, found_azimuth = tilt_azimuth(normal(tilt, azimuth))
    assert abs(found_tilt - tilt) < 1e-9
    if tilt > 1e-3:
        assert abs((found_azimuth - azimuth + 180.0) % 360.0 - 180.0) < 1e-9
    assert 0.0 <= found_azimuth < 360.0


@given(tilts, azimuths, tilts, azimuths)
def test_incidence_is_the_angle_whose_cosine_is_the_product(tilt, azimuth, zenith, bearing):
    facet, sun = normal(tilt, azimuth), normal(zenith, bearing)
    cosine = cos_incidence(facet, sun)
    assert -1.0 - 1e-15 <= cosine <= 1.0 + 1e-15
    assert abs(np.cos(np.radians(incidence_deg(facet, sun))) - cosine) < 1e-12


@given(tilts, azimuths, tilts, azimuths, azimuths)
def test_turning_the_compass_changes_no_angle(tilt, azimuth, zenith, bearing, turn):
    before = angle_between_deg(normal(tilt, azimuth), normal(zenith, bearing))
    after = angle_between_deg(normal(tilt, azimuth + turn), normal(zenith, bearing + turn))
    assert abs(before - after) < 1e-10


@given(kelvins, kelvins, surfaces)
def test_equation_6_is_odd_and_grows_with_the_target(target, reference, surface):
    forth = irradiance_difference(target, reference, surface)
    assert forth == -irradiance_difference(reference, target, surface)
    assert (forth > 0) == (target > reference) or target == reference


@given(kelvins, surfaces)
def test_watts_per_kelvin_is_the_derivative_of_equation_6(kelvin, surface):
    step = irradiance_difference(kelvin + 0.01, kelvin - 0.01, surface) / 0.02
    assert abs(step / irradiance_per_kelvin(kelvin, surface) - 1.0) < 1e-6


@given(st.floats(0.0, 1100.0), st.floats(50.0, 500.0), st.floats(230.0, 320.0), surfaces)
def test_equation_6_undoes_equation_7(sunlight, longwave, air, surface):
    target = surface_temperature(sunlight, longwave, air, surface)
    reference = surface_temperature(300.0, longwave, air, surface)
    assert abs(irradiance_difference(target, reference, surface) - (sunlight - 300.0)) < 1e-6


@given(kelvins, st.floats(0.01, 50.0))
def test_warmer_surfaces_shine_brighter(kelvin, more):
    assert band_radiance(kelvin + more) > band_radiance(kelvin)


@given(st.floats(0.0, 75.0), st.floats(100.0, 1000.0), st.floats(0.0, 0.6), tilts, azimuths)
def test_a_beam_put_on_the_meters_plane_comes_back(zenith, beam, share, tilt, azimuth):
    sun, board = normal(zenith, 180.0), normal(tilt, azimuth)
    sky = share / (1 - share) * sun[2]
    ground = 0.3 * (sun[2] + sky) * (1 - board[2]) / 2
    reading = beam * (sun @ board + sky * (1 + board[2]) / 2 + ground)
    model = IrradianceModel(
        "calibrated", factor=1.0, mounting="in-plane", plane_tilt_deg=tilt, plane_azimuth_deg=azimuth,
        diffuse_fraction=share, ground_albedo=0.3,
    )  # fmt: skip
    found = direct_normal(model, [reading], sun[np.newaxis], [0])[0]
    assert np.isnan(found) if sun @ board < 0.1999 else np.isnan(found) or abs(found - beam) < 1e-8 * beam
