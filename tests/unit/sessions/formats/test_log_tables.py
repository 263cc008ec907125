"""The tables that two makers' loggers write, with the lines they put above the rows."""

from __future__ import annotations

from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from fieldkit.model.errors import ConfigError
from fieldkit.model.samples import Reading, Severity
from fieldkit.sessions.formats.imported import ImportedRecording
from fieldkit.sessions.formats.logs import LogColumns, LogOptions, read_log, read_table

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


def test_a_campbell_table_is_read_as_it_is(tmp_path: Path) -> None:
    columns = LogColumns(values=("Tair_Avg", "Tsand_Avg"))
    imported = read_log(written(tmp_path, TOA5), "tower", LogOptions(zone=DENVER, columns=columns))
    first, second = readings(imported)
    assert first.time_ns == 1_778_601_660_000_000_000  # 2026-05-12T16:01:00Z
    assert first.values == (293.65, 304.4)
    assert np.isnan(second.values[0])
    assert imported.streams[0].channels == ("Tair_Avg", "Tsand_Avg")
    assert any("--offset -30s" in text for _, text in imported.notes)  # the rows stand at the ends of minutes


def test_columns_of_several_units_go_into_streams_of_their_own(tmp_path: Path) -> None:
    imported = read_log(written(tmp_path, TOA5), "tower", LogOptions(zone=DENVER))
    assert {info.name: info.channels for info in imported.streams} == {
        "tower-temperature": ("Tair_Avg", "Tsand_Avg"),
        "tower-irradiance": ("SWin_Avg",),
    }


def test_of_a_campbell_table_each_unit_is_a_stream_of_its_own(tmp_path: Path) -> None:
    path = written(tmp_path, TOA5)
    imported = read_log(path, "sun", LogOptions(zone=DENVER, columns=LogColumns(values=("SWin_Avg",))))
    assert [one.values for one in readings(imported)] == [(812.5,), (813.0,)]
    assert (imported.streams[0].unit, imported.streams[0].quantity) == ("W m-2", "irradiance")
    assert read_table(path, "utf-8").head[:3] == ["TIMESTAMP", "RECORD", "Batt_Min [Volts]"]


def test_radiation_of_a_table_is_what_its_columns_are_called_or_what_was_said(tmp_path: Path) -> None:
    path = written(tmp_path, TOA5)
    sun = LogColumns(values=("SWin_Avg",))
    unknown = read_log(path, "sun", LogOptions(zone=DENVER, columns=sun))
    assert unknown.streams[0].measures == ()
    warned = [text for severity, text in unknown.notes if severity is Severity.WARNING]
    assert any("--measures ghi" in text and "irradiance.measures.sun" in text for text in warned)
    said = read_log(path, "sun", LogOptions(zone=DENVER, columns=sun, measures="ghi"))
    assert said.streams[0].measures == ("ghi",)
    named = written(tmp_path, TOA5.replace("SWin_Avg", "DNI_Avg"))
    imported = read_log(named, "sun", LogOptions(zone=DENVER, columns=LogColumns(values=("DNI_Avg",))))
    assert imported.streams[0].measures == ("dni",)
    assert not any("--measures" in text for _, text in [*said.notes, *imported.notes])


def test_samples_of_a_campbell_table_are_not_told_to_be_means(tmp_path: Path) -> None:
    path = written(tmp_path, TOA5.replace('"Avg"', '"Smp"'))
    imported = read_log(path, "sun", LogOptions(zone=DENVER, columns=LogColumns(values=("SWin_Avg",))))
    assert not any("--offset" in text for _, text in imported.notes)


@pytest.mark.parametrize("text", [HOBO, HOBO.split("\n", 1)[1]], ids=["title", "no title"])
def test_a_hobo_table_says_its_zone_and_counts_fahrenheit(tmp_path: Path, text: str) -> None:
    columns = LogColumns(values=("Temp",))
    imported = read_log(written(tmp_path, text), "bed3", LogOptions(time_format=HOBO_TIME, columns=columns))
    first, second, event = readings(imported)
    assert first.time_ns == 1_778_605_200_000_000_000  # 2026-05-12T17:00:00Z
    assert first.values[0] == pytest.approx(293.15)  # 68 °F are 20 °C
    assert second.values[0] == pytest.approx(294.15)
    assert np.isnan(event.values[0])
    assert imported.streams[0].channels == ("Temp",)


def test_times_with_am_and_pm_are_asked_for_by_an_example_that_fits(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="'05/12/26 10:00:00 AM' is not a time") as caught:
        read_log(written(tmp_path, HOBO), "bed3", LogOptions(columns=LogColumns(values=("Temp",))))
    assert f'--time-format "{HOBO_TIME}"' in (caught.value.fix or "")


def test_thousands_with_a_point_behind_them_are_understood(tmp_path: Path) -> None:
    columns = LogColumns(values=("Intensity",))
    imported = read_log(written(tmp_path, HOBO), "lux", LogOptions(time_format=HOBO_TIME, columns=columns))
    assert [one.values[0] for one in readings(imported)][:2] == [52_356.0, 52_400.0]


def test_a_zone_that_is_given_is_taken_before_that_of_the_table(tmp_path: Path) -> None:
    columns = LogColumns(values=("Temp",))
    imported = read_log(
        written(tmp_path, HOBO), "x", LogOptions(zone=DENVER, time_format=HOBO_TIME, columns=columns)
    )
    assert readings(imported)[0].time_ns == 1_778_601_600_000_000_000  # summer time: 2026-05-12T16:00:00Z


def test_sensors_of_a_hobo_are_called_by_label_or_number(tmp_path: Path) -> None:
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
def test_a_line_separator_in_a_cell_ends_no_row(tmp_path: Path, separator: str) -> None:
    """As pasted into a note from a web page."""
    rows = f"time,T [C],note\n2026-05-12 10:00:00,20.5,wind{separator}picks up\n2026-05-12 10:01:00,20.6,\n"
    table = read_table(written(tmp_path, rows), "utf-8")
    assert [row[1] for row in table.rows] == ["20.5", "20.6"]
