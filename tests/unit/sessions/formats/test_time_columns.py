"""Times as people's tables have them: in parts, without a date, counted, unpadded; asked in one refusal."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.sessions.formats.imported import MissingOptionsError
from tests.harness.logs import notes, read, readings
from tests.harness.next_steps import at, steps

NOON = datetime(2026, 6, 11, 12, tzinfo=UTC)
START, DATE = {"start": "2026-06-11T12:00"}, {"date": "2026-06-11"}


def seconds(folder: Path, text: str | bytes, **options: Any) -> list[float]:
    """Times of the rows, seconds after noon."""
    times_ns = sorted({reading.time_ns for reading in readings(read(folder, text, **options))})
    return [round(time_ns / 1e9 - NOON.timestamp(), 3) for time_ns in times_ns]


def table(head: str, *times: str, sep: str = ",") -> str:
    """A table with times and a temperature of twenty degrees and something."""
    return f"{head}{sep}T [C]\n" + "".join(f"{time}{sep}2{row}\n" for row, time in enumerate(times))


GRAPHTEC = """Vendor,"GRAPHTEC Corporation"
Start time,2026-06-11,10:00:00
End time,2026-06-11,10:00:02
Trigger time,2026-06-11,10:00:00
Data
Number,Date&Time,ms,CH1
NO.,Time,ms,"degC"
         1,2026/06/11 12:00:00,  0,+   30.00
         2,2026/06/11 12:00:00,200,+   30.10
"""
CASES = [
    # five columns, under names of several makers and languages, hours from 1 to 24, days of the year
    (table("Year,Month,Day,Hour,Minute", "2026,6,11,12,0", "2026,6,11,12,15"), {}, [0, 900]),
    (table("#YY,MM,DD,hh,mm".replace("YY", "YYYY"), "2026,06,11,12,00", "2026,06,11,12,10"), {}, [0, 600]),
    (table("Minuto;Hora;Día;Mes;Año", "0;12;11;6;2026", "30;12;11;6;2026", sep=";"), {}, [0, 1800]),
    (table("Jahr;Monat;Tag;Stunde", "2026;6;11;23", "2026;6;11;24", sep=";"), {}, [39600, 43200]),
    (table("Year,DOY,HHMM", "2026,162,1200", "2026,162,1201"), {}, [0, 60]),
    (table("year,month,day,hour,minute,second", "2026.0,6.0,11.0,12.0,0.0,1.5"), {}, [1.5]),
    ("Source,City,Year\nNSRDB,-,1998\n" + table("Year,Month,Day,Hour,Minute", "2026,6,11,12,0"), {}, [0]),
    (table("year,month,day,time", "2026,6,11,12:00:30", "2026,6,11,12:01:30"), {}, [30, 90]),
    (table("Year,Day,Time", "2026,162,1200", "2026,162,1201"), {}, [0, 60]),
    (table("Year,Month,Day", "2026,6,11", "2026,6,12"), {}, [-43200, 43200]),
    (
        table("Minute,Hour,Year,Month,Day", "0,12,2026,6,11", "1,12,2026,6,11"),
        {"time_columns": ("Year", "Month", "Day", "Hour", "Minute")},
        [0, 60],
    ),
    (
        table("a,b,c,d", "2026,6,11,12", "2026,6,11,13"),
        {"time_columns": ("a", "b", "c", "d"), "time_format": "%Y %m %d %H"},
        [0, 3600],
    ),
    # a date, and hours without their zero
    (
        table("date,time (HHMM)", "2026-06-11,100", "2026-06-11,1300", "2026-06-11,2400"),
        {},
        [-39600, 3600, 43200],
    ),
    (table("when", "11/6/2026 130", "11/6/2026 0"), {"time_format": "%d/%m/%Y %H%M"}, [-43200, -37800]),
    (table("when", "11062026 93000"), {"time_format": "%d%m%Y %H%M%S"}, [-9000]),
    (table("date,hour", "2026-06-11,9", "2026-06-11,10"), {}, [-10800, -7200]),
    # fractions of seconds, halves of days
    (GRAPHTEC, {}, [0, 0.2]),
    (table("time", "2026-06-11 12:00:00:123"), {}, [0.123]),
    # Keysight's BenchLink, by the format as its cells have it; T&D
    (table("Time", "06/11/2026 12:00:05:123"), {"time_format": "%m/%d/%Y %H:%M:%S:%f"}, [5.123]),
    (table("Date/Time", "2026/06/11 12:00'30"), {}, [30]),
    # copied from Arduino's serial monitor
    ("12:00:00.250 -> T [C]\n12:00:01.250 -> 21.5\n12:00:02.500 -> 21.6\n", DATE, [1.25, 2.5]),
    (table("Date,Time", "06/11/26,12:00p", "06/11/26,12:01p"), {"time_format": "%m/%d/%y %I:%M %p"}, [0, 60]),
    (table("time", "2026-06-11 12:30 p. m.", "2026-06-11 01:00:00 PM"), {}, [1800, 3600]),
    (table("time", "2026-06-11 12:00:00 +0000 UTC"), {"zone": None}, [0]),
    # counts from a start, phones
    (table('"Time (s)"', "0.0E0", "1.5E0"), START, [0, 1.5]),
    (table('"Zeit (s)"', "0,0", "1,5", sep=";"), START, [0, 1.5]),
    (table("n,elapsed_ms", "1,0", "2,250"), START, [0, 0.25]),
    (table("Elapsed Time [min]", "0", "0.5"), START, [0, 30]),
    (table("t", "0", "2"), START | {"time_format": "s"}, [0, 2]),
    (table("elapsed", "00:00:00.031", "36:00:01"), START, [0.031, 129_601]),
    (table("time", "12:00:00:123", "12:00:01:123"), DATE, [0.123, 1.123]),
    (table("time", "23:59:59", "00:00:01", "00:00:02"), DATE, [43199, 43201, 43202]),
    (table("Time", "11:59p", "12:01a"), DATE, [43140, 43260]),
    (table("Uhrzeit", "12.00.30", "12.01.30"), DATE | {"time_format": "%H.%M.%S"}, [30, 90]),
    (table("time,seconds_elapsed", "1781179200000000000,0", "1781179201500000000,1.5"), {}, [0, 1.5]),
]


@pytest.mark.parametrize(("text", "options", "expected"), CASES)
def test_times_of_tables_are_read_as_they_were_meant(tmp_path, text, options, expected):
    assert seconds(tmp_path, text, **options) == expected


@pytest.mark.parametrize(
    ("text", "options", "missing"),
    [
        (table("Time (s)", "0", "1"), {}, [Argument("start", "2026-12-11T12:00:00")]),
        ("Title,test\nx,2026-06-11,10:00:00\n" + table("Time (s)", "0", "1"), {}, None),
        (
            table("time", "10:00", "10:01"),
            {},
            [Argument("date", "2026-12-11"), Argument("start", "2026-12-11T12:00:00")],
        ),
        (
            table("t", "0", "1"),
            {},
            [Argument("start", "2026-12-11T12:00:00"), *(Argument("time_format", unit) for unit in "sd")],
        ),
        (table("t", "0", "1"), START, [Argument("time_format", "s")]),
        (
            table("when", "11/6/2026 130"),
            {},
            [Argument("time_format", f"%{a}/%{b}/%Y %H%M") for a, b in ("md", "dm")],
        ),
        (table("when", "13/6/2026 9:05"), {}, [Argument("time_format", "%d/%m/%Y %H:%M")]),
        (
            table("when", "05/06/26 9:05 AM", "05/13/26 9:05 AM"),
            {},
            [Argument("time_format", "%m/%d/%y %I:%M %p")],
        ),
        (table("when", "11-Jun-2026 09:05:01"), {}, [Argument("time_format", "%d-%b-%Y %H:%M:%S")]),
        (
            table("when", "13.6.2026 9:05"),
            {"zone": None},
            [Argument("time_format", "%d.%m.%Y %H:%M"), Argument("zone", "Asia/Tokyo")],
        ),
        ("when,T\n13.6.2026 9:05,20\n", {"zone": None}, ["unit", "time_format", "zone"]),
    ],
)
def test_what_is_missing_is_named_at_once_in_forms_that_fit(tmp_path, text, options, missing):
    with pytest.raises(MissingOptionsError) as caught:
        read(tmp_path, text, **options)
    if missing is None:
        missing = [Argument("start", "2026-06-11 10:00:00")]
    named = (
        [step.name for step in steps(caught.value)] if isinstance(missing[0], str) else steps(caught.value)
    )
    assert [step for step in named if step != "columns"] == missing


def test_days_of_a_spreadsheet_are_dates_where_they_are_said_to_be(tmp_path):
    """Day 44927 is 2023-01-01: Microsoft, "Date systems in Excel", the 1900 date system."""
    imported = read(tmp_path, table("when", "44927", "1e300", "44927.25"), time_format="d")
    assert [sample.time_ns // 10**9 for sample in imported.samples] == [1672531200, 1672531200 + 6 * 3600]


@pytest.mark.parametrize(
    ("text", "options"),
    [
        (table("time", "2026-06-11 12:00"), START),
        (table("time", "2026-06-11 12:00"), DATE),
        (table("time (s)", "0"), DATE),
        (table("time", "12:00"), START | DATE),
    ],
)
def test_an_origin_that_times_do_not_need_is_refused(tmp_path, text, options):
    with pytest.raises(ConfigError, check=at(tmp_path / "log.csv", Argument([*options][-1]))):
        read(tmp_path, text, **options)


def test_a_start_and_a_date_are_in_the_zone(tmp_path):
    assert "with their own offset" in notes(read(tmp_path, table("time (s)", "0"), start="2026-06-11T12:00Z"))
    with pytest.raises(
        MissingOptionsError, check=lambda error: [step.name for step in steps(error)] == ["zone"]
    ):
        read(tmp_path, table("time (s)", "0"), zone=None, **START)
    with pytest.raises(ConfigError, check=at(Argument("start"))):
        read(tmp_path, table("time (s)", "0"), start="noon")
