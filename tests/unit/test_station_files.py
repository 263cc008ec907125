"""Station files are told apart by what stands in them, and read as their networks describe them."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from fieldkit import weather
from fieldkit.errors import ConfigError
from fieldkit.station_files import is_station_file, read_station_file
from tests.harness import foreign_files
from tests.shared_data import shared


def bsrn(path: Path, *, longwave_up: bool = False) -> Path:
    path.write_bytes(foreign_files.bsrn(longwave_up=longwave_up))
    return path


@pytest.mark.parametrize("packed", [False, True])
def test_bsrn_month_is_read_by_pvlib_and_stamped_in_the_middle(tmp_path: Path, packed: bool) -> None:
    pytest.importorskip("pvlib")
    path = bsrn(tmp_path / "tat0624.dat")
    if packed:
        plain, path = path, tmp_path / "tat0624.dat.gz"
        path.write_bytes(gzip.compress(plain.read_bytes()))
    assert is_station_file(path)
    month = read_station_file(path)
    assert month.site.latitude_deg == pytest.approx(36.058)  # the file counts from the south pole
    assert month.site.longitude_deg == pytest.approx(140.126)  # and from 180 degrees west
    # labels are the beginnings of minutes (GCOS-174), so the first middle is half past midnight's minute
    assert np.datetime64(int(month.time_ns[0]), "ns") == np.datetime64("2024-06-01T00:00:30")
    assert np.isnan(month.dni).tolist() == [False, True, False]
    assert (month.ghi[0], month.dhi[0], month.longwave_down_w_m2[0]) == (600.0, 90.0, 350.0)
    assert (month.air_temperature_k[0], month.pressure_pa[0]) == (pytest.approx(294.65), 101200.0)
    assert np.isnan(month.wind_m_s).all()


def test_bsrn_long_wave_from_the_ground_is_read_where_it_is_there(tmp_path: Path) -> None:
    pytest.importorskip("pvlib")
    assert np.isnan(read_station_file(bsrn(tmp_path / "a.dat")).longwave_up_w_m2).all()
    month = read_station_file(bsrn(tmp_path / "b.dat", longwave_up=True))
    assert month.longwave_up_w_m2.tolist() == [450.0, 451.0, 452.0]


@pytest.mark.parametrize(("name", "station"), [("slv16001.dat", "alamosa"), ("tbl17005.dat", "boulder")])
def test_surfrad_station_is_told_by_its_place(name: str, station: str) -> None:
    path = shared(f"data/weather/{name}")
    assert is_station_file(path)
    day = read_station_file(path)
    assert day.site == weather.STATIONS[station]
    assert np.array_equal(day.dni, weather.read_surfrad(path, station).dni, equal_nan=True)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "not a SURFRAD daily file"),
        (b"Somewhere\n 10.0 20.0 5 m version 1\n", "no SURFRAD station known here"),
        (b"Alamosa\n 37.70 105.92 2317 m version 1\n2016 1 99 99 0 0 0 0" + b" 1.0 0" * 20, "is damaged"),
        (b"Alamosa\n 37.70 105.92 2317 m version 1\n2016 1 1 1", "not a SURFRAD daily file"),
        (b"*U0001\n 16  6 2024  1\n", "is damaged"),
        (gzip.compress(b"*U0001\n 16  6 2024  1\n")[:-9], "is damaged"),
    ],
)  # fmt: skip
def test_damaged_and_other_files_are_told(tmp_path: Path, content: bytes, words: str) -> None:
    pytest.importorskip("pvlib")
    path = tmp_path / "a.dat"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=words) as caught:
        read_station_file(path)
    assert caught.value.fix
