"""Foreign recordings become sessions with their stamps and counts as they are."""

import gzip
import math
import os
import struct
from datetime import UTC
from pathlib import Path
from zoneinfo import ZoneInfo

import cv2
import numpy as np
import pytest
import tifffile

from fieldkit.estimation.bins import CameraStream
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.model.samples import Frame, Quality, Severity
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.physics.camera_laws import frame_k
from fieldkit.results.importing import ImportOptions, read_source
from fieldkit.sessions.formats.imported import flag_bunched, possible, write_imported
from fieldkit.sessions.formats.purethermal_files import is_purethermal, read_purethermal
from fieldkit.sessions.formats.stills import NO_VALUE, Scale, read_stills
from fieldkit.sessions.formats.times import parse_times_ns
from fieldkit.sessions.layout import SessionHeader
from fieldkit.sessions.reader import open_session
from tests.harness.command_line import run_code
from tests.harness.foreign_files import irg, purethermal, tiff_pages
from tests.harness.next_steps import at
from tests.shared_data import shared

SITE = Site(-33.5, -70.6, 500.0, "America/Santiago")


def written(path: Path, stamps_s: list[float], cut: int = 0, count: int = 29_500) -> Path:
    """A recording in the PureThermal recorder's format, its end cut off by some bytes."""
    data = purethermal(stamps_s, count=count)
    path.write_bytes(gzip.compress(data[: len(data) - cut]))
    return path


def test_real_recording_comes_through_whole(tmp_path):
    """Expected numbers: the README beside the recording."""
    source = shared("data/frames/purethermal3/thermal_20260512_151542.raw.y16.gz")
    imported = read_purethermal(source)
    report = write_imported(
        tmp_path / "a.h5", SessionHeader("t", SITE, imported.streams), imported, source.name
    )
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
        assert [frame.seq for frame in frames if frame.quality & Quality.INTERPOLATED] == [1, 2, 3, 4]
        assert any(event.text.startswith("4 of 82 ") for event in session.events())


def test_recording_cut_off_keeps_its_whole_frames(tmp_path):
    path = written(tmp_path / "cut.raw.y16.gz", [1.7e9 + n / 9 for n in range(5)], cut=10)
    imported = read_purethermal(path)
    for _ in range(2):  # read again whenever asked for
        assert len(list(imported.samples)) == 4
    assert "frame 4:" in imported.notes[0][1]


def test_counts_that_are_no_kelvin_get_no_scale(tmp_path):
    imported = read_purethermal(written(tmp_path / "raw.raw.y16.gz", [1.7e9], count=8192))
    assert np.isnan(imported.streams[0].scale)
    assert "TLinear off" in imported.notes[0][1]


def with_header(header: bytes) -> bytes:
    return b"PTY16V1\n" + struct.pack("<I", len(header)) + header


RATES = ("NaN", "Infinity", "-9", "0", "1e6", "[9]", "null", "9" * 400)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"plain",
        gzip.compress(b"PTY16V1\n\xff\xff\xff\xff", mtime=0),
        *(
            gzip.compress(with_header(header.encode()), mtime=0)
            for header in (
                "{}",
                "[" * 100_000,
                '{"width": 1000000000, "height": 1000000000, "fps": 9}',
                *(f'{{"width": 4, "height": 3, "fps": {rate}}}' for rate in RATES),
            )
        ),
    ],
)
def test_files_that_no_camera_wrote_are_refused(tmp_path, data):
    path = tmp_path / "other.gz"
    path.write_bytes(data)
    assert is_purethermal(path) == data.startswith(gzip.compress(b"")[:2])
    with pytest.raises(ConfigError, check=at(path)):
        read_purethermal(path)


@pytest.mark.parametrize("seconds", [1e300, 1.7e308, 1e10, -1.0, float("inf"), float("-inf"), math.nan])
@pytest.mark.parametrize("frame", [0, 2])
def test_a_time_that_no_frame_has_names_the_frame(tmp_path, seconds, frame):
    """A frame is u64 number, f64 seconds, i64 milliseconds and 4 x 6 pixels of 16 bits, after the header."""
    data = bytearray(purethermal([1.7e9, 1.7e9 + 1, 1.7e9 + 2]))
    struct.pack_into("<d", data, len(data) - (3 - frame) * 72 + 8, seconds)
    (tmp_path / "a.raw.y16.gz").write_bytes(gzip.compress(bytes(data)))
    with pytest.raises(ConfigError, check=at(f"frame {frame}")):
        read_purethermal(tmp_path / "a.raw.y16.gz")


def test_a_recorder_whose_clock_was_slow_is_corrected_by_the_offset(tmp_path):
    path = written(tmp_path / "a.raw.y16.gz", [1.7e9, 1.7e9 + 1])
    times_ns = [frame.time_ns for frame in read_purethermal(path, offset_ns=83_000_000_000).samples]
    assert times_ns == [1_700_000_083 * 10**9, 1_700_000_084 * 10**9]


def tiffs(folder: Path, names: list[str]) -> Path:
    folder.mkdir()
    for number, name in enumerate(names):
        cv2.imwrite(str(folder / name), np.full((5, 7), 6900 + number, np.uint16))
    return folder


def test_tiffs_are_ordered_by_their_stamps_and_keep_their_counts(tmp_path):
    folder = tiffs(tmp_path / "f", ["c.tif", "a.tif", "b.tiff"])
    times = tmp_path / "times.csv"
    times.write_text(
        "file,time\na.tif,2026-05-12T10:00:01\nb.tiff,2026-05-12T10:00:02\nc.tif,2026-05-12T10:00:00.5\n"
    )
    imported = read_stills(folder, Scale(0.04, 0.0), times=times, zone=ZoneInfo("Asia/Tokyo"))
    frames = [frame for frame in imported.samples if isinstance(frame, Frame)]
    assert [int(frame.counts[0, 0]) for frame in frames] == [6900, 6901, 6902]
    assert frames[0].time_ns == 1_778_547_600_500_000_000  # 2026-05-12T01:00:00.5Z by date(1)
    assert imported.streams[0].scale == 0.04


@pytest.mark.parametrize("mark", [";", "\t"])
def test_table_of_times_may_be_parted_otherwise_than_by_commas(tmp_path, mark):
    folder = tiffs(tmp_path / "f", ["a.tif"])
    times = tmp_path / "times.csv"
    times.write_text(f"file{mark}time\na.tif{mark}2026-05-12 10:00:01\n", encoding="utf-8-sig")
    (frame,) = read_stills(folder, Scale(0.04), times=times, zone=ZoneInfo("Asia/Tokyo")).samples
    assert frame.time_ns == 1_778_547_601_000_000_000  # 2026-05-12T01:00:01Z by date(1)


def test_times_in_the_names_by_a_slow_clock_are_corrected_by_the_offset(tmp_path):
    folder = tiffs(tmp_path / "f", ["IR_20260512T010000.tif", "IR_20260512T010001.tif"])
    moment = {"time_format": "IR_%Y%m%dT%H%M%S", "zone": UTC}
    imported = read_stills(folder, Scale(math.nan), **moment, offset_ns=83_000_000_000)
    (first, second) = imported.samples
    assert first.time_ns == 1_778_547_683_000_000_000  # 2026-05-12T01:01:23Z by date(1)
    assert second.time_ns == 1_778_547_684_000_000_000
    assert math.isnan(imported.streams[0].scale)


GIVEN_TIMES = (Argument("times", "stamps.csv"), Argument("time_format"))


def test_trouble_with_tiffs_is_told(tmp_path):
    folder = tiffs(tmp_path / "f", ["a.tif", "b.tif"])
    (tmp_path / "empty").mkdir()
    times = tmp_path / "times.csv"
    times.write_text("a.tif,2026-05-12T10:00:01Z\n")
    with pytest.raises(ConfigError, check=at(tmp_path / "empty")):
        read_stills(tmp_path / "empty", Scale(1.0), times=times)
    with pytest.raises(ConfigError, match=r"0 times .* 1 frames of b\.tif", check=at(times)):
        read_stills(folder, Scale(1.0), times=times)
    with pytest.raises(ConfigError, check=at(folder / "a.tif", *GIVEN_TIMES)):
        read_stills(folder, Scale(1.0))
    with pytest.raises(ConfigError, check=at(Argument("times"), *GIVEN_TIMES)):
        read_stills(folder, Scale(1.0), times=times, time_format="%Y")
    times.write_text("a.tif,12/05/2026 10:00\nb.tif,12/05/2026 10:01\n")
    with pytest.raises(ConfigError, match="'12/05/2026 10:00'", check=at(f"{times}, a.tif")) as caught:
        read_stills(folder, Scale(1.0), times=times, zone=UTC)
    assert "ISO 8601" in str(caught.value.fix)  # a format would be of the names
    with pytest.raises(ConfigError, check=at("'20260512'", Argument("zone", "Asia/Tokyo"))):
        read_stills(tiffs(tmp_path / "g", ["20260512.tif"]), Scale(1.0), time_format="%Y%m%d")
    times.write_text("a.tif,2026-05-12T10:00:01Z\nb.tif,2026-05-12T10:00:02Z\n")
    for data in (cv2.imencode(".tif", np.zeros((5, 7, 3), np.uint8))[1].tobytes(), b"not a picture"):
        (folder / "b.tif").write_bytes(data)
        with pytest.raises(ConfigError, check=at(folder / "b.tif")):
            list(read_stills(folder, Scale(1.0), times=times).samples)


FIRST = np.arange(30_000, 30_035, dtype=np.uint16).reshape(5, 7)
SMALL, MOMENT = FIRST[:2, :3], {"time_format": "%Y%m%d", "zone": UTC}


def tiff_file(folder: Path, data: bytes) -> Path:
    (folder / "20260512.tif").write_bytes(data)
    return folder / "20260512.tif"


def frames_of(source: Path, **times) -> list[np.ndarray]:
    return [frame.counts for frame in read_stills(source, Scale(0.01), **times).samples]


@pytest.mark.parametrize("layout", [{}, {"order": ">"}, {"is_big": True}, {"order": ">", "is_big": True}])
def test_every_page_of_a_tiff_is_a_frame_with_a_time_of_its_own(tmp_path, layout):
    path = tiff_file(tmp_path, tiff_pages(*((FIRST + n, {}) for n in range(10)), **layout))
    times = tmp_path / "times.csv"
    times.write_text("".join(f"{path.name},2026-05-12T10:00:{second:02}Z\n" for second in range(10)))
    assert [frame[0, 0] for frame in frames_of(path, times=times)] == list(range(30_000, 30_010))
    with pytest.raises(ConfigError, match="10 frames", check=at(path, Argument("times", "stamps.csv"))):
        frames_of(path, **MOMENT)
    times.write_text("".join(times.read_text().splitlines(keepends=True)[:9]))
    with pytest.raises(ConfigError, match=r"9 times .* 10 frames of 20260512\.tif", check=at(times)):
        frames_of(path, times=times)


@pytest.mark.parametrize("tag", [{254: 1}, {254: 4}, {254: 5}, {255: 2}])  # TIFF 6.0, section 8
@pytest.mark.parametrize("is_first", [True, False])
def test_thumbnails_and_masks_are_not_taken_for_frames(tmp_path, tag, is_first):
    coloured = (np.zeros((2, 3, 3), np.uint8), {**tag, 258: 8})
    pages = [coloured, (FIRST, {254: 0})] if is_first else [(FIRST, {254: 2}), (SMALL, tag)]
    path = tiff_file(tmp_path, tiff_pages(*pages))
    (frame,) = frames_of(path, **MOMENT)
    assert np.array_equal(frame, FIRST)
    assert read_stills(path, Scale(0.01), **MOMENT).notes[0][1].startswith("1 pages ")
    with pytest.raises(ConfigError, check=at(path), match=" 1 pages"):
        frames_of(tiff_file(tmp_path, tiff_pages((FIRST, tag))), **MOMENT)


@pytest.mark.parametrize("orientation", range(1, 9))  # TIFF 6.0, section 8: which side is row 0
@pytest.mark.parametrize("order", ["<", ">"])
def test_frames_stay_as_the_sensor_has_them_whatever_their_orientation(tmp_path, orientation, order):
    path = tiff_file(tmp_path, tiff_pages((FIRST, {274: orientation}), order=order))
    imported = read_stills(path, Scale(0.01), **MOMENT)
    (frame,) = imported.samples
    assert np.array_equal(frame.counts, FIRST)
    assert any("orientation of 1 " in text for _, text in imported.notes) == (orientation != 1)


@pytest.mark.parametrize(
    ("pixels", "more", "words", "fix"),
    [
        (FIRST.astype(np.float32), {}, "32-bit floating-point numbers", "unit='C'"),
        (FIRST.astype(np.int16), {}, "16-bit signed numbers", "unsigned 16-bit"),
        (FIRST.astype(np.uint8), {}, "8-bit numbers", "coloured"),
        (FIRST.astype(np.uint32), {}, "32-bit numbers", "unsigned 16-bit"),
        (FIRST, {258: 14}, "14-bit numbers", "unsigned 16-bit"),  # OpenCV would multiply them by 4
        (np.zeros((5, 7, 3), np.uint8), {}, "3 channels", "coloured"),
        (np.zeros((5, 7, 2), np.uint16), {}, "2 channels", "unsigned 16-bit"),
    ],
)
def test_a_tiff_of_other_numbers_is_named_for_what_it_is(tmp_path, pixels, more, words, fix):
    path = tiff_file(tmp_path, tiff_pages((pixels, more)))
    with pytest.raises(ConfigError, match=f"has {words}, ", check=at(path)) as caught:
        frames_of(path, **MOMENT)
    assert fix in str(caught.value.fix)
    tiff_file(tmp_path, tiff_pages((FIRST, {}), (pixels, more)))
    with pytest.raises(ConfigError, match=f"has {words}, ", check=at(f"page 2 of 2 of {path}")):
        frames_of(path, **MOMENT)


SCALE = (Argument("kelvin_per_count"), Argument("kelvin_at_zero"))
SIGNALLING = np.array(0x7F800001, np.uint32).view(np.float32)  # a NaN that warns when it is converted


@pytest.mark.parametrize(
    ("hole", "count", "quality"),
    [
        *((hole, NO_VALUE, Quality.GOOD) for hole in (np.nan, SIGNALLING, -9999.0)),
        *((hole, NO_VALUE - 1, Quality.SATURATED) for hole in (np.inf, 400.0)),
    ],
)
def test_a_pixel_without_a_temperature_has_no_value_and_one_too_hot_flags_its_frame(
    tmp_path, hole, count, quality
):
    pixels = np.full((5, 7), 22.35, np.float32)
    pixels[1, 2] = hole
    imported = read_stills(tiff_file(tmp_path, tiff_pages((pixels, {}))), None, unit="C", **MOMENT)
    (frame,), (info,) = imported.samples, imported.streams
    assert (frame.counts[1, 2], frame.quality) == (count, quality)
    is_hole = np.isnan(frame_k(info, frame.counts, frame.metadata_rows))
    assert is_hole.sum() == is_hole[1, 2] == (quality == Quality.GOOD)


GDAL = "<GDALMetadata>{}</GDALMetadata>"
ITEM = '<Item name="{}" sample="0" role="{}">{}</Item>'


def gdal(scale: object, offset: object = 0.0, unit: str = "", no_data: str = "") -> dict:
    """Options of tifffile for GDAL's tags, as `gdal_translate` writes them."""
    values = (("SCALE", "scale", scale), ("OFFSET", "offset", offset), ("UNITTYPE", "unittype", unit))
    items = "".join(ITEM.format(*item) for item in values if item[2] != "")
    texts = [(42112, GDAL.format(items)), *([(42113, no_data)] if no_data else [])]
    return {"extratags": [(tag, "s", 0, text, True) for tag, text in texts], "metadata": None}


DEEP = np.arange(29_000, 29_000 + 3 * 40 * 48, dtype=np.uint16).reshape(3, 40, 48)
CENTIGRADE = np.float32(DEEP[0] * 0.01 - 273.15)
STACK = {"metadata": {"axes": "TYX"}, "truncate": True}


@pytest.mark.parametrize(
    ("pixels", "options", "unit", "frames"),
    [
        (DEEP, STACK, "", 3),
        (DEEP, {**STACK, "byteorder": ">", "bigtiff": True}, "", 3),
        (DEEP, {"imagej": True, "truncate": True}, "", 3),
        (DEEP, {"ome": True, "metadata": {"axes": "TYX"}}, "", 3),
        *((DEEP, {"compression": name}, "", 3) for name in ("lzw", "zstd", "deflate", "packbits", "lzma")),
        (DEEP, {"compression": "lzw", "predictor": True}, "", 3),
        (DEEP, {"tile": (16, 16), "compression": "lerc"}, "", 3),
        (DEEP[0], gdal(0.01, 0.0, "K"), "", 1),
        (DEEP[0], gdal(0.01, -273.15, "degC"), "", 1),
        (DEEP[0], gdal(0.01, -273.15), "C", 1),
        (np.int16(DEEP[0] - 27_315), gdal(0.01, 0.0, "C"), "", 1),
        (np.int32(DEEP[0]) * 10, gdal(0.001, 0.0), "K", 1),
        (CENTIGRADE, gdal("", "", "C"), "", 1),
        (np.float64(CENTIGRADE) * 10.0, gdal(0.1, 0.0, "C"), "", 1),
        (np.float32(DEEP[0] * 0.018 - 459.67), {}, "F", 1),
        (np.float32(DEEP[0] * 0.01), {}, "K", 1),
    ],
)
def test_tiffs_of_every_program_mean_the_same_frames(tmp_path, pixels, options, unit, frames, capfd):
    """Written by tifffile as ImageJ, GDAL and others write them; right are the numbers that went in."""
    path = tmp_path / "20260512.tif"
    tifffile.imwrite(path, pixels, **{"photometric": "minisblack"} | options)
    times = tmp_path / "times.csv"
    times.write_text("".join(f"{path.name},2026-05-12T10:00:{n:02}Z\n" for n in range(frames)))
    scale = None if unit or "extratags" in options else Scale(0.01)
    imported = read_stills(path, scale, times=times, unit=unit)
    (info,) = imported.streams
    assert (info.unit, info.offset) == ("K", 0.0)
    kelvin = [frame_k(info, frame.counts, frame.metadata_rows) for frame in imported.samples]
    assert np.abs(kelvin - DEEP[:frames] * 0.01).max() <= 0.0051
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("pixels", "options", "given", "step"),
    [
        (DEEP[0], gdal(0.04, 0.0, "K"), {"scale": Scale(0.01)}, SCALE),
        (DEEP[0], gdal(0.04, 0.0, "K"), {"unit": "C"}, (Argument("unit"),)),
        (DEEP[0], gdal(0.04, 0.0), {}, (Argument("unit", "C"),)),
        (DEEP, STACK, {"scale": Scale(0.01), "cut": -2}, ()),
        (DEEP[0], {"compression": "lzw"}, {"scale": Scale(0.01), "cut": -900}, ()),
    ],
)
def test_what_a_tiff_states_is_not_overridden_and_a_cut_one_refused(tmp_path, pixels, options, given, step):
    path = tmp_path / "20260512.tif"
    tifffile.imwrite(path, pixels, photometric="minisblack", **options)
    path.write_bytes(path.read_bytes()[: given.get("cut")])
    with pytest.raises(ConfigError, check=at(path, *step)):
        read_stills(path, given.get("scale"), unit=given.get("unit", ""), **MOMENT)


WITHOUT_CODECS = """
import sys
from pathlib import Path
sys.modules["imagecodecs"] = None  # as where it is not installed
from fieldkit.sessions.formats.tiff import read_pages
for name in sys.argv[1:]:
    try:
        print(read_pages(Path(name))[0].read(Path(name)).sum())
    except Exception as error:
        print(type(error).__name__, "ZSTD" in error.message, "files" in error.fix)
"""


def test_without_codecs_deflate_is_read_and_others_are_refused_by_name(tmp_path):
    names = [str(tmp_path / f"{name}.tif") for name in ("deflate", "zstd")]
    for name in names:
        tifffile.imwrite(name, DEEP[0], compression=Path(name).stem)
    printed = run_code(WITHOUT_CODECS, *names)
    assert printed.split("\n")[:2] == [str(DEEP[0].sum()), "ConfigError True True"]


def test_regions_lose_only_the_pixels_that_have_no_value(tmp_path):
    path = tmp_path / "20260512.tif"
    pixels = CENTIGRADE.copy()
    pixels[:4, :4] = np.nan
    tifffile.imwrite(path, pixels)
    imported = read_stills(path, None, unit="C", **MOMENT)
    (frame,), (info,) = imported.samples, imported.streams
    square = ((0.0, 0.0), (9.0, 0.0), (9.0, 9.0), (0.0, 9.0))
    aside = tuple((x + 20.0, y + 20.0) for x, y in square)
    regions = {
        place: Region(f"r{place}", RegionKind.TARGET, points) for place, points in enumerate((square, aside))
    }
    camera = CameraStream(info, regions, EstimatorSettings())
    sums = camera.sums(frame, camera.outline)
    whole = [int(region.mask(DEEP[0].shape).sum()) for region in regions.values()]
    assert sums.pixels == [whole[0] - 16, whole[1]]
    seen = regions[0].mask(DEEP[0].shape) & np.isfinite(pixels)
    assert sums.totals[0] / sums.pixels[0] == pytest.approx(DEEP[0][seen].mean(), abs=0.6)


def test_a_number_that_the_file_declares_as_no_data_has_no_value(tmp_path):
    path = tmp_path / "20260512.tif"
    tifffile.imwrite(path, np.where(DEEP[0] > 29_005, DEEP[0], 0), **gdal(0.01, 0.0, "K", "0"))
    imported = read_stills(path, None, **MOMENT)
    (frame,), (info,) = imported.samples, imported.streams
    assert np.isnan(frame_k(info, frame.counts, frame.metadata_rows)).sum() == 6
    assert frame.quality == Quality.GOOD


def test_an_option_for_other_numbers_is_refused(tmp_path):
    counts = tiff_file(tmp_path, tiff_pages((FIRST, {})))
    with pytest.raises(ConfigError, check=at(counts, Argument("unit"))):
        read_stills(counts, None, unit="C", **MOMENT)
    floats = tiff_file(tmp_path, tiff_pages((FIRST.astype(np.float32), {})))
    with pytest.raises(ConfigError, check=at(Argument("unit", "lx"), Argument("unit", "C"))):
        read_stills(floats, None, unit="lx", **MOMENT)
    with pytest.raises(ConfigError, check=at(floats, *SCALE), match=r"0\.01 .* 0\.04"):
        read_stills(floats, Scale(0.04), unit="C", **MOMENT)


def png(folder: Path, pixels: np.ndarray) -> Path:
    folder.mkdir(exist_ok=True)
    cv2.imwrite(str(folder / "20260512.png"), pixels)
    return folder


def test_png_of_16_bits_needs_its_scale(tmp_path):
    folder = png(tmp_path / "f", FIRST)
    path = folder / "20260512.png"
    (counts,) = frames_of(folder, **MOMENT)
    assert np.array_equal(counts, FIRST)
    with pytest.raises(ConfigError, check=at(path, Argument("kelvin_per_count", 0.01))):
        read_stills(folder, None, **MOMENT)
    for data in (cv2.imencode(".png", np.zeros((5, 7), np.uint8))[1].tobytes(), b"\x89PNG"):
        path.write_bytes(data)
        with pytest.raises(ConfigError, check=at(path)):
            frames_of(folder, **MOMENT)


def test_pngs_beside_other_frames_are_only_to_look_at(tmp_path):
    folder = png(tiffs(tmp_path / "f", ["20260512.tif"]), np.zeros((5, 7), np.uint8))
    (counts,) = frames_of(folder, **MOMENT)
    assert counts[0, 0] == 6900


def test_directories_in_a_circle_or_cut_off_are_named(tmp_path):
    data = tiff_pages((FIRST, {}), (FIRST, {}))
    for damaged in (data[:-4] + data[4:8], *(data[:n] for n in (0, 3, 7, len(data) - 1, len(data) - 100))):
        path = tiff_file(tmp_path, damaged)
        with pytest.raises(ConfigError, check=at(path)):
            frames_of(path, **MOMENT)


def test_frames_that_state_different_scales_are_not_taken_for_one(tmp_path):
    for name, magic in (("20260512.irg", b"\xba\xab"), ("20260513.irg", b"\xca\xac")):
        (tmp_path / name).write_bytes(irg(FIRST, magic))
    with pytest.raises(ConfigError, check=at(tmp_path / "20260512.irg"), match=r"20260513\.irg"):
        read_stills(tmp_path, None, **MOMENT)


def test_failed_import_leaves_nothing(tmp_path):
    folder = tiffs(tmp_path / "f", ["20260512T010000.tif", "20260512T010001.tif"])
    cv2.imwrite(str(folder / "20260512T010001.tif"), np.zeros((6, 7), np.uint16))  # of another size
    imported = read_stills(folder, Scale(0.01), time_format="%Y%m%dT%H%M%S", zone=UTC)
    with pytest.raises(ConfigError):
        write_imported(tmp_path / "a.h5", SessionHeader("t", SITE, imported.streams), imported, "f")
    assert [path.name for path in tmp_path.iterdir()] == ["f"]


@pytest.mark.parametrize(
    ("text", "time_format", "zone", "expected"),
    [
        ("2026-05-12T01:00:00Z", None, None, 1_778_547_600_000_000_000),
        ("2026-05-12T10:00:00+09:00", None, None, 1_778_547_600_000_000_000),
        ("1778547600.25", None, None, 1_778_547_600_250_000_000),
        ("1778547600,25", None, None, 1_778_547_600_250_000_000),
        ("1778547600250", None, None, 1_778_547_600_250_000_000),
        ("1778547600250001", None, None, 1_778_547_600_250_001_000),
        ("1778547600250000001", None, None, 1_778_547_600_250_000_001),
        ("202605121000", "%Y%m%d%H%M", ZoneInfo("Asia/Tokyo"), 1_778_547_600_000_000_000),
        ("20260512T100000250", "%Y%m%dT%H%M%S%f", ZoneInfo("Asia/Tokyo"), 1_778_547_600_250_000_000),
        ("2026/05/12 10:00:00", "yyyy/mm/dd HH:MM:SS", ZoneInfo("Asia/Tokyo"), 1_778_547_600_000_000_000),
        ("12.05.26 03:00", "%d.%m.%y %H:%M", ZoneInfo("Europe/Berlin"), 1_778_547_600_000_000_000),
    ],
)
def test_times_of_many_kinds(text, time_format, zone, expected):
    assert parse_times_ns([text], zone, time_format) == [expected]


@pytest.mark.parametrize(
    ("text", "fix"),
    [("2026051210", "%Y%m%d%H"), ("202605121000", "%Y%m%d%H%M"), ("20260512100000", "%Y%m%d%H%M%S")],
)
def test_date_and_hour_in_digits_are_never_unix_seconds(text, fix):
    with pytest.raises(ConfigError, check=at(f"'{text}'", Argument("time_format", fix))):
        parse_times_ns([text], UTC)  # 2026051210 s is March 2034


@pytest.mark.parametrize(
    ("text", "time_format", "wrong"),
    [
        ("2026-05-12 01:00 PM", "%Y-%m-%d %H:%M %p", "%I and %p"),  # strptime: 01:00
        ("2026-05-12 12:00", "%Y-%m-%d %I:%M", "%I and %p"),  # strptime: 00:00
        ("2026-05-12 12:00 UTC", "%Y-%m-%d %H:%M %Z", "%Z"),  # strptime: no zone
        ("2026-05-12 12:05", "yyyy-mm-dd HH:mm", "%m twice"),  # strptime: re.error
    ],
)
def test_what_strptime_would_read_wrongly_is_refused(text, time_format, wrong):
    with pytest.raises(ConfigError, match=wrong, check=at(Argument("time_format", time_format))):
        parse_times_ns([text], UTC, time_format)


@pytest.mark.parametrize(
    ("text", "time_format"),
    [
        ("202605121530", "%Y%m%d%H%M%S"),  # strptime: 15:03:00
        ("2026051", "%Y%m%d"),  # strptime: the 1st
        ("yesterday", None),
    ],
)
def test_what_is_no_time_is_refused(text, time_format):
    with pytest.raises(ConfigError, check=at(f"'{text}'")):
        parse_times_ns([text], UTC, time_format)


COUNTS = np.arange(18_000, 18_035, dtype=np.uint16).reshape(5, 7)


def test_irg_pictures_are_tenths_of_a_kelvin_where_all_readers_agree(tmp_path):
    for second, magic in enumerate((b"\xba\xab", b"\xb0\x0b")):
        (tmp_path / f"23020115291{second}.irg").write_bytes(irg(COUNTS // 6, magic))
    imported = read_stills(tmp_path, None, time_format="%y%m%d%H%M%S", zone=ZoneInfo("Europe/Amsterdam"))
    frames = [frame for frame in imported.samples if isinstance(frame, Frame)]
    assert all(np.array_equal(frame.counts, COUNTS // 6) for frame in frames)
    assert frames[0].time_ns == 1_675_261_750_000_000_000  # 2023-02-01T14:29:10Z by date(1)
    assert imported.streams[0].scale == 0.1
    assert "emissivity was 0.95" in imported.notes[0][1]


@pytest.mark.parametrize("given", [Scale(0.04), Scale(0.1, 2.0), Scale(math.nan)])
def test_a_scale_against_the_one_in_the_file_is_refused_with_both(tmp_path, given):
    path = tmp_path / "20230201.irg"
    path.write_bytes(irg(COUNTS // 6, b"\xba\xab"))
    with pytest.raises(ConfigError, match=r"0\.1 K .* 0 K .* (0|nan)", check=at(path, *SCALE)):
        read_stills(path, given, **MOMENT)
    assert read_stills(path, Scale(0.1), **MOMENT).streams[0].scale == 0.1


def test_irg_pictures_of_disputed_scale_ask_for_it(tmp_path):
    path = tmp_path / "20230201.irg"
    path.write_bytes(irg(COUNTS, b"\xca\xac"))
    with pytest.raises(ConfigError, check=at(path, Argument("kelvin_per_count", 0.0625))):
        read_stills(path, None, **MOMENT)
    assert read_stills(path, Scale(1 / 16), **MOMENT).streams[0].scale == 0.0625


@pytest.mark.parametrize(
    "data",
    [
        b"JFIF" * 40,
        irg(COUNTS)[:100],
        irg(COUNTS)[:-1],
        irg(COUNTS)[:4] + b"\xff" * 8 + irg(COUNTS)[12:],
    ],
    ids=["begins otherwise", "header cut off", "cut off", "other pixels"],
)
def test_other_irg_files_are_refused(tmp_path, data):
    (tmp_path / "1.irg").write_bytes(data)
    with pytest.raises(ConfigError, check=at(tmp_path / "1.irg")):
        read_stills(tmp_path / "1.irg", None, time_format="%y", zone=UTC)


def test_tiff_that_claims_more_than_any_camera_has_is_refused_unread(tmp_path):
    """The first directory of a TIFF (TIFF 6.0, section 2), and no pixels at all."""
    sides = struct.pack("<HHII", 256, 4, 1, 16_000) + struct.pack("<HHII", 257, 4, 1, 16_000)
    path = tmp_path / "2026.tif"
    path.write_bytes(b"II*\0" + struct.pack("<IH", 8, 2) + sides + bytes(4))
    with pytest.raises(ConfigError, match=" 16 million", check=at(path)):
        frames_of(path, time_format="%Y", zone=UTC)


def test_frames_that_came_in_bunches_are_flagged_whenever_they_are_read():
    """A ninth of a second apart but for two that were 20 ms apart: both stamps are of arrival."""
    time_ns = np.arange(12) * 111_000_000
    time_ns[5] = time_ns[4] + 20_000_000
    counts = np.zeros((2, 2), np.uint16)
    frames = [Frame("ir", int(at), int(at), counts, counts[:0]) for at in time_ns]
    flagged, notes = flag_bunched(lambda: iter(frames), time_ns.tolist())
    for _ in range(2):
        late = [n for n, frame in enumerate(flagged) if frame.quality]
        assert late == [4, 5]
    ((severity, said),) = notes
    assert severity is Severity.WARNING
    assert said.startswith("2 of 12 ")
    steady, nothing = flag_bunched(lambda: iter(frames[6:]), time_ns[6:].tolist())
    assert not any(frame.quality for frame in steady)
    assert nothing == ()


@pytest.mark.parametrize(
    "options",
    [
        {"name": "events"},
        {"name": "a/b"},
        {"zone": "Mars/Utopia"},
        {"kelvin_per_count": 0.0},
        {"kelvin_per_count": -0.01},
        {"kelvin_at_zero": math.nan},
        {"offset_s": float("inf")},
        {"keep": "middle"},
        {"measures": "par"},
    ],
)
def test_options_that_no_recording_has_are_refused(options):
    with pytest.raises(ConfigError, check=at(Argument(*options))):
        ImportOptions(**options)


def test_pipes_and_devices_are_refused_before_they_are_read(tmp_path):
    os.mkfifo(tmp_path / "log.csv")
    (tmp_path / "zero.csv").symlink_to("/dev/zero")
    for name in ("log.csv", "zero.csv", "missing.csv"):
        with pytest.raises(ConfigError, check=at(tmp_path / name)):
            read_source(tmp_path / name, ImportOptions())


@pytest.mark.parametrize(("scale", "is_named"), [(0.04, False), (0.01, True), (math.nan, False)])
def test_frames_that_cannot_be_are_named(tmp_path, scale, is_named):
    folder = tiffs(tmp_path / "f", ["20260512.tif"])
    imported = possible(read_stills(folder, Scale(scale), **MOMENT), {}, SITE)
    assert any(" 175 to 440" in text for _, text in imported.notes) is is_named
