from datetime import UTC, datetime

import click
import pytest

from fieldkit.cli.record import parse_duration, seconds_until
from fieldkit.model.site import Site
from fieldkit.simulation.simulated_clock import SimulatedClock


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("3h", 10_800.0),
        ("1.5h", 5400.0),
        ("2h30m", 9000.0),
        ("45s", 45.0),
        # a bare number is of the unit below the one in front of it
        ("1h30", 5400.0),
        ("1m30", 90.0),
        ("1h2m3", 3723.0),
    ],
)
def test_lengths_of_time(text, seconds):
    assert parse_duration(text) == seconds


@pytest.mark.parametrize("text", ["", "10", "1.5", "soon", "1d", "10s30", "-5m", "1.55.5", "3 h"])
def test_what_is_no_length_of_time_is_refused(text):
    with pytest.raises(click.UsageError, match="is not a valid duration; give it with its unit"):
        parse_duration(text)


def clock_at(moment: datetime) -> SimulatedClock:
    return SimulatedClock(round(moment.timestamp()) * 10**9)


@pytest.mark.parametrize(
    ("now", "until", "hours"),
    [
        # Zurich, 22:00 until 06:00: clocks go forward on 2026-03-29 and back on 2026-10-25
        (datetime(2026, 3, 28, 21, tzinfo=UTC), "06:00", 7.0),
        (datetime(2026, 10, 24, 20, tzinfo=UTC), "06:00", 9.0),
        (datetime(2026, 7, 1, 20, tzinfo=UTC), "06:00", 8.0),
        (datetime(2026, 7, 1, 20, tzinfo=UTC), "23:30", 1.5),
    ],
)
def test_until_a_clock_time_also_where_the_clocks_are_changed(now, until, hours):
    assert seconds_until(until, Site(47.4, 8.5, 400, "Europe/Zurich"), clock_at(now)) == pytest.approx(
        3600.0 * hours
    )


@pytest.mark.parametrize("text", ["6", "25:00", "noon"])
def test_what_is_no_time_of_day_is_refused(text):
    with pytest.raises(click.UsageError, match="is no time of day"):
        seconds_until(text, Site(0, 0), clock_at(datetime(2026, 7, 1, tzinfo=UTC)))


@pytest.mark.parametrize("zone", ["Mars/Jezero", "Asia", "", "x" * 5000])
def test_until_a_clock_time_where_the_zone_is_unknown_on_this_computer_is_utc(zone):
    now = clock_at(datetime(2026, 7, 1, 20, tzinfo=UTC))
    assert seconds_until("23:30", Site(0, 0, 0, zone), now) == 3.5 * 3600
