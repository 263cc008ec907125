"""Tables are found in files as loggers write them: what parts the columns, header, units, time, zone."""

import codecs
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from tests.harness import logs
from tests.harness.next_steps import at, steps

NOON_S = int(datetime(2026, 6, 11, 12, tzinfo=UTC).timestamp())


def readings(tmp_path: Path, text: str | bytes, **options: Any) -> list[tuple[float, float]]:
    """Seconds after noon and the first channel's value as it was written, of temperatures in °C."""
    imported = logs.read(tmp_path, text, **options)
    shift = 273.15 if imported.streams[0].unit == "K" else 0.0
    return [
        ((reading.time_ns - NOON_S * 10**9) / 1e9, pytest.approx(reading.values[0] - shift))
        for reading in logs.readings(imported, imported.streams[0].name)
    ]


TWO_ROWS = [(0, 20.5), (60, 21.5)]
ROWS = "2026-06-11 12:00:00,20.5\n2026-06-11 12:01:00,21.5\n"


@pytest.mark.parametrize(
    "text",
    [
        f"# logger 5, north bed\n# read out 2026-06-12 08:00 by hand\ntime,T [C]\n{ROWS}",
        f"Device,ABC\nSerial,123\n\ntime,T [C]\n{ROWS}",
        f"time,T\nyyyy-mm-dd hh:mm:ss,degC\n{ROWS}",
        f"Model,X\ntime,T\n,°C\n{ROWS}",
        f"time,T\n[UTC],[degC]\n{ROWS}",
        f"time,T [C]\n{ROWS}End of data\n",
        f",T [C]\n{ROWS}",
        "sep=;\ntime;T [C]\n2026-06-11 12:00:00;20,5\n2026-06-11 12:01:00;21,5\n",
        "DATE       TIME      T_C   note\n2026-06-11 12:00:00  20.5   a\n2026-06-11 12:01:00  21.5   b\n",
        "time\tT [C]\tnote\n2026-06-11 12:00:00\t20,5\ta, b\n2026-06-11 12:01:00\t21,5\tc, d, e\n",
        "time, T [C]\r2026/6/11 12:00, 20.5\r2026/6/11 12:01, 21.5\r",
        'time,T [C],note\n2026-06-11 12:00:00,20.5\n2026-06-11 12:01:00,21.5,"a, b",,\n',
        "time,RH [%],T [℃]\n2026-06-11 12:00:00,55,20.5\n2026-06-11 12:01:00,56,21.5\n",
    ],
    ids=[
        "comments", "preamble", "units below", "units below a preamble", "brackets below", "footer",
        "no name of the time", "sep", "blanks", "tabs", "spaces", "ragged", "unit in one sign",
    ],
)  # fmt: skip
def test_lines_around_a_table_do_not_hide_it(tmp_path, text):
    assert readings(tmp_path, text) == TWO_ROWS


@pytest.mark.parametrize(
    "text",
    [
        "NO.,Date,Time,T [C]\n1,2026-06-11,12:00:00,20.5\n2,2026-06-11,12:01:00,21.5\n",
        "Place;Date;Time;T [C]\n1;2026/06/11;12:00:00;20,5\n2;2026/06/11;12:01:00;21,5\n",
        "Time,Date,T [C]\n12:00:00,2026-06-11,20.5\n12:01:00,2026-06-11,21.5\n",
        "No,Date,T [C],Time\n1,2026-06-11,20.5,12:00\n2,2026-06-11,21.5,12:01\n",
        f"Sync,No,Time,T [C]\n2026-06-01 08:00:00,1,{ROWS.splitlines()[0]}\n"
        f"2026-06-01 08:00:00,2,{ROWS.splitlines()[1]}\n",
        f"No,Unix,T [C]\n1,{NOON_S},20.5\n2,{NOON_S + 60},21.5\n",
    ],
)
def test_times_are_found_behind_counters_and_apart_from_their_dates(tmp_path, text):
    assert readings(tmp_path, text) == TWO_ROWS


def test_microseconds_in_a_column_of_their_own_belong_to_the_time(tmp_path):
    text = "NO.,Date,Time,us,T1 [C]\n1,2026-06-11,12:00:00,0,+ 20.081\n2,2026-06-11,12:00:00,500000,- 0.413\n"
    assert readings(tmp_path, text) == [(0, 20.081), (0.5, -0.413)]
    milliseconds = text.replace(",us,", ",ms,").replace("500000", "5")
    assert readings(tmp_path, milliseconds)[1] == (0.005, -0.413)


def test_a_column_of_the_time_may_be_named(tmp_path):
    rows = "2026-06-11 08:00,20.5,2026-06-11,12:00\n2026-06-11 08:02,21.5,2026-06-11,12:01\n"
    text = f"Logged,T [C],Shown,Clock\n{rows}"
    assert [second for second, _ in readings(tmp_path, text)] == [-4 * 3600, -4 * 3600 + 120]
    assert readings(tmp_path, text, time_columns=("Shown", "Clock")) == TWO_ROWS
    with pytest.raises(ConfigError, match="'When'", check=at(tmp_path / "log.csv")):
        readings(tmp_path, text, time_columns=("When",))


def test_units_stand_in_a_column_of_their_own(tmp_path):
    """Illuminance in two units, one foot-candle being 10.763 91 lx (NIST SP 811, appendix B)."""
    text = (
        "Position,Date,Time,Value,Unit\n1,2026/06/11,12:00:00,98760,Lux\n2,2026/06/11,12:00:02,9880,Ft-cd\n"
        "3,2026/06/11,12:00:04,12,OL\n"
    )
    assert readings(tmp_path, text)[:2] == [(0, 98_760.0), (2, pytest.approx(106_347.43, abs=0.01))]
    assert "'OL' (row 4)" in logs.notes(logs.read(tmp_path, text))
    with pytest.raises(ConfigError, match=r"'Lux' \(row 2\)") as caught:
        readings(tmp_path, text.replace("OL", "Degree C"))
    assert caught.value.place == f"{tmp_path / 'log.csv'}, column 'Value'"
    assert "'Degree C' (row 4)" in caught.value.message
    humid = text.replace("Lux", "%RH").replace("Ft-cd", "%RH").replace("OL", "%RH")
    assert readings(tmp_path, humid) == [(0, 98_760.0), (2, 9880.0), (4, 12.0)]


def test_wide_tables_are_read(tmp_path):
    head = ",".join(map(str, range(768)))
    rows = "".join(f"2026-06-11 12:0{m}:00,{','.join(['20.5'] * 768)}\n" for m in range(3))
    imported = logs.read(tmp_path, f"time,{head}\n{rows}", unit="C")
    assert imported.streams[0].shape == (768,)
    with pytest.raises(ConfigError, check=at(tmp_path / "log.csv", Argument("unit"))):
        logs.read(tmp_path, f"time,{head}\n{rows}")


def test_a_row_longer_than_the_header_is_excluded_by_its_number(tmp_path):
    rows = "".join(f"2026-06-11 12:0{m}:00,20.5,dry\n" for m in range(3))
    text = f"time,T [C],note\n{rows}2026-06-11 12:03:00,21,5,wet\n"
    assert len(readings(tmp_path, text)) == 3
    imported = logs.read(tmp_path, text)
    (note,) = [text for _, text in imported.notes if "row 5 (it has 4 cells" in text]
    assert note.startswith("1 row ")
    with pytest.raises(ConfigError, match="3 cells", check=at(f"{tmp_path / 'log.csv'}, row 2")):
        readings(tmp_path, "time,T [C]\n2026-06-11 12:00:00,20,5\n2026-06-11 12:01:00,21,5\n")


def test_decimals_below_a_header_that_ends_in_a_separator_are_no_column(tmp_path):
    rows = "".join(f"2026-06-11 12:0{m}:00,20,5,\n" for m in range(3))
    with pytest.raises(ConfigError, match=r"4 cells, .* 2", check=at(f"{tmp_path / 'log.csv'}, row 2")):
        readings(tmp_path, f"time,T [C],\n{rows}")
    assert len(readings(tmp_path, "time,T [C],\n" + rows.replace(",5,", ",wet"))) == 3


def test_a_second_header_ends_the_table_where_its_columns_or_units_are_others(tmp_path):
    rows = ["".join(f"2026-06-11 12:{m:02}:00,20.5,9\n" for m in part) for part in (range(3), range(3, 6))]
    plain, of_units = "time,T1 [C],T2 [C]\n", "time,T1,n\n,[C],\n"
    for head, again in ((plain, plain), (of_units, of_units), (of_units, of_units.replace(",[C],\n", ""))):
        assert len(readings(tmp_path, f"{head}{rows[0]}{again}{rows[1]}")) == 6
    for head, other, line in (
        (plain, "time,T2 [C],T1 [C]\n", 5),
        (plain, "Logger 2,of another maker\nn,date,T1 [F]\n", 6),
        (of_units, of_units.replace("C", "F"), 6),
    ):
        imported = logs.read(tmp_path, f"{head}{rows[0]}{other}{rows[1]}")
        assert len(logs.readings(imported, imported.streams[0].name)) == 3
        assert f"rows {line} to " in logs.notes(imported)


DAMAGE = [
    # what follows two whole rows, and what the notes name
    ("\0" * 512, "zeros"),
    ("2026-06-11 12:02:00,2" + "\0" * 512, "zeros"),
    ("2026-06-11 12:02:00,2" + "\0" * 64 + "2026-06-11 12:0" + "\0" * 64 + "\n", "zeros"),
    ("2026-06-11 12:02:00", "row 4 is cut off"),
    ("2026-06-11 12:02:00,2", "row 4 is cut off"),
    ("2026-06-11 12:0", "row 4 is cut off"),
    ("time,T [°C]\n", "row 4"),
]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
@pytest.mark.parametrize(("tail", "named"), DAMAGE)
def test_the_whole_part_of_a_damaged_table_is_read_and_the_rest_named(tmp_path, encoding, tail, named):
    data = f"time,T [°C]\n{ROWS}{tail}".encode(encoding)
    assert readings(tmp_path, data) == TWO_ROWS
    assert named in logs.notes(logs.read(tmp_path, data))


@pytest.mark.parametrize(
    "data", [b"\xff" * 64, "2026-06-11 12:02:00,2".encode("utf-16-le")[1:], "°".encode()[:1]]
)
def test_an_erased_or_cut_end_is_no_reason_to_refuse_a_table(tmp_path, data):
    assert readings(tmp_path, f"time,T [°C]\n{ROWS}".encode() + data.replace(b"\0", b""))[:2] == TWO_ROWS


ONSET = """"{0}: sand"
"#","{1}, GMT-05:00","{2}, °C ({3}: 1, {4}: 10000002, {5}: bed)","{6}, Lux ({3}: 1, {4}: 10000003)"
1,2026-06-11 07:00:00,20.5,50000
2,2026-06-11 07:01:00,21.5,50001
"""
ONSETS_WORDS = [
    "Plot Title;Date Time;Temp;LGR S/N;SEN S/N;LBL;Intensity",
    "Título;Fecha Tiempo;Temp;LGR S/N;SEN S/N;ETI;Intensidad",
    "Titre;Date Heure;Temp.;N° série enr.;N° série cap.;ÉTQ;Intensité",
    "プロット;日付 時間;温度;ロガー;センサー;ラベル;照度",
]


@pytest.mark.parametrize("words", ONSETS_WORDS)
def test_hoboware_is_read_by_its_structure_in_any_language(tmp_path, words):
    text = ONSET.format(*words.split(";"))
    assert readings(tmp_path, text, zone=None) == TWO_ROWS
    imported = logs.read(tmp_path, text, zone=None)
    assert [(info.unit, info.channels) for info in imported.streams] == [
        ("K", ("bed",)),
        ("lx", (words.rpartition(";")[2],)),
    ]


@pytest.mark.parametrize(
    "head", ["Date\tTime\tTemperature\n\t\t(*C)\n", "Fecha\tHora\tTemperatura\n\t\t(*C)\n"]
)
def test_boxcar_has_its_units_in_a_second_line(tmp_path, head):
    assert readings(tmp_path, head + ROWS.replace(",", "\t").replace(" 12", "\t12")) == TWO_ROWS


def minute_rows(counts: list[int]) -> str:
    times = [f"2026-06-11 12:0{minute}" for minute, count in enumerate(counts) for _ in range(count)]
    return "time,light [lx]\n" + "".join(f"{time},{row}\n" for row, time in enumerate(times))


@pytest.mark.parametrize(("counts", "first"), [([6, 6, 6, 6], 0), ([2, 6, 6, 3], 40), ([1, 2, 2, 1], 30)])
def test_times_in_whole_minutes_are_spread_evenly_and_named(tmp_path, counts, first):
    step = 60 // max(counts)
    timed = readings(tmp_path, minute_rows(counts))
    assert timed == [(first + step * row, row) for row in range(sum(counts))]
    assert f"{max(counts)} rows" in logs.notes(logs.read(tmp_path, minute_rows(counts)))


def test_uneven_rows_in_whole_minutes_are_asked(tmp_path):
    with pytest.raises(ConfigError, check=at(tmp_path / "log.csv", Argument("keep", "first"))):
        readings(tmp_path, minute_rows([6, 6, 5, 6, 6]))
    assert len(readings(tmp_path, minute_rows([6, 6, 5, 6, 6]), keep="first")) == 5


@pytest.mark.parametrize("closed", ["", '"'])
def test_a_quote_that_swallows_rows_is_refused(tmp_path, closed):
    rows = [f"2026-06-11 12:0{m}:00,20.{m},{note}\n" for m, note in enumerate(["", '"dry', "", closed, ""])]
    line = 5 if closed else 6
    with pytest.raises(ConfigError, match=f"line {line}", check=at(tmp_path / "log.csv")):
        readings(tmp_path, "".join(["time,T [C],note\n", *rows]))
    comment = [*rows[:1], '2026-06-11 12:01:00,20.1,"dry,\nthen wet"\n', *rows[4:]]
    assert len(readings(tmp_path, "".join(["time,T [C],note\n", *comment]))) == 3


def test_columns_of_one_name_are_told_apart(tmp_path):
    rows = "2026-06-11 12:00:00,20.5,21,9\n2026-06-11 12:01:00,21.5,22,9\n"
    imported = logs.read(tmp_path, f"time,T [C],T [C],T 2 [C]\n{rows}")
    assert imported.streams[0].channels == ("T", "T 2", "T 2 2")
    second = logs.read(tmp_path, f"time,T [C],T [C],T 2 [C]\n{rows}", columns=("T 2",))
    assert logs.values(second) == [(294.15,), (295.15,)]


@pytest.mark.parametrize(
    ("text", "place", "value"),
    [
        ("time (s),T (C)\n1,36.65\n2,36.59\n", ", column 'time (s)'", " 1,"),
        ("elapsed,T [C]\n00:00:01,20\n00:00:02,21\n", ", column 'elapsed'", "date"),
        ("2026-06-11 12:00:00,20\n2026-06-11 12:01:00,21\n", "", "header"),
    ],
)
def test_what_has_no_times_is_refused_by_what_it_is(tmp_path, text, place, value):
    with pytest.raises(ConfigError, check=at(f"{tmp_path / 'log.csv'}{place}"), match=value) as caught:
        readings(tmp_path, text)
    assert caught.value.fix


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_a_mark_at_the_beginning_gives_the_encoding(tmp_path, encoding):
    data = f"time,T [°C]\n{ROWS}".encode(encoding)
    assert readings(tmp_path, data) == TWO_ROWS
    assert readings(tmp_path, data, encoding=encoding) == TWO_ROWS
    check = at(tmp_path / "log.csv", Argument("encoding"))
    with pytest.raises(ConfigError, match=f"{encoding}.* cp932", check=check):
        readings(tmp_path, data, encoding="cp932")


def test_utf_16_without_a_mark_is_asked_for(tmp_path):
    data = f"time,T [C]\n{ROWS}".encode("utf-16-le")
    with pytest.raises(ConfigError, check=at(tmp_path / "log.csv")) as caught:
        readings(tmp_path, data)
    assert [step.name for step in steps(caught.value)] == ["encoding"]
    assert readings(tmp_path, data, encoding="utf-16-le") == TWO_ROWS
    assert readings(tmp_path, codecs.BOM_UTF16_BE + data.decode("utf-16-le").encode("utf-16-be")) == TWO_ROWS


@pytest.mark.parametrize("line", ["Time zone: UTC-5", "Zone,GMT-05:00", "timezone (America/Panama)"])
def test_a_zone_above_the_header_is_used(tmp_path, line):
    timed = readings(tmp_path, f"{line}\ntime,T [C]\n{ROWS}", zone=None)
    assert [second for second, _ in timed] == [5 * 3600, 5 * 3600 + 60]


def test_a_date_of_the_preamble_does_not_state_the_zone(tmp_path):
    with pytest.raises(ConfigError, check=at("'2026-06-11 12:00:00'", Argument("zone", "Asia/Tokyo"))):
        readings(tmp_path, f"# read out 2026-06-12 08:00 UTC, by hand\ntime,T [C]\n{ROWS}", zone=None)
