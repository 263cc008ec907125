import subprocess
import sys
import warnings
from importlib import resources

import numpy as np
import pytest

from fieldkit import weather
from fieldkit.errors import ConfigError
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
    assert day.dni.max() == 1076.1
    assert day.air_temperature_k.min() == pytest.approx(273.15 - 22.9)


def test_direct_and_diffuse_add_up_to_the_measured_global(day):
    """The three instruments are separate; BSRN accepts 8 % below 75 degrees of zenith."""
    from fieldkit.physics.sun import sun_vectors

    cos_zenith = sun_vectors(day.time_ns, day.site)[:, 2]
    high = cos_zenith > np.cos(np.radians(75.0))
    closure = day.ghi[high] / (day.dni[high] * cos_zenith[high] + day.dhi[high])
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
    names = {"dni": "dni", "dhi": "dhi", "longwave_down_w_m2": "dw_ir", "wind_m_s": "wind_speed"}
    for mine, name in names.items():
        np.testing.assert_array_equal(getattr(ours, mine), theirs[name].to_numpy())
    stamps = theirs.index.tz_localize(None).to_numpy().astype("datetime64[ns]").astype(np.int64)
    np.testing.assert_array_equal(ours.time_ns + 30_000_000_000, stamps)


def test_station_whose_header_has_the_right_sign_is_read_too():
    """Table Mountain writes -105.237 where Alamosa writes +105.92; that day was overcast."""
    day = weather.read_surfrad(shared("data/weather/tbl17005.dat"), "boulder")
    assert day.site.longitude_deg == -105.237
    assert np.nanmax(day.dni) < 400.0
    assert np.nanmax(day.longwave_up_w_m2) < 330.0, "snow"


def test_bad_values_become_nan(tmp_path):
    lines = shared(SURFRAD).read_text().splitlines()
    words = lines[2].split()
    words[12:14] = "-9999.9", "1"  # the direct beam of the first minute
    path = tmp_path / "day.dat"
    path.write_text("\n".join([*lines[:2], " ".join(words), *lines[3:5]]))
    assert np.isnan(weather.read_surfrad(path, "alamosa").dni).tolist() == [True, False, False]


def test_file_of_another_station_is_refused():
    with pytest.raises(ConfigError, match="not at bondville"):
        weather.read_surfrad(shared(SURFRAD), "bondville")


def test_file_that_is_no_surfrad_file_is_refused(tmp_path):
    path = tmp_path / "day.dat"
    path.write_text("hello\nworld\n")
    with pytest.raises(ConfigError, match="not a SURFRAD"):
        weather.read_surfrad(path, "alamosa")
