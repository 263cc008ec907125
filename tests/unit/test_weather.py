import gzip
import subprocess
import sys
import warnings
from importlib import resources
from pathlib import Path

import numpy as np
import pvlib
import pytest

from fieldkit import weather
from fieldkit.model.errors import ConfigError
from fieldkit.weather import is_station_file, read_station_file
from tests.harness import foreign_files
from tests.harness.next_steps import at
from tests.shared_data import shared

SURFRAD = "data/weather/slv16001.dat"


@pytest.fixture(scope="module")
def day():
    return weather.packaged_day()


def test_packaged_day_is_the_clear_one_the_station_saw_stamped_in_the_middle_of_minutes(day):
    """Extremes as NOAA's file has them: 1076.1 W/m² direct, -22.9 °C at night."""
    assert day.site.longitude_deg == -105.92  # west of Greenwich
    assert day.dni_w_m2.max() == 1076.1
    assert day.air_temperature_k.min() == pytest.approx(273.15 - 22.9)
    assert len(day.time_ns) == 1440
    assert np.datetime64(int(day.time_ns[0]), "ns") == np.datetime64("2015-12-31T23:59:30")
    assert np.all(np.diff(day.time_ns) == 60_000_000_000)


def test_command_makes_the_packaged_table_from_the_file_of_noaa(tmp_path):
    made = tmp_path / "table.csv"
    subprocess.run([sys.executable, "-m", "fieldkit.weather", shared(SURFRAD), "--out", made], check=True)
    kept = resources.files("fieldkit") / "data" / weather.PACKAGED
    assert made.read_text() == kept.read_text()


@pytest.mark.parametrize("name", ["a.epw", "tmy3.csv", "nsrdb.csv", "pvgis.csv", "cams.csv"])
def test_services_mean_the_same_hours_by_their_own_rules(tmp_path, name):
    """EnergyPlus and TMY3 name the end of an hour, CAMS its beginning, the other two a moment; UTC-7."""
    (tmp_path / name).write_bytes(foreign_files.modelled_weather()[name])
    assert is_station_file(tmp_path / name)
    read = read_station_file(tmp_path / name)
    hour, ghi, dni, dhi, celsius = np.array(foreign_files.HOURS).T
    middles = np.datetime64("2020-06-11T06:30", "ns") + hour.astype(int) * np.timedelta64(1, "h")
    assert np.array_equal(read.time_ns, middles.astype(np.int64))
    assert (read.site.latitude_deg, read.site.longitude_deg, read.site.elevation_m) == (40.0, -105.0, 1600.0)
    assert read.ghi_w_m2 == pytest.approx(ghi)
    assert read.dhi_w_m2 == pytest.approx(dhi)
    if name != "pvgis.csv":  # which has the beam on the horizontal
        assert read.dni_w_m2 == pytest.approx(dni)
    if name != "cams.csv":
        assert read.air_temperature_k == pytest.approx(celsius + 273.15)
        assert read.wind_m_s == pytest.approx(2.5)
    if name not in ("cams.csv", "pvgis.csv"):
        assert read.pressure_pa == pytest.approx(84_000.0)


def test_solrad_stamps_the_end_of_a_minute_and_marks_what_is_bad(tmp_path):
    (tmp_path / "abq20163.dat").write_bytes(foreign_files.solrad())
    read = read_station_file(tmp_path / "abq20163.dat")
    assert np.datetime64(int(read.time_ns[0]), "ns") == np.datetime64("2020-06-11T19:00:30")
    assert read.dni_w_m2 == pytest.approx([901.0, np.nan, 903.0], nan_ok=True)
    assert read.ghi_w_m2 == pytest.approx([1001.0, 1002.0, 1003.0])


def test_irradiance_on_a_tilted_plane_is_left_out_and_a_typical_year_named(tmp_path):
    data = foreign_files.modelled_weather()
    (tmp_path / "a.csv").write_bytes(data["pvgis.csv"].replace(b"Slope: 0", b"Slope: 35"))
    (tmp_path / "b.csv").write_bytes(
        data["tmy3.csv"].replace(b"2020,11", b"2019,11").replace(b"2020,09", b"2021,09")
    )
    tilted, typical = (read_station_file(tmp_path / name) for name in ("a.csv", "b.csv"))
    assert np.isnan(tilted.ghi_w_m2).all()
    assert len(tilted.notes) == len(typical.notes) == 1
    (tmp_path / "c.csv").write_bytes(data["nsrdb.csv"] + data["nsrdb.csv"].splitlines(keepends=True)[-1])
    with pytest.raises(ConfigError, match="comes twice", check=at(tmp_path / "c.csv")):
        read_station_file(tmp_path / "c.csv")


def test_reader_agrees_with_pvlib():
    path = shared(SURFRAD)
    ours = weather.read_surfrad(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # pvlib still asks pandas for what pandas is about to drop
        theirs, _ = pvlib.iotools.read_surfrad(path)
    names = {"dni_w_m2": "dni", "dhi_w_m2": "dhi", "longwave_down_w_m2": "dw_ir", "wind_m_s": "wind_speed"}
    for mine, name in names.items():
        np.testing.assert_array_equal(getattr(ours, mine), theirs[name].to_numpy())
    stamps = theirs.index.tz_localize(None).to_numpy().astype("datetime64[ns]").astype(np.int64)
    np.testing.assert_array_equal(ours.time_ns + 30_000_000_000, stamps)


def surfrad_file(path, values=(), bad=()):
    """A SURFRAD file of three minutes: pair n reads 100 + n unless given; `bad` pairs have quality 1."""
    numbers = {**{n: f"{100 + n}.0" for n in range(20)}, **dict(values)}
    pairs = " ".join(f"{numbers[n]} {int(n in bad)}" for n in range(20))
    rows = [f"2016 1 1 1 17 {minute} 17.{minute} 60.0 {pairs}" for minute in (1, 2, 3)]
    head = [" Alamosa", "   37.70  105.92 2317 m version 1"]
    path.write_text("\n".join([*head, *rows]) + "\n")
    return path


def test_columns_are_where_the_networks_readme_has_them(tmp_path):
    """README of data/radiation/surfrad at NOAA: pairs of value and quality after eight columns."""
    day = weather.read_surfrad(surfrad_file(tmp_path / "day.dat"))
    light = [
        getattr(day, f"{name}_w_m2")[0] for name in ("ghi", "dni", "dhi", "longwave_down", "longwave_up")
    ]
    assert [*light, day.wind_m_s[0]] == [100.0, 102.0, 103.0, 104.0, 107.0, 117.0]
    assert day.air_temperature_k[0] == pytest.approx(115.0 + 273.15)
    assert day.pressure_pa[0] == pytest.approx(119.0 * 100.0)  # hPa


@pytest.mark.parametrize("values", [{2: "850.0"}, {2: "-9999.9"}])
def test_values_that_the_station_calls_bad_or_lacks_are_not_measured(tmp_path, values):
    bad = (2,) if values[2] == "850.0" else ()
    day = weather.read_surfrad(surfrad_file(tmp_path / "day.dat", values, bad))
    assert np.isnan(day.dni_w_m2).all()
    assert np.isfinite(day.dhi_w_m2).all()


def test_a_file_of_another_place_is_refused(tmp_path):
    north = surfrad_file(tmp_path / "day.dat")
    north.write_text(north.read_text().replace("37.70  105.92", "48.31  105.92"))
    with pytest.raises(ConfigError, match=r"(?s)day\.dat.*alamosa"):
        weather.read_surfrad(north)


def row(text: str) -> str:
    """A row of Bondville at 18 h of 2000-06-30, whose global irradiance is its minute."""
    return f" {text} 18.0 20.0" + f" {float(text.split()[-1])} 0" + " 100.0 0" * 19 + "\n"


HEAD = " Bondville\n   40.05 -88.37  213 m version 1\n"
MINUTES = [row(f"2000 182 6 30 18 {minute}") for minute in (0, 3, 6)]


@pytest.mark.parametrize("cut", [1, 2, 3, 7, 100, len(MINUTES[0]) - 2])
def test_a_day_that_is_still_being_written_is_read_up_to_its_last_whole_row(tmp_path, cut):
    path = tmp_path / "bon00182.dat"
    path.write_text((HEAD + "".join(MINUTES))[:-cut])
    day = read_station_file(path)
    if cut == 1:  # nothing but the end of the line
        assert day.ghi_w_m2.tolist() == [0.0, 3.0, 6.0]
        assert day.notes == ()
    else:
        assert day.ghi_w_m2.tolist() == [0.0, 3.0]
        (note,) = day.notes
        assert note.startswith("bon00182.dat: ")
        assert "2 whole" in note


def test_a_row_cut_off_within_the_day_is_named(tmp_path):
    (tmp_path / "a.dat").write_text(HEAD + MINUTES[0] + MINUTES[1][:-9] + "\n" + MINUTES[2])
    with pytest.raises(ConfigError, match=r"row 2 .* 46 .* 48"):
        read_station_file(tmp_path / "a.dat")


def test_minutes_that_stand_twice_or_late_are_read_once_and_in_order(tmp_path):
    (tmp_path / "a.dat").write_text(HEAD + "".join(MINUTES[n] for n in (0, 2, 1, 2)))
    day = read_station_file(tmp_path / "a.dat")
    assert day.ghi_w_m2.tolist() == [0.0, 3.0, 6.0]
    (note,) = day.notes
    assert note.startswith("a.dat: 1 rows")


@pytest.mark.parametrize("year", ["00", "24", "99", "1899", "1960", "2262", "9999"])
def test_a_year_that_no_network_has_is_refused(tmp_path, year):
    """Years of two digits used to become 1754 or so, where nanoseconds of 64 bits overflow."""
    (tmp_path / "a.dat").write_text(HEAD + row(f"{year} 182 6 30 18 0"))
    with pytest.raises(ConfigError, match=rf"year {int(year)} .* 1992"):
        read_station_file(tmp_path / "a.dat")
    (tmp_path / "b.dat").write_bytes(foreign_files.bsrn(month=f" 6 {year:>4}"))
    with pytest.raises(ConfigError, match="damaged"):
        read_station_file(tmp_path / "b.dat")


def test_a_bsrn_month_cut_off_within_a_number_does_not_use_it(tmp_path):
    data = foreign_files.bsrn()
    for cut in range(1, 60):
        (tmp_path / "tat0624.dat").write_bytes(data[:-cut])
        month = read_station_file(tmp_path / "tat0624.dat")
        assert set(month.dhi_w_m2[np.isfinite(month.dhi_w_m2)]) == {90.0}
        assert set(month.longwave_down_w_m2[np.isfinite(month.longwave_down_w_m2)]) == {350.0}
        notes = ("tat0624.dat: its last line is cut off and was excluded",)
        assert month.notes == (notes if cut > 1 else ())


# --- station files are told apart by what stands in them, and read as their networks describe them


def bsrn(path: Path, *, longwave_up: bool = False) -> Path:
    path.write_bytes(foreign_files.bsrn(longwave_up=longwave_up))
    return path


# --- station files are identified by their content
@pytest.mark.parametrize("packed", [False, True])
def test_bsrn_month_is_read_by_pvlib_and_stamped_in_the_middle(tmp_path, packed):
    path = bsrn(tmp_path / "tat0624.dat")
    if packed:
        plain, path = path, tmp_path / "tat0624.dat.gz"
        path.write_bytes(gzip.compress(plain.read_bytes()))
    assert is_station_file(path)
    month = read_station_file(path)
    assert month.site.latitude_deg == pytest.approx(36.058)  # the file counts from the south pole
    assert month.site.longitude_deg == pytest.approx(140.126)  # and from 180 degrees west
    assert month.site.timezone == "Etc/GMT-9"  # nine hours ahead: the file does not say
    # labels are the beginnings of minutes (GCOS-174), so the first middle is half past midnight's minute
    assert np.datetime64(int(month.time_ns[0]), "ns") == np.datetime64("2024-06-01T00:00:30")
    assert np.isnan(month.dni_w_m2).tolist() == [False, True, False]
    assert (month.ghi_w_m2[0], month.dhi_w_m2[0], month.longwave_down_w_m2[0]) == (600.0, 90.0, 350.0)
    assert (month.air_temperature_k[0], month.pressure_pa[0]) == (pytest.approx(294.65), 101200.0)
    assert np.isnan(month.wind_m_s).all()


def test_bsrn_minutes_that_only_the_further_record_has_stand_at_their_time(tmp_path):
    """Layout: GCOS-174, records 0100 and 0300, which need not have the same minutes."""
    lines = foreign_files.bsrn(longwave_up=True).decode().splitlines()
    basic = lines.index("*C0100")
    (tmp_path / "gap.dat").write_text("\n".join(lines[: basic + 3] + lines[basic + 5 :]))  # without minute 1
    month = read_station_file(tmp_path / "gap.dat")
    assert (np.diff(month.time_ns) == 60_000_000_000).all()
    assert np.isnan(month.ghi_w_m2).tolist() == [False, True, False]
    assert month.longwave_up_w_m2.tolist() == [450.0, 451.0, 452.0]


def test_bsrn_minute_that_stands_twice_counts_once(tmp_path):
    minutes = foreign_files.BSRN_MINUTES
    (tmp_path / "twice.dat").write_bytes(foreign_files.bsrn([*minutes[:2], minutes[1], minutes[2]]))
    assert read_station_file(tmp_path / "twice.dat").time_ns.size == len(minutes)


def test_means_of_three_minutes_are_stamped_in_their_middle(tmp_path):
    """SURFRAD README: stamps are the ends of averages, of three minutes before 2009; BSRN labels starts."""
    lines = foreign_files.surfrad().decode().splitlines()
    stamps = [(f" 19 {n:2} 19.{n:03}", f" 19 {3 * n:2} 19.{5 * n:02}") for n in range(len(lines) - 2)]
    rows = [line.replace(*stamp) for line, stamp in zip(lines[2:], stamps, strict=True)]
    (tmp_path / "slv08001.dat").write_text("\n".join([*lines[:2], *rows]))
    day = read_station_file(tmp_path / "slv08001.dat")
    middles = np.array(
        ["2016-01-01T18:58:30", "2016-01-01T19:01:30", "2016-01-01T19:04:30"], "datetime64[ns]"
    )
    assert np.array_equal(day.time_ns, middles.astype(np.int64))
    minutes = [(day, 3 * minute, *values) for day, minute, *values in foreign_files.BSRN_MINUTES]
    (tmp_path / "tat0624.dat").write_bytes(foreign_files.bsrn(minutes))
    first = read_station_file(tmp_path / "tat0624.dat").time_ns[0]
    assert np.datetime64(int(first), "ns") == np.datetime64("2024-06-01T00:01:30")


def test_bsrn_long_wave_from_the_ground_is_read_where_it_is_there(tmp_path):
    assert np.isnan(read_station_file(bsrn(tmp_path / "a.dat")).longwave_up_w_m2).all()
    month = read_station_file(bsrn(tmp_path / "b.dat", longwave_up=True))
    assert month.longwave_up_w_m2.tolist() == [450.0, 451.0, 452.0]


@pytest.mark.parametrize(("name", "station"), [("slv16001.dat", "alamosa"), ("tbl17005.dat", "boulder")])
def test_surfrad_station_is_identified_by_its_place(name, station):
    path = shared(f"data/weather/{name}")
    assert is_station_file(path)
    day = read_station_file(path)
    assert day.site == weather.STATIONS[station]
    assert np.array_equal(day.dni_w_m2, weather.read_surfrad(path).dni_w_m2, equal_nan=True)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "not a SURFRAD daily file"),
        (b"Somewhere\n 10.0 20.0 5 m version 1\n", "unknown SURFRAD station"),
        (b"Alamosa\n 37.70 105.92 2317 m version 1\n2016 1 99 99 0 0 0 0" + b" 1.0 0" * 20, "damaged"),
        (b"Alamosa\n 37.70 105.92 2317 m version 1\n2016 1 1 1", "not a SURFRAD daily file"),
        (b"*U0001\n 16  6 2024  1\n", "damaged"),
        (gzip.compress(foreign_files.surfrad(), mtime=0), "compressed"),
        (gzip.compress(b"*U0001\n 16  6 2024  1\n", mtime=0)[:-9], "damaged"),
    ],
)
def test_damaged_and_other_files_are_refused(tmp_path, content, words):
    path = tmp_path / "a.dat"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=words) as caught:
        read_station_file(path)
    assert caught.value.fix


def alamosa_as_bsrn(path: Path) -> Path:
    """The packaged day, 2016-01-01 UTC, in BSRN's whole watts, without the row that ends at midnight."""
    day = weather.packaged_day()
    labels = (day.time_ns[1:] - 30_000_000_000) // 60_000_000_000 % 1440
    columns = (day.ghi_w_m2, day.dni_w_m2, day.dhi_w_m2, day.longwave_down_w_m2)
    rows = zip(
        np.ones(1439), labels, *(np.rint(column[1:]) for column in columns),
        day.air_temperature_k[1:] - 273.15, day.pressure_pa[1:] / 100.0, strict=True,
    )  # fmt: skip
    place = (day.site.latitude_deg, day.site.longitude_deg, 2317)
    path.write_bytes(foreign_files.bsrn(list(rows), month=" 1 2016", place=place))
    return path


def test_bsrn_serves_the_calibration_and_not_the_scene_for_it_has_no_wind(tmp_path):
    from fieldkit.config import load_config
    from fieldkit.config.template import SIMULATED, campaign_toml
    from fieldkit.recording.simulated_scene import measured_weather
    from fieldkit.simulation import MeasuredSky

    (tmp_path / "fieldkit.toml").write_text(campaign_toml(SIMULATED))
    config = load_config(tmp_path / "fieldkit.toml")
    alamosa_as_bsrn(tmp_path / "ala0116.dat")
    found = measured_weather(config, "ala0116.dat")
    with pytest.raises(ConfigError, match="wind_m_s"):
        MeasuredSky(found).sky_state(found.time_ns[:3], np.ones(3), found.site)
    bsrn(tmp_path / "tat0624.dat")
    with pytest.raises(ConfigError, match=r"36\.058, 140\.126"):
        measured_weather(config, "tat0624.dat")
