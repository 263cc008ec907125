import subprocess
import sys
import warnings
from importlib import resources

import numpy as np
import pytest

from fieldkit import weather
from fieldkit.model.errors import ConfigError
from tests.shared_data import shared

SURFRAD = "data/weather/slv16001.dat"


@pytest.fixture(scope="module")
def day() -> weather.Weather:
    return weather.packaged()


def test_packaged_day_has_every_minute_stamped_in_its_middle(day):
    assert len(day.time_ns) == 1440
    assert np.datetime64(int(day.time_ns[0]), "ns") == np.datetime64("2015-12-31T23:59:30")
    assert np.all(np.diff(day.time_ns) == 60_000_000_000)


def test_packaged_day_is_west_of_greenwich(day):
    assert day.site.longitude_deg == -105.92


def test_packaged_day_is_the_clear_one_the_station_saw(day):
    """Extremes as NOAA's file has them: 1076.1 W/m² direct, -22.9 °C at night."""
    assert day.dni_w_m2.max() == 1076.1
    assert day.air_temperature_k.min() == pytest.approx(273.15 - 22.9)


def test_direct_and_diffuse_add_up_to_the_measured_global(day):
    """The three instruments are separate; BSRN accepts 8 % below 75 degrees of zenith."""
    from fieldkit.physics.sun import sun_vectors

    cos_zenith = sun_vectors(day.time_ns, day.site)[:, 2]
    high = cos_zenith > np.cos(np.radians(75.0))
    closure = day.ghi_w_m2[high] / (day.dni_w_m2[high] * cos_zenith[high] + day.dhi_w_m2[high])
    assert np.abs(closure - 1.0).max() < 0.08


def test_command_makes_the_packaged_table_from_the_file_of_noaa(tmp_path):
    made = tmp_path / "table.csv"
    subprocess.run(
        [sys.executable, "-m", "fieldkit.weather", shared(SURFRAD), "--station", "alamosa", "--out", made],
        check=True,
    )
    kept = resources.files("fieldkit") / "data" / weather.PACKAGED
    assert made.read_text() == kept.read_text()


def test_reader_agrees_with_pvlib():
    pvlib = pytest.importorskip("pvlib")
    path = shared(SURFRAD)
    ours = weather.read_surfrad(path, "alamosa")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # pvlib still asks pandas for what pandas is about to drop
        theirs, _ = pvlib.iotools.read_surfrad(path)
    names = {"dni_w_m2": "dni", "dhi_w_m2": "dhi", "longwave_down_w_m2": "dw_ir", "wind_m_s": "wind_speed"}
    for mine, name in names.items():
        np.testing.assert_array_equal(getattr(ours, mine), theirs[name].to_numpy())
    stamps = theirs.index.tz_localize(None).to_numpy().astype("datetime64[ns]").astype(np.int64)
    np.testing.assert_array_equal(ours.time_ns + 30_000_000_000, stamps)


def test_station_whose_header_has_the_right_sign_is_read_too():
    """Table Mountain writes -105.237 where Alamosa writes +105.92; that day was overcast."""
    day = weather.read_surfrad(shared("data/weather/tbl17005.dat"), "boulder")
    assert day.site.longitude_deg == -105.237
    assert np.nanmax(day.dni_w_m2) < 400.0
    assert np.nanmax(day.longwave_up_w_m2) < 330.0, "snow"


def test_bad_values_become_nan(tmp_path):
    lines = shared(SURFRAD).read_text().splitlines()
    words = lines[2].split()
    words[12:14] = "-9999.9", "1"  # the direct beam of the first minute
    path = tmp_path / "day.dat"
    path.write_text("\n".join([*lines[:2], " ".join(words), *lines[3:5]]))
    assert np.isnan(weather.read_surfrad(path, "alamosa").dni_w_m2).tolist() == [True, False, False]


def test_file_of_another_station_is_refused():
    with pytest.raises(ConfigError, match="not at bondville"):
        weather.read_surfrad(shared(SURFRAD), "bondville")


def test_file_that_is_no_surfrad_file_is_refused(tmp_path):
    path = tmp_path / "day.dat"
    path.write_text("hello\nworld\n")
    with pytest.raises(ConfigError, match="not a SURFRAD"):
        weather.read_surfrad(path, "alamosa")


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
    day = weather.read_surfrad(surfrad_file(tmp_path / "day.dat"), "alamosa")
    found = (
        day.ghi_w_m2,
        day.dni_w_m2,
        day.dhi_w_m2,
        day.longwave_down_w_m2,
        day.longwave_up_w_m2,
        day.wind_m_s,
    )
    assert [column[0] for column in found] == [100.0, 102.0, 103.0, 104.0, 107.0, 117.0]
    assert day.air_temperature_k[0] == pytest.approx(115.0 + 273.15)
    assert day.pressure_pa[0] == pytest.approx(119.0 * 100.0)  # hPa


@pytest.mark.parametrize("values", [{2: "850.0"}, {2: "-9999.9"}])
def test_values_that_the_station_calls_bad_or_lacks_are_not_measured(tmp_path, values):
    bad = (2,) if values[2] == "850.0" else ()
    day = weather.read_surfrad(surfrad_file(tmp_path / "day.dat", values, bad), "alamosa")
    assert np.isnan(day.dni_w_m2).all()
    assert np.isfinite(day.dhi_w_m2).all()


def test_a_file_of_another_place_is_refused(tmp_path):
    north = surfrad_file(tmp_path / "day.dat")
    north.write_text(north.read_text().replace("37.70  105.92", "48.31  105.92"))
    with pytest.raises(ConfigError, match="not at alamosa"):
        weather.read_surfrad(north, "alamosa")
