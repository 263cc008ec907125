"""Tables of loggers become streams, alone or beside an old session."""

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from fieldkit.model.channels import air_quantities
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.model.samples import EventKind, Quality, Severity
from fieldkit.model.site import Site
from fieldkit.sessions.formats.imported import ImportedRecording, possible
from fieldkit.sessions.formats.logs import read_table
from fieldkit.sessions.formats.merged import cut_session, merge
from fieldkit.sessions.reader import open_session
from tests.harness.logs import notes, read, readings, values
from tests.harness.next_steps import at, steps
from tests.harness.recording import START_NS, header, recorded, same

TOKYO, BERLIN, DENVER = map(ZoneInfo, ("Asia/Tokyo", "Europe/Berlin", "America/Denver"))
ZONELESS = {"zone": None}


def test_celsius_becomes_kelvin_and_the_offset_is_added(tmp_path):
    text = "time,T1 [C],T2 [C],note\n2026/05/12 10:00:00,20.5,,dry\n2026/05/12 10:00:10,21,19,wet\n"
    options = {"zone": TOKYO, "time_format": "yyyy/mm/dd HH:MM:SS", "offset_ns": 12_000_000_000}
    imported = read(tmp_path, text, **options)
    first, second = readings(imported)
    assert first.time_ns == 1_778_547_612_000_000_000  # 2026-05-12T01:00:12Z
    assert first.values[0] == 293.65
    assert np.isnan(first.values[1])
    assert second.values == (294.15, 292.15)
    (info,) = imported.streams
    assert (info.unit, info.channels, info.rate_hz) == ("K", ("T1", "T2"), 0.1)
    assert "+12 s" in notes(imported)


@pytest.mark.parametrize(
    ("text", "time_format", "unit"),
    [
        ("Date,Time,T1 [C]\n2026-05-12,10:00:00,20.5\n2026-05-12,10:00:10,21\n", None, ""),
        ("Date,Time,T1\n2026-05-12,10:00:00,20.5\n2026-05-12,10:00:10,21\n", None, "C"),
        ("Datum;Zeit;T1 [°C]\n12.05.2026;10:00:00;20,5\n12.05.2026;10:00:10;21\n", "%d.%m.%Y %H:%M:%S", ""),
    ],
)
def test_date_and_time_of_day_in_two_columns_are_one_time(tmp_path, text, time_format, unit):
    """Layout: HOBO's own option "Separate date and time into two columns" (HOBOware User's Guide)."""
    imported = read(tmp_path, text, zone=TOKYO, time_format=time_format, unit=unit)
    times_s = [reading.time_ns // 10**9 for reading in readings(imported)]
    assert times_s == [1_778_547_600, 1_778_547_610]  # 2026-05-12T01:00:00Z
    assert values(imported) == [(293.65,), (294.15,)]


@pytest.mark.parametrize(
    ("unit", "cells", "impossible"),
    [
        # -9999.9 as in SURFRAD's README, 9999 as in NOAA's format of hourly observations (ISD), the others as
        # Campbell Scientific's loggers and SCPI instruments write "out of range"
        ("C", ("9999", "-9999.9", "-999.9", "inf", "-7999", "-99.9", "9.91E+37", "21"), 7),
        ("lx", ("9999", "-9999", "-999.9", "-inf", "9.9E+37", "-5", "21"), 5),
        ("W/m2", ("7999", "-6999", "-99999", "800", "-150"), 3),
        ("m/s", ("-99.9", "6999", "5"), 2),
    ],
)
def test_numbers_that_cannot_be_are_stored_as_they_came_flagged_and_counted(
    tmp_path, unit, cells, impossible
):
    imported = possible(read(tmp_path, minutes(f"x [{unit}]", *cells)), {}, Site(35.0, 139.0, 0.0))
    zero = 273.15 if unit == "C" else 0.0
    assert values(imported) == [pytest.approx((float(cell) + zero,)) for cell in cells]
    flagged = [n for n, reading in enumerate(readings(imported)) if Quality.IMPLAUSIBLE in reading.quality]
    assert len(flagged) == impossible
    (note,) = [text for _, text in imported.notes if "implausible" in text]
    assert f"log: {impossible} " in note
    assert f"(line {flagged[0] + 2})" in note


def test_columns_of_unknown_units_are_stored_as_they_came(tmp_path):
    text = "time,T1 [C],soil [%],flow [l/h],RH [%],VWC [%],Pressure [hPa],note\n"
    text += "2026-05-12T01:00:00Z,3,12.5,7,40,12.5,1000,dry\n"
    imported = read(tmp_path, text, **ZONELESS)
    assert {info.name: (info.unit, info.channels) for info in imported.streams} == {
        "log-temperature": ("K", ("T1",)),
        "log-soil_moisture": ("m3 m-3", ("VWC",)),
        "log-air_pressure": ("Pa", ("Pressure",)),
        "log-unknown": ("%", ("soil", "RH")),
        "log-unknown-2": ("l/h", ("flow",)),
    }
    assert values(imported, "log-unknown") == [(12.5, 40.0)]
    assert values(imported, "log-soil_moisture") == [(0.125,)]
    assert "soil [%], flow [l/h], RH [%]" in notes(imported)
    assert len(read(tmp_path, text, **ZONELESS, columns=("T1",)).notes) == 1


def test_dates_alone_are_taken_where_each_stands_once(tmp_path):
    imported = read(tmp_path, "date,T1 [C]\n2026-05-12,3\n2026-05-13,4\n", zone=TOKYO)
    assert imported.streams[0].rate_hz == 1 / 86_400


@pytest.mark.parametrize(
    ("text", "place", "value"),
    [
        (
            'time,E [lx]\n2026-05-12T01:00:00Z,"12,345"\n2026-05-12T01:01:00Z,999\n',
            ", column 'E [lx]'",
            "'12,345'",
        ),
        ("date,h,T1 [C]\n2026-05-12,10,3\n2026-05-12,11,3\n", "", "'2026-05-12'"),
        ("", "", "header"),
        ("time,T1\n2026-05-12T01:00:00Z,3\n", "", "unit"),
        ("time,T1 [C]\nyesterday,3\n", ", row 2", "'yesterday'"),
    ],
)
def test_table_that_is_not_understood_is_refused_at_its_place(tmp_path, text, place, value):
    with pytest.raises(ConfigError, check=at(f"{tmp_path / 'log.csv'}{place}"), match=value):
        read(tmp_path, text, **ZONELESS)


END_OF_SUMMER_NS = 1_792_890_000 * 10**9
"""2026-10-25T01:00Z: clocks in Berlin go from 3:00 back to 2:00 (directive 2000/84/EC)."""


def read_in_berlin(folder: Path, numbers: Sequence[int], *, newest_first: bool = False) -> ImportedRecording:
    """A log in Berlin's clock time, its rows at these minutes around the end of summer time."""
    moments = [datetime.fromtimestamp(END_OF_SUMMER_NS / 1e9 + 60 * minute, BERLIN) for minute in numbers]
    rows = [f"{moment:%Y-%m-%d %H:%M:%S},{minute}\n" for moment, minute in zip(moments, numbers, strict=True)]
    return read(folder, "time,T [C]\n" + "".join(rows[::-1] if newest_first else rows), zone=BERLIN)


@pytest.mark.parametrize("newest_first", [False, True])
@pytest.mark.parametrize(
    "numbers",
    [range(-90, 120), range(-30, 5), range(-5, 70), range(-300, 300, 60), range(-90, 90, 30)],
    ids=["minutes", "ends within", "begins within", "hourly", "half-hourly"],
)
def test_hour_that_comes_twice_keeps_the_order_of_the_rows(tmp_path, numbers, newest_first):
    imported = read_in_berlin(tmp_path, numbers, newest_first=newest_first)
    shown = [(reading.time_ns - END_OF_SUMMER_NS) / 60e9 for reading in readings(imported)]
    assert shown == list(numbers)
    assert values(imported) == [pytest.approx((minute + 273.15,)) for minute in numbers]


@pytest.mark.parametrize(
    "numbers", [[*range(-60, -30)], [*range(10, 100)], [-120, -50, 70], [-20, -10, 5, -30, 20]]
)
def test_hour_that_came_twice_is_refused_where_its_rows_do_not_tell_which(tmp_path, numbers):
    with pytest.raises(ConfigError, match="Europe/Berlin") as caught:
        read_in_berlin(tmp_path, numbers)
    assert "Etc/GMT-2" in str(caught.value.fix)  # what a clock left in summer time needs


def test_time_over_which_clocks_were_put_forward_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="'2026-03-29 02:01:00'"):
        read(tmp_path, "time,T1 [C]\n2026-03-29 01:59:00,1\n2026-03-29 02:01:00,2\n", zone=BERLIN)


def parted(mark: str, cells: Sequence[str]) -> str:
    rows = (f"2026-05-12T01:0{minute}:00Z{mark}{cell}\n" for minute, cell in enumerate(cells))
    return f"time{mark}E [lx]\n{''.join(rows)}"


@pytest.mark.parametrize(
    ("cells", "expected"),
    [
        (["12.345,6", "1.234.567"], [12345.6, 1234567.0]),
        (["52300,5", "12,345"], [52300.5, 12.345]),
        (["12.5", "12.345"], [12.5, 12.345]),
        (["0.345", "12.345"], [0.345, 12.345]),
        (["12,345.6", "1,234,567"], [12345.6, 1234567.0]),
    ],
)
def test_marks_in_numbers_between_semicolons_are_what_the_numbers_show(tmp_path, cells, expected):
    imported = read(tmp_path, parted(";", cells), **ZONELESS)
    assert values(imported) == [(value,) for value in expected]
    assert len(imported.notes) == 1


@pytest.mark.parametrize("mark", [";", "\t"])
@pytest.mark.parametrize("cells", [["12.345", "900"], ["12.345", "20,5"], ["12.345", "98.760"]])
def test_points_that_may_be_of_thousands_are_refused_as_commas_are(tmp_path, cells, mark):
    with pytest.raises(ConfigError, match=r"'12\.345'"):
        read(tmp_path, parted(mark, cells))


def test_log_that_ran_longer_is_cut_to_the_session(tmp_path):
    recorded(tmp_path / "old.h5", header((24, 32)), 20)
    with open_session(tmp_path / "old.h5") as session:
        start_s = session.start_ns / 1e9
        rows = "".join(f"{start_s + n + 0.01:.3f},{n}\n" for n in range(-10, 11))
        cut = cut_session(session, read(tmp_path, "time,T1 [C]\n" + rows))
        # it is twenty milliseconds long: of readings a second apart, two on either side and the one within
        assert values(cut) == [pytest.approx((n + 273.15,)) for n in range(-2, 3)]
        assert cut.notes[-1][1].startswith("16 samples")
        assert merge(session, cut, tmp_path / "new.h5", "log.csv").counts["log"] == 5


def test_stream_is_added_beside_an_old_session(tmp_path):
    appended = recorded(tmp_path / "old.h5", header((24, 32)), 20)
    before = (tmp_path / "old.h5").read_bytes()
    start_s = START_NS / 1e9 + 5.01
    rows = "time,T1 [C]\n" + "".join(f"{start_s + n / 100:.2f},{20 + n}\n" for n in range(2))
    with open_session(tmp_path / "old.h5") as session:
        report = merge(session, read(tmp_path, rows), tmp_path / "new.h5", "log.csv")
        with pytest.raises(ConfigError, check=at(session.path, Argument("name")), match="'lux'"):
            merge(session, read(tmp_path, rows, "lux"), tmp_path / "x.h5", "log.csv")
        late = read(tmp_path, "time,T1 [C]\n2031-01-01T00:00:00Z,1\n")
        with pytest.raises(ConfigError, check=at("late.csv", Argument("zone"), Argument("offset_s"))):
            merge(session, late, tmp_path / "x.h5", "late.csv")
    assert report.counts == {"camera": 20, "lux": 5, "thermometer": 5, "log": 2}
    assert (tmp_path / "old.h5").read_bytes() == before
    with open_session(tmp_path / "new.h5") as session:
        old = [sample for sample in session.samples() if sample.stream != "log"]
        assert all(same(stored, other) for stored, other in zip(old, appended, strict=True))
        mark, *others = session.events()
        assert mark.text == "wolke über b05"
        assert others[0].kind is EventKind.IMPORTED
        assert others[0].text.endswith(" log.csv")
        assert len(session.region_history()) == 2


# --- tables of Campbell and HOBO loggers, with the lines above their rows

# Layout: Campbell Scientific, LoggerNet manual, "Computer File Data Formats: TOA5"
TOA5 = """\
"TOA5","Tower","CR1000","12216","CR1000.Std.31.08","CPU:tower.CR1","3076","Minute"
"TIMESTAMP","RECORD","Batt_Min","Tair_Avg","Tsand_Avg","Sun_Avg"
"TS","RN","Volts","Deg C","DegC","W/m^2"
"","","Min","Avg","Avg","Avg"
"2026-05-12 10:01:00",17,12.6,20.5,31.25,812.5
"2026-05-12 10:02:00",18,12.6,"NAN",31.5,813
"""
# Layout: Onset, HOBOware User's Guide, "Exporting Table Data"
HOBO = """\
"Plot Title: bed 3"
"#","Date Time, GMT-07:00","Temp, °F (LGR S/N: 1, SEN S/N: 7)","Intensity, Lux","Stopped (LGR S/N: 1)"
1,"05/12/26 10:00:00 AM",68.0,"52,356.0",
2,"05/12/26 10:00:10 AM",69.8,"52,400.0",
3,"05/12/26 10:00:12 AM",,,Logged
"""
HOBO_TIME = "%m/%d/%y %I:%M:%S %p"


def test_a_campbell_table_is_read_as_it_is(tmp_path):
    imported = read(tmp_path, TOA5, zone=DENVER)
    assert {info.name: info.channels for info in imported.streams} == {
        "log-temperature": ("Tair_Avg", "Tsand_Avg"),
        "log-irradiance": ("Sun_Avg",),
        "log-unknown": ("Batt_Min",),
    }
    first, second = readings(imported, "log-temperature")
    assert first.time_ns == 1_778_601_630_000_000_000  # 2026-05-12T16:00:30Z, in the middle of the minute
    assert first.values == (293.65, 304.4)
    assert np.isnan(second.values[0])
    assert " 60 s" in notes(imported)
    sun = read(tmp_path, TOA5, zone=DENVER, columns=("Sun_Avg",))
    assert values(sun) == [(812.5,), (813.0,)]
    assert (sun.streams[0].unit, sun.streams[0].quantity) == ("W m-2", "irradiance")
    heads = [column.head for column in read_table(tmp_path / "log.csv").columns]
    assert heads[:3] == ["TIMESTAMP [TS]", "RECORD [RN]", "Batt_Min [Volts]"]


def test_radiation_of_a_table_is_what_its_columns_are_called_or_what_was_said(tmp_path):
    sun = {"zone": DENVER, "columns": ("Sun_Avg",)}
    unknown = read(tmp_path, TOA5, "sun", **sun)
    assert unknown.streams[0].measures == ()
    warnings = [text for severity, text in unknown.notes if severity is Severity.WARNING]
    assert any("ghi" in text and "irradiance.measures.sun" in text for text in warnings)
    stated = read(tmp_path, TOA5, **sun, measures="ghi")
    assert stated.streams[0].measures == ("ghi",)
    named = read(tmp_path, TOA5.replace("Sun_Avg", "DNI_Avg"), zone=DENVER, columns=("DNI_Avg",))
    assert named.streams[0].measures == ("dni",)
    assert "ghi applies to Sun_Avg" in notes(stated)
    assert "ghi" not in notes(named)


@pytest.mark.parametrize("text", [HOBO, HOBO.split("\n", 1)[1]], ids=["title", "no title"])
def test_a_hobo_table_says_its_zone_and_counts_fahrenheit_and_thousands(tmp_path, text):
    imported = read(tmp_path, text, **ZONELESS, time_format=HOBO_TIME)
    temperature, light = imported.streams
    assert readings(imported)[0].time_ns == 1_778_605_200_000_000_000  # 2026-05-12T17:00:00Z
    first, second, event = values(imported, temperature.name)
    assert (*first, *second) == pytest.approx((293.15, 294.15))  # 68 °F are 20 °C
    assert np.isnan(event[0])
    assert temperature.channels == ("Temp",)
    assert values(imported, light.name)[:2] == [(52_356.0,), (52_400.0,)]


def test_times_with_am_and_pm_are_asked_for_by_an_example_that_fits(tmp_path):
    with pytest.raises(ConfigError, match="'05/12/26 10:00:00 AM'") as caught:
        read(tmp_path, HOBO, **ZONELESS, columns=("Temp",))
    assert Argument("time_format", HOBO_TIME) in steps(caught.value)


@pytest.mark.parametrize(
    ("head", "stated"),
    [
        ("Date Time, GMT-07:00", "UTC-07:00"),
        ("Date/Time (GMT-08:00)", "UTC-08:00"),
        ("Local time (GMT+01:00)", "UTC+01:00"),
        ("Timestamp UTC+9", "UTC+09:00"),
        ("time [UTC]", "UTC"),
        ("time (Asia/Kathmandu)", "Asia/Kathmandu"),
    ],
)
def test_a_zone_against_the_one_in_the_header_is_refused_with_both(tmp_path, head, stated):
    text = f'"{head}",T [C]\n2026-05-12 10:00:00,20\n2026-05-12 10:01:00,21\n'
    with pytest.raises(
        ConfigError, check=at(tmp_path / "log.csv", Argument("zone"), Argument("offset_s"))
    ) as caught:
        read(tmp_path, text, zone=ZoneInfo("Pacific/Auckland"))
    assert f" {stated}, " in str(caught.value)
    assert "Pacific/Auckland" in str(caught.value)
    assert len(readings(read(tmp_path, text, **ZONELESS))) == 2


def test_sensors_of_a_hobo_are_called_by_label_or_number(tmp_path):
    numbers = ("11, LBL: bed", "12", "13")
    heads = ",".join(f'"Temp, °C (LGR S/N: 1, SEN S/N: {number})"' for number in numbers)
    rows = "2026-05-12 10:00:00,20,21,22\n2026-05-12 10:00:10,20,21,22\n"
    imported = read(tmp_path, f'"Date Time, GMT+09:00",{heads}\n{rows}', **ZONELESS)
    assert imported.streams[0].channels == ("bed", "Temp 12", "Temp 13")
    assert readings(imported)[0].time_ns == 1_778_547_600_000_000_000  # 2026-05-12T01:00:00Z


@pytest.mark.parametrize("separator", ["\u2028", "\x85"])
def test_a_line_separator_in_a_cell_ends_no_row(tmp_path, separator):
    """As pasted into a note from a web page."""
    rows = f"time,T [C],note\n2026-05-12 10:00:00,20,wind{separator}picks up\n2026-05-12 10:01:00,21,\n"
    assert values(read(tmp_path, rows)) == [(293.15,), (294.15,)]


# --- units and encodings


@pytest.mark.parametrize(
    ("unit", "cell", "stored", "value"),
    [
        ("klx", "63.986", "lx", 63_986.0),
        ("kilolux", "0.5", "lx", 500.0),
        ("fc", "100", "lx", 1076.3910),  # NIST SP 811, appendix B: 1 fc = 10.763 91 lx
        ("kW/m2", "0.9415", "W m-2", 941.5),
    ],
)
def test_thousands_of_a_unit_and_foot_candles_become_the_streams(tmp_path, unit, cell, stored, value):
    imported = read(tmp_path, minutes(f"dni [{unit}]", cell))
    assert imported.streams[0].unit == stored
    assert values(imported) == [pytest.approx((value,), rel=1e-7)]


def test_a_table_of_western_windows_asks_for_its_encoding(tmp_path):
    data = minutes("T1 [°C]", "21.5").encode("cp1252")
    with pytest.raises(
        ConfigError, match="0xb0", check=at(tmp_path / "log.csv", Argument("encoding", "cp1252"))
    ):
        read(tmp_path, data)
    assert values(read(tmp_path, data, encoding="cp1252")) == [pytest.approx((294.65,))]


def test_an_encoding_that_is_none_is_named(tmp_path):
    check = at(Argument("encoding", "klingon"), Argument("encoding", "cp1252"))
    with pytest.raises(ConfigError, check=check):
        read(tmp_path, minutes("T1 [C]", "21.5"), encoding="klingon")


def test_one_import_takes_columns_of_every_unit(tmp_path):
    text = "time,bed [C],air [F],light [klx],dni [W/m2],wind [m/s],gust [Bft]\n"
    rows = "2026-05-12T10:01:00,22.5,-999.9,64.1,,3,9\n2026-05-12T10:00:00,21.5,68,63.986,850,2,8\n"
    imported = read(tmp_path, text + rows)
    assert {info.name: (info.quantity, info.unit, info.channels) for info in imported.streams} == {
        "log-temperature": ("temperature", "K", ("bed", "air")),
        "log-illuminance": ("illuminance", "lx", ("light",)),
        "log-irradiance": ("irradiance", "W m-2", ("dni",)),
        "log-speed": ("speed", "m s-1", ("wind",)),
        "log-unknown": ("unknown", "Bft", ("gust",)),
    }
    assert imported.streams[2].measures == ("dni",)
    first, second = values(imported, "log-temperature")
    assert first == pytest.approx((294.65, 293.15))
    assert second == pytest.approx((295.65, (-999.9 + 459.67) / 1.8))
    light = [value for (value,) in values(imported, "log-illuminance")]
    assert light == pytest.approx([63_986.0, 64_100.0])
    assert values(imported, "log-irradiance")[0] == (850.0,)
    assert values(imported, "log-speed") == [(2.0,), (3.0,)]
    quantities = [air_quantities(info) for info in imported.streams]
    assert quantities == [("", "air_temperature"), ("",), ("",), ("wind_speed",), ("",)]
    times = [reading.time_ns for reading in imported.samples]
    assert times == sorted(times)
    assert imported.notes[0][1] == "log.csv: 2 rows, times in UTC"
    assert "gust [Bft]" in notes(imported)


# --- what the table states, no option overrides

NOON_NS = 1_781_179_200 * 10**9
"""2026-06-11T12:00:00Z by date(1)."""


def minutes(columns: str, *cells: str) -> str:
    rows = (f"2026-06-11 12:{minute:02}:00,{cell}\n" for minute, cell in enumerate(cells))
    return f"time,{columns}\n{''.join(rows)}"


FOUR_COLUMNS = minutes("RH [%],T,T2 [F],WindDir (deg)", "55,21,68,180", "56,22,70,190")


def test_a_unit_that_is_given_is_of_columns_that_state_none(tmp_path):
    imported = read(tmp_path, FOUR_COLUMNS, unit="C")
    assert imported.streams[0].channels == ("T", "T2")
    assert readings(imported)[0].values == pytest.approx((294.15, 293.15))  # 68 °F are 20 °C
    assert [info.unit for info in imported.streams] == ["K", "degree", "%"]
    (note,) = [text for severity, text in imported.notes[1:] if severity is Severity.INFO]
    assert [word in note for word in (" C ", " T;", "T2 [F], WindDir (deg)", "RH")] == [True] * 3 + [False]


@pytest.mark.parametrize(("column", "unit"), [("RH", "%"), ("T2", "F"), ("WindDir", "deg")])
def test_a_unit_against_that_of_a_column_asked_for_is_refused_with_both(tmp_path, column, unit):
    with pytest.raises(ConfigError, match=f"'{unit}', not 'C'") as caught:
        read(tmp_path, FOUR_COLUMNS, unit="C", columns=(column,))
    assert str(caught.value.place).startswith(f"{tmp_path / 'log.csv'}, column '{column} ")
    assert steps(caught.value) == [Argument("unit")]


def test_a_unit_that_every_column_states_itself_applies_to_none(tmp_path):
    imported = read(tmp_path, minutes("T [C]", "20", "21"), unit="F")
    assert readings(imported)[0].values == pytest.approx((293.15,))
    ((severity, text),) = imported.notes[1:]
    assert severity is Severity.WARNING
    assert text.endswith(" T [C]")
    same_unit = read(tmp_path, minutes("T [C]", "20", "21"), unit="degC", columns=("T",))
    assert values(same_unit) == values(imported)


@pytest.mark.parametrize(
    ("text", "channels"),
    [
        # arrays of Campbell loggers are ``Temp(1)``, ``Temp(2)``
        (
            "time,Temp(1),Temp(2),Temp (3),n\n2026-06-11 12:00,20,21,22,dry\n2026-06-11 12:01,21,22,23,wet\n",
            ("Temp(1)", "Temp(2)", "Temp (3)"),
        ),
        ("No,Date,Time,T,note\n1,2026-06-11,12:00,20,dry\n2,2026-06-11,12:01,21,wet\n", ("T",)),
    ],
    ids=["brackets around a number or a place", "a counter before the time"],
)
def test_units_and_values_are_not_seen_where_none_are(tmp_path, text, channels):
    assert read(tmp_path, text, unit="C").streams[0].channels == channels


NOON = "2026-06-11T12:00:00Z,"
STATED = [
    ("units above the names", ",°F,°F\ntime,T1,T2\n", "68,68", (293.15, 293.15)),
    ("units below other words", "Timestamp,T1,T2\nLocal time,°F,K\n", "68,293.15", (293.15, 293.15)),
    ("behind a dash", "time,Temp - °F,T2 - K\n", "68,293.15", (293.15, 293.15)),
    ("behind an underscore", "time,T1_°F,bed_f\n", "68,68", (293.15, 293.15)),
    ("beside others", "time,RH - %,Hum_%,T1 [F]\n", "50,50,68", (293.15,)),
    ("below a table of the place", "Long,Lat,Module\n8.5,47.1,x\ntime,T1 [F],RH_%\n", "68,50", (293.15,)),
    ("behind a sign", "time,T1°F,tempF\n", "68,68", (293.15, 293.15)),
    ("in a column before", "time,unit,T1\n", "F,68", (293.15,)),
    ("in a column behind", "time,T1,unit\n", "68,ºF", (293.15,)),
    ("in a column of no such name", "time,T1,x\n", "68,°F", (293.15,)),
    ("in a column of the same name", "time,T1 unit,T1,T2,T2 unit\n", "F,68,293.15,K", (293.15, 293.15)),
    ("in the cells", "time,T1,T2\n", "68 °F,68F", (293.15, 293.15)),
    ("in the cells, against the header", "time,T1 [K]\n", "68 °F", (293.15,)),
]


@pytest.mark.parametrize(
    ("head", "cells", "kelvin"), [case[1:] for case in STATED], ids=[case[0] for case in STATED]
)
def test_a_unit_that_stands_anywhere_wins(tmp_path, head, cells, kelvin):
    imported = read(
        tmp_path, f"{head}{NOON}{cells}\n{NOON.replace('12:', '13:')}{cells}\n", zone=None, unit="C"
    )
    assert values(imported)[0] == pytest.approx(kelvin)
    assert "the unit C applies to no column" in notes(imported)


@pytest.mark.parametrize(
    ("text", "steps_asked"),
    [
        (
            minutes("temperature,humidity", "22,48"),
            [Argument("columns", "temperature"), Argument("columns", "humidity")],
        ),
        ("Temperature unit: °F\n" + minutes("T1", "70"), [Argument("unit"), Argument("unit", "°F")]),
    ],
    ids=["of several columns", "against a line above"],
)
def test_a_unit_that_need_not_be_of_all_is_asked(tmp_path, text, steps_asked):
    with pytest.raises(ConfigError, check=at(tmp_path / "log.csv", *steps_asked)):
        read(tmp_path, text, unit="C")


def test_letters_of_a_series_are_no_units(tmp_path):
    assert values(read(tmp_path, minutes("T_a,T_b,T_c", "68,68,68"), unit="F")) == [
        pytest.approx((293.15,) * 3)
    ]


@pytest.mark.parametrize(
    "number", ["98'700.5", "98\u202f700,5", "98\u00a0700.5", "98 700,5", "98’700.5", "+98 700.5"]
)
def test_thousands_by_blanks_and_apostrophes_are_numbers(tmp_path, number):
    assert values(read(tmp_path, minutes("E [lx]", f'"{number}"'))) == [(98_700.5,)]


@pytest.mark.parametrize("cell", ["98·700", "ERR", "1e", "98_700_"])
def test_a_column_without_one_number_is_refused(tmp_path, cell):
    with pytest.raises(
        ConfigError, check=at(f"{tmp_path / 'log.csv'}, column 'E [lx]'", Argument("columns", "T"))
    ):
        read(tmp_path, minutes("E [lx],T [C]", f"{cell},20", f"{cell},21"))
    assert np.isnan(values(read(tmp_path, minutes("E [lx],T [C]", "NAN,20")), "log-illuminance")[0][0])


def test_components_are_given_by_column(tmp_path):
    text = minutes("sun [W/m2],tracker [W/m2],Pyrgeometer [W/m2],T [C]", "800,900,300,20")
    with pytest.raises(ConfigError, check=at(tmp_path / "log.csv", Argument("measures", {"sun": "ghi"}))):
        read(tmp_path, text, measures="ghi")
    given = read(tmp_path, text, measures={"sun": "ghi", "tracker": "dni"})
    assert given.streams[0].measures == ("ghi", "dni", "")
    assert "dni applies to tracker" in notes(given)
    for column, component in (("Pyrgeometer", "ghi"), ("T", "ghi")):
        with pytest.raises(
            ConfigError, match=column, check=lambda error: steps(error) == [Argument("measures")]
        ):
            read(tmp_path, text, measures={column: component})


def test_a_component_that_is_given_is_of_columns_that_name_none(tmp_path):
    text = minutes("GHI [W/m2],sun [W/m2],DHI [W/m2]", "800,900,100", "801,901,101")
    imported = read(tmp_path, text, measures="dni")
    assert imported.streams[0].measures == ("ghi", "dni", "dhi")
    (note,) = [text for _, text in imported.notes if "dni" in text]
    assert note.index(" sun;") < note.index(" GHI, DHI")
    check = at(f"{tmp_path / 'log.csv'}, column 'GHI [W/m2]'", Argument("measures"))
    with pytest.raises(ConfigError, check=check, match="ghi, not dni"):
        read(tmp_path, text, measures="dni", columns=("GHI",))


@pytest.mark.parametrize("columns", ["GHI [W/m2],DNI [W/m2]", "T1 [C],T2 [C]"])
def test_a_component_that_no_column_can_take_is_named(tmp_path, columns):
    imported = read(tmp_path, minutes(columns, "8,9", "7,6"), measures="dhi")
    assert "dhi" in notes(imported)
    assert "dhi" not in imported.streams[0].measures


def test_offsets_of_times_hold_against_a_zone_that_is_given(tmp_path):
    text = "time,T [C]\n2026-06-11T21:00:00+09:00,20\n2026-06-11T12:01:00Z,21\n"
    imported = read(tmp_path, text, zone=DENVER)
    assert [reading.time_ns - NOON_NS for reading in readings(imported)] == [0, 60 * 10**9]
    assert "America/Denver" in notes(imported)


def test_a_zone_that_agrees_with_the_one_in_the_header_is_taken(tmp_path):
    text = "time (UTC+02:00),T [C]\n2026-06-11 14:00:00,20\n2026-06-11 14:01:00,21\n"
    assert readings(read(tmp_path, text, zone=BERLIN))[0].time_ns == NOON_NS


# --- averages: each column by its own process

# Layout: Campbell Scientific, LoggerNet manual, "Computer File Data Formats: TOA5"
MIXED = """\
"TOA5","CR6","CR6","1","CR6.Std.11.01","CPU:x.CR6","1","T"
"TIMESTAMP","RECORD","T_sand_C","T_Avg","T_Max","T_Std","GHI_Avg","WS_WVc(1)","Flux_Tot"
"TS","RN","Deg C","Deg C","Deg C","Deg C","W/m^2","meters/second","W/m^2"
"","","Smp","Avg","Max","Std","Avg","WVc","Tot"
"""


def mixed(*clocks: str) -> str:
    return MIXED + "".join(f'"2026-06-11 {clock}:00",1,20,21,30,0.1,800,2,5000\n' for clock in clocks)


def seconds(imported: ImportedRecording, stream: str) -> list[float]:
    return [(reading.time_ns - NOON_NS) / 1e9 for reading in readings(imported, stream)]


def test_averages_stand_in_the_middle_of_their_interval_and_samples_where_they_are(tmp_path):
    imported = read(tmp_path, mixed("12:00", "12:10", "12:20"))
    assert {info.name: info.channels for info in imported.streams} == {
        "log-temperature": ("T_sand_C",),
        "log-temperature-mean": ("T_Avg",),
        "log-irradiance": ("GHI_Avg",),
        "log-speed": ("WS_WVc(1)",),
        "log-unknown": ("T_Max", "T_Std"),
        "log-unknown-2": ("Flux_Tot",),
    }
    assert seconds(imported, "log-temperature") == [0, 600, 1200]
    for averages in ("log-temperature-mean", "log-irradiance", "log-speed"):
        assert seconds(imported, averages) == [-300, 300, 900]
    assert "T_Max [Deg C], T_Std [Deg C], Flux_Tot [W/m^2]" in notes(imported)


def test_an_extreme_asked_for_by_name_stays_where_it_is_and_is_named(tmp_path):
    imported = read(tmp_path, mixed("12:00", "12:10"), columns=("T_Max",))
    assert seconds(imported, "log") == [0, 600]
    (warning,) = [text for severity, text in imported.notes if severity is Severity.WARNING]
    assert warning.endswith(" T_Max [Deg C] (Max)")


@pytest.mark.parametrize(
    ("clocks", "middles"),
    [
        # a gap of an hour: the row after it is an average of ten minutes as the others are
        (["12:00", "12:10", "12:20", "13:20", "13:30"], [-300, 300, 900, 4500, 5100]),
        # from minutes to ten minutes
        (["12:00", "12:01", "12:02", "12:03", "12:13", "12:23"], [-30, 30, 90, 150, 480, 1080]),
        # a row of its own between two gaps is as long as is usual
        (
            ["12:00", "12:10", "12:20", "13:20", "15:20", "15:30", "15:40"],
            [-300, 300, 900, 4500, 11700, 12300, 12900],
        ),
        # an output after three minutes, when the program was restarted
        (["12:00", "12:10", "12:13", "12:20", "12:30"], [-300, 300, 690, 990, 1500]),
        (["12:00"], [0]),
    ],
    ids=["gap", "other interval", "alone", "short", "one row shows no interval"],
)
def test_averages_after_a_gap_or_of_another_interval_have_their_own_middle(tmp_path, clocks, middles):
    imported = read(tmp_path, mixed(*clocks))
    assert seconds(imported, "log-irradiance") == middles
    about_averages = {
        severity for severity, text in imported.notes if "GHI_Avg" in text and "interval" in text
    }
    assert about_averages == {Severity.INFO if clocks[1:] else Severity.WARNING}


def test_a_campbell_table_of_two_header_lines_has_units_and_processes_in_its_names(tmp_path):
    """Names as Campbell's Short Cut gives them: AirTC in °C, SlrW in W/m², WS_ms in m/s."""
    imported = read(
        tmp_path,
        '"TOACI1","CR1000","Hourly"\n"TMSTAMP","RECNBR","AirTC_Avg","AirTC_Max","SlrW_Avg","WS_ms","BattV"\n'
        '"2026-06-11 12:00:00",1,12.5,19,455,2,12\n"2026-06-11 13:00:00",2,13.5,20,555,3,12\n',
    )
    assert {info.name: info.channels for info in imported.streams} == {
        "log-temperature": ("AirTC_Avg",),
        "log-irradiance": ("SlrW_Avg",),
        "log-speed": ("WS_ms",),
        "log-unknown": ("RECNBR", "BattV"),
        "log-unknown-2": ("AirTC_Max",),
    }
    assert seconds(imported, "log-temperature") == [-1800, 1800]
    assert seconds(imported, "log-speed") == [0, 3600]


def test_a_process_that_is_not_known_is_no_sample(tmp_path):
    imported = read(tmp_path, mixed("12:00", "12:10").replace('"Smp","Avg"', '"Rfl","Avg"'))
    assert imported.streams[0].channels == ("T_Avg",)
    assert "T_sand_C [Deg C]" in notes(imported)


@pytest.mark.parametrize("year", [1650, 1965, 2255, 9999])
def test_years_that_no_session_holds_are_refused(tmp_path, year):
    with pytest.raises(ConfigError, match=f"{year}|s after 1970"):
        read(tmp_path, f"time,T [K]\n{year}-05-12T01:00:00+00:00,300\n")
