from dataclasses import replace

import numpy as np
import pytest

from fieldkit.model.fault_kind import FaultKind
from fieldkit.model.site import RegionKind
from fieldkit.model.units import SECOND_NS
from fieldkit.physics.irradiance import IrradianceModel, direct_normal
from fieldkit.physics.sun import sun_vectors
from fieldkit.simulation import Fault, LightStep, sand_slopes

MINUTE_NS = 60 * SECOND_NS


@pytest.fixture(scope="module")
def scene():
    return sand_slopes()


def after(scene, seconds):
    return scene.start_ns + round(seconds * SECOND_NS)


def test_scene_starts_at_noon_of_the_site(scene):
    assert np.datetime64(scene.start_ns, "ns") == np.datetime64("2016-01-01T19:00")
    assert scene.end_ns - scene.start_ns == 180 * MINUTE_NS


def test_same_seed_gives_the_same_world_and_another_seed_another(scene):
    again, other = sand_slopes(), replace(scene, seed=2)
    noon = after(scene, 1234.5)
    np.testing.assert_array_equal(scene.frame(noon, 7), again.frame(noon, 7))
    assert scene.lux_reading(noon) == again.lux_reading(noon)
    assert scene.lux_reading(noon) != other.lux_reading(noon)
    assert not np.array_equal(scene.frame(noon, 7), other.frame(noon, 7))


def test_answers_do_not_depend_on_what_was_asked_before(scene):
    asked, fresh = sand_slopes(duration_s=600.0), sand_slopes(duration_s=600.0)
    for seconds in range(0, 600, 50):
        asked.frame(after(asked, seconds), seconds)
        asked.probe_readings(after(asked, seconds))
    np.testing.assert_array_equal(asked.frame(after(asked, 99), 3), fresh.frame(after(fresh, 99), 3))


def test_steeper_beds_towards_the_sun_are_warmer(scene):
    """The paper's Fig. 13 setting: slopes facing south on a December noon."""
    flat, b05, b15, b25, _ = scene.at(after(scene, 1800)).surface_k
    assert flat < b05 < b15 < b25
    assert 2.0 < b05 - flat < 6.0


def test_sun_shines_on_a_bed_only_from_the_front(scene):
    """Turned away beyond the sun's elevation of 29 degrees, a bed gets sky and ground light alone."""
    away = replace(scene.facets[3], name="away", tilt_deg=60.0, azimuth_deg=0.0)
    beds = replace(scene, facets=(scene.facets[0], scene.facets[3], away))
    flat, _, turned = beds.at(after(scene, 600)).surface_k[:3]
    assert turned < flat - 10.0


def test_cold_sky_in_the_sand_makes_beds_look_colder_than_they_are(scene):
    """At emissivity 0.90 under a sky of -40 °C and colder: some 4 K at 10 to 30 °C."""
    moment = scene.at(after(scene, 600))
    missing_k = moment.surface_k - moment.brightness_k
    assert np.all((missing_k > 3.0) & (missing_k < 7.0))


def test_truth_about_the_sky_is_the_measurement(scene):
    weather = scene.sky.weather
    minute = 1200  # averaged from 19:59 to 20:00 UTC
    moment = scene.at(int(weather.time_ns[minute]))
    # the scene's own times are 10 s apart, lines between minutes are kept to a watt
    assert moment.dni_w_m2 == pytest.approx(weather.dni_w_m2[minute], abs=1.0)
    assert moment.dhi_w_m2 == pytest.approx(weather.dhi_w_m2[minute], abs=1.0)
    assert moment.air_temperature_k == pytest.approx(weather.air_temperature_k[minute], abs=0.05)


@pytest.mark.parametrize("diffuse", ["fraction", "erbs"])
def test_direct_light_from_the_light_meter_is_within_ten_percent_of_the_measured(scene, diffuse):
    """The default model, 12 to 15 h on the clear day, against NOAA's pyrheliometer."""
    time_ns = scene.start_ns + np.arange(181) * MINUTE_NS
    lux = np.array([scene.lux_reading(int(t)) for t in time_ns])
    measured = np.array([scene.at(int(t)).dni_w_m2 for t in time_ns])
    model = IrradianceModel(diffuse=diffuse)
    assert (model.kind, model.par_fraction) == ("eq10", 0.44)
    ours = direct_normal(model, lux, sun_vectors(time_ns, scene.site), time_ns)
    error = ours / measured - 1.0
    assert np.abs(error).max() < 0.10
    assert np.abs(error).max() > 0.01, "the scene's daylight must not share the model's one efficacy"


def test_probes_lag_behind_the_surface(scene):
    """A probe of first order follows a steady trend by its time constant."""
    slow = replace(scene, response_s=30.0)
    moment, before = slow.at(after(slow, 2000)), slow.at(after(slow, 1970))
    lag_k = moment.surface_k - moment.contact_k
    trend_k = moment.surface_k - before.surface_k
    assert np.all(np.sign(lag_k) == np.sign(trend_k))
    np.testing.assert_allclose(lag_k, trend_k, atol=0.6 * np.abs(trend_k).max())


def test_probe_noise_is_small_and_of_zero_mean(scene):
    start = after(scene, 600)
    times = range(start, start + 500)
    errors = np.array([scene.probe_readings(at) - scene.at(at).contact_k[:-1] for at in times])
    assert np.abs(errors.mean()) < 0.005
    assert errors.std() == pytest.approx(0.03, rel=0.1)


def test_regions_lie_within_their_beds_and_carry_the_truth(scene):
    for facet, region in zip(scene.facets, scene.regions, strict=True):
        assert region.name == facet.name
        assert (region.tilt_deg, region.azimuth_deg) == (facet.tilt_deg, facet.azimuth_deg)
        bed = replace(region, points_px=facet.points_px).mask((120, 160))
        inside = region.mask((120, 160))
        assert inside.sum() > 500
        assert not (inside & ~bed).any()
    kinds = [region.kind for region in scene.regions]
    assert kinds == [RegionKind.REFERENCE] + [RegionKind.TARGET] * 3


# --- trouble


def test_faults_begin_in_the_middle_unless_told_otherwise():
    faults = Fault(FaultKind.CABLE), Fault(FaultKind.FROZEN, 10.0, 5.0)
    scene = sand_slopes(duration_s=1000.0, faults=faults)
    middle = scene.start_ns + 500 * SECOND_NS
    lasts_ns = round(FaultKind.CABLE.lasts_s * SECOND_NS)
    assert scene.fault_spans(FaultKind.CABLE) == [(middle, middle + lasts_ns)]
    assert scene.is_on(FaultKind.FROZEN, after(scene, 10.0))
    assert not scene.is_on(FaultKind.FROZEN, after(scene, 15.0))
    assert not scene.is_on(FaultKind.CLOUD, middle)
    assert all(kind.lasts_s >= 0.0 for kind in FaultKind)


def test_cloud_dims_the_beam_at_once_and_cools_the_sand_slowly():
    clear = sand_slopes(duration_s=1800.0)
    cloudy = sand_slopes(duration_s=1800.0, faults=(Fault(FaultKind.CLOUD),))
    begin_ns, end_ns = cloudy.fault_spans(FaultKind.CLOUD)[0]
    inside = (begin_ns + end_ns) // 2
    assert cloudy.at(begin_ns - SECOND_NS).dni_w_m2 == clear.at(begin_ns - SECOND_NS).dni_w_m2
    assert cloudy.at(inside).dni_w_m2 == pytest.approx(0.2 * clear.at(inside).dni_w_m2, rel=0.01)
    assert cloudy.at(inside).illuminance_lx < 0.4 * clear.at(inside).illuminance_lx
    times = (begin_ns, begin_ns + 30 * SECOND_NS, inside)
    cooling = [clear.at(t).surface_k[0] - cloudy.at(t).surface_k[0] for t in times]
    assert cooling[0] == pytest.approx(0.0, abs=1e-3)
    assert 0.5 < cooling[1] < 3.0 < cooling[2]
    assert cloudy.at(end_ns + 600 * SECOND_NS).surface_k[0] > cloudy.at(end_ns).surface_k[0] + 1.0


def test_light_step_changes_all_light_within_a_microsecond():
    noon = sand_slopes().start_ns + 100 * SECOND_NS
    stepped = sand_slopes(duration_s=300.0, light_steps=(LightStep(noon, 0.25),))
    before, at = stepped.at(noon - 2_000), stepped.at(noon)
    assert at.illuminance_lx == pytest.approx(0.25 * before.illuminance_lx, rel=1e-4)
    assert at.surface_k[0] == pytest.approx(before.surface_k[0], abs=1e-3), "sand is slower than light"
    assert stepped.at(noon + 30 * SECOND_NS).surface_k[0] < before.surface_k[0] - 1.0


def test_disk_fault_shrinks_the_free_space_below_any_reserve_and_ends():
    scene = sand_slopes(duration_s=3600.0, faults=(Fault(FaultKind.DISK, 600.0, 600.0),))
    real = 10**11
    free = [scene.disk_free_bytes(after(scene, seconds), real) for seconds in range(0, 1500, 60)]
    during = free[10:20]
    assert free[:10] == [real] * 10
    assert free[20:] == [real] * 5
    assert during == sorted(during, reverse=True)
    assert during[-1] < 64_000_000
