import numpy as np
import pvlib
import pytest

from fieldkit.physics.daylight import diffuse_fraction_erbs, extraterrestrial, perez_efficacy
from fieldkit.physics.facet import normal
from fieldkit.physics.irradiance import IrradianceModel, direct_normal, eq10

NOON = np.array(["2017-08-30T03:00"], dtype="datetime64[ns]").astype(np.int64)
SUN = normal(60.0, 180.0).reshape(1, 3)  # cosine 0.5 on the horizontal


def beam(value, sun=SUN, **choices):
    return float(direct_normal(IrradianceModel(**choices), [value], sun, NOON)[0])


def test_equation_10_as_printed():
    # 100 klx give 405 W/m2 of 400-700 nm light
    assert eq10(100_000.0, par_fraction=1.0) == pytest.approx(100_000.0 / 246.78, rel=1e-12)
    assert eq10(100_000.0, par_fraction=1.0) == pytest.approx(405.2, abs=0.05)


def test_equation_10_over_the_bands_share_agrees_with_standard_sunlight():
    # ASTM G173 direct and circumsolar: 97 200 lux are 900 W/m2; global on 37 degrees: 109 600 lux, 1000 W/m2
    assert eq10(97_200.0) == pytest.approx(900.0, rel=0.01)
    assert eq10(109_600.0) == pytest.approx(1000.0, rel=0.01)


def test_diffuse_share_goes_out_and_the_cosine_divides():
    flat = eq10(50_000.0)
    assert beam(50_000.0, diffuse="none") == pytest.approx(float(flat) / 0.5)
    assert beam(50_000.0) == pytest.approx(float(flat) * 0.85 / 0.5)


def test_sun_pointing_tube_reads_the_beam_itself():
    assert beam(50_000.0, mounting="sun-pointing", diffuse="none") == pytest.approx(float(eq10(50_000.0)))


def test_open_sun_pointing_meter_also_sees_the_sky():
    # S + D (1 + cos 60) / 2 + 0.3 (S cos 60 + D) (1 - cos 60) / 2 with D = 0.2 / 0.8 * S / 2
    reading = 800.0 * (1.0 + 0.125 * 0.75 + 0.3 * 0.625 * 0.25)
    open_meter = {"mounting": "sun-pointing", "diffuse_fraction": 0.2, "ground_albedo": 0.3}
    assert beam(reading, kind="calibrated", factor=1.0, **open_meter) == pytest.approx(800.0)


def test_meter_on_a_tilted_board():
    # the board faces the sun 30 degrees off
    board = {"mounting": "in-plane", "plane_tilt_deg": 30.0, "plane_azimuth_deg": 180.0}
    found = beam(400.0, kind="calibrated", factor=2.0, diffuse="none", **board)
    assert found == pytest.approx(800.0 / np.cos(np.radians(30.0)))


@pytest.mark.parametrize("kind", ["pyranometer", "calibrated"])
def test_a_tilted_meter_does_not_take_the_light_of_the_ground_for_beam(kind):
    """On 30 degrees the ground adds 0.2 x 520 W/m2 x 0.067: without it the beam was 1.1 % too large."""
    on_plane = pvlib.irradiance.get_total_irradiance(
        30.0, 180.0, 60.0, 180.0, dni=800.0, ghi=520.0, dhi=120.0, albedo=0.2, model="isotropic"
    )
    model = IrradianceModel(
        kind, factor=1.0, mounting="in-plane", plane_tilt_deg=30.0, plane_azimuth_deg=180.0,
        diffuse_fraction=120.0 / 520.0,
    )  # fmt: skip
    for dhi in (np.nan, 120.0):
        found = direct_normal(model, [on_plane["poa_global"]], SUN, NOON, dhi)
        assert found[0] == pytest.approx(800.0, rel=1e-6)


def test_efficacy_in_lumens_per_watt():
    assert beam(52_500.0, kind="efficacy", diffuse="none") == pytest.approx(1000.0)


def test_perez_split_is_consistent_with_itself():
    # the beam found and its sky light must make the lux that were read
    sun, cosine = normal(27.0, 180.0).reshape(1, 3), np.cos(np.radians(27.0))
    found = beam(100_000.0, sun=sun, kind="perez", diffuse_fraction=0.1)
    flat = found * cosine / 0.9
    of_global, _ = perez_efficacy(found, 0.1 * flat, cosine, extraterrestrial(NOON)[0])
    assert of_global * flat == pytest.approx(100_000.0, rel=1e-9)
    assert 95.0 < of_global < 120.0


@pytest.mark.parametrize("kind", ["pyrheliometer", "file"])
def test_measured_beam_is_taken_as_it_is(kind):
    low_sun = normal(85.0, 180.0).reshape(1, 3)
    assert beam(432.1, kind=kind) == 432.1
    assert beam(200.0, kind=kind, sun=low_sun) == 200.0


def test_low_sun_on_the_meters_plane_determines_nothing():
    low = normal(78.5, 180.0).reshape(1, 3)  # cosine 0.1994
    assert np.isnan(beam(20_000.0, sun=low))
    assert np.isnan(beam(np.nan))  # and a missing reading stays missing
    assert not np.isnan(beam(20_000.0, sun=low, mounting="sun-pointing", diffuse="none"))


def test_sun_below_the_horizon_has_no_beam():
    night = normal(95.0, 0.0).reshape(1, 3)
    for kind in ("eq10", "pyrheliometer"):
        assert np.isnan(beam(10.0, sun=night, kind=kind, mounting="sun-pointing"))


def test_erbs_split_is_consistent_with_itself():
    # what the beam and its diffuse light make on the plane must be the reading
    sun = normal(50.0, 200.0).reshape(1, 3)
    cosine = np.cos(np.radians(50.0))
    for flat in (150.0, 400.0, 650.0):
        found = beam(flat, sun=sun, kind="calibrated", factor=1.0, diffuse="erbs")
        share = diffuse_fraction_erbs(flat / (extraterrestrial(NOON)[0] * cosine))
        assert found * cosine == pytest.approx(flat * (1.0 - share), rel=1e-9)


def test_every_label_fits_and_differs():
    models = [
        IrradianceModel(),
        IrradianceModel(par_fraction=1.0),
        IrradianceModel("efficacy", diffuse="none"),
        IrradianceModel("perez", diffuse="erbs"),
        IrradianceModel("calibrated", factor=0.00912345678),
        IrradianceModel("pyrheliometer"),
        IrradianceModel("file"),
        IrradianceModel("calibrated", factor=0.0091234, mounting="in-plane", plane_tilt_deg=12.25,
                        plane_azimuth_deg=181.75),
    ]  # fmt: skip
    labels = [model.label for model in models]
    assert len(set(labels)) == len(labels)
    assert max(map(len, labels)) <= 64
    assert labels[0] == "eq10 /0.44, diffuse 15%, horizontal"


def test_perez_for_a_meter_held_into_the_sun_is_the_efficacy_of_direct_light():
    sun, cosine = normal(60.0, 180.0).reshape(1, 3), 0.5
    found = beam(90_000.0, sun=sun, kind="perez", mounting="sun-pointing", diffuse_fraction=0.1)
    sky = 0.1 / 0.9 * found * cosine  # of which the meter sees (1 + cos 60) / 2
    ground = 0.2 * (found * cosine + sky) * 0.25
    _, of_direct = perez_efficacy(found, sky, cosine, extraterrestrial(NOON)[0])
    assert of_direct * (found + sky * 0.75 + ground) == pytest.approx(90_000.0, rel=1e-9)
