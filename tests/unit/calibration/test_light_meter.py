"""Light on a meter's plane is beam times cosine plus the sky's share (ISO 9060's closure of the three)."""

from dataclasses import replace

import numpy as np
import pytest

from fieldkit.calibration.light_meter import (
    clock_lag_s,
    light_factor,
    on_plane,
    refuse_shifted_clocks,
    with_lag,
)
from fieldkit.model.errors import CalibrationError
from fieldkit.model.next_step import Action
from fieldkit.model.site import Site
from fieldkit.physics.irradiance import IrradianceModel, direct_normal
from fieldkit.physics.sun import sun_vectors
from fieldkit.weather import packaged_day
from tests.harness.next_steps import steps

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
    beam = np.linspace(600.0, 1000.0, TIMES.size)
    plane = on_plane(model, beam, None, SUN, TIMES)
    calibrated = replace(model, kind="calibrated", factor=0.0092)
    np.testing.assert_allclose(direct_normal(calibrated, plane / 0.0092, SUN, TIMES), beam, rtol=2e-3)


def test_measured_diffuse_light_is_added_as_measured():
    """SURFRAD, Alamosa, 2016-01-01: beam and diffuse together are what its global pyranometer reads."""
    weather = packaged_day()
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
    reading = plane / 0.0091 * (1.0 + 0.003 * random.standard_normal(120))
    found = light_factor(reading, plane, reference_sd=0.02)
    assert found.value == pytest.approx(0.0091, rel=0.001)
    assert found.standard_uncertainty == pytest.approx(0.0091 * np.hypot(0.02, 0.0153), rel=0.02)
    assert found.minutes == 120
    assert found.remarks == ()


def test_a_dark_offset_is_told():
    plane = np.linspace(200.0, 800.0, 200)
    assert "the origin" in light_factor((plane + 60.0) / 0.0091, plane).remarks[0]


def test_too_little_and_what_does_not_go_together_is_refused():
    plane = np.linspace(300.0, 600.0, 100)
    with pytest.raises(CalibrationError, match="only 5 "):
        light_factor(plane[:5] / 0.009, plane[:5])
    with pytest.raises(CalibrationError, match=r"\d+ of 100"):
        light_factor(plane[::-1] / 0.009, plane)  # as with a wrong zone: rising beside falling
    with pytest.raises(CalibrationError, match="origin by -27%"):
        light_factor((plane + 120.0) / 0.0091, plane)


@pytest.mark.parametrize(("on_meter", "on_reference", "excluded"), [(0.3, 1.0, 5), (1.0, 0.93, 4)])
def test_minutes_around_a_cloud_are_excluded(on_meter, on_reference, excluded):
    """A thin cloud over the pyranometer alone takes 7 %, within what one factor fits."""
    reading, plane = np.full(60, 500.0 / 0.0091), np.full(60, 500.0)
    reading[20:23] *= on_meter
    plane[20:25] *= on_reference
    found = light_factor(reading, plane)
    assert found.value == pytest.approx(0.0091, rel=0.005)
    assert found.minutes == 60 - excluded


DAY = packaged_day()
"""Alamosa, 2016-01-01, clear: global irradiance by its pyranometer."""
HOUR_NS = 3_600_000_000_000
WINDOWS = [(15, 24), (16, 17), (18, 20), (19, 20), (19, 22), (22, 23)]


def beside(hours: tuple[int, int], wrong_min: float, efficacy: float = 109.0):
    """Times, light by the meter, and by a reference whose clock is that much slow, of some hours UTC."""
    random = np.random.default_rng(1)
    light = DAY.ghi_w_m2 * efficacy * (1.0 + 0.003 * random.standard_normal(DAY.time_ns.size))
    late = np.interp(DAY.time_ns, DAY.time_ns + round(wrong_min * 60e9), DAY.ghi_w_m2)
    begin, end = (START + (hour - 17) * HOUR_NS for hour in hours)
    rows = (begin <= DAY.time_ns) & (DAY.time_ns < end)
    return DAY.time_ns[rows], light[rows], late


@pytest.mark.parametrize("hours", WINDOWS)
@pytest.mark.parametrize("wrong_min", [20.0, 30.0, 60.0, -60.0])
def test_a_clock_that_is_wrong_is_not_taken_for_a_factor(hours, wrong_min):
    """An hour of the afternoon, with a clock an hour off, gave a factor 38 % wrong at stated 18 % (k=2)."""
    time_ns, light, late = beside(hours, wrong_min)
    lag_s = clock_lag_s(time_ns, light, DAY.time_ns, late)
    assert lag_s == pytest.approx(60.0 * wrong_min, abs=120.0)
    with pytest.raises(CalibrationError) as refused:
        refuse_shifted_clocks(lag_s)
    assert steps(refused.value) == [Action.CALIBRATE("clock")]


@pytest.mark.parametrize("hours", WINDOWS)
@pytest.mark.parametrize("wrong_min", [0.0, 3.0, -5.0, 10.0])
def test_minutes_that_level_and_cosine_error_may_look_like_are_in_the_uncertainty(hours, wrong_min):
    time_ns, light, late = beside(hours, wrong_min)
    plane, aligned = (np.interp(time_ns + shift, DAY.time_ns, late) for shift in (0, round(wrong_min * 60e9)))
    refuse_shifted_clocks(lag_s := clock_lag_s(time_ns, light, DAY.time_ns, late))
    found = light_factor(light, plane)
    if lag_s:
        found = with_lag(found, light_factor(light, aligned), lag_s)
    assert 1.0 / found.value == pytest.approx(109.0, rel=found.expanded / found.value)
    if not wrong_min:
        assert lag_s == 0.0


def test_three_instruments_of_one_day_are_not_called_clocks_that_differ():
    """By beam and diffuse light the pyranometer of that day is 5 % low in the morning: level, not clock."""
    for hours in WINDOWS:
        time_ns, _, _ = beside(hours, 0.0)
        sun = sun_vectors(time_ns, SITE)
        columns = (DAY.dni_w_m2, DAY.dhi_w_m2, DAY.ghi_w_m2)
        dni, dhi, ghi = (np.interp(time_ns, DAY.time_ns, column) for column in columns)
        refuse_shifted_clocks(clock_lag_s(time_ns, dni * sun[:, 2] + dhi, time_ns, ghi))


@pytest.mark.parametrize("light", [np.full(240, np.nan), np.full(240, 50_000.0)])
def test_light_that_tells_no_time_shifts_no_clock(light):
    assert clock_lag_s(TIMES, light, TIMES, np.full(240, 500.0)) == 0.0
