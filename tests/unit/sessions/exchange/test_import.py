"""Foreign recordings become sessions with their stamps and counts as they are."""

from __future__ import annotations

import gzip
import json
import struct
from datetime import UTC
from pathlib import Path
from zoneinfo import ZoneInfo

import cv2
import numpy as np
import pytest

from fieldkit.errors import ConfigError
from fieldkit.samples import EventKind, Frame, Quality
from fieldkit.sessions.exchange.imported import bunched, write_foreign
from fieldkit.sessions.exchange.purethermal import is_purethermal, read_purethermal
from fieldkit.sessions.exchange.stills import Scale, read_stills
from fieldkit.sessions.exchange.times import parse_time_ns
from fieldkit.sessions.layout import SessionHeader
from fieldkit.sessions.reader import open_session
from fieldkit.site import Site
from tests.shared_data import shared

SITE = Site(-33.5, -70.6, 500.0, "America/Santiago")


def written(
    path: Path, stamps_s: list[float], shape: tuple[int, int] = (4, 6), cut: int = 0, count: int = 29_500
) -> Path:
    """A recording in the PureThermal recorder's format, its end cut off by some bytes."""
    header = json.dumps({"width": shape[1], "height": shape[0], "fps": 9.0}).encode()
    data = b"PTY16V1\n" + struct.pack("<I", len(header)) + header
    for number, stamp in enumerate(stamps_s):
        picture = np.full(shape, count + number, "<u2")
        data += struct.pack("<Qdq", number, stamp, round(stamp * 1000)) + picture.tobytes()
    path.write_bytes(gzip.compress(data[: len(data) - cut]))
    return path


def test_real_recording_comes_through_whole(tmp_path: Path) -> None:
    """Expected numbers: the README beside the recording."""
    source = shared("data/frames/purethermal3/thermal_20260512_151542.raw.y16.gz")
    foreign = read_purethermal(source)
    report = write_foreign(tmp_path / "a.h5", SessionHeader("t", SITE, foreign.streams), foreign, source.name)
    assert report.counts == {"camera": 82}
    with open_session(tmp_path / "a.h5") as session:
        frames = [frame for frame in session.samples("camera") if isinstance(frame, Frame)]
        assert (frames[0].counts.min(), frames[0].counts.max()) == (29354, 30656)
        assert frames[0].counts.mean() == pytest.approx(29591.0263, abs=1e-4)
        assert (frames[0].counts[60, 80], frames[0].counts[0, 0]) == (29523, 29558)
        assert (frames[81].counts.min(), frames[81].counts.max()) == (29318, 30427)
        assert (session.end_ns - session.start_ns) / 1e9 == pytest.approx(9.22071, abs=1e-5)
        assert session.streams["camera"].scale == 0.01
        # gaps of 0.412, 0.032, 0.015 and 0.017 s at the beginning: a burst of waiting pictures
        assert [frame.seq for frame in frames if frame.quality & Quality.STALE] == [1, 2, 3, 4]
        assert any("came in bunches" in event.text for event in session.events())


def test_recording_cut_off_keeps_its_whole_frames(tmp_path: Path) -> None:
    path = written(tmp_path / "cut.raw.y16.gz", [1.7e9 + n / 9 for n in range(5)], cut=10)
    foreign = read_purethermal(path)
    assert len(list(foreign.samples)) == 4
    assert "ends within frame 4" in foreign.remarks[0][1]


def test_counts_that_are_no_kelvin_get_no_scale(tmp_path: Path) -> None:
    foreign = read_purethermal(written(tmp_path / "raw.raw.y16.gz", [1.7e9], count=8192))
    assert np.isnan(foreign.streams[0].scale)
    assert "TLinear off" in foreign.remarks[0][1]


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"plain",
        gzip.compress(b"PTY16V1\n\xff\xff\xff\xff", mtime=0),
        gzip.compress(b"PTY16V1\n\2\0\0\0{}", mtime=0),
    ],
)
def test_other_files_are_refused(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "other.gz"
    path.write_bytes(data)
    assert is_purethermal(path) == data.startswith(gzip.compress(b"")[:2])
    with pytest.raises(ConfigError, match="not a recording"):
        read_purethermal(path)


def test_picture_of_hostile_size_is_refused(tmp_path: Path) -> None:
    header = json.dumps({"width": 10**9, "height": 10**9, "fps": 9}).encode()
    path = tmp_path / "huge.gz"
    path.write_bytes(gzip.compress(b"PTY16V1\n" + struct.pack("<I", len(header)) + header))
    with pytest.raises(ConfigError, match="pictures of"):
        read_purethermal(path)


def tiffs(folder: Path, names: list[str]) -> Path:
    folder.mkdir()
    for number, name in enumerate(names):
        cv2.imwrite(str(folder / name), np.full((5, 7), 6900 + number, np.uint16))
    return folder


def test_tiffs_are_ordered_by_their_stamps_and_keep_their_counts(tmp_path: Path) -> None:
    folder = tiffs(tmp_path / "f", ["c.tif", "a.tif", "b.tiff"])
    times = tmp_path / "times.csv"
    times.write_text(
        "file,time\na.tif,2026-05-12T10:00:01\nb.tiff,2026-05-12T10:00:02\nc.tif,2026-05-12T10:00:00.5\n"
    )
    foreign = read_stills(folder, Scale(0.04, 0.0), times=times, zone=ZoneInfo("Asia/Tokyo"))
    frames = [frame for frame in foreign.samples if isinstance(frame, Frame)]
    assert [int(frame.counts[0, 0]) for frame in frames] == [6900, 6901, 6902]
    assert frames[0].time_ns == 1_778_547_600_500_000_000  # 2026-05-12T01:00:00.5Z by date(1)
    assert foreign.streams[0].scale == 0.04


def test_stamps_may_stand_in_the_names(tmp_path: Path) -> None:
    folder = tiffs(tmp_path / "f", ["IR_20260512T010000.tif", "IR_20260512T010001.tif"])
    foreign = read_stills(folder, Scale(float("nan")), time_format="IR_%Y%m%dT%H%M%S", zone=UTC)
    assert [frame.time_ns for frame in foreign.samples] == [
        1_778_547_600_000_000_000,
        1_778_547_601_000_000_000,
    ]
    assert np.isnan(foreign.streams[0].scale)


def test_trouble_with_tiffs_is_told(tmp_path: Path) -> None:
    folder = tiffs(tmp_path / "f", ["a.tif", "b.tif"])
    (tmp_path / "empty").mkdir()
    times = tmp_path / "times.csv"
    times.write_text("a.tif,2026-05-12T10:00:01Z\n")
    with pytest.raises(ConfigError, match="no TIFF"):
        read_stills(tmp_path / "empty", Scale(1.0), times=times)
    with pytest.raises(ConfigError, match=r"no time for 1 pictures, the first b\.tif"):
        read_stills(folder, Scale(1.0), times=times)
    with pytest.raises(ConfigError, match="one way"):
        read_stills(folder, Scale(1.0))
    with pytest.raises(ConfigError, match="no zone"):
        read_stills(tiffs(tmp_path / "g", ["20260512.tif"]), Scale(1.0), time_format="%Y%m%d")
    cv2.imwrite(str(folder / "b.tif"), np.zeros((5, 7, 3), np.uint8))
    times.write_text("a.tif,2026-05-12T10:00:01Z\nb.tif,2026-05-12T10:00:02Z\n")
    with pytest.raises(ConfigError, match="16-bit"):
        list(read_stills(folder, Scale(1.0), times=times).samples)
    (folder / "b.tif").write_bytes(b"not a picture")
    with pytest.raises(ConfigError, match="cannot be read"):
        list(read_stills(folder, Scale(1.0), times=times).samples)


def test_failed_import_leaves_nothing(tmp_path: Path) -> None:
    folder = tiffs(tmp_path / "f", ["20260512T010000.tif", "20260512T010001.tif"])
    (folder / "20260512T010001.tif").write_bytes(b"not a picture")
    foreign = read_stills(folder, Scale(0.01), time_format="%Y%m%dT%H%M%S", zone=UTC)
    with pytest.raises(ConfigError):
        write_foreign(tmp_path / "a.h5", SessionHeader("t", SITE, foreign.streams), foreign, "f")
    assert [path.name for path in tmp_path.iterdir()] == ["f"]


def test_origin_is_told_in_an_event(tmp_path: Path) -> None:
    foreign = read_purethermal(written(tmp_path / "a.gz", [1.7e9, 1.7e9 + 0.1]))
    write_foreign(tmp_path / "a.h5", SessionHeader("t", SITE, foreign.streams), foreign, "a.gz")
    with open_session(tmp_path / "a.h5") as session:
        assert session.events()[0].kind is EventKind.IMPORTED
        assert session.events()[0].text == "imported from a.gz"


def test_bunched_stamps() -> None:
    steady = np.arange(10, dtype=np.int64) * 100
    assert not bunched(steady).any()
    moved = steady.copy()
    moved[4] = 495  # late, so it came together with the next
    assert np.flatnonzero(bunched(moved)).tolist() == [4, 5]


@pytest.mark.parametrize(
    ("text", "time_format", "zone", "expected"),
    [
        ("2026-05-12T01:00:00Z", None, None, 1_778_547_600_000_000_000),
        ("2026-05-12T10:00:00+09:00", None, None, 1_778_547_600_000_000_000),
        ("1778547600.25", None, None, 1_778_547_600_250_000_000),
        ("2026/05/12 10:00:00", "yyyy/mm/dd HH:MM:SS", ZoneInfo("Asia/Tokyo"), 1_778_547_600_000_000_000),
        ("12.05.26 03:00", "%d.%m.%y %H:%M", ZoneInfo("Europe/Berlin"), 1_778_547_600_000_000_000),
    ],
)
def test_times_of_many_kinds(
    text: str, time_format: str | None, zone: ZoneInfo | None, expected: int
) -> None:
    assert parse_time_ns(text, zone, time_format) == expected


def test_time_without_a_zone_is_refused() -> None:
    with pytest.raises(ConfigError, match="no zone"):
        parse_time_ns("2026-05-12T10:00:00", None)
    with pytest.raises(ConfigError, match="not a time"):
        parse_time_ns("yesterday", UTC)


def test_flir_files_keep_their_law(tmp_path: Path) -> None:
    """Expected counts: the README beside the file; an indoor scene near room temperature."""
    from fieldkit.commands.import_flir import read_flir

    source = shared("data/frames/flir_file/frame_000000_le.fff")
    foreign = read_flir(source, "camera")
    write_foreign(tmp_path / "a.h5", SessionHeader("t", SITE, foreign.streams), foreign, source.name)
    with open_session(tmp_path / "a.h5") as session:
        counts = session.raw("camera")[0]
        assert (counts.min(), counts.max()) == (17899, 19192)
        assert session.streams["camera"].law == "planck"
        kelvin = session.kelvin()
        assert 290.0 < kelvin.min() < kelvin.max() < 310.0
