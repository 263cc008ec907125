"""Tables of loggers become streams, alone or beside an old session."""

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from fieldkit.model.channels import air_quantities
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.model.samples import Quality, Reading, Severity
from fieldkit.model.site import Site
from fieldkit.sessions.formats.imported import ImportedRecording, possible
from fieldkit.sessions.formats.logs import LogColumns, LogOptions, read_log, read_table
from fieldkit.sessions.formats.merged import cut_session, merge
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.writer import SessionWriter
from tests.harness.next_steps import steps
from tests.harness.recording import START_NS, CountedClock, fill, header, same

TOKYO = ZoneInfo("Asia/Tokyo")


def table(tmp_path: Path, text: str, encoding: str = "utf-8") -> Path:
    path = tmp_path / "log.csv"
    path.write_bytes(text.encode(encoding))
    return path


def test_celsius_becomes_kelvin_and_the_offset_is_added(tmp_path):
    path = table(
        tmp_path, "time,T1 [C],T2 [C],note\n2026/05/12 10:00:00,20.5,,dry\n2026/05/12 10:00:10,21,19,wet\n"
    )
    imported = read_log(
        path, "logger", LogOptions(zone=TOKYO, time_format="yyyy/mm/dd HH:MM:SS", offset_ns=12_000_000_000)
    )
    first, second = (one for one in imported.samples if isinstance(one, Reading))
    assert first.time_ns == 1_778_547_612_000_000_000  # 2026-05-12T01:00:12Z
    assert first.values[0] == 293.65
    assert np.isnan(first.values[1])
    assert second.values == (294.15, 292.15)
    (info,) = imported.streams
    assert (info.unit, info.channels, info.rate_hz) == ("K", ("T1", "T2"), 0.1)
    assert "+12 s" in imported.notes[0][1]


def test_semicolons_decimal_commas_and_other_encodings(tmp_path):
    path = table(
        tmp_path,
        "Zeit;Licht (lx);Fühler [°C]\n2026-05-12T01:00:00Z;52300,5;20\n2026-05-12T01:01:00Z;1;2\n",
        "cp1252",
    )
    imported = read_log(path, "lux", LogOptions(columns=LogColumns(values=("Licht",)), encoding="cp1252"))
    assert [one.values for one in imported.samples if isinstance(one, Reading)] == [(52300.5,), (1.0,)]


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
    imported = read_log(
        table(tmp_path, text), "logger", LogOptions(zone=TOKYO, time_format=time_format, unit=unit)
    )
    found = [one for one in imported.samples if isinstance(one, Reading)]
    assert [one.time_ns // 10**9 for one in found] == [1_778_547_600, 1_778_547_610]  # 2026-05-12T01:00:00Z
    assert [one.values for one in found] == [(293.65,), (294.15,)]


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
    rows = "".join(f"2026-05-12T01:0{minute}:00Z,{cell}\n" for minute, cell in enumerate(cells))
    read = read_log(table(tmp_path, f"time,x [{unit}]\n{rows}"), "logger")
    imported = possible(read, {}, Site(35.0, 139.0, 0.0))
    readings = [one for one in imported.samples if isinstance(one, Reading)]
    zero = 273.15 if unit == "C" else 0.0
    assert [one.values[0] for one in readings] == pytest.approx([float(cell) + zero for cell in cells])
    flagged = [cells[n] for n, one in enumerate(readings) if Quality.IMPLAUSIBLE in one.quality]
    assert len(flagged) == impossible
    (note,) = [text for _, text in imported.notes if "implausible" in text]
    assert f"logger: {impossible} implausible values" in note
    assert f"(line {cells.index(flagged[0]) + 2})" in note


def test_columns_of_unknown_units_are_stored_as_they_came(tmp_path):
    text = "time,T1 [C],soil [%],flow [l/h],RH [%],VWC [%],Pressure [hPa],note\n"
    path = table(tmp_path, f"{text}2026-05-12T01:00:00Z,3,12.5,7,40,12.5,1000,dry\n")
    imported = read_log(path, "logger")
    streams = {info.name: (info.unit, info.channels) for info in imported.streams}
    assert streams == {
        "logger-temperature": ("K", ("T1",)),
        "logger-soil_moisture": ("m3 m-3", ("VWC",)),
        "logger-air_pressure": ("Pa", ("Pressure",)),
        "logger-unknown": ("%", ("soil", "RH")),
        "logger-unknown-2": ("l/h", ("flow",)),
    }
    values = {one.stream: one.values for one in imported.samples}
    assert values["logger-unknown"] == (12.5, 40.0)
    assert values["logger-soil_moisture"] == (0.125,)
    assert "soil [%], flow [l/h], RH [%]" in notes(imported)
    assert len(read_log(path, "logger", LogOptions(columns=LogColumns(values=("T1",)))).notes) == 1


def test_dates_alone_are_taken_where_each_stands_once(tmp_path):
    imported = read_log(
        table(tmp_path, "date,T1 [C]\n2026-05-12,3\n2026-05-13,4\n"), "logger", LogOptions(zone=TOKYO)
    )
    assert imported.streams[0].rate_hz == 1 / 86_400


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('time,E [lx]\n2026-05-12T01:00:00Z,"12,345"\n2026-05-12T01:01:00Z,999\n', "'12,345' .* has a comma"),
        ("date,h,T1 [C]\n2026-05-12,10,3\n2026-05-12,11,3\n", "several rows have the date '2026-05-12'"),
        ("", "cannot be read|no table"),
        ("time,T1\n2026-05-12T01:00:00Z,3\n", "no column has a unit"),
        ("time,T1 [C]\n2026-05-12 01:00:00,3\n", "no zone"),
        ("time,T1 [C]\nyesterday,3\n", "not a time"),
    ],
)
def test_table_that_is_not_understood_is_told(tmp_path, text, words):
    with pytest.raises(ConfigError, match=words):
        read_log(table(tmp_path, text), "logger")


BERLIN = ZoneInfo("Europe/Berlin")
END_OF_SUMMER_NS = 1_792_890_000 * 10**9
"""2026-10-25T01:00Z: clocks in Berlin go from 3:00 back to 2:00 (directive 2000/84/EC)."""


def local_log(tmp_path: Path, minutes: Sequence[int], *, newest_first: bool = False) -> Path:
    """A log in Berlin's clock time, its rows at these minutes around the end of summer time."""
    moments = [datetime.fromtimestamp(END_OF_SUMMER_NS / 1e9 + 60 * minute, BERLIN) for minute in minutes]
    rows = [f"{moment:%Y-%m-%d %H:%M:%S},{minute}\n" for moment, minute in zip(moments, minutes, strict=True)]
    return table(tmp_path, "time,T1 [C]\n" + "".join(reversed(rows) if newest_first else rows))


@pytest.mark.parametrize("newest_first", [False, True])
@pytest.mark.parametrize(
    "minutes",
    [range(-90, 120), range(-30, 5), range(-5, 70), range(-300, 300, 60), range(-90, 90, 30)],
    ids=["minutes", "ends within", "begins within", "hourly", "half-hourly"],
)
def test_hour_that_comes_twice_keeps_the_order_of_the_rows(tmp_path, minutes, newest_first):
    imported = read_log(
        local_log(tmp_path, minutes, newest_first=newest_first), "logger", LogOptions(zone=BERLIN)
    )
    found = [
        ((one.time_ns - END_OF_SUMMER_NS) / 60e9, one.values[0] - 273.15)
        for one in imported.samples
        if isinstance(one, Reading)
    ]
    assert [minute for minute, _ in found] == list(minutes)
    assert [value for _, value in found] == pytest.approx(list(minutes))


@pytest.mark.parametrize(
    "minutes", [[*range(-60, -30)], [*range(10, 100)], [-120, -50, 70], [-20, -10, 5, -30, 20]]
)
def test_hour_that_came_twice_is_refused_where_its_rows_do_not_tell_which(tmp_path, minutes):
    with pytest.raises(ConfigError, match="Europe/Berlin") as caught:
        read_log(local_log(tmp_path, minutes), "logger", LogOptions(zone=BERLIN))
    assert "Etc/GMT-2" in str(caught.value.fix)  # what a clock left in summer time needs


def test_log_of_a_clock_that_stayed_in_summer_time_is_taken_with_its_offset(tmp_path):
    path = table(tmp_path, "time,T1 [C]\n2026-10-25 02:30:00,1\n2026-10-25 03:30:00,2\n")
    imported = read_log(path, "logger", LogOptions(zone=ZoneInfo("Etc/GMT-2")))
    times = [reading.time_ns for reading in imported.samples]
    assert times == [END_OF_SUMMER_NS - 30 * 60 * 10**9, END_OF_SUMMER_NS + 30 * 60 * 10**9]


def test_time_over_which_clocks_were_put_forward_is_refused(tmp_path):
    path = table(tmp_path, "time,T1 [C]\n2026-03-29 01:59:00,1\n2026-03-29 02:01:00,2\n")
    with pytest.raises(ConfigError, match="'2026-03-29 02:01:00'"):
        read_log(path, "logger", LogOptions(zone=BERLIN))


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
    rows = "".join(f"2026-05-12T01:0{minute}:00Z;{cell}\n" for minute, cell in enumerate(cells))
    imported = read_log(table(tmp_path, f"time;E [lx]\n{rows}"), "lux")
    assert [one.values[0] for one in imported.samples if isinstance(one, Reading)] == expected
    assert len(imported.notes) == 1


@pytest.mark.parametrize("mark", [";", "\t"])
@pytest.mark.parametrize("cells", [["12.345", "900"], ["12.345", "20,5"], ["12.345", "98.760"]])
def test_points_that_may_be_of_thousands_are_refused_as_commas_are(tmp_path, cells, mark):
    rows = "".join(f"2026-05-12T01:0{minute}:00Z{mark}{cell}\n" for minute, cell in enumerate(cells))
    with pytest.raises(ConfigError, match=r"'12\.345'"):
        read_log(table(tmp_path, f"time{mark}E [lx]\n{rows}"), "lux")


def test_cells_that_are_not_numbers_are_counted(tmp_path):
    path = table(
        tmp_path, "time,T1 [C]\n2026-05-12T01:00:00Z,ERR\n2026-05-12T01:01:00Z,\n2026-05-12T01:02:00Z,3\n"
    )
    notes = [text for _, text in read_log(path, "logger").notes]
    assert "1 cells are not numbers and have no value, such as 'ERR'" in notes


def test_log_that_ran_longer_is_cut_to_the_session(tmp_path):
    clock = CountedClock()
    writer = SessionWriter(tmp_path / "old.h5", header((24, 32)), clock)
    fill(writer, 20, clock)
    writer.close()
    with open_session(tmp_path / "old.h5") as session:
        start_s = session.start_ns / 1e9
        rows = "".join(f"{start_s + n + 0.01:.3f},{n}\n" for n in range(-10, 11))
        imported = read_log(table(tmp_path, "time,T1 [C]\n" + rows), "logger")
        cut = cut_session(session, imported)
        found = [one.values[0] - 273.15 for one in cut.samples if isinstance(one, Reading)]
        # it is twenty milliseconds long: of readings a second apart, two on either side and the one within
        assert found == pytest.approx([-2, -1, 0, 1, 2], abs=1e-9)
        assert "16 samples from before or after" in cut.notes[-1][1]
        assert merge(session, cut, tmp_path / "new.h5", "log.csv").counts["logger"] == 5


def test_stream_is_added_beside_an_old_session(tmp_path):
    clock = CountedClock()
    writer = SessionWriter(tmp_path / "old.h5", header((24, 32)), clock)
    appended = fill(writer, 20, clock)
    writer.close()
    before = (tmp_path / "old.h5").read_bytes()
    start_s = START_NS / 1e9 + 5.01
    rows = "".join(f"{start_s + n / 100:.2f},{20 + n}\n" for n in range(2))
    imported = read_log(table(tmp_path, "time,T1 [C]\n" + rows), "logger")
    with open_session(tmp_path / "old.h5") as session:
        report = merge(session, imported, tmp_path / "new.h5", "log.csv")
        with pytest.raises(ConfigError, match="'lux' already"):
            merge(session, read_log(tmp_path / "log.csv", "lux"), tmp_path / "x.h5", "log.csv")
        late = table(tmp_path, "time,T1 [C]\n2031-01-01T00:00:00Z,1\n")
        with pytest.raises(ConfigError, match="do not overlap"):
            merge(session, read_log(late, "logger"), tmp_path / "x.h5", "log.csv")
    assert report.counts == {"camera": 20, "lux": 5, "thermometer": 5, "logger": 2}
    assert (tmp_path / "old.h5").read_bytes() == before
    with open_session(tmp_path / "new.h5") as session:
        old = [one for one in session.samples() if one.stream != "logger"]
        assert all(same(one, other) for one, other in zip(old, appended, strict=True))
        texts = [event.text for event in session.events()]
        assert texts[0] == "wolke über b05"
        assert "stream added from log.csv" in texts
        assert len(session.region_history()) == 2


# --- tables of Campbell and HOBO loggers, with the lines above their rows

DENVER = ZoneInfo("America/Denver")

# Layout: Campbell Scientific, LoggerNet manual, "Computer File Data Formats: TOA5"
TOA5 = """\
"TOA5","Tower","CR1000","12216","CR1000.Std.31.08","CPU:tower.CR1","3076","Minute"
"TIMESTAMP","RECORD","Batt_Min","Tair_Avg","Tsand_Avg","SWin_Avg"
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


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "log.csv"
    path.write_text(text, encoding="utf-8")
    return path


def readings(imported: ImportedRecording) -> list[Reading]:
    return [one for one in imported.samples if isinstance(one, Reading)]


def test_a_campbell_table_is_read_as_it_is(tmp_path):
    columns = LogColumns(values=("Tair_Avg", "Tsand_Avg"))
    imported = read_log(written(tmp_path, TOA5), "tower", LogOptions(zone=DENVER, columns=columns))
    first, second = readings(imported)
    assert first.time_ns == 1_778_601_630_000_000_000  # 2026-05-12T16:00:30Z, in the middle of the minute
    assert first.values == (293.65, 304.4)
    assert np.isnan(second.values[0])
    assert imported.streams[0].channels == ("Tair_Avg", "Tsand_Avg")
    assert any("in the middle of their interval of 60 s" in text for _, text in imported.notes)


def test_columns_of_several_units_go_into_streams_of_their_own(tmp_path):
    imported = read_log(written(tmp_path, TOA5), "tower", LogOptions(zone=DENVER))
    assert {info.name: info.channels for info in imported.streams} == {
        "tower-temperature": ("Tair_Avg", "Tsand_Avg"),
        "tower-irradiance": ("SWin_Avg",),
        "tower-unknown": ("Batt_Min",),
    }


def test_of_a_campbell_table_each_unit_is_a_stream_of_its_own(tmp_path):
    path = written(tmp_path, TOA5)
    imported = read_log(path, "sun", LogOptions(zone=DENVER, columns=LogColumns(values=("SWin_Avg",))))
    assert [one.values for one in readings(imported)] == [(812.5,), (813.0,)]
    assert (imported.streams[0].unit, imported.streams[0].quantity) == ("W m-2", "irradiance")
    heads = [column.head for column in read_table(path).columns]
    assert heads[:3] == ["TIMESTAMP [TS]", "RECORD [RN]", "Batt_Min [Volts]"]


def test_radiation_of_a_table_is_what_its_columns_are_called_or_what_was_said(tmp_path):
    path = written(tmp_path, TOA5)
    sun = LogColumns(values=("SWin_Avg",))
    unknown = read_log(path, "sun", LogOptions(zone=DENVER, columns=sun))
    assert unknown.streams[0].measures == ()
    warned = [text for severity, text in unknown.notes if severity is Severity.WARNING]
    assert any("ghi" in text and "irradiance.measures.sun" in text for text in warned)
    said = read_log(path, "sun", LogOptions(zone=DENVER, columns=sun, measures="ghi"))
    assert said.streams[0].measures == ("ghi",)
    named = written(tmp_path, TOA5.replace("SWin_Avg", "DNI_Avg"))
    imported = read_log(named, "sun", LogOptions(zone=DENVER, columns=LogColumns(values=("DNI_Avg",))))
    assert imported.streams[0].measures == ("dni",)
    assert not any("ghi" in text for _, text in [*said.notes, *imported.notes])


def test_samples_of_a_campbell_table_are_not_told_to_be_means(tmp_path):
    path = written(tmp_path, TOA5.replace('"Avg"', '"Smp"'))
    imported = read_log(path, "sun", LogOptions(zone=DENVER, columns=LogColumns(values=("SWin_Avg",))))
    assert not any("interval" in text for _, text in imported.notes)


@pytest.mark.parametrize("text", [HOBO, HOBO.split("\n", 1)[1]], ids=["title", "no title"])
def test_a_hobo_table_says_its_zone_and_counts_fahrenheit(tmp_path, text):
    columns = LogColumns(values=("Temp",))
    imported = read_log(written(tmp_path, text), "bed3", LogOptions(time_format=HOBO_TIME, columns=columns))
    first, second, event = readings(imported)
    assert first.time_ns == 1_778_605_200_000_000_000  # 2026-05-12T17:00:00Z
    assert first.values[0] == pytest.approx(293.15)  # 68 °F are 20 °C
    assert second.values[0] == pytest.approx(294.15)
    assert np.isnan(event.values[0])
    assert imported.streams[0].channels == ("Temp",)


def test_times_with_am_and_pm_are_asked_for_by_an_example_that_fits(tmp_path):
    with pytest.raises(ConfigError, match="'05/12/26 10:00:00 AM'") as caught:
        read_log(written(tmp_path, HOBO), "bed3", LogOptions(columns=LogColumns(values=("Temp",))))
    assert Argument("time_format", HOBO_TIME) in steps(caught.value)


def test_thousands_with_a_point_behind_them_are_understood(tmp_path):
    columns = LogColumns(values=("Intensity",))
    imported = read_log(written(tmp_path, HOBO), "lux", LogOptions(time_format=HOBO_TIME, columns=columns))
    assert [reading.values[0] for reading in readings(imported)][:2] == [52_356.0, 52_400.0]


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
    path = written(tmp_path, f'"{head}",T [C]\n2026-05-12 10:00:00,20\n2026-05-12 10:01:00,21\n')
    with pytest.raises(ConfigError, match="not of Pacific/Auckland") as caught:
        read_log(path, "x", LogOptions(zone=ZoneInfo("Pacific/Auckland")))
    assert f"zone {stated}, " in caught.value.message
    assert caught.value.place == path
    assert len(readings(read_log(path, "x"))) == 2


def test_sensors_of_a_hobo_are_called_by_label_or_number(tmp_path):
    heads = (
        "Date Time, GMT+09:00",
        "Temp, °C (LGR S/N: 1, SEN S/N: 11, LBL: bed)",
        "Temp, °C (LGR S/N: 1, SEN S/N: 12)",
        "Temp, °C (LGR S/N: 1, SEN S/N: 13)",
    )
    text = (
        ",".join(f'"{head}"' for head in heads)
        + "\n2026-05-12 10:00:00,20,21,22\n2026-05-12 10:00:10,20,21,22\n"
    )
    imported = read_log(written(tmp_path, text), "x")
    assert imported.streams[0].channels == ("bed", "Temp 12", "Temp 13")
    assert readings(imported)[0].time_ns == 1_778_547_600_000_000_000  # 2026-05-12T01:00:00Z


@pytest.mark.parametrize("separator", ["\u2028", "\x85"])
def test_a_line_separator_in_a_cell_ends_no_row(tmp_path, separator):
    """As pasted into a note from a web page."""
    rows = f"time,T [C],note\n2026-05-12 10:00:00,20.5,wind{separator}picks up\n2026-05-12 10:01:00,20.6,\n"
    table = read_table(written(tmp_path, rows))
    assert [row.cells[1] for row in table.rows] == ["20.5", "20.6"]


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
    path = table(tmp_path, f"time,dni [{unit}]\n2026-05-12T10:00:00,{cell}\n")
    imported = read_log(path, "log", LogOptions(zone=UTC))
    (reading,) = imported.samples
    assert imported.streams[0].unit == stored
    assert reading.values == pytest.approx((value,), rel=1e-7)


def test_a_table_of_western_windows_asks_for_its_encoding(tmp_path):
    path = table(tmp_path, "time,T1 [°C]\n2026-05-12T10:00:00,21.5\n", "cp1252")
    with pytest.raises(ConfigError, match="0xb0") as caught:
        read_log(path, "log", LogOptions(zone=UTC))
    assert Argument("encoding", "cp1252") in steps(caught.value)
    (reading,) = read_log(path, "log", LogOptions(zone=UTC, encoding="cp1252")).samples
    assert reading.values == pytest.approx((294.65,))


def test_an_encoding_that_is_none_is_named(tmp_path):
    path = table(tmp_path, "time,T1 [C]\n2026-05-12T10:00:00,21.5\n")
    with pytest.raises(ConfigError, match="klingon") as caught:
        read_log(path, "log", LogOptions(zone=UTC, encoding="klingon"))
    assert Argument("encoding", "cp1252") in steps(caught.value)


def test_one_import_takes_columns_of_every_unit(tmp_path):
    text = "time,bed [C],air [F],light [klx],dni [W/m2],wind [m/s],gust [km/h]\n"
    rows = "2026-05-12T10:01:00,22.5,-999.9,64.1,,3,9\n2026-05-12T10:00:00,21.5,68,63.986,850,2,8\n"
    imported = read_log(table(tmp_path, text + rows), "logger", LogOptions(zone=UTC))
    found = {info.name: (info.quantity, info.unit, info.channels) for info in imported.streams}
    assert found == {
        "logger-temperature": ("temperature", "K", ("bed", "air")),
        "logger-illuminance": ("illuminance", "lx", ("light",)),
        "logger-irradiance": ("irradiance", "W m-2", ("dni",)),
        "logger-speed": ("speed", "m s-1", ("wind",)),
        "logger-unknown": ("unknown", "km/h", ("gust",)),
    }
    assert imported.streams[2].measures == ("dni",)
    readings = {name: [one.values for one in imported.samples if one.stream == name] for name in found}
    assert readings["logger-temperature"][0] == pytest.approx((294.65, 293.15))
    assert readings["logger-temperature"][1] == pytest.approx((295.65, (-999.9 + 459.67) / 1.8))
    assert readings["logger-illuminance"] == [pytest.approx((63_986.0,)), pytest.approx((64_100.0,))]
    assert readings["logger-irradiance"][0] == (850.0,)
    assert readings["logger-speed"] == [(2.0,), (3.0,)]
    assert [air_quantities(info) for info in imported.streams] == [
        ("", "air_temperature"),
        ("",),
        ("",),
        ("wind_speed",),
        ("",),
    ]
    times = [reading.time_ns for reading in imported.samples]
    assert times == sorted(times)
    said = [text for _, text in imported.notes]
    assert said[0] == "log.csv: 2 rows"
    assert any("gust [km/h]" in text for text in said)


def test_a_column_named_by_hand_in_an_unknown_unit_is_stored_as_it_came(tmp_path):
    path = table(tmp_path, "time,wind [mph],T [C]\n2026-05-12T10:00:00,3,21\n")
    imported = read_log(path, "log", LogOptions(zone=UTC, columns=LogColumns(values=("wind",))))
    assert [(info.quantity, info.unit) for info in imported.streams] == [("unknown", "mph")]
    assert air_quantities(imported.streams[0]) == ("",)
    assert readings(imported)[0].values == (3.0,)


# --- what the table states, no option overrides

NOON_NS = 1_781_179_200 * 10**9
"""2026-06-11T12:00:00Z by date(1)."""


def notes(imported: ImportedRecording) -> str:
    return "\n".join(text for _, text in imported.notes)


def minutes(columns: str, *cells: str) -> str:
    rows = (f"2026-06-11 12:{minute:02}:00,{one}\n" for minute, one in enumerate(cells))
    return f"time,{columns}\n{''.join(rows)}"


def test_a_unit_that_is_given_is_of_columns_that_state_none(tmp_path):
    path = table(tmp_path, minutes("RH [%],T,T2 [F],WindDir (deg)", "55,21,68,180", "56,22,70,190"))
    imported = read_log(path, "x", LogOptions(zone=UTC, unit="C"))
    assert imported.streams[0].channels == ("T", "T2")
    assert readings(imported)[0].values == pytest.approx((294.15, 293.15))  # 68 °F are 20 °C
    assert [info.unit for info in imported.streams] == ["K", "degree", "%"]
    assert "the unit C applies to T; stated by the table: T2 [F], WindDir (deg)" in notes(imported)


@pytest.mark.parametrize(("column", "unit"), [("RH", "%"), ("T2", "F"), ("WindDir", "deg")])
def test_a_unit_against_that_of_a_column_asked_for_is_refused_with_both(tmp_path, column, unit):
    path = table(tmp_path, minutes("RH [%],T,T2 [F],WindDir (deg)", "55,21,68,180"))
    asked = LogColumns(values=(column,))
    with pytest.raises(ConfigError, match=f"unit '{unit}', not 'C'") as caught:
        read_log(path, "x", LogOptions(zone=UTC, unit="C", columns=asked))
    assert steps(caught.value) == [Argument("unit")]


def test_a_unit_that_every_column_states_itself_applies_to_none(tmp_path):
    path = table(tmp_path, minutes("T [C]", "20", "21"))
    imported = read_log(path, "x", LogOptions(zone=UTC, unit="F"))
    assert readings(imported)[0].values == pytest.approx((293.15,))
    assert (Severity.WARNING, "the unit F applies to no column; stated by the table: T [C]") in imported.notes
    asked = LogOptions(zone=UTC, unit="degC", columns=LogColumns(values=("T",)))
    assert readings(read_log(path, "x", asked))[0].values == pytest.approx((293.15,))


def test_brackets_around_a_number_or_a_place_state_no_unit(tmp_path):
    """Arrays of Campbell loggers are ``Temp(1)``, ``Temp(2)``."""
    path = table(tmp_path, minutes("No,Temp(1),Temp(2),T (shade),note", "1,20,21,22,dry", "2,21,22,23,wet"))
    imported = read_log(path, "x", LogOptions(zone=UTC, unit="C"))
    assert imported.streams[0].channels == ("No", "Temp(1)", "Temp(2)", "T (shade)")


def test_counters_before_the_time_and_words_are_no_values(tmp_path):
    text = "No,Date,Time,T,note\n1,2026-06-11,12:00,20,dry\n2,2026-06-11,12:01,21,wet\n"
    imported = read_log(table(tmp_path, text), "x", LogOptions(zone=UTC, unit="C"))
    assert imported.streams[0].channels == ("T",)


def test_a_component_that_is_given_is_of_columns_that_name_none(tmp_path):
    path = table(tmp_path, minutes("GHI [W/m2],sun [W/m2],DHI [W/m2]", "800,900,100", "801,901,101"))
    imported = read_log(path, "x", LogOptions(zone=UTC, measures="dni"))
    assert imported.streams[0].measures == ("ghi", "dni", "dhi")
    assert "dni applies to sun; stated by the table: GHI, DHI" in notes(imported)
    named_ghi = LogOptions(zone=UTC, measures="dni", columns=LogColumns(values=("GHI",)))
    with pytest.raises(ConfigError, match=r"GHI \[W/m2\].* ghi, not dni") as caught:
        read_log(path, "x", named_ghi)
    assert steps(caught.value) == [Argument("measures")]


@pytest.mark.parametrize("columns", ["GHI [W/m2],DNI [W/m2]", "T1 [C],T2 [C]"])
def test_a_component_that_no_column_can_take_is_named(tmp_path, columns):
    path = table(tmp_path, minutes(columns, "8,9", "7,6"))
    imported = read_log(path, "x", LogOptions(zone=UTC, measures="dhi"))
    assert "dhi" in notes(imported)
    assert "dhi" not in imported.streams[0].measures


def test_offsets_of_times_hold_against_a_zone_that_is_given(tmp_path):
    path = table(tmp_path, "time,T [C]\n2026-06-11T21:00:00+09:00,20\n2026-06-11T12:01:00Z,21\n")
    imported = read_log(path, "x", LogOptions(zone=DENVER))
    assert [reading.time_ns - NOON_NS for reading in readings(imported)] == [0, 60 * 10**9]
    assert "America/Denver" in notes(imported)


def test_a_zone_that_agrees_with_the_one_in_the_header_is_taken(tmp_path):
    path = table(tmp_path, "time (UTC+02:00),T [C]\n2026-06-11 14:00:00,20\n2026-06-11 14:01:00,21\n")
    assert readings(read_log(path, "x", LogOptions(zone=BERLIN)))[0].time_ns == NOON_NS


# --- averages: each column by its own process

# Layout: Campbell Scientific, LoggerNet manual, "Computer File Data Formats: TOA5"
MIXED = """\
"TOA5","CR6","CR6","1","CR6.Std.11.01","CPU:x.CR6","1","T"
"TIMESTAMP","RECORD","T_sand_C","T_Avg","T_Max","T_Std","GHI_Avg","WS_WVc(1)","Flux_Tot"
"TS","RN","Deg C","Deg C","Deg C","Deg C","W/m^2","meters/second","W/m^2"
"","","Smp","Avg","Max","Std","Avg","WVc","Tot"
"""


def mixed(*rows: str) -> str:
    return MIXED + "".join(f'"2026-06-11 {row}",1,20,21,30,0.1,800,2,5000\n' for row in rows)


def seconds(imported: ImportedRecording, stream: str) -> list[float]:
    return [(one.time_ns - NOON_NS) / 1e9 for one in imported.samples if one.stream == stream]


def test_averages_stand_in_the_middle_of_their_interval_and_samples_where_they_are(tmp_path):
    path = table(tmp_path, mixed("12:00:00", "12:10:00", "12:20:00"))
    imported = read_log(path, "log", LogOptions(zone=UTC))
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
    assert "--clock-offset" not in notes(imported)


def test_an_extreme_asked_for_by_name_stays_where_it_is_and_is_named(tmp_path):
    path = table(tmp_path, mixed("12:00:00", "12:10:00"))
    imported = read_log(path, "log", LogOptions(zone=UTC, columns=LogColumns(values=("T_Max",))))
    assert seconds(imported, "log") == [0, 600]
    assert "neither samples nor averages, stamped as the table has them: T_Max [Deg C] (Max)" in notes(
        imported
    )


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
    ],
    ids=["gap", "other interval", "alone", "short"],
)
def test_averages_after_a_gap_or_of_another_interval_have_their_own_middle(tmp_path, clocks, middles):
    path = table(tmp_path, mixed(*(f"{clock}:00" for clock in clocks)))
    assert seconds(read_log(path, "log", LogOptions(zone=UTC)), "log-irradiance") == middles


def test_one_average_alone_shows_no_interval(tmp_path):
    imported = read_log(table(tmp_path, mixed("12:00:00")), "log", LogOptions(zone=UTC))
    assert seconds(imported, "log-irradiance") == [0]
    assert "averages of GHI_Avg are stamped at the end of their interval" in notes(imported)


def test_a_campbell_table_of_two_header_lines_has_units_and_processes_in_its_names(tmp_path):
    """Names as Campbell's Short Cut gives them: AirTC in °C, SlrW in W/m², WS_ms in m/s."""
    text = (
        '"TOACI1","CR1000","Hourly"\n"TMSTAMP","RECNBR","AirTC_Avg","AirTC_Max","SlrW_Avg","WS_ms","BattV"\n'
        '"2026-06-11 12:00:00",1,12.5,19,455,2,12\n"2026-06-11 13:00:00",2,13.5,20,555,3,12\n'
    )
    imported = read_log(table(tmp_path, text), "log", LogOptions(zone=UTC))
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
    text = mixed("12:00:00", "12:10:00").replace('"Smp","Avg"', '"Rfl","Avg"')
    imported = read_log(table(tmp_path, text), "log", LogOptions(zone=UTC))
    assert imported.streams[0].channels == ("T_Avg",)
    assert "T_sand_C [Deg C]" in notes(imported)


@pytest.mark.parametrize("year", [1650, 1965, 2255, 9999])
def test_years_that_no_session_holds_are_refused(tmp_path, year):
    path = tmp_path / "a.csv"
    path.write_text(f"time,T [K]\n{year}-05-12T01:00:00+00:00,300\n")
    with pytest.raises(ConfigError, match=r"year must lie within|none of a recording"):
        read_log(path, "a", LogOptions())
