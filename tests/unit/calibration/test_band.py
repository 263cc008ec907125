import math

import numpy as np
import pytest

from fieldkit.calibration.band import (
    FLAT,
    CameraBand,
    ResponseBand,
    before_camera_settings,
    own_part_k,
    transmission,
)
from fieldkit.model.errors import ConfigError
from fieldkit.physics.radiance import band_radiance, band_temperature


@pytest.mark.parametrize("air_k", [263.15, 303.15])
def test_air_taken_out_gives_what_left_the_surface(air_k):
    surface = np.array([280.0, 320.0])
    seen = 0.93 * band_radiance(surface) + 0.07 * band_radiance(air_k)
    np.testing.assert_allclose(own_part_k(band_temperature(seen), 0.93, air_k), surface, atol=1e-6)


def test_flat_8_to_14_is_matched_by_a_cameras_constants():
    """B 1324 K, F 2.81 follow the flat band to 0.05 K over -20..80 °C (fitted elsewhere)."""
    camera, kelvin = CameraBand(1324.0, 2.81), np.linspace(253.0, 353.0, 21)
    gain, offset = np.polyfit(camera.signal(kelvin), FLAT.signal(kelvin), 1)
    fitted = FLAT.temperature(gain * camera.signal(kelvin) + offset)
    np.testing.assert_allclose(fitted, kelvin, atol=0.2)
    np.testing.assert_allclose(camera.temperature(camera.signal(kelvin)), kelvin, atol=1e-9)


def test_a_response_is_read_from_a_table_with_a_heading(tmp_path):
    table = tmp_path / "response.csv"
    table.write_text("um,response\n8,1\n14,1\n", encoding="utf-8")
    band = ResponseBand.read(table)
    ratio = band.signal([260.0, 300.0, 340.0]) / FLAT.signal([260.0, 300.0, 340.0])
    np.testing.assert_allclose(ratio / ratio[0], 1.0, rtol=1e-4)
    assert band.label == "response response.csv"


@pytest.mark.parametrize(
    "text",
    ["um,response\n", "8,1\n", "8,1\n7,1\n", "8,-1\n9,1\n", "8,0\n9,0\n", "8;1\n9;1\n", "8,nan\n9,1\n"],
)
def test_what_is_no_response_is_refused(tmp_path, text):
    table = tmp_path / "response.csv"
    table.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError):
        ResponseBand.read(table)


def test_a_cameras_own_band_is_its_planck_law_with_the_offset_taken_away():
    """S = R / (exp(B / T) - F) - O, as FLIR's constants are used everywhere."""
    band = CameraBand(1500.0, 1.2, 15_000.0, -7000.0)
    expected = 15_000.0 / (math.exp(1500.0 / 300.0) - 1.2) + 7000.0
    assert float(band.signal(300.0)) == pytest.approx(expected, rel=1e-12)
    assert float(band.temperature(expected)) == pytest.approx(300.0, abs=1e-9)


@pytest.mark.parametrize("distance_m", [0.0, 2.0, 10.0, 50.0])
def test_air_in_between_lets_through_what_flirs_law_says(distance_m):
    """Eq. (3.6) of Minkina and Dudzik, "Infrared Thermography: Errors and Uncertainties", 2009."""
    air_c, humidity = 25.0, 0.6
    water = humidity * math.exp(1.5587 + 6.939e-2 * air_c - 2.7816e-4 * air_c**2 + 6.8455e-7 * air_c**3)
    first = math.exp(-math.sqrt(distance_m) * (0.006569 - 0.002276 * math.sqrt(water)))
    second = math.exp(-math.sqrt(distance_m) * (0.01262 - 0.00667 * math.sqrt(water)))
    expected = 1.9 * first + (1.0 - 1.9) * second
    assert transmission(distance_m, air_c + 273.15, humidity) == pytest.approx(expected, rel=1e-9)


def test_what_a_camera_corrected_itself_is_undone():
    """It reported 320 K for an emissivity of 0.9 under 280 K: it saw the brightness of such a surface."""
    seen = 0.9 * band_radiance(320.0) + 0.1 * band_radiance(280.0)
    found = float(before_camera_settings(320.0, 0.9, 280.0))
    assert found == pytest.approx(float(band_temperature(seen)), abs=1e-6)
