"""A logger's clock that steps, stands still or is far off is named by its rows; nothing is merely sorted."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from zoneinfo import ZoneInfo

import pytest

from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.model.samples import Reading
from fieldkit.sessions.formats.imported import ImportedRecording
from fieldkit.sessions.formats.logger_clock import Keep
from fieldkit.sessions.formats.logs import LogOptions, read_log
from tests.harness.next_steps import steps

NOON = datetime(2026, 6, 11, 12, tzinfo=UTC)


def log(tmp_path: Path, rows: Sequence[tuple[str, float]]) -> Path:
    path = tmp_path / "log.csv"
    path.write_text("time,light [lx]\n" + "".join(f"{time},{value:g}\n" for time, value in rows))
    return path


def at(minutes: Sequence[float]) -> list[str]:
    return [f"{NOON + timedelta(minutes=minute):%Y-%m-%d %H:%M:%S}" for minute in minutes]


def numbered(times: Sequence[str]) -> list[tuple[str, float]]:
    """Rows with the number of their line as the value: the header is line 1."""
    return [(time, number) for number, time in enumerate(times, start=2)]


def lines(imported: ImportedRecording) -> list[int]:
    found = [one for one in imported.samples if isinstance(one, Reading)]
    assert [one.values[0] for one in found] == [one.device_seq for one in found]
    return [one.device_seq for one in found]


def notes(imported: ImportedRecording) -> str:
    return "\n".join(text for _, text in imported.notes)


SET_BACK = [0, 1, 2, -27.5, -26.5, 0]


@pytest.mark.parametrize(
    ("minutes", "row", "first", "last"),
    [
        (SET_BACK, 5, [2, 3, 4], [5, 6, 7]),
        ([0, 1, 2, 3, 1.5, 2.5, 3.5, 4.5], 6, [2, 3, 4, 5, 8, 9], [2, 3, 6, 7, 8, 9]),
        ([0, 1, 2, 1, 2, 3], 5, [2, 3, 4, 7], [2, 5, 6, 7]),
        ([1440, 1441, 1442, 0, 1, 2], 5, [2, 3, 4], [5, 6, 7]),
        ([0, 1, 2, 2, 3, 4], 5, [2, 3, 4, 6, 7], [2, 3, 5, 6, 7]),
    ],
    ids=["set back", "set back for two minutes", "the same minutes", "another day", "one time twice"],
)
def test_a_clock_that_steps_back_is_refused_by_its_row_unless_keep_decides(
    tmp_path, minutes, row, first, last
):
    path = log(tmp_path, numbered(at(minutes)))
    with pytest.raises(
        ConfigError, match=rf"the clock (goes back|stands still) .* to row {row} \(2026"
    ) as caught:
        read_log(path, "x", LogOptions(zone=UTC))
    assert Argument("keep") in steps(caught.value)
    options: list[Keep] = ["first", "last"]
    for keep, expected in zip(options, (first, last), strict=True):
        kept = read_log(path, "x", LogOptions(zone=UTC, keep=keep))
        assert lines(kept) == expected
        assert f"{len(minutes) - len(expected)} row" in notes(kept)
        assert f"{keep} kept" in notes(kept)


def test_keep_without_a_step_is_named(tmp_path):
    imported = read_log(log(tmp_path, numbered(at([0, 1, 2]))), "x", LogOptions(zone=UTC, keep="last"))
    assert lines(imported) == [2, 3, 4]
    assert "keep last" in notes(imported)


def test_steps_are_found_in_tables_that_have_the_newest_first(tmp_path):
    whole = log(tmp_path, numbered(at([4, 3, 2, 1, 0])))
    assert lines(read_log(whole, "x", LogOptions(zone=UTC))) == [6, 5, 4, 3, 2]
    stepped = log(tmp_path, numbered(at([4, 3, 2, 30, 1, 0])))
    with pytest.raises(ConfigError, match=r"from row 5 .* to row 4"):
        read_log(stepped, "x", LogOptions(zone=UTC))


@pytest.mark.parametrize("zone", [ZoneInfo("Europe/Berlin"), UTC])
def test_an_hour_that_comes_twice_in_spring_is_a_step(tmp_path, zone):
    times = [f"2026-03-29 {hour}:{minute}:00" for hour in ("01", "01", "04") for minute in ("00", "20", "40")]
    with pytest.raises(ConfigError, match="0:40:00"):
        read_log(log(tmp_path, numbered(times)), "x", LogOptions(zone=zone))


@pytest.mark.parametrize(
    "hours", [["01", "02", "02", "03"], ["00", "01", "02", "02", "03", "04"]], ids=["minutes", "hours"]
)
def test_the_end_of_summer_time_is_a_step_only_for_a_clock_without_it(tmp_path, hours):
    minutes = ("00", "20", "40") if len(hours) == 4 else ("00",)
    times = [f"2026-10-25 {hour}:{minute}:00" for hour in hours for minute in minutes]
    path = log(tmp_path, numbered(times))
    assert len(lines(read_log(path, "x", LogOptions(zone=ZoneInfo("Europe/Berlin"))))) == len(times)
    with pytest.raises(ConfigError, match=r"the clock (goes back|stands still)") as caught:
        read_log(path, "x", LogOptions(zone=UTC))
    assert Argument("zone") in steps(caught.value)


@pytest.mark.parametrize(
    ("times", "kept", "named"),
    [
        (["2000-01-01 00:00:01", "2000-01-01 00:00:11", *at([0, 1])], [4, 5], "2 rows"),
        ([*at([0]), "2073-05-05 21:01:33", *at([1])], [2, 4], "1 row excluded, more than a year"),
        (
            [*at([0, 1, 2]), "1970-01-01 00:00:05", "1970-01-01 00:01:05", *at([5])],
            [2, 3, 4, 7],
            "row 5 (1970-",
        ),
        (
            [*at([0]), "2073-50-00 21:01:33", *at([1])],
            [2, 4],
            "1 row excluded: row 3 ('2073-50-00 21:01:33' is",
        ),
        ([*at([0, 1]), "", *at([2])], [2, 3, 5], "row 4 ('' is not a time"),
        ([*at([0, 1]), "1904-01-01 00:00:00", *at([2])], [2, 3, 5], "row 4 (a time -2082844800 s after 1970"),
    ],
)
def test_rows_far_from_the_others_or_without_a_time_are_excluded_by_name(tmp_path, times, kept, named):
    imported = read_log(log(tmp_path, numbered(times)), "x", LogOptions(zone=UTC))
    assert lines(imported) == kept
    assert named in notes(imported)
    assert imported.notes[0][1] == f"log.csv: {len(kept)} rows"


def test_years_without_a_gap_are_one_log(tmp_path):
    times = [f"{year}-{month:02}-01 00:00:00" for year in range(2020, 2027) for month in range(1, 13)]
    assert len(lines(read_log(log(tmp_path, numbered(times)), "x", LogOptions(zone=UTC)))) == 84


def test_times_are_refused_where_most_of_them_cannot_be_read(tmp_path):
    with pytest.raises(ConfigError, match=r"row 2: '11\.06\.2026 12:00'") as caught:
        read_log(log(tmp_path, numbered(["11.06.2026 12:00", "11.06.2026 12:01"])), "x", LogOptions(zone=UTC))
    assert [step.name for step in steps(caught.value)] == ["time_format"]


def test_two_downloads_that_overlap_are_joined(tmp_path):
    rows = [(time, float(minute)) for minute, time in enumerate(at(range(7)))]
    imported = read_log(log(tmp_path, rows[:5] + rows[2:]), "x", LogOptions(zone=UTC))
    assert [one.values[0] for one in imported.samples if isinstance(one, Reading)] == [0, 1, 2, 3, 4, 5, 6]
    assert "3 rows excluded, copies of earlier ones: row 7" in notes(imported)


def test_several_rows_within_a_second_are_all_kept(tmp_path):
    times = [time for time in at([0, 1 / 60, 2 / 60]) for _ in range(3)]
    assert len(lines(read_log(log(tmp_path, numbered(times)), "x", LogOptions(zone=UTC)))) == 9


def test_a_clock_set_forward_is_named_as_a_gap(tmp_path):
    imported = read_log(log(tmp_path, numbered(at([0, 1, 2, 62, 63]))), "x", LogOptions(zone=UTC))
    assert "a gap of 1 h 00 min before row 5 (2026-06-11 13:02:00 UTC): nothing" in notes(imported)


@pytest.mark.parametrize(
    ("texts", "time_format"),
    [
        (["2026-06-11 23:00", "2026-06-11 24:00", "2026-06-12 01:00"], None),
        (["2026-06-11T23:00:00Z", "2026-06-11T24:00:00Z", "2026-06-12T01:00:00Z"], None),
        (["11.06.2026 23:00", "11.06.2026 24:00", "12.06.2026 01:00"], "%d.%m.%Y %H:%M"),
    ],
)
def test_twenty_four_hours_are_midnight_of_the_next_day(tmp_path, texts, time_format):
    path = log(tmp_path, numbered(texts))
    imported = read_log(path, "x", LogOptions(zone=UTC, time_format=time_format))
    midnight_ns = int(datetime(2026, 6, 12, tzinfo=UTC).timestamp()) * 10**9
    assert [one.time_ns - midnight_ns for one in imported.samples] == [-3600 * 10**9, 0, 3600 * 10**9]


def test_a_leap_second_is_the_second_before(tmp_path):
    times = ["2016-12-31 23:59:58", "2016-12-31 23:59:59", "2016-12-31 23:59:60", "2017-01-01 00:00:00"]
    imported = read_log(log(tmp_path, numbered(times)), "x", LogOptions(zone=UTC))
    new_year = 1_483_228_800  # 2017-01-01T00:00:00Z by date(1)
    assert [reading.time_ns // 10**9 - new_year for reading in imported.samples] == [-2, -1, -1, 0]
