"""A logger's clock that steps, stands still or is far off is named by its rows; nothing is merely sorted."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from zoneinfo import ZoneInfo

import pytest

from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.sessions.formats.imported import ImportedRecording
from tests.harness.logs import notes, read, readings, values
from tests.harness.next_steps import at

NOON = datetime(2026, 6, 11, 12, tzinfo=UTC)
BERLIN = ZoneInfo("Europe/Berlin")


def clocks(minutes: Sequence[float]) -> list[str]:
    return [f"{NOON + timedelta(minutes=minute):%Y-%m-%d %H:%M:%S}" for minute in minutes]


def log(times: Sequence[str]) -> str:
    """A table with the number of its line as each row's value: the header is line 1."""
    return "time,light [lx]\n" + "".join(f"{time},{number}\n" for number, time in enumerate(times, start=2))


def lines(imported: ImportedRecording) -> list[int]:
    rows = [reading.device_seq for reading in readings(imported)]
    assert values(imported) == [(row,) for row in rows]
    return rows


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
    text = log(clocks(minutes))
    check = at(tmp_path / "log.csv", Argument("keep"), Argument("zone"))
    with pytest.raises(ConfigError, match=rf"clock .* row {row} \(2026", check=check):
        read(tmp_path, text)
    for keep, expected in {"first": first, "last": last}.items():
        imported = read(tmp_path, text, keep=keep)
        assert lines(imported) == expected
        (note,) = [text for _, text in imported.notes if f"{keep} kept" in text]
        assert note.startswith(f"{len(minutes) - len(expected)} row")


def test_keep_without_a_step_is_named(tmp_path):
    imported = read(tmp_path, log(clocks([0, 1, 2])), keep="last")
    assert lines(imported) == [2, 3, 4]
    assert "keep last" in notes(imported)


def test_steps_are_found_in_tables_that_have_the_newest_first(tmp_path):
    assert lines(read(tmp_path, log(clocks([4, 3, 2, 1, 0])))) == [6, 5, 4, 3, 2]
    with pytest.raises(ConfigError, match=r"row 5 .* row 4"):
        read(tmp_path, log(clocks([4, 3, 2, 30, 1, 0])))


@pytest.mark.parametrize("zone", [BERLIN, UTC])
def test_an_hour_that_comes_twice_in_spring_is_a_step(tmp_path, zone):
    times = [f"2026-03-29 {hour}:{minute}:00" for hour in ("01", "01", "04") for minute in ("00", "20", "40")]
    with pytest.raises(ConfigError, match="0:40:00"):
        read(tmp_path, log(times), zone=zone)


@pytest.mark.parametrize(
    "hours", [["01", "02", "02", "03"], ["00", "01", "02", "02", "03", "04"]], ids=["minutes", "hours"]
)
def test_the_end_of_summer_time_is_a_step_only_for_a_clock_without_it(tmp_path, hours):
    minutes = ("00", "20", "40") if len(hours) == 4 else ("00",)
    text = log([f"2026-10-25 {hour}:{minute}:00" for hour in hours for minute in minutes])
    assert len(lines(read(tmp_path, text, zone=BERLIN))) == len(hours) * len(minutes)
    with pytest.raises(ConfigError, check=at(tmp_path / "log.csv", Argument("keep"), Argument("zone"))):
        read(tmp_path, text)


@pytest.mark.parametrize(
    ("times", "rows", "named"),
    [
        (["2000-01-01 00:00:01", "2000-01-01 00:00:11", *clocks([0, 1])], [4, 5], "2 rows"),
        ([*clocks([0]), "2073-05-05 21:01:33", *clocks([1])], [2, 4], "1 row excluded, "),
        ([*clocks([0, 1, 2]), "1970-01-01 00:00:05", *clocks([5])], [2, 3, 4, 6], "row 5 (1970-"),
        ([*clocks([0]), "2073-50-00 21:01:33", *clocks([1])], [2, 4], "row 3 ('2073-50-00 21:01:33'"),
        ([*clocks([0, 1]), "", *clocks([2])], [2, 3, 5], "row 4 ('':"),
        ([*clocks([0, 1]), "1904-01-01 00:00:00", *clocks([2])], [2, 3, 5], " -2082844800 s after 1970"),
    ],
)
def test_rows_far_from_the_others_or_without_a_time_are_excluded_by_name(tmp_path, times, rows, named):
    imported = read(tmp_path, log(times))
    assert lines(imported) == rows
    assert named in notes(imported)
    assert imported.notes[0][1] == f"log.csv: {len(rows)} rows, times in UTC"


def test_years_without_a_gap_are_one_log(tmp_path):
    times = [f"{year}-{month:02}-01 00:00:00" for year in range(2020, 2027) for month in range(1, 13)]
    assert len(lines(read(tmp_path, log(times)))) == 84


def test_times_are_refused_where_most_of_them_cannot_be_read(tmp_path):
    check = at(f"{tmp_path / 'log.csv'}, row 2", Argument("time_format", "%d.%m.%Y %H:%M"))
    with pytest.raises(ConfigError, match=r"'11\.06\.2026 12:00'", check=check):
        read(tmp_path, log(["11.06.2026 12:00", "11.06.2026 12:01"]))


def test_two_downloads_that_overlap_are_joined(tmp_path):
    head, *rows = log(clocks(range(7))).splitlines(keepends=True)
    imported = read(tmp_path, "".join([head, *rows[:5], *rows[2:]]))
    assert values(imported) == [(number,) for number in range(2, 9)]
    (note,) = [text for _, text in imported.notes if "row 7" in text]
    assert note.startswith("3 rows")


def test_several_rows_within_a_second_are_all_kept(tmp_path):
    times = [time for time in clocks([0, 1 / 60, 2 / 60]) for _ in range(3)]
    assert len(lines(read(tmp_path, log(times)))) == 9


def test_a_clock_set_forward_is_named_as_a_gap(tmp_path):
    imported = read(tmp_path, log(clocks([0, 1, 2, 62, 63])))
    (note,) = [text for _, text in imported.notes if "row 5 (2026-06-11 13:02:00 UTC)" in text]
    assert "1 h 00 min" in note


@pytest.mark.parametrize(
    ("texts", "time_format"),
    [
        (["2026-06-11 23:00", "2026-06-11 24:00", "2026-06-12 01:00"], None),
        (["2026-06-11T23:00:00Z", "2026-06-11T24:00:00Z", "2026-06-12T01:00:00Z"], None),
        (["11.06.2026 23:00", "11.06.2026 24:00", "12.06.2026 01:00"], "%d.%m.%Y %H:%M"),
    ],
)
def test_twenty_four_hours_are_midnight_of_the_next_day(tmp_path, texts, time_format):
    imported = read(tmp_path, log(texts), time_format=time_format)
    midnight_ns = int(datetime(2026, 6, 12, tzinfo=UTC).timestamp()) * 10**9
    assert [reading.time_ns - midnight_ns for reading in readings(imported)] == [
        -3600 * 10**9,
        0,
        3600 * 10**9,
    ]


def test_a_leap_second_is_the_second_before(tmp_path):
    times = ["2016-12-31 23:59:58", "2016-12-31 23:59:59", "2016-12-31 23:59:60", "2017-01-01 00:00:00"]
    new_year = 1_483_228_800  # 2017-01-01T00:00:00Z by date(1)
    seconds = [reading.time_ns // 10**9 - new_year for reading in readings(read(tmp_path, log(times)))]
    assert seconds == [-2, -1, -1, 0]
