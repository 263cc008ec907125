import math
from dataclasses import replace

import pytest

from fieldkit.model.samples import Event, EventKind, Severity
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.model.slope import SlopeEstimate, SlopeState
from fieldkit.views import formatting

DAY_NS = 86_400 * 10**9
NEW_YEAR_NS = 1_451_606_400 * 10**9  # 2016-01-01T00:00:00Z


def estimate(**values: object) -> SlopeEstimate:
    return SlopeEstimate(0, "b15", **{"state": SlopeState.OK, **values})


def region(tilt_deg: float, azimuth_deg: float) -> Region:
    corners = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))
    return Region("b", RegionKind.TARGET, corners, tilt_deg, azimuth_deg)


WIDE = estimate(state=SlopeState.WIDE, tilt_low_deg=0.0, tilt_high_deg=40.2)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (formatting.celsius(298.15), "25.00"),  # kelvin come in
        (formatting.celsius(math.nan), "–"),
        (formatting.number(math.nan), "–"),
        (formatting.plus_minus(math.nan, 1.0), "–"),
        (formatting.number(-0.04, 1), "0.0"),  # what is rounded to zero has no sign
        (formatting.number(-0.06, 1), "-0.1"),
        (formatting.size(11.2e9), "11.2 GB"),
        (formatting.size(28e6), "28.0 MB"),
        (formatting.size(640e3), "640 kB"),
        (formatting.size(12), "12 B"),
        (formatting.rate(8.96), "9.0/s"),
        (formatting.rate(0.05), "3/min"),
        (formatting.rate(0.0), "0/min"),
        (formatting.rate(math.nan), "–/s"),
    ],
)
def test_numbers(text, expected):
    assert text == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (formatting.tilt(estimate(tilt_deg=15.0)), "15.0"),
        # half the width of a region
        (formatting.tilt(estimate(tilt_deg=15.0, tilt_low_deg=14.0, tilt_high_deg=16.6)), "15.0 ±1.3"),
        (formatting.tilt(estimate(tilt_deg=4.8, tilt_low_deg=4.0, tilt_high_deg=12.2)), "4.8 (4.0–12.2)"),
        (formatting.tilt(estimate(tilt_deg=0.8, tilt_low_deg=0.0, tilt_high_deg=2.7)), "0.8 ±1.9"),
        (formatting.tilt_degrees(estimate(tilt_deg=15.0)), "15.0°"),
        (formatting.tilt_degrees(estimate(tilt_deg=math.nan)), "–"),
        (
            formatting.noise(estimate(tilt_deg=15.0, noise_tilt_low_deg=14.8, noise_tilt_high_deg=15.7)),
            "±0.4°",
        ),
        (formatting.state(estimate(state=SlopeState.FLAT, tilt_high_deg=2.13)), "flat within 2.1°"),
        # a slope that may be flat has no azimuth
        (formatting.azimuth(estimate(state=SlopeState.FLAT, azimuth_deg=178.0, tilt_low_deg=0.0)), "–"),
        (formatting.azimuth(replace(WIDE, azimuth_deg=178.0)), "–"),
        (formatting.given_slope(region(15.0, 180.0)), "15°/180°"),
        (formatting.given_slope(region(0.0, 0.0)), "0°"),
        (formatting.given_slope(region(15.0, math.nan)), "15°"),
        (formatting.given_slope(region(math.nan, 180.0)), "–"),
    ],
)
def test_slopes(text, expected):
    assert text == expected


@pytest.mark.parametrize(
    ("value", "low", "high", "expected"),
    [
        (5.0, -10.0, 16.0, "5 ±13"),
        (355.0, 340.0, 362.0, "355 ±11"),
        (355.0, 175.0, 535.0, "355 ±180"),
        (180.0, 180.0, 180.0, "180 given"),
    ],
)
def test_an_azimuth_region_across_north_is_as_wide_as_it_is(value, low, high, expected):
    azimuth = formatting.azimuth(estimate(azimuth_deg=value, azimuth_low_deg=low, azimuth_high_deg=high))
    assert azimuth == expected


def test_findings_are_the_certain_slopes_then_the_others_then_the_known_beds():
    tilts = {"b05": (4.9, 3.9, 5.9), "b15": (22.6, 17.6, 28.0), "b25": (24.9, 22.8, 27.0)}
    slopes = [
        replace(estimate(), region=name, tilt_deg=tilt, tilt_low_deg=low, tilt_high_deg=high)
        for name, (tilt, low, high) in tilts.items()
    ]
    slopes[1] = replace(slopes[1], state=SlopeState.WIDE)
    beds = [Region(name, RegionKind.REFERENCE, (), tilt) for name, tilt in (("flat", 0.0), ("b35", 35.0))]
    certain = "b05 4.9° (3.9–5.9), b25 24.9° (22.8–27.0)"
    assert formatting.findings(slopes, beds) == f"{certain}; b15 22.6° (17.6–28.0), wide; known: b35"
    assert formatting.findings([estimate(state=SlopeState.NO_DATA)], beds) == ""


@pytest.mark.parametrize("state", SlopeState)
def test_every_state_has_words(state):
    assert formatting.state(estimate(state=state))


def test_the_second_branch_is_told_unless_it_has_its_own_place():
    both = estimate(state=SlopeState.NOT_RESOLVED, second_tilt_deg=43.3, second_azimuth_deg=181.0)
    assert formatting.state(both).removeprefix(formatting.state(both, second=False)) == ", or 43.3°/181°"


ALAMOSA = Site(37.70, -105.92, 2317.0, "America/Denver")


@pytest.mark.parametrize(
    ("zone", "times_ns", "expected"),
    [
        ("America/Denver", (NEW_YEAR_NS,), "MST, UTC-07:00"),
        ("America/Denver", (NEW_YEAR_NS, NEW_YEAR_NS + 1), "MST, UTC-07:00"),
        # clocks that change have two zones
        ("America/Denver", (NEW_YEAR_NS, NEW_YEAR_NS + 190 * DAY_NS), "MST, UTC-07:00, then MDT, UTC-06:00"),
        ("Africa/Monrovia", (0,), "MMT, UTC-00:44"),  # 44 min 30 s behind until 1972
        ("America/Sao_Paulo", (NEW_YEAR_NS,), "UTC-02:00"),  # it has no letters
        ("Mars/Olympus", (NEW_YEAR_NS,), "UTC"),  # an unknown one
        ("Asia/Kolkata", (NEW_YEAR_NS,), "IST, UTC+05:30"),
        ("Asia/Tokyo", (NEW_YEAR_NS,), "JST, UTC+09:00"),
        ("America/St_Johns", (NEW_YEAR_NS,), "NST, UTC-03:30"),
    ],
)
def test_zones_are_named_with_their_offsets(zone, times_ns, expected):
    first_ns, *last_ns = times_ns
    assert formatting.zone_name(first_ns, Site(0.0, 0.0, 0.0, zone), *last_ns) == expected


def test_time_is_local_with_its_date_on_another_day():
    # New Year in UTC is still the last evening of 2015 in Alamosa: its midnight comes seven hours later
    assert formatting.clock_time(NEW_YEAR_NS, ALAMOSA) == "17:00"
    assert formatting.clock_time(NEW_YEAR_NS, Site(0.0, 0.0, timezone="Mars/Olympus")) == "00:00"
    after_ns = NEW_YEAR_NS + 7 * 3600 * 10**9
    assert formatting.clock_time(after_ns - 1_000, ALAMOSA, since_ns=NEW_YEAR_NS) == "23:59"
    assert formatting.clock_time(after_ns, ALAMOSA, since_ns=NEW_YEAR_NS) == "2016-01-01 00:00"
    assert formatting.of_day_ns(NEW_YEAR_NS + 90 * 10**9 + 5, ALAMOSA) == (17 * 3600 + 90) * 10**9 + 5


def test_places_have_letters_for_their_halves():
    assert formatting.place(Site(-33.9, -151.2, 10.0)).split(", ") == ["33.9000 S 151.2000 W", "10 m"]


def test_bad_events_say_so_without_colour():
    event = Event(EventKind.DISK, 0, 0, "disk full", severity=Severity.ERROR)
    assert formatting.event_line(event) == "ERROR: disk full"
