"""Tables of loggers become streams, alone or beside an old session."""

from __future__ import annotations

from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from fieldkit.errors import ConfigError
from fieldkit.samples import Reading
from fieldkit.sessions.exchange.logs import LogColumns, read_log
from fieldkit.sessions.exchange.merged import cut_to, merge
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.writer import SessionWriter
from tests.harness.recording import START_NS, CountedClock, fill, header, same

TOKYO = ZoneInfo("Asia/Tokyo")


def table(tmp_path: Path, text: str, encoding: str = "utf-8") -> Path:
    path = tmp_path / "log.csv"
    path.write_bytes(text.encode(encoding))
    return path


def test_celsius_becomes_kelvin_and_the_offset_is_added(tmp_path: Path) -> None:
    path = table(
        tmp_path, "time,T1 [C],T2 [C],note\n2026/05/12 10:00:00,20.5,,dry\n2026/05/12 10:00:10,21,19,wet\n"
    )
    foreign = read_log(
        path, "logger", zone=TOKYO, time_format="yyyy/mm/dd HH:MM:SS", offset_ns=12_000_000_000
    )
    first, second = (one for one in foreign.samples if isinstance(one, Reading))
    assert first.time_ns == 1_778_547_612_000_000_000  # 2026-05-12T01:00:12Z
    assert first.values[0] == 293.65
    assert np.isnan(first.values[1])
    assert second.values == (294.15, 292.15)
    (info,) = foreign.streams
    assert (info.unit, info.channels, info.rate_hz) == ("K", ("T1", "T2"), 0.1)
    assert "+12 s" in foreign.remarks[0][1]


def test_semicolons_decimal_commas_and_other_encodings(tmp_path: Path) -> None:
    path = table(
        tmp_path,
        "Zeit;Licht (lx);Fühler [°C]\n2026-05-12T01:00:00Z;52300,5;20\n2026-05-12T01:01:00Z;1;2\n",
        "cp1252",
    )
    foreign = read_log(path, "lux", columns=LogColumns(values=("Licht",)), encoding="cp1252")
    assert [one.values for one in foreign.samples if isinstance(one, Reading)] == [(52300.5,), (1.0,)]


@pytest.mark.parametrize(
    ("text", "time_format", "unit"),
    [
        ("Date,Time,T1 [C]\n2026-05-12,10:00:00,20.5\n2026-05-12,10:00:10,21\n", None, ""),
        ("Date,Time,T1\n2026-05-12,10:00:00,20.5\n2026-05-12,10:00:10,21\n", None, "C"),
        ("Datum;Zeit;T1 [°C]\n12.05.2026;10:00:00;20,5\n12.05.2026;10:00:10;21\n", "%d.%m.%Y %H:%M:%S", ""),
    ],
)
def test_date_and_time_of_day_in_two_columns_are_one_time(
    tmp_path: Path, text: str, time_format: str | None, unit: str
) -> None:
    """Layout: HOBO's own option "Separate date and time into two columns" (HOBOware User's Guide)."""
    foreign = read_log(table(tmp_path, text), "logger", zone=TOKYO, time_format=time_format, unit=unit)
    found = [one for one in foreign.samples if isinstance(one, Reading)]
    assert [one.time_ns // 10**9 for one in found] == [1_778_547_600, 1_778_547_610]  # 2026-05-12T01:00:00Z
    assert [one.values for one in found] == [(293.65,), (294.15,)]


@pytest.mark.parametrize(
    ("unit", "cells", "missing"),
    [
        # -9999.9 as in SURFRAD's README, 9999 as in NOAA's format of hourly observations (ISD)
        ("C", ("9999", "-9999.9", "-999.9", "inf", "21"), 4),
        ("lx", ("9999", "-9999", "-999.9", "-inf", "21"), 3),
    ],
)
def test_numbers_that_stand_for_no_value_are_missing(
    tmp_path: Path, unit: str, cells: tuple[str, ...], missing: int
) -> None:
    rows = "".join(f"2026-05-12T01:0{minute}:00Z,{cell}\n" for minute, cell in enumerate(cells))
    foreign = read_log(table(tmp_path, f"time,x [{unit}]\n{rows}"), "logger")
    values = [one.values[0] for one in foreign.samples if isinstance(one, Reading)]
    assert np.isnan(values).sum() == missing
    assert f"{missing} cells stand for no value (like -9999 or inf)" in [text for _, text in foreign.remarks]


def test_columns_of_unknown_units_are_named(tmp_path: Path) -> None:
    path = table(tmp_path, "time,T1 [C],RH [%],P [hPa],note\n2026-05-12T01:00:00Z,3,40,1000,dry\n")
    foreign = read_log(path, "logger")
    assert [
        text for _, text in foreign.remarks if text.startswith("left out for their unit: RH [%], P [hPa];")
    ]
    assert len(read_log(path, "logger", columns=LogColumns(values=("T1",))).remarks) == 1


def test_dates_alone_are_taken_where_each_stands_once(tmp_path: Path) -> None:
    foreign = read_log(table(tmp_path, "date,T1 [C]\n2026-05-12,3\n2026-05-13,4\n"), "logger", zone=TOKYO)
    assert foreign.streams[0].rate_hz == 1 / 86_400


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('time,E [lx]\n2026-05-12T01:00:00Z,"12,345"\n2026-05-12T01:01:00Z,999\n', "'12,345' .* has a comma"),
        ("date,h,T1 [C]\n2026-05-12,10,3\n2026-05-12,11,3\n", "several rows have the date '2026-05-12'"),
        ("", "cannot be read|no table"),
        ("time,T1\n2026-05-12T01:00:00Z,3\n", "no column has a unit"),
        ("time,T1 [C],L [lx]\n2026-05-12T01:00:00Z,3,4\n", "units 'C', 'lx'"),
        ("time,T1 [C]\n2026-05-12 01:00:00,3\n", "no zone"),
        ("time,T1 [C]\nyesterday,3\n", "not a time"),
        ("time,T1 [furlong]\n2026-05-12T01:00:00Z,3\n", "no column has a unit"),
    ],
)
def test_table_that_is_not_understood_is_told(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        read_log(table(tmp_path, text), "logger")


def test_log_that_ran_longer_is_cut_to_the_session(tmp_path: Path) -> None:
    clock = CountedClock()
    writer = SessionWriter(tmp_path / "old.h5", header((24, 32)), clock)
    fill(writer, 20, clock)
    writer.close()
    with open_session(tmp_path / "old.h5") as session:
        start_s = session.start_ns / 1e9
        rows = "".join(f"{start_s + n + 0.01:.3f},{n}\n" for n in range(-10, 11))
        foreign = read_log(table(tmp_path, "time,T1 [C]\n" + rows), "logger")
        cut = cut_to(session, foreign)
        found = [one.values[0] - 273.15 for one in cut.samples if isinstance(one, Reading)]
        # it is twenty milliseconds long: of readings a second apart, two on either side and the one within
        assert found == pytest.approx([-2, -1, 0, 1, 2], abs=1e-9)
        assert "16 samples from before or after" in cut.remarks[-1][1]
        assert merge(session, cut, tmp_path / "new.h5", "log.csv").counts["logger"] == 5


def test_stream_is_added_beside_an_old_session(tmp_path: Path) -> None:
    clock = CountedClock()
    writer = SessionWriter(tmp_path / "old.h5", header((24, 32)), clock)
    appended = fill(writer, 20, clock)
    writer.close()
    before = (tmp_path / "old.h5").read_bytes()
    start_s = START_NS / 1e9 + 5.01
    rows = "".join(f"{start_s + n / 100:.2f},{20 + n}\n" for n in range(2))
    foreign = read_log(table(tmp_path, "time,T1 [C]\n" + rows), "logger")
    with open_session(tmp_path / "old.h5") as session:
        report = merge(session, foreign, tmp_path / "new.h5", "log.csv")
        with pytest.raises(ConfigError, match="already"):
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
