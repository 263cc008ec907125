"""Units and encodings that loggers' tables come in."""

from __future__ import annotations

from datetime import UTC
from pathlib import Path

import pytest

from fieldkit.model.errors import ConfigError
from fieldkit.sessions.formats.logs import LogColumns, LogOptions, read_log


def table(path: Path, text: str, encoding: str = "utf-8") -> Path:
    path.write_bytes(text.encode(encoding))
    return path


@pytest.mark.parametrize(
    ("unit", "cell", "stored", "value"),
    [
        ("klx", "63.986", "lx", 63_986.0),
        ("kilolux", "0.5", "lx", 500.0),
        ("fc", "100", "lx", 1076.3910),  # NIST SP 811, appendix B: 1 fc = 10.763 91 lx
        ("kW/m2", "0.9415", "W m-2", 941.5),
    ],
)
def test_thousands_of_a_unit_and_foot_candles_become_the_streams(
    tmp_path: Path, unit: str, cell: str, stored: str, value: float
) -> None:
    path = table(tmp_path / "log.csv", f"time,dni [{unit}]\n2026-05-12T10:00:00,{cell}\n")
    imported = read_log(path, "log", LogOptions(zone=UTC))
    (reading,) = imported.samples
    assert imported.streams[0].unit == stored
    assert reading.values == pytest.approx((value,), rel=1e-7)


def test_a_table_of_western_windows_asks_for_its_encoding(tmp_path: Path) -> None:
    path = table(tmp_path / "log.csv", "time,T1 [°C]\n2026-05-12T10:00:00,21.5\n", "cp1252")
    with pytest.raises(ConfigError, match="is not in utf-8: byte 0xb0") as caught:
        read_log(path, "log", LogOptions(zone=UTC))
    assert "--encoding cp1252" in (caught.value.fix or "")
    (reading,) = read_log(path, "log", LogOptions(zone=UTC, encoding="cp1252")).samples
    assert reading.values == pytest.approx((294.65,))


def test_an_encoding_that_is_none_is_named(tmp_path: Path) -> None:
    path = table(tmp_path / "log.csv", "time,T1 [C]\n2026-05-12T10:00:00,21.5\n")
    with pytest.raises(ConfigError, match="unknown encoding: klingon") as caught:
        read_log(path, "log", LogOptions(zone=UTC, encoding="klingon"))
    assert "cp1252" in (caught.value.fix or "")


def test_one_import_takes_columns_of_every_unit(tmp_path: Path) -> None:
    text = "time,bed [C],air [F],light [klx],dni [W/m2],wind [m/s]\n"
    rows = "2026-05-12T10:01:00,22.5,-999.9,64.1,,3\n2026-05-12T10:00:00,21.5,68,63.986,850,2\n"
    imported = read_log(table(tmp_path / "log.csv", text + rows), "logger", LogOptions(zone=UTC))
    found = {info.name: (info.quantity, info.unit, info.channels) for info in imported.streams}
    assert found == {
        "logger-temperature": ("temperature", "K", ("bed", "air")),
        "logger-illuminance": ("illuminance", "lx", ("light",)),
        "logger-irradiance": ("irradiance", "W m-2", ("dni",)),
    }
    assert imported.streams[2].measures == ("dni",)
    readings = {name: [one.values for one in imported.samples if one.stream == name] for name in found}
    assert readings["logger-temperature"][0] == pytest.approx((294.65, 293.15))
    assert readings["logger-temperature"][1] == pytest.approx((295.65, float("nan")), nan_ok=True)
    assert readings["logger-illuminance"] == [pytest.approx((63_986.0,)), pytest.approx((64_100.0,))]
    assert readings["logger-irradiance"][0] == (850.0,)
    times = [one.time_ns for one in imported.samples]
    assert times == sorted(times)
    said = [text for _, text in imported.notes]
    assert said[0] == "log.csv: 2 rows"
    assert "1 cells stand for no value (like -9999 or inf)" in said
    assert any("excluded for their unit: wind [m/s]" in text for text in said)


def test_a_column_named_by_hand_in_an_unknown_unit_is_refused(tmp_path: Path) -> None:
    path = table(tmp_path / "log.csv", "time,wind [m/s],T [C]\n2026-05-12T10:00:00,3,21\n")
    with pytest.raises(ConfigError, match=r"column 'wind \[m/s\]' has the unit 'm/s'"):
        read_log(path, "log", LogOptions(zone=UTC, columns=LogColumns(values=("wind",))))
