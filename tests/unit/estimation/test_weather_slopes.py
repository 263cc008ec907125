"""Slopes from the weather alone, on days of the forward model of plans, which shares no code with it."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import multivariate_normal

import fieldkit
from fieldkit.config import config_from_text
from fieldkit.estimation import weather_slopes
from fieldkit.estimation.bins import join
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.table import slopes_of_part
from fieldkit.estimation.together import Part, slopes_together
from fieldkit.model.errors import ConfigError
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import SlopeState
from fieldkit.physics.facet import angle_between_deg, normal
from fieldkit.recording.predict import history_of
from fieldkit.results.estimate import estimate_tables
from fieldkit.weather import packaged_day
from tests.harness.drawn import later, write_table

FACETS = {"east": (30.0, 90.0), "south": (40.0, 180.0), "west wall": (90.0, 270.0)}
REGIONS = [Region(name, RegionKind.TARGET, ((0.0, 0.0),)) for name in FACETS]


def settings_of(kind, text=""):
    site = "[site]\nlatitude_deg = 37.7\nlongitude_deg = -105.92\n"
    text = f'{site}[estimator]\nreference = "weather"\n[surface]\nkind = "{kind}"\n{text}'
    return config_from_text(text, Path("fieldkit.toml")).estimator_settings()


PLATE = settings_of("plate")


def day_of(settings, albedo=None):
    """The packaged day from 7 to 17 h local in a warmer season, predicted for the facets."""
    cold = packaged_day()
    air_k, longwave = cold.air_temperature_k + 25.0, cold.longwave_down_w_m2 + 110.0
    warm = replace(cold, air_temperature_k=air_k, longwave_down_w_m2=longwave)
    surface = replace(settings.surface, albedo=settings.surface.albedo if albedo is None else albedo)
    field = fieldkit.predict(
        list(FACETS.values()),
        warm,
        settings=replace(settings, surface=surface),
        exchange=settings.prior.exchange_w_m2_k,
        start="2016-01-01T07:00-07:00",
        minutes=590,
    )
    return history_of(field, packaged_day().site)


@pytest.fixture(scope="module")
def day():
    return day_of(PLATE)


@pytest.fixture(scope="module")
def slopes(day):
    return {slope.region: slope for slope in SlopeChain(REGIONS, PLATE).at(day).slopes}


@pytest.mark.parametrize(("name", "most_deg"), [("east", 15.0), ("south", 27.0), ("west wall", 8.0)])
def test_facets_alone_are_held(slopes, name, most_deg):
    """Errors: a tilt of 30 degrees without reference is known to 5 to 10 degrees, north and south to 27."""
    (tilt, azimuth), slope = FACETS[name], slopes[name]
    assert angle_between_deg(normal(slope.tilt_deg, slope.azimuth_deg), normal(tilt, azimuth)) < most_deg
    assert slope.tilt_low_deg <= tilt <= slope.tilt_high_deg
    east, north, _ = np.degrees(np.arcsin(normal(tilt, azimuth)))
    assert slope.east_low_deg <= east <= slope.east_high_deg
    assert slope.north_low_deg <= north <= slope.north_high_deg
    assert slope.model == "weather"


def test_north_and_south_are_undetermined_where_the_gain_decides(slopes):
    """One day has one declination of the sun: gain and tilt along the meridian are one number."""
    south = slopes["south"]
    assert south.north_high_deg - south.north_low_deg > 30.0
    assert south.east_high_deg - south.east_low_deg < 0.6 * (south.north_high_deg - south.north_low_deg)
    assert south.state is SlopeState.WIDE
    assert "north–south" in south.reason


def test_the_albedo_of_a_wall_is_asked_for():
    stated = settings_of("wall", "albedo = 0.77\n")
    white = day_of(stated)
    wall = white.only(np.array([2]))
    by_kind, slope = (
        SlopeChain(REGIONS[2:], settings).at(wall).slopes[0] for settings in (settings_of("wall"), stated)
    )
    assert "surface.albedo" in by_kind.reason
    assert "surface.albedo" not in slope.reason
    assert slope.tilt_high_deg - slope.tilt_low_deg < by_kind.tilt_high_deg - by_kind.tilt_low_deg
    assert by_kind.tilt_low_deg <= 90.0 <= by_kind.tilt_high_deg


def test_a_known_azimuth_leaves_the_tilt(day):
    known = replace(PLATE, azimuth="known")
    (slope,) = SlopeChain([replace(REGIONS[0], azimuth_deg=90.0)], known).at(day.only(np.array([0]))).slopes
    assert slope.azimuth_deg == 90.0
    assert slope.tilt_low_deg < 30.0 < slope.tilt_high_deg


def of_east(day, settings=PLATE):
    return SlopeChain(REGIONS[:1], settings).at(day.only(np.array([0]))).slopes[0]


def nan(day):
    return np.full(len(day), np.nan)


REFUSALS = {
    "air and light": ("plate", lambda day: {"air_k": nan(day), "dni_w_m2": nan(day)}, "irradiance.*air temp"),
    **{kind: (kind, lambda _: {}, kind) for kind in ("soil", "sand", "snow")},
    "frost": ("plate", lambda day: {"temperature_k": np.full_like(day.temperature_k, 273.15)}, "0 °C"),
    "misfit": ("plate", lambda day: {"temperature_k": restless_k(day)}, "weather"),
}


def restless_k(day):
    return day.temperature_k + 25.0 * np.sin(0.2 * day.minute)[:, np.newaxis]


@pytest.mark.parametrize("case", REFUSALS)
def test_what_cannot_be_known_is_refused_with_all_that_lacks(day, case):
    kind, changes, words = REFUSALS[case]
    slope = of_east(replace(day, **changes(day)), settings_of(kind))
    assert slope.state is (SlopeState.NO_DATA if case == "air and light" else SlopeState.NO_INTERSECTION)
    assert re.search(words, slope.reason)
    assert np.isnan(slope.tilt_deg)


def test_the_answer_changes_with_whole_rows_and_is_that_of_a_batch(day):
    """Live, replayed and at once: the same numbers."""
    chain, few = SlopeChain(REGIONS[:1], PLATE), day.only(np.array([0])).until(300)
    live = [chain.at(few.until(last)).slopes[0] for last in range(275, 301)]
    at_once = SlopeChain(REGIONS[:1], PLATE).at(few).slopes[0]
    assert live[-1] == at_once
    assert 2 <= len({slope.tilt_deg for slope in live}) <= 4
    assert len({slope.time_ns for slope in live}) == len(live)


def test_one_empty_minute_changes_next_to_nothing(day, slopes):
    kelvin = day.temperature_k.copy()
    kelvin[300] = np.nan
    slope = of_east(replace(day, temperature_k=kelvin))
    assert slope.tilt_deg == pytest.approx(slopes["east"].tilt_deg, abs=0.5)


def test_several_days_narrow_a_slope_by_half_their_evidence(day, slopes):
    """Two equal days with the exponent one half are one day; four are two."""
    east = day.only(np.array([0]))
    of_days = {
        count: SlopeChain(REGIONS[:1], PLATE)
        .together([later(east, number) for number in range(count)])
        .slopes[0]
        for count in (2, 4)
    }
    one = slopes["east"]
    assert of_days[2].tilt_deg == pytest.approx(one.tilt_deg, abs=1.0)
    assert of_days[4].east_high_deg - of_days[4].east_low_deg < one.east_high_deg - one.east_low_deg


def test_days_together_need_no_learned_model_and_enter_none(day):
    site, full = packaged_day().site, replace(PLATE, model="full")
    day = day.only(np.array([0]))
    parts = [Part(f"day {n}", site, (REGIONS[0],), later(day, n), full) for n in range(2)]
    together = slopes_together(parts)
    assert (together.estimated.learnt, together.budgets) == (None, {})
    learned = [replace(part, settings=replace(PLATE, model="learned")) for part in parts]
    assert slopes_together(learned).estimated == together.estimated
    joined = replace(learned[0], history=join([part.history for part in parts]))
    assert slopes_of_part(joined) == together.estimated.slopes


def test_the_density_is_that_of_scipy():
    rng = np.random.default_rng(3)
    columns, residual, variance = rng.normal(size=(9, 4)), rng.normal(size=9), 1.7
    sizes, axes = np.linalg.eigh(columns.T @ columns)
    found = weather_slopes._log_density(
        np.array([residual @ residual]),
        ((residual @ columns @ axes) ** 2)[np.newaxis],
        sizes[np.newaxis],
        9,
        variance,
    )
    expected = multivariate_normal(np.zeros(9), variance * np.eye(9) + columns @ columns.T).logpdf(residual)
    assert found[0] - 4.5 * np.log(2.0 * np.pi) == pytest.approx(expected, rel=1e-12)


def test_directions_share_the_sphere_evenly():
    up = weather_slopes.directions(90.0)
    assert up.mean(axis=0) == pytest.approx([0.0, 0.0, 0.5], abs=2e-3)
    assert (up.T @ up / len(up)) == pytest.approx(np.eye(3) / 3.0, abs=2e-3)


def test_a_table_needs_no_reference_then(day, tmp_path):
    columns = {"longwave_w_m2": day.longwave_down_w_m2, "wind_m_s": np.full(len(day), 2.0)}
    path = write_table(tmp_path / "bed.csv", day, bed_k=day.temperature_k[:, 0], **columns)
    with pytest.raises(ConfigError, match="reference_k"):
        estimate_tables([path], packaged_day().site)
    keys = ["estimator.reference=weather", "surface.kind=plate"]
    (found,) = estimate_tables([path], packaged_day().site, settings=keys)
    assert (found.region, found.model) == ("bed", "weather")
    assert angle_between_deg(normal(found.tilt_deg, found.azimuth_deg), normal(30.0, 90.0)) < 15.0
    (of_model,) = estimate_tables([path], packaged_day().site, settings=[*keys, "estimator.air=model"])
    assert of_model.tilt_high_deg - of_model.tilt_low_deg > found.tilt_high_deg - found.tilt_low_deg


def test_a_configuration_needs_no_reference_then():
    region = '[[region]]\nname = "bed"\npoints_px = [[1, 1], [9, 1], [9, 9]]\n'
    site = "[site]\nlatitude_deg = 35\nlongitude_deg = 139\n"
    found = config_from_text(f'{site}{region}[estimator]\nreference = "weather"\n', Path("fieldkit.toml"))
    assert [one.kind for one in found.regions] == [RegionKind.TARGET]
    with pytest.raises(ConfigError, match=r"fieldkit\.toml:4: region"):
        config_from_text(f"{site}{region}", Path("fieldkit.toml"))
