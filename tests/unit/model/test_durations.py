import pytest

from fieldkit.model.durations import (
    as_seconds,
    parse_duration,
    parse_offset,
    parse_time_of_day,
    precise_duration,
    rounded_duration,
)
from fieldkit.model.errors import ConfigError
from tests.harness.next_steps import at


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("3h", 10_800.0),
        ("1.5h", 5400.0),
        ("2h30m", 9000.0),
        ("1d12h", 129_600.0),
        ("45s", 45.0),
        ("10min", 600.0),
        ("1h5min30", 3930.0),
        # a bare number is of the unit below the one in front of it
        ("1h30", 5400.0),
        ("1m30", 90.0),
        ("1h2m3", 3723.0),
    ],
)
def test_durations(text, seconds):
    assert parse_duration(text) == seconds


@pytest.mark.parametrize("text", ["", "10", "1.5", "soon", "1w", "10s30", "-5m", "1.55.5", "3 h"])
def test_anything_else_is_not_a_duration(text):
    with pytest.raises(ConfigError, check=at(repr(text))):
        parse_duration(text)


@pytest.mark.parametrize(
    ("text", "seconds"), [("+12s", 12.0), ("-0.5s", -0.5), ("2m", 120.0), ("-7", -7.0), ("+1h30", 5400.0)]
)
def test_offsets_carry_a_sign_and_are_seconds_without_a_unit(text, seconds):
    assert parse_offset(text) == seconds


@pytest.mark.parametrize("text", ["", "+", "--5s", "1w", "soon"])
def test_anything_else_is_not_an_offset(text):
    with pytest.raises(ConfigError, match=r"\+12s or -2m", check=at(repr(text))):
        parse_offset(text)


@pytest.mark.parametrize("duration", ["876601h", "9" * 400 + "h", 3_155_760_001.0, float("inf")])
def test_a_duration_is_at_most_a_hundred_years(duration):
    with pytest.raises(ConfigError, match="3h, 90m or 45s"):
        as_seconds(duration)
    assert as_seconds("876600h") == 100 * 365.25 * 86_400


def test_from_python_a_duration_may_be_a_number_of_seconds():
    assert as_seconds("20m") == as_seconds(1200) == 1200.0


@pytest.mark.parametrize("text", ["6", "25:00", "noon"])
def test_anything_else_is_not_a_time_of_day(text):
    with pytest.raises(ConfigError, check=at(repr(text))):
        parse_time_of_day(text)


@pytest.mark.parametrize(
    ("words", "seconds", "expected"),
    [
        (rounded_duration, 14, "14 s"),
        (rounded_duration, 540, "9 min"),
        (rounded_duration, 3 * 3600 + 540, "3 h 09 min"),
        (rounded_duration, 3599, "1 h 00 min"),
        (precise_duration, 4.23, "4.2 s"),
        (precise_duration, 750, "12 min 30 s"),
        (precise_duration, 57_630, "16 h 00 min"),
    ],
)
def test_durations_in_words(words, seconds, expected):
    assert words(seconds) == expected
