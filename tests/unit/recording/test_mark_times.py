import re
from datetime import datetime
from zoneinfo import ZoneInfo

import pytest

from fieldkit.model.errors import ConfigError
from fieldkit.model.mark_times import parse_when, reject_outside
from fieldkit.model.marks import Mark
from fieldkit.model.next_step import Argument

TOKYO = ZoneInfo("Asia/Tokyo")
NOON = datetime(2026, 12, 11, 12, 0, tzinfo=TOKYO)


@pytest.mark.parametrize(("text", "seconds"), [("-30s", -30.0), ("-5m", -300.0), ("-1.5h", -5400.0)])
def test_times_before_now(text, seconds):
    assert parse_when(text, NOON) == seconds


@pytest.mark.parametrize(
    ("text", "moment"),
    [
        ("11:31", "2026-12-11T11:31:00+09:00"),
        ("11:31:05", "2026-12-11T11:31:05+09:00"),
        # a zone that is given stays, and its own day counts: in Denver it is still the tenth
        ("02:00Z", "2026-12-11T02:00:00+00:00"),
        ("19:00-07:00", "2026-12-10T19:00:00-07:00"),
        # somebody's watch is a little ahead; what is further ahead was yesterday
        ("12:04", "2026-12-11T12:04:00+09:00"),
        ("12:06", "2026-12-10T12:06:00+09:00"),
    ],
)
def test_a_clock_time_is_the_last_one_in_its_zone_or_the_sites(text, moment):
    assert parse_when(text, NOON) == moment


def test_around_midnight_a_clock_time_is_the_one_nearby():
    after = datetime(2026, 12, 11, 0, 3, tzinfo=TOKYO)
    before = datetime(2026, 12, 10, 23, 58, tzinfo=TOKYO)
    assert parse_when("23:58", after) == "2026-12-10T23:58:00+09:00"
    assert parse_when("00:01", before) == "2026-12-11T00:01:00+09:00"


def test_an_hour_that_clocks_show_twice_is_the_later_of_those_that_were():
    # in Denver 2026-11-01 02:00 MDT is 01:00 MST
    first, second = (
        datetime(2026, 11, 1, 1, 40, fold=fold, tzinfo=ZoneInfo("America/Denver")) for fold in (0, 1)
    )
    assert parse_when("01:30", first) == "2026-11-01T01:30:00-06:00"
    assert parse_when("01:30", second) == "2026-11-01T01:30:00-07:00"
    assert parse_when("01:55", second) == "2026-11-01T01:55:00-06:00"


def test_an_iso_time_keeps_its_zone_and_without_one_is_the_sites():
    assert parse_when("2026-12-11T12:31-07:00", NOON) == "2026-12-11T12:31:00-07:00"
    assert parse_when("2026-12-11T12:31", NOON) == "2026-12-11T12:31:00+09:00"


@pytest.mark.parametrize("text", ["30s", "-30", "noon", "25:00", "-1w", "2026-12"])
def test_anything_else_is_not_a_time(text):
    with pytest.raises(ConfigError, match=re.escape(repr(text))):
        parse_when(text, NOON)


def test_a_mark_of_another_decade_is_rejected_even_if_the_start_is_not_known():
    reject_outside(Mark("x", at=-1e8), 0, NOON)
    with pytest.raises(ConfigError):
        reject_outside(Mark("x", at=-1e9), 0, NOON)


START_NS = int(datetime(2026, 12, 11, 11, 0, 40, tzinfo=TOKYO).timestamp()) * 10**9


@pytest.mark.parametrize(
    "mark",
    [
        Mark("x"),
        Mark("x", at="2026-12-11T11:00:00+09:00"),  # the minute in which the recording began
        Mark("x", at="2026-12-11T12:04:00+09:00"),  # by a watch that is fast
        Mark("x", at=-3500.0, to=-10.0),
    ],
)
def test_a_mark_within_the_recording_is_possible(mark):
    reject_outside(mark, START_NS, NOON)


@pytest.mark.parametrize(
    ("mark", "place"),
    [
        (Mark("x", at="2026-12-11T10:59:00+09:00"), "2026-12-11T10:59:00+09:00"),
        (Mark("x", at=-7200.0, to=-10.0), "-7200 s"),
        (Mark("x", at=-60.0, to="2026-12-11T12:30:00+09:00"), "2026-12-11T12:30:00+09:00"),
        (Mark("x", at="2927-01-01T12:00:00+00:00"), "2927-01-01T12:00:00+00:00"),
        (Mark("x", at=-60.0, to=-90.0), Argument("to")),
        (Mark("x", at=-60.0, to="2026-12-11T11:30:00+09:00"), Argument("to")),
        (Mark("x", at=-99999 * 3600.0), "-3.59996e+08 s"),
    ],
)
def test_a_mark_outside_the_recording_is_rejected(mark, place):
    with pytest.raises(ConfigError) as caught:
        reject_outside(mark, START_NS, NOON)
    assert caught.value.place == place
