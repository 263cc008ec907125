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
    with pytest.raises(ConfigError, match="is not a valid duration; use 3h, 90m or 45s"):
        parse_duration(text)


@pytest.mark.parametrize(
    ("text", "seconds"), [("+12s", 12.0), ("-0.5s", -0.5), ("2m", 120.0), ("-7", -7.0), ("+1h30", 5400.0)]
)
def test_offsets_carry_a_sign_and_are_seconds_without_a_unit(text, seconds):
    assert parse_offset(text) == seconds


@pytest.mark.parametrize("text", ["", "+", "--5s", "1w", "soon"])
def test_anything_else_is_not_an_offset(text):
    with pytest.raises(ConfigError, match=r"\+12s or -2m"):
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
    with pytest.raises(ConfigError, match="is not a valid time of day"):
        parse_time_of_day(text)


@pytest.mark.parametrize(
    ("seconds", "said"), [(14, "14 s"), (540, "9 min"), (3 * 3600 + 540, "3 h 09 min"), (3599, "1 h 00 min")]
)
def test_rounded_durations(seconds, said):
    assert rounded_duration(seconds) == said


@pytest.mark.parametrize(
    ("seconds", "said"), [(4.23, "4.2 s"), (750, "12 min 30 s"), (57_630, "16 h 00 min")]
)
def test_precise_durations(seconds, said):
    assert precise_duration(seconds) == said
