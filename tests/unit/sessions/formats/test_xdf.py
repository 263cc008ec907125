"""Recordings of the lab streaming layer, written chunk by chunk after the public specification of XDF."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

import fieldkit
from fieldkit.model.errors import ConfigError
from fieldkit.model.samples import Reading, Severity
from fieldkit.sessions.formats.imported import ImportedRecording
from fieldkit.sessions.formats.logs import LogColumns, LogOptions
from fieldkit.sessions.formats.xdf import read_xdf
from tests.harness.foreign_files import xdf, xdf_chunk, xdf_stream

BEGIN = datetime(2026, 5, 12, 10, 0, 0, tzinfo=UTC)  # the date that `xdf` writes: noon of UTC+2
BOUNDARY = bytes.fromhex("43a546dccbf5410fb30ed5467383cbe4")  # of the specification
AS_STATED = LogOptions()


def read(
    folder: Path, data: bytes, options: LogOptions = AS_STATED, name: str | None = None
) -> ImportedRecording:
    path = folder / "day.xdf"
    path.write_bytes(data)
    return read_xdf(path, name, options)


def readings(imported: ImportedRecording, stream: str) -> list[Reading]:
    return [one for one in imported.samples if isinstance(one, Reading) and one.stream == stream]


def seconds(imported: ImportedRecording, stream: str) -> list[float]:
    """Times after the date of the file."""
    begin_ns = round(BEGIN.timestamp()) * 10**9
    return [(one.time_ns - begin_ns) / 1e9 for one in readings(imported, stream)]


def warnings(imported: ImportedRecording) -> list[str]:
    return [text for severity, text in imported.notes if severity is not Severity.INFO]


def test_channels_with_a_unit_become_streams_in_the_session_s_units(tmp_path: Path) -> None:
    channels = [("E", "lux"), ("bed", "celsius"), ("flat", "celsius"), ("strain", "microvolts")]
    stream = xdf_stream(
        3, "Field box", channels, [100.0, 101.0], [[9e4, 20.0, 21.5, 3.0], [9.1e4, 20.5, 22.0, 3.0]]
    )
    imported = read(tmp_path, xdf(stream))
    found = {info.name: (info.quantity, info.unit, info.channels) for info in imported.streams}
    assert found == {
        "Field-box-illuminance": ("illuminance", "lx", ("E",)),
        "Field-box-temperature": ("temperature", "K", ("bed", "flat")),
    }
    assert readings(imported, "Field-box-temperature")[1].values == pytest.approx((293.65, 295.15))
    assert seconds(imported, "Field-box-illuminance") == [0.0, 1.0]
    assert any("strain [microvolts]" in text for text in warnings(imported))


def test_clock_offsets_move_the_stamps_onto_the_recorder_s_clock_and_raw_stamps_are_kept(
    tmp_path: Path,
) -> None:
    """Specification: the offset is added to a stamp; a clock that drifts has one that rises linearly."""
    steady = xdf_stream(1, "near", [("E", "lx")], [500.0, 550.0, 600.0], [[1.0]] * 3)
    offsets = [(1000.0 + 10.0 * n, -500.0 + 0.001 * n) for n in range(11)]  # 0.1 ms a second
    drifting = xdf_stream(2, "far", [("E", "lx")], [1000.0, 1050.0, 1100.0], [[1.0]] * 3, offsets)
    imported = read(tmp_path, xdf(steady, drifting))
    assert seconds(imported, "near") == [0.0, 50.0, 100.0]
    assert seconds(imported, "far") == pytest.approx([0.0, 50.005, 100.01], abs=1e-4)
    assert [float(one.raw.split(b",")[0]) for one in readings(imported, "far")] == [1000.0, 1050.0, 1100.0]
    assert warnings(imported) == []
    assert any(text.startswith("far: stamps moved by -499.99") for _, text in imported.notes)


def test_a_sample_without_a_stamp_follows_the_one_before_by_the_nominal_rate(tmp_path: Path) -> None:
    stream = xdf_stream(1, "lux", [("E", "lx")], [7.0, None, None], [[1.0], [2.0], [3.0]])
    assert seconds(read(tmp_path, xdf(stream)), "lux") == [0.0, 1.0, 2.0]


@pytest.mark.parametrize(("form", "value"), [("float32", 0.5), ("int16", -7.0)])
def test_forms_of_numbers(tmp_path: Path, form: str, value: float) -> None:
    stream = xdf_stream(
        1, "T", [("bed", "C")], [7.0], [[round(value) if form == "int16" else value]], form=form
    )
    assert readings(read(tmp_path, xdf(stream)), "T")[0].values == pytest.approx((value + 273.15,))


def test_streams_of_text_or_without_units_are_excluded_by_name(tmp_path: Path) -> None:
    light = xdf_stream(1, "lux", [("E", "lx")], [5.0], [[1.0]])
    marks = xdf_stream(2, "Markers", [("", "")], [3.0], [["go"]], form="string")  # type: ignore[list-item]
    imported = read(tmp_path, xdf(light, marks, xdf_stream(4, "probe", [("1", "")], [5.0], [[20.0]])))
    assert [info.name for info in imported.streams] == ["lux"]
    assert seconds(imported, "lux") == [2.0]  # the mark is the earliest sample
    assert warnings(imported) == ["streams excluded: Markers (text, 1 samples), probe (no unit, 1 samples)"]


def test_a_stream_without_a_unit_asks_for_it(tmp_path: Path) -> None:
    probe = xdf(xdf_stream(1, "probe", [("bed", "")], [5.0], [[20.0]]))
    with pytest.raises(
        ConfigError, match=r"no channel has samples .* probe \(no unit, 1 samples\)"
    ) as raised:
        read(tmp_path, probe)
    assert "unit of C, F, K, lx" in str(raised.value.fix)
    imported = read(tmp_path, probe, replace(AS_STATED, unit="C"))
    assert readings(imported, "probe")[0].values == pytest.approx((293.15,))


def test_channels_are_chosen_by_label(tmp_path: Path) -> None:
    both = xdf(
        xdf_stream(1, "a", [("bed", "C"), ("air", "C")], [5.0], [[20.0, 10.0]]),
        xdf_stream(2, "b", [("E", "lx")], [5.0], [[1.0]]),
    )
    imported = read(tmp_path, both, replace(AS_STATED, columns=LogColumns(values=("air",))))
    assert [(info.name, info.channels) for info in imported.streams] == [("a", ("air",))]
    with pytest.raises(ConfigError, match="no channel wind"):
        read(tmp_path, both, replace(AS_STATED, columns=LogColumns(values=("air", "wind"))))


def test_names_that_come_twice_or_cannot_stand_in_a_session(tmp_path: Path) -> None:
    """HDF5 groups; the file has two streams of one name where two instruments are alike."""
    names = ("lux", "lux", "///", "events")
    data = xdf(*(xdf_stream(n, name, [("E", "lx")], [5.0], [[1.0]]) for n, name in enumerate(names, 1)))
    assert [info.name for info in read(tmp_path, data).streams] == ["lux-1", "lux-2", "3", "events-4"]
    one = xdf(xdf_stream(1, "lux", [("E", "lx")], [5.0], [[1.0]]))
    assert [info.name for info in read(tmp_path, one, name="sun").streams] == ["sun"]


def test_a_file_without_a_date_needs_the_time_at_which_its_clock_was_0(tmp_path: Path) -> None:
    data = xdf(xdf_stream(1, "lux", [("E", "lx")], [5.0, 6.0], [[1.0]] * 2), date="")
    with pytest.raises(ConfigError, match="does not state when") as raised:
        read(tmp_path, data)
    assert "less 5.000" in str(raised.value.fix)
    given = replace(AS_STATED, offset_ns=round((BEGIN - timedelta(seconds=5)).timestamp()) * 10**9)
    assert seconds(read(tmp_path, data, given), "lux") == [0.0, 1.0]


def test_stamps_that_are_unix_seconds_are_their_own_date(tmp_path: Path) -> None:
    first = BEGIN.timestamp() + 90.0
    data = xdf(
        xdf_stream(1, "phone", [("E", "lx")], [first, first + 1.0], [[1.0]] * 2),
        xdf_stream(2, "lux", [("E", "lx")], [5.0], [[1.0]]),
    )
    assert seconds(read(tmp_path, data), "phone") == pytest.approx([90.0, 91.0], abs=1e-6)
    assert seconds(read(tmp_path, data), "lux") == [0.0]


def test_a_file_cut_off_anywhere_gives_its_whole_chunks_or_is_refused(tmp_path: Path) -> None:
    """The sample that is cut off must not come back as a whole one with numbers of another."""
    one = xdf_stream(1, "lux", [("E", "lx"), ("D", "lx")], [5.0], [[1.0, 2.0]])
    data, whole = xdf(one) + xdf_chunk(3, b"\1\1\0" + bytes(16), 1), xdf(one)
    assert len(readings(read(tmp_path, data), "lux")) == 2
    for size in range(len(whole), len(data)):
        imported = read(tmp_path, data[:size])
        assert [reading.values for reading in readings(imported, "lux")] == [(1.0, 2.0)]
        excluded = [f"day.xdf: {size - len(whole)} bytes after the last whole chunk are excluded"]
        assert warnings(imported) == (excluded if size > len(whole) else [])
    for size in range(0, len(whole), 9):
        with suppress(ConfigError):
            assert [one.values for one in readings(read(tmp_path, data[:size]), "lux")] == [(1.0, 2.0)]


def test_samples_that_are_damaged_are_skipped_to_the_next_boundary_with_a_warning(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    one = xdf_stream(1, "lux", [("E", "lx")], [5.0], [[1.0]])
    broken = xdf_chunk(3, b"\3" + bytes(20), 1)  # 3 is no length of a number
    good = xdf_chunk(3, b"\1\1\0" + bytes(8), 1)
    imported = read(tmp_path, xdf(one) + broken + xdf_chunk(5, BOUNDARY) + good)
    assert len(readings(imported, "lux")) == 2
    assert any("corruption" in text for text in warnings(imported))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"PK\3\4 something else", "is not an XDF file"),
        (b"XDF:", "it has no streams"),
        (xdf(xdf_chunk(2, b"<info><name>", 1)), "is damaged"),
        (xdf(xdf_stream(1, "lux", [("E", "lx")], [float("nan")], [[1.0]])), "a stamp is not a number"),
        (xdf(xdf_stream(1, "lux", [("E", "lx")], [], [])), "0 samples"),
    ],
)  # fmt: skip
def test_what_is_not_such_a_recording_is_refused(tmp_path: Path, data: bytes, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        read(tmp_path, data)


def test_it_becomes_a_session_and_joins_one(tmp_path: Path) -> None:
    rows = [[1e4 + n] for n in range(10)]
    (tmp_path / "box.xdf").write_bytes(
        xdf(xdf_stream(1, "lux", [("E", "lx")], [5.0 + n for n in range(10)], rows))
    )
    (tmp_path / "log.csv").write_text("time,air [C]\n2026-05-12 10:00:00,20\n2026-05-12 10:00:08,21\n")
    site = fieldkit.Site(47.1, 8.5, 400.0, "Europe/Zurich")
    options = fieldkit.ImportOptions(site=site, zone="UTC")
    log = fieldkit.import_recording(tmp_path / "log.csv", tmp_path / "log.h5", options)
    both = fieldkit.import_into(log.path, tmp_path / "box.xdf", tmp_path / "both.h5")
    with both.open() as session:
        assert list(session.streams) == ["logger", "lux"]
        assert session["lux"].readings().values.ravel().tolist() == [row[0] for row in rows]
