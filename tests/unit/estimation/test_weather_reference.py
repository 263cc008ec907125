"""The level surface computed from the weather, against a balance by hand and the forward model of plans."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

import fieldkit
from fieldkit.config import config_from_text
from fieldkit.estimation.bins import History
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.slopes import slopes
from fieldkit.estimation.weather_reference import INPUTS, level_k
from fieldkit.model.errors import ConfigError
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import SlopeState
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.facet import angle_between_deg, normal
from fieldkit.physics.slab import Slab
from fieldkit.recording.predict import history_of
from fieldkit.results.estimate import estimate_tables
from fieldkit.weather import packaged_day

NONE = ((0.0, 0.0),)
TARGET = Region("bed", RegionKind.TARGET, NONE)
SETTINGS = EstimatorSettings(model="full", reference="weather", window_s=36_000.0)
SIGMA_SB = 5.670374419e-8


def steady(minutes: int, **changes: object) -> History:
    """Minutes of a sun that stands still."""
    minute, full = 25_000_000 + np.arange(minutes), lambda value: np.full(minutes, value)
    history = History(
        minute=minute,
        time_ns=minute * MINUTE_NS,
        sun=np.tile(normal(40.0, 180.0), (minutes, 1)),
        temperature_k=np.full((minutes, 1), 300.0),
        dni_w_m2=full(700.0),
        dhi_w_m2=full(90.0),
        longwave_down_w_m2=full(310.0),
        air_k=full(290.0),
    )
    return replace(history, **changes)  # type: ignore[arg-type]


def test_in_the_end_the_level_surface_gives_off_what_it_absorbs():
    """Eq. (1) of the paper with diffuse light: absorbed light and longwave equal emission and exchange."""
    thin = replace(SETTINGS, slab=Slab(depth_m=0.005))
    ghi = 700.0 * np.cos(np.radians(40.0)) + 90.0
    exchange = 1000.0 * 1.21 * 0.015  # Table 1: C_p, rho, C_H U

    def left_w_m2(kelvin: float, gain: float) -> float:
        lost = 0.90 * SIGMA_SB * kelvin**4 + exchange * (kelvin - 290.0)
        return lost - 0.80 * ghi * (1.0 + gain * SETTINGS.prior.gain_sd) - 0.90 * 310.0

    for gain in (0.0, 1.0):
        found = level_k(steady(300), thin, gain * (np.array(INPUTS) == "level gain"))
        assert found[-1] == pytest.approx(brentq(left_w_m2, 250.0, 400.0, args=(gain,)), abs=0.01)


def test_every_input_moves_the_level_surface():
    exact = level_k(steady(120, longwave_down_w_m2=np.full(120, np.nan)), SETTINGS)
    for shifts in np.eye(len(INPUTS)):
        shifted = level_k(steady(120, longwave_down_w_m2=np.full(120, np.nan)), SETTINGS, shifts)
        assert np.abs(shifted[-1] - exact[-1]) > 0.2


@pytest.fixture(scope="module")
def day():
    """The packaged day from 7 to 14 h local, predicted for a facet of 20° to the east and a level one."""
    exchange = SETTINGS.surface.exchange_w_m2_k
    span = {"start": "2016-01-01T07:00-07:00", "minutes": 420}
    facets = [(20.0, 90.0), (0.0, 0.0)]
    field = fieldkit.predict(facets, packaged_day(), settings=SETTINGS, exchange=exchange, **span)
    return history_of(field, packaged_day().site)


def test_the_level_surface_is_that_of_plans(day):
    """The forward model of plans, in steps of seconds: equal but for the first hours and changing light."""
    off = level_k(day, SETTINGS) - day.temperature_k[:, 1]
    assert np.abs(off[120:]).max() < 0.5
    assert np.abs(off[120:].mean()) < 0.05


def test_a_facet_alone_reads_right_where_the_weather_explains_it(day):
    (found,) = slopes(day.only(np.array([0])), [TARGET], SETTINGS)
    assert angle_between_deg(normal(found.tilt_deg, found.azimuth_deg), normal(20.0, 90.0)) < 3.0
    assert found.tilt_low_deg < 20.0 < found.tilt_high_deg
    measured = replace(SETTINGS, reference="region")
    (beside,) = slopes(day, [TARGET, Region("level", RegionKind.REFERENCE, NONE, 0.0, 0.0)], measured)
    assert found.tilt_high_deg - found.tilt_low_deg > 1.3 * (beside.tilt_high_deg - beside.tilt_low_deg)


def test_level_ground_says_that_north_and_south_are_undetermined(day):
    """One day has one declination of the sun: the gain and the tilt along the meridian are one number."""
    (found,) = slopes(day.only(np.array([1])), [TARGET], SETTINGS)
    assert found.tilt_low_deg == 0.0
    assert found.state is SlopeState.UNCERTAIN
    assert "north–south undetermined" in found.reason


def test_without_air_the_reason_says_so(day):
    unknown = replace(day.only(np.array([1])), air_k=np.full(len(day), np.nan))
    (found,) = slopes(unknown, [TARGET], SETTINGS)
    assert found.state is SlopeState.NO_DATA
    assert "air temperature" in found.reason


def test_a_table_needs_no_reference_then(day, tmp_path):
    path, kelvin = tmp_path / "bed.csv", day.temperature_k[:, 0]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["time", "bed_k", "air_k", "irradiance_w_m2", "diffuse_w_m2", "longwave_w_m2"])
        light = (day.dni_w_m2, day.dhi_w_m2, day.longwave_down_w_m2)
        times = np.datetime_as_string(day.time_ns.astype("datetime64[ns]"), unit="s")
        writer.writerows(zip(np.char.add(times, "Z"), kelvin, day.air_k, *light, strict=True))
    with pytest.raises(ConfigError, match="reference_k"):
        estimate_tables([path], packaged_day().site)
    (found,) = estimate_tables([path], packaged_day().site, settings=["estimator.reference=weather"])
    assert (found.region, found.model) == ("bed", "full, unit-norm")
    assert angle_between_deg(normal(found.tilt_deg, found.azimuth_deg), normal(20.0, 90.0)) < 3.0


def test_a_configuration_needs_no_reference_then():
    region = '[[region]]\nname = "bed"\npoints_px = [[1, 1], [9, 1], [9, 9]]\n'
    site = "[site]\nlatitude_deg = 35\nlongitude_deg = 139\n"
    found = config_from_text(f'{site}{region}[estimator]\nreference = "weather"\n', Path("fieldkit.toml"))
    assert [one.kind for one in found.regions] == [RegionKind.TARGET]
    with pytest.raises(ConfigError, match=r"fieldkit\.toml:4: region"):
        config_from_text(f"{site}{region}", Path("fieldkit.toml"))
