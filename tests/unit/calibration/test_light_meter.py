"""Light on a meter's plane is beam times cosine plus the sky's share (ISO 9060's closure of the three)."""

import numpy as np
import pytest

from fieldkit.calibration.light_meter import light_factor, on_plane
from fieldkit.model.errors import CalibrationError
from fieldkit.model.site import Site
from fieldkit.physics.irradiance import IrradianceModel, direct_normal
from fieldkit.physics.sun import sun_vectors
from fieldkit.weather import packaged

SITE = Site(37.70, -105.92, 2317.0)
START = int(np.datetime64("2016-01-01T17:00", "ns").astype(np.int64))
TIMES = START + np.arange(240) * 60_000_000_000
SUN = sun_vectors(TIMES, SITE)


@pytest.mark.parametrize(
    "model",
    [
        IrradianceModel(diffuse="none"),
        IrradianceModel(diffuse="fraction", diffuse_fraction=0.12),
        IrradianceModel(diffuse="erbs"),
        IrradianceModel(mounting="sun-pointing"),
        IrradianceModel(mounting="in-plane", plane_tilt_deg=20.0, plane_azimuth_deg=180.0),
    ],
    ids=lambda model: f"{model.mounting}-{model.diffuse}",
)
def test_the_factor_found_gives_the_beam_back(model):
    from dataclasses import replace

    beam = np.linspace(600.0, 1000.0, TIMES.size)
    plane = on_plane(model, beam, None, SUN, TIMES)
    calibrated = replace(model, kind="calibrated", factor=0.0092)
    np.testing.assert_allclose(direct_normal(calibrated, plane / 0.0092, SUN, TIMES), beam, rtol=2e-3)


def test_measured_diffuse_light_is_added_as_measured():
    """SURFRAD, Alamosa, 2016-01-01: beam and diffuse together are what its global pyranometer reads."""
    weather = packaged()
    dni, dhi = (np.interp(TIMES, weather.time_ns, column) for column in (weather.dni_w_m2, weather.dhi_w_m2))
    plane = on_plane(IrradianceModel(), dni, dhi, SUN, TIMES)
    np.testing.assert_allclose(plane, dni * SUN[:, 2] + dhi, rtol=1e-9)


def test_a_baffled_tube_beside_a_station_receives_its_beam_alone():
    tube = IrradianceModel(mounting="sun-pointing", diffuse="none")
    plane = on_plane(tube, np.full(240, 900.0), np.full(240, 80.0), SUN, TIMES)
    np.testing.assert_allclose(plane, 900.0)


def test_factor_and_uncertainty_of_a_clear_hour():
    random = np.random.default_rng(1)
    plane = np.linspace(300.0, 600.0, 120)
    found = light_factor(
        plane / 0.0091 * (1.0 + 0.003 * random.standard_normal(120)), plane, reference_sd=0.02
    )
    assert found.value == pytest.approx(0.0091, rel=0.001)
    assert found.standard_uncertainty == pytest.approx(0.0091 * np.hypot(0.02, 0.0153), rel=0.02)
    assert found.minutes == 120
    assert found.remarks == ()


def test_clouded_minutes_are_left_out():
    plane = np.full(60, 500.0)
    reading = plane / 0.0091
    reading[20:23] *= 0.3
    found = light_factor(reading, plane)
    assert found.value == pytest.approx(0.0091)
    assert found.minutes == 60 - 5


def test_a_dark_offset_is_told():
    plane = np.linspace(200.0, 800.0, 200)
    assert "misses the origin by" in light_factor((plane + 60.0) / 0.0091, plane).remarks[0]


def test_too_little_and_what_does_not_go_together_is_refused():
    plane = np.linspace(300.0, 600.0, 100)
    with pytest.raises(CalibrationError, match="only 5 steady minutes"):
        light_factor(plane[:5] / 0.009, plane[:5])
    with pytest.raises(CalibrationError, match="the instruments disagree"):
        light_factor(plane[::-1] / 0.009, plane)  # as with a wrong zone: rising beside falling


def test_minutes_around_a_step_of_the_reference_alone_are_left_out():
    """A thin cloud over the pyranometer only: 7 % less, within what one factor fits."""
    plane = np.full(60, 500.0)
    reading = plane / 0.0091
    plane[20:25] *= 0.93
    assert light_factor(reading, plane).minutes == 60 - 4
