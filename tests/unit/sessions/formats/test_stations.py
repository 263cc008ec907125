"""What stations measured becomes streams, at the middle of what each value stands for."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.model.samples import Reading, Severity
from fieldkit.results.importing import ImportOptions, read_source
from fieldkit.sessions.formats.jma import is_obsdl, is_radiation_table, read_obsdl, read_radiation_table
from fieldkit.sessions.formats.stations import read_station
from fieldkit.weather import STATIONS
from tests.harness import foreign_files
from tests.harness.logs import notes, readings, values
from tests.harness.next_steps import at
from tests.shared_data import shared


def utc(reading: Reading) -> str:
    return datetime.fromtimestamp(reading.time_ns / 1e9, UTC).isoformat()


def test_a_surfrad_file_gives_its_irradiance_with_what_it_measures(tmp_path):
    """Expected: the values that `foreign_files.surfrad` writes: global 500, direct 900, diffuse 50 W/m2."""
    (tmp_path / "slv16001.dat").write_bytes(foreign_files.surfrad())
    imported = read_station(tmp_path / "slv16001.dat", "slv")
    first = {name: readings(imported, f"slv-{name}")[0].values for name in ("global", "direct", "diffuse")}
    assert first == {"global": (500.0,), "direct": (900.0,), "diffuse": (50.0,)}
    measured = {info.name: info.measures for info in imported.streams}
    assert measured["slv-direct"] == ("dni",)


def test_a_surfrad_day_still_being_written_is_imported_with_a_word(tmp_path):
    (tmp_path / "slv16001.dat").write_bytes(foreign_files.surfrad()[:-20])
    imported = read_station(tmp_path / "slv16001.dat", "slv")
    assert len(readings(imported, "slv-global")) == 2
    assert imported.notes[1][0] is Severity.WARNING


def test_surfrad_day_gives_a_stream_for_each_quantity():
    """Expected: the extremes and the conventions in the README beside the file."""
    imported = read_station(shared("data/weather/slv16001.dat"), "slv")
    assert imported.site == STATIONS["alamosa"]
    units = {info.name: (info.quantity, info.unit) for info in imported.streams}
    assert units["slv-direct"] == ("irradiance", "W m-2")
    assert units["slv-air"] == ("air_temperature", "K")
    assert {info.name: info.measures for info in imported.streams if info.measures} == {
        "slv-direct": ("dni",), "slv-diffuse": ("dhi",), "slv-global": ("ghi",),
        "slv-longwave-down": ("longwave_down",), "slv-longwave-up": ("longwave_up",),
    }  # fmt: skip
    assert len(units) == 8
    direct = readings(imported, "slv-direct")
    assert len(direct) == 1440
    assert max(reading.values[0] for reading in direct) == 1076.1
    assert utc(direct[0]) == "2015-12-31T23:59:30+00:00"


# --- obsdl

HEAD = "ダウンロードした時刻：2024/10/13 09:28:46\r\n\r\n"


def obsdl(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "data.csv"
    path.write_bytes((HEAD + text).encode("cp932"))
    return path


@pytest.mark.parametrize("encoding", ["cp932", "utf-8", "utf-8-sig"])  # as downloaded, or saved again
def test_hourly_sums_become_means_in_the_middle_of_their_hour(tmp_path, encoding):
    path = tmp_path / "data.csv"
    path.write_bytes(foreign_files.obsdl().decode("cp932").encode(encoding))
    assert is_obsdl(path)
    imported = read_obsdl(path, "jma")
    sums = readings(imported, "jma-global")
    assert sums[0].values == (1000.0,)  # 3.6 MJ/m² in an hour
    assert utc(sums[0]) == "2024-06-01T01:30:00+00:00"  # 11 h of Japan is the end of the hour
    assert np.isnan(sums[1].values[0])  # quality 4
    air = readings(imported, "jma-air")
    assert (air[0].values, utc(air[0])) == ((294.65,), "2024-06-01T02:00:00+00:00")
    assert values(imported, "jma-wind") == [(2.5,), (3.0,), (1.0,)]
    times = [reading.time_ns for reading in imported.samples]
    assert times == sorted(times)
    assert [(severity, text.split()[0]) for severity, text in imported.notes[1:]] == [
        (Severity.WARNING, "日射量:"),
        (Severity.WARNING, "風速:"),
    ]
    assert "日射量: 1 " in notes(imported)


def test_date_may_be_split_into_cells(tmp_path):
    """The other choice at the download page; 24 h is the next day's beginning."""
    path = obsdl(tmp_path, ",,,,館野\r\n年,月,日,時,気温(℃)\r\n,,,,\r\n2024,6,1,24,20.0\r\n")
    (air,) = readings(read_obsdl(path, "jma"), "jma-air")
    assert utc(air) == "2024-06-01T15:00:00+00:00"


def test_real_daily_download_is_read():
    """Expected: the rows as they stand in the file."""
    imported = read_obsdl(shared("data/weather/jma_obsdl_kyoto_daily_201406.csv"), "kyoto")
    air = readings(imported, "kyoto-air")
    assert imported.streams[1].channels == ("平均気温", "最高気温", "最低気温")
    assert len(air) == 30
    assert air[0].values == pytest.approx((27.4 + 273.15, 36.0 + 273.15, 19.1 + 273.15))
    assert utc(air[0]) == "2014-06-01T03:00:00+00:00"  # noon in Japan
    assert readings(imported, "kyoto-sea-level-pressure")[1].values == pytest.approx((101240.0,))


@pytest.mark.parametrize("again", ["品質情報", "品質情報.1"])  # the latter of a table saved again by pandas
def test_quality_named_beside_its_item_holds(tmp_path, again):
    """The compact form: quality 8 is normal, 1 missing (JMA obsdl/top/help3)."""
    rows = "2023/10/1 1:00:00,22.9,8,2.0,1\r\n2023/10/1 2:00:00,99.9,1,3.0,8\r\n"
    head = f",試験,試験,試験,試験\r\n年月日時,気温(℃),品質情報,風速(m/s),{again}\r\n"
    imported = read_obsdl(obsdl(tmp_path, head + rows), "jma")
    air = [value for (value,) in values(imported, "jma-air")]
    wind = [value for (value,) in values(imported, "jma-wind")]
    assert air == pytest.approx([296.05, np.nan], nan_ok=True)
    assert wind == pytest.approx([np.nan, 3.0], nan_ok=True)
    assert "気温: 1 " in notes(imported)


def test_two_stations_of_one_name_are_told_apart(tmp_path):
    head = ",白浜,白浜,白浜,白浜\r\n年月日時,気温(℃),気温(℃),気温(℃),気温(℃)\r\n,,品質情報,,品質情報\r\n"
    imported = read_obsdl(obsdl(tmp_path, f"{head}2026/7/5 11:00:00,28.9,8,18.9,8\r\n"), "jma")
    assert imported.streams[0].channels == ("気温", "気温 (2)")
    assert readings(imported, "jma-air")[0].values == pytest.approx((302.05, 292.05))


@pytest.mark.parametrize(
    ("date", "expected"),
    [
        ("2021年1月1日", "2021-01-01T03:00:00+00:00"),  # noon in Japan, of a day
        ("2021年1月1日 13時", "2021-01-01T04:00:00+00:00"),
        ("2021年1月1日24時", "2021-01-01T15:00:00+00:00"),
        ("2021年01月01日 13時10分", "2021-01-01T04:10:00+00:00"),
        ("2021年1月1日 13:10:00", "2021-01-01T04:10:00+00:00"),
    ],
)
@pytest.mark.parametrize("name", ["年月日", ""])
def test_dates_in_words_are_read(tmp_path, date, expected, name):
    name = name and name + "時" * ("日 " in date or "24" in date)
    head = f",甲\r\n{name},平均気温(℃)\r\n"
    (air,) = readings(read_obsdl(obsdl(tmp_path, f"{head}{date},5.0\r\n"), "jma"), "jma-air")
    assert utc(air) == expected


@pytest.mark.parametrize("encoding", ["cp932", "utf-8", "utf-8-sig"])
def test_ten_minute_table_without_a_date_needs_it(tmp_path, encoding):
    path = tmp_path / "ten.csv"
    path.write_bytes("時分,気温(℃)\r\n00:10,22.1\r\n".encode(encoding))
    assert is_obsdl(path)
    with pytest.raises(ConfigError, check=at(path, Argument("date", "2026-07-05"))):
        read_source(path, ImportOptions())
    path.write_bytes("時分,気温(℃)\r\n23:50,22.1\r\n24:00,22.2\r\n".encode(encoding))
    imported = read_source(path, ImportOptions(date="2026-07-05"))
    assert [utc(reading) for reading in readings(imported, "station")] == [
        "2026-07-05T14:50:00+00:00",
        "2026-07-05T15:00:00+00:00",
    ]
    path.write_bytes("時分,気温(℃)\r\n2026-07-05 00:10,22.1\r\n".encode(encoding))
    assert not is_obsdl(path), "with dates it is a table like any other"


def test_marked_values_are_counted(tmp_path):
    """Marks of a download in letters, such as ``)`` and ``]``: the value is not of full quality."""
    rows = "2024/7/1 1:00:00,22.1 )\r\n2024/7/1 2:00:00,///\r\n2024/7/1 3:00:00,\r\n2024/7/1 4:00:00,21\r\n"
    imported = read_obsdl(obsdl(tmp_path, f",甲\r\n年月日時,気温(℃)\r\n{rows}"), "jma")
    assert np.isnan([value for (value,) in values(imported, "jma-air")]).tolist() == [True] * 3 + [False]
    assert ": 2 cells" in imported.notes[1][1]
    assert "'22.1 )'" in imported.notes[1][1]


def test_pressures_of_vapour_and_reduced_to_the_sea_are_not_the_stations(tmp_path):
    """Names of items: JMA obsdl; on Mount Fuji 640 hPa stand against 1015 hPa at the sea."""
    head = ",富士山,富士山,富士山\r\n年月日時,海面気圧(hPa),蒸気圧(hPa),現地気圧(hPa)\r\n"
    imported = read_obsdl(obsdl(tmp_path, f"{head}2024/7/1 12:00:00,1015.0,6.1,640.0\r\n"), "jma")
    channels = sorted(channel for info in imported.streams for channel in info.channels)
    assert channels == ["海面気圧", "現地気圧"]
    assert readings(imported, "jma-pressure")[0].values == pytest.approx((64_000.0,))
    assert readings(imported, "jma-sea-level-pressure")[0].values == pytest.approx((101_500.0,))
    quantities = {info.name: info.quantity for info in imported.streams}
    assert quantities["jma-sea-level-pressure"] == "air_pressure_at_mean_sea_level"  # CF standard name


@pytest.mark.parametrize("date", ["2024/7/1", "2024,7,1"])
def test_sunshine_hours_before_the_sums_of_days_do_not_make_them_hourly(tmp_path, date):
    """Layout: JMA obsdl/top/help3; 日照時間 (sunshine duration) has the character of an hour in its name."""
    skip, names = ("", "年月日") if "/" in date else (",,", "年,月,日")
    head = f"{skip},東京,東京\r\n{names},日照時間(時間),合計全天日射量(MJ/㎡)\r\n"
    (sun,) = readings(read_obsdl(obsdl(tmp_path, f"{head}{date},5.0,21.6\r\n"), "jma"), "jma-global")
    assert sun.values == pytest.approx((250.0,))  # 21.6 MJ/m² in 86 400 s
    assert utc(sun) == "2024-07-01T03:00:00+00:00"  # noon in Japan


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("", "年"),
        ("集計開始,集計終了,京都\r\n年月日,年月日,気温(℃)\r\n2024/7/1,2024/7/5,25\r\n", "時別値"),
        ("集計開始,,,集計終了,,,京都\r\n年,月,日,年,月,日,気温(℃)\r\n2024,7,1,2024,7,5,25\r\n", "時別値"),
        ("2014/6/1,33\r\n", "年"),
        (",京都\r\n年月日,平均気温(℃)\r\n", "hourly"),
        (",京都\r\n年月日,降水量の合計(mm)\r\n2014/6/1,0\r\n", "日射量"),
        (",京都\r\n年月日時,気温(℃)\r\n2014/13/1 1:00:00,0\r\n", "month"),
    ],
)
def test_downloads_without_what_is_needed_are_refused(tmp_path, text, value):
    with pytest.raises(ConfigError, match=value, check=at(tmp_path / "data.csv")):
        read_obsdl(obsdl(tmp_path, text), "jma")


# --- radiation tables


def table(tmp_path: Path, rows: list[tuple[int, list[str], str]]) -> Path:
    path = tmp_path / "DR202406_tat.txt"
    path.write_bytes(foreign_files.radiation_table(rows))
    return path


def test_tables_hold_hourly_sums_without_a_decimal_point(tmp_path):
    hours = ["0"] * 10 + ["324", "XXX", "180"] + ["0"] * 11
    path = table(tmp_path, [(1, hours, "504]"), (2, ["XXX"] * 24, "XXXX")])
    assert is_radiation_table(path)
    imported = read_radiation_table(path, "tat")
    direct = readings(imported, "tat-direct")
    assert imported.streams[0].measures == ("dni",)
    assert len(direct) == 48
    assert direct[10].values == pytest.approx((900.0,))  # 3.24 MJ/m² from 10 to 11 h
    assert utc(direct[10]) == "2024-06-01T01:30:00+00:00"
    assert np.isnan(direct[11].values[0])
    assert np.isnan([reading.values[0] for reading in direct[24:]]).all()


@pytest.mark.parametrize(
    ("rows", "value"),
    [
        ([], "rows"),
        ([(2, ["0"] * 24, "0")], "rows"),
        ([(day, ["0"] * 24, "0") for day in range(1, 32)], "31 days.* 2024-06"),
        ([(1, ["0"] * 23, "0")], "24 hours"),
        ([(1, ["100"] * 24, "1200")], "day 1 "),
    ],
)
def test_tables_laid_out_otherwise_are_refused(tmp_path, rows, value):
    path = table(tmp_path, rows)
    with pytest.raises(ConfigError, match=value, check=at(path)):
        read_radiation_table(path, "tat")
