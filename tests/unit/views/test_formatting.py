import math

import pytest

from fieldkit.model.samples import Event, EventKind, Severity
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.model.slope import SlopeEstimate, SlopeState
from fieldkit.views import formatting

NEW_YEAR_NS = 1_451_606_400 * 10**9  # 2016-01-01T00:00:00Z


def estimate(**values: object) -> SlopeEstimate:
    return SlopeEstimate(0, "b15", **{"state": SlopeState.OK, **values})


def test_kelvin_come_in_and_celsius_go_out():
    assert formatting.celsius(298.15) == "25.00"


def test_unknown_numbers_are_a_dash():
    assert formatting.number(math.nan) == "–"
    assert formatting.celsius(math.nan) == "–"
    assert formatting.plus_minus(math.nan, 1.0, 2.0) == "–"


def test_tilt_carries_the_larger_half_of_its_region():
    assert formatting.tilt(estimate(tilt_deg=15.0, tilt_low_deg=14.5, tilt_high_deg=17.0)) == "15.0 ±2.0"


def test_tilt_without_a_region_stands_alone():
    assert formatting.tilt(estimate(tilt_deg=15.0)) == "15.0"


@pytest.mark.parametrize(
    ("value", "low", "high"), [(5.0, 350.0, 15.0), (5.0, -10.0, 15.0), (355.0, 340.0, 361.0)]
)
def test_azimuth_bounds_may_lie_beyond_north(value, low, high):
    said = formatting.azimuth(estimate(azimuth_deg=value, azimuth_low_deg=low, azimuth_high_deg=high))
    assert said == f"{value:.0f} ±15"


def test_an_azimuth_that_was_given_says_so():
    known = estimate(azimuth_deg=180.0, azimuth_low_deg=180.0, azimuth_high_deg=180.0)
    assert formatting.azimuth(known) == "180 given"


def test_a_slope_that_may_be_flat_has_no_azimuth():
    assert formatting.azimuth(estimate(state=SlopeState.FLAT, azimuth_deg=178.0, tilt_low_deg=0.0)) == "–"
    wide = estimate(state=SlopeState.UNCERTAIN, azimuth_deg=178.0, tilt_low_deg=0.0, tilt_high_deg=40.2)
    assert formatting.azimuth(wide) == "–"


@pytest.mark.parametrize("state", SlopeState)
def test_every_state_has_words(state):
    assert formatting.state(estimate(state=state))


def test_flat_says_within_what():
    assert formatting.state(estimate(state=SlopeState.FLAT, tilt_high_deg=2.13)) == "flat within 2.1°"


def test_the_second_branch_is_told_unless_it_has_its_own_place():
    both = estimate(state=SlopeState.NOT_RESOLVED, second_tilt_deg=43.3, second_azimuth_deg=181.0)
    assert formatting.state(both).removeprefix(formatting.state(both, second=False)) == ", or 43.3°/181°"


def test_time_is_local_and_names_its_zone():
    alamosa = Site(37.70, -105.92, 2317.0, "America/Denver")
    assert formatting.clock_time(NEW_YEAR_NS, alamosa) == "17:00"
    assert formatting.zone_name(NEW_YEAR_NS, alamosa) == "MST, UTC-07:00"


def test_a_time_of_another_day_has_its_date():
    # New Year in UTC is still the last evening of 2015 in Alamosa: its midnight comes seven hours later
    alamosa = Site(37.70, -105.92, 2317.0, "America/Denver")
    after_ns = NEW_YEAR_NS + 7 * 3600 * 10**9
    assert formatting.clock_time(after_ns - 1_000, alamosa, since_ns=NEW_YEAR_NS) == "23:59"
    assert formatting.clock_time(after_ns, alamosa, since_ns=NEW_YEAR_NS) == "2016-01-01 00:00"


def test_clocks_that_change_have_two_zones():
    alamosa, july_ns = Site(37.70, -105.92, 2317.0, "America/Denver"), NEW_YEAR_NS + 190 * 86_400 * 10**9
    assert formatting.zone_name(NEW_YEAR_NS, alamosa, july_ns) == "MST, UTC-07:00, then MDT, UTC-06:00"
    assert formatting.zone_name(NEW_YEAR_NS, alamosa, NEW_YEAR_NS + 1) == "MST, UTC-07:00"


def test_an_offset_with_seconds_is_told_to_the_minute():
    # Liberia's clocks were 44 min 30 s behind until 1972
    assert formatting.zone_name(0, Site(6.3, -10.8, timezone="Africa/Monrovia")) == "MMT, UTC-00:44"


def test_what_is_rounded_to_zero_has_no_sign():
    assert [formatting.number(-0.04, 1), formatting.number(-0.06, 1)] == ["0.0", "-0.1"]


def test_time_of_day_is_that_of_the_sites_clocks():
    alamosa = Site(37.70, -105.92, 2317.0, "America/Denver")
    assert formatting.of_day_ns(NEW_YEAR_NS + 90 * 10**9 + 5, alamosa) == (17 * 3600 + 90) * 10**9 + 5


def test_a_zone_without_letters_is_named_by_its_offset():
    assert formatting.zone_name(NEW_YEAR_NS, Site(0.0, 0.0, timezone="America/Sao_Paulo")) == "UTC-02:00"


def test_an_unknown_zone_is_shown_as_utc():
    nowhere = Site(0.0, 0.0, timezone="Mars/Olympus")
    assert formatting.clock_time(NEW_YEAR_NS, nowhere) == "00:00"
    assert formatting.zone_name(NEW_YEAR_NS, nowhere) == "UTC"


def test_places_have_letters_for_their_halves():
    assert formatting.place(Site(-33.9, -151.2, 10.0)).split(", ") == ["33.9000 S 151.2000 W", "10 m"]


@pytest.mark.parametrize(
    ("n_bytes", "said"), [(11.2e9, "11.2 GB"), (28e6, "28.0 MB"), (640e3, "640 kB"), (12, "12 B")]
)
def test_sizes(n_bytes, said):
    assert formatting.size(n_bytes) == said


@pytest.mark.parametrize(
    ("rate_hz", "said"), [(8.96, "9.0/s"), (0.05, "3/min"), (0.0, "0/min"), (math.nan, "–/s")]
)
def test_rates(rate_hz, said):
    assert formatting.rate(rate_hz) == said


@pytest.mark.parametrize(
    ("tilt", "azimuth", "said"),
    [(15.0, 180.0, "15°/180°"), (0.0, 0.0, "0°"), (15.0, math.nan, "15°"), (math.nan, 180.0, "–")],
)
def test_what_inclinometer_and_compass_said(tilt, azimuth, said):
    corners = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))
    assert formatting.given_slope(Region("b", RegionKind.TARGET, corners, tilt, azimuth)) == said


def test_bad_events_say_so_without_colour():
    event = Event(EventKind.DISK, 0, 0, "disk full", severity=Severity.ERROR)
    assert formatting.event_line(event) == "ERROR: disk full"


@pytest.mark.parametrize(
    ("value", "low", "high", "said"),
    [
        (2.0, 340.0, 12.0, "2 ±22"),
        (350.0, 345.0, 20.0, "350 ±30"),
        (350.0, 345.0, 380.0, "350 ±30"),
        (-5.0, 340.0, 10.0, "-5 ±15"),
    ],
)
def test_an_azimuth_region_across_north_is_as_wide_as_it_is(value, low, high, said):
    found = formatting.azimuth(estimate(azimuth_deg=value, azimuth_low_deg=low, azimuth_high_deg=high))
    assert found == said


def test_noise_is_the_larger_half_of_its_own_region():
    noisy = estimate(tilt_deg=15.0, noise_tilt_low_deg=14.8, noise_tilt_high_deg=15.7)
    assert formatting.noise(noisy) == "±0.7°"


@pytest.mark.parametrize(
    ("zone", "said"),
    [
        ("Asia/Kolkata", "IST, UTC+05:30"),
        ("Asia/Tokyo", "JST, UTC+09:00"),
        ("America/St_Johns", "NST, UTC-03:30"),
    ],
)
def test_zones_are_told_to_the_half_hour(zone, said):
    assert formatting.zone_name(NEW_YEAR_NS, Site(0.0, 0.0, 0.0, zone)) == said
