"""What other programs get is what was recorded, with units and times."""

import json
import math
import shutil
from dataclasses import replace
from datetime import UTC
from pathlib import Path
from typing import Any

import cv2
import h5py
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from PIL import Image

from fieldkit.model.errors import ConfigError, SessionError, StorageError
from fieldkit.model.next_step import Argument
from fieldkit.model.samples import Event, EventKind, Quality
from fieldkit.model.site import Region, RegionKind
from fieldkit.palettes import palette
from fieldkit.physics.camera_laws import frame_k, ht301
from fieldkit.pixel_axes import BELOW_PX, LEFT_PX
from fieldkit.results.export import export
from fieldkit.results.session import open_session
from fieldkit.sessions.file_tree import LIBVER
from fieldkit.sessions.formats.exports import EXPORTS
from fieldkit.sessions.formats.images_out import export_frame_tables, export_pngs, export_tiffs, export_video
from fieldkit.sessions.formats.logs import read_log
from fieldkit.sessions.formats.netcdf_out import export_netcdf
from fieldkit.sessions.formats.stills import Scale, read_stills
from fieldkit.sessions.formats.tables_out import as_text, export_csv, export_parquet
from fieldkit.sessions.formats.tiff import read_pages
from fieldkit.sessions.reader import SessionReader
from fieldkit.sessions.records import MinuteRecord
from tests.harness.command_line import run_code
from tests.harness.disk import full_disk
from tests.harness.faults import small_session
from tests.harness.learnt import learnt
from tests.harness.next_steps import at, steps
from tests.harness.recording import START_NS, header, picture, recorded, sample, session_of

TABLES = {"csv": export_csv, "parquet": export_parquet}
HEADER = header((24, 32))
TWO_CAMERAS = replace(HEADER, streams=(*HEADER.streams, replace(HEADER.streams[0], name="cam2")))
FRAMES = 20
PLANCK = {"r1": 16125.788, "b": 1420.1, "f": 1.0, "o": -5588, "r2": 0.0109034}


def sealed_session(path: Path, *entries: Any, **changes: Any) -> SessionReader:
    """A session of these samples, events and minutes; `changes` are to its header."""
    return open_session(session_of(path, replace(HEADER, **changes), *entries))


@pytest.fixture(scope="module")
def sealed(tmp_path_factory):
    path = tmp_path_factory.mktemp("sealed") / "field.h5"
    recorded(path, HEADER, FRAMES)
    return path


@pytest.fixture
def session(sealed, tmp_path):
    with open_session(Path(shutil.copy(sealed, tmp_path))) as opened:
        yield opened


@pytest.fixture(scope="module")
def two_cameras(tmp_path_factory):
    path = tmp_path_factory.mktemp("two-cameras") / "field.h5"
    recorded(path, TWO_CAMERAS, 4)
    with open_session(path) as opened:
        yield opened


def test_region_series_is_mean_and_spread_of_its_pixels(session):
    series = session["camera"].region_series()
    assert series.regions == ("flat", "b05")
    mask = HEADER.regions[0].mask((24, 32))
    expected = np.array([picture(n, (24, 32))[mask] * 0.01 for n in range(FRAMES)])
    assert series.mean_k[:, 0] == pytest.approx(expected.mean(axis=1), abs=1e-9)
    assert series.spread_k[:, 0] == pytest.approx(expected.std(axis=1), abs=1e-9)
    assert series.pixels.tolist() == [mask.sum()] * 2
    assert series.flags[7] == 16  # shutter
    assert series.time_ns[0] == next(session.samples("camera")).time_ns


def test_another_calibration_may_be_chosen(session):
    doubled = session["camera"].kelvin(0, 2, calibration=lambda counts: counts * 0.02)
    assert doubled == pytest.approx(2 * session["camera"].kelvin(0, 2), abs=1e-9)
    assert np.array_equal(session.raw("camera")[3], picture(3, (24, 32)))


def test_region_outside_the_picture_and_meters_are_refused(session):
    outside = Region("far", RegionKind.TARGET, ((100.0, 100.0), (110.0, 100.0), (110.0, 110.0)))
    with pytest.raises(SessionError, match="far"):
        session["camera"].region_series([outside])
    with pytest.raises(SessionError, match="lux"):
        session.raw("lux")
    with pytest.raises(SessionError, match="sonar"):
        session["sonar"].to_pandas()


def test_pandas_has_units_in_its_columns_also_of_a_meter_without_a_reading(session, tmp_path):
    table = session["thermometer"].to_pandas()
    channels = ["T1 [K]", "T2 [K]", "T3 [K]", "T4 [K]"]
    assert list(table.columns[:4]) == channels
    assert table["T3 [K]"].iloc[4] == 252 + 4 / 3
    assert str(table.index.tz) == "UTC"
    with sealed_session(tmp_path / "a.h5") as empty:
        table = empty["thermometer"].to_pandas()
    assert (len(table), list(table.columns[:4])) == (0, channels)


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_tables_are_tidy_and_come_back(session, tmp_path, kind):
    paths = {path.stem.removeprefix("field-"): path for path in TABLES[kind](session, tmp_path)}
    assert set(paths) - {"datapackage"} == {"camera-regions", "lux", "thermometer", "slopes", "events"}
    read = pd.read_csv if kind == "csv" else pd.read_parquet
    regions = read(paths["camera-regions"])
    assert len(regions) == 2 * FRAMES
    flat = regions[regions["region"] == "flat"]["temperature [K]"].to_numpy()
    assert flat == pytest.approx(session["camera"].region_series().mean_k[:, 0], abs=1e-9)
    spread = regions[regions["region"] == "flat"]["spread [K]"].to_numpy()
    inside = session.regions[0].mask((24, 32))
    assert spread == pytest.approx(session["camera"].kelvin()[:, inside].std(axis=1), abs=1e-9)
    assert read(paths["events"])["text"].iloc[0] == "wolke über b05"


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "tiffs").mkdir()
    return tmp_path / "tiffs"


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    return small_session(tmp_path_factory.mktemp("small") / "field.h5", license="CC-BY-4.0")


def test_tables_of_meters_come_back_with_times_values_and_flags(tmp_path):
    lux = HEADER.streams[1]
    flags = [Quality.GOOD, Quality.OVERRANGE, Quality.STALE | Quality.DROPPED_BEFORE]
    samples = (sample(lux, seq)._replace(quality=quality) for seq, quality in enumerate(flags))
    with sealed_session(tmp_path / "a.h5", *samples, streams=(lux,)) as session:
        table, stored = export_csv(session, tmp_path)[0], session.readings(lux.name)
    imported = list(read_log(table, "x").samples)
    assert [reading.quality for reading in imported] == flags == stored.flags.tolist()
    assert [reading.time_ns // 1000 for reading in imported] == (stored.time_ns // 1000).tolist()
    np.testing.assert_allclose([reading.values for reading in imported], stored.values, rtol=1e-11)


@pytest.mark.parametrize("name", EXPORTS)
def test_every_format_is_written_and_on_a_disk_that_takes_no_more_no_part_of_a_file(name, small, tmp_path):
    written = export(small, name, tmp_path / "whole")
    whole = {path.name: path.stat().st_size for path in (tmp_path / "whole").iterdir()}
    assert (written.problems, {path.name for path in written.files}) == ((), whole.keys())
    assert all(whole.values())
    with full_disk(max(whole.values()) * 3 // 4), pytest.raises(StorageError) as caught:
        export(small, name, tmp_path / "full")
    assert caught.value.fix
    assert str(tmp_path / "full") in caught.value.message
    remaining = {path.name: path.stat().st_size for path in (tmp_path / "full").iterdir()}
    assert all(whole[name] == pytest.approx(size, rel=0.02) for name, size in remaining.items())


WITHOUT_EXTRAS = """
import sys
from pathlib import Path
from typing import Any
for name in sys.argv[3:]:
    sys.modules[name] = None  # as where it is not installed
import fieldkit
from fieldkit.model.errors import ConfigError
from fieldkit.sessions.formats.exports import EXPORTS
for name in EXPORTS:
    try:
        fieldkit.export(sys.argv[1], name, Path(sys.argv[2]) / name)
    except ConfigError:
        continue
    print(name)
"""


def test_most_formats_need_no_extra(small, tmp_path):
    extras = ("pandas", "pyarrow", "xarray", "matplotlib", "mcap", "mcap_ros2", "rasterio", "h5netcdf")
    printed = run_code(WITHOUT_EXTRAS, small, tmp_path, *extras)
    assert printed.split() == ["csv", "netcdf", "ro-crate", "png", "video", "frames-csv", "tiff"]


def test_table_of_slopes_has_both_ends_of_each_region(small, tmp_path):
    with open_session(small) as session:
        paths = {path.stem: path for path in export_csv(session, tmp_path)}
    (row,) = pd.read_csv(paths["field-slopes"]).to_dict("records")
    for angle, values in {"tilt": (4.0, 5.1, 6.0), "azimuth": (170.0, 181.0, 190.0)}.items():
        ends = (f"{angle} low [deg]", f"{angle} [deg]", f"{angle} high [deg]")
        assert tuple(row[name] for name in ends) == values
    assert row.keys() >= {"sensitivity [K/deg]", "chi-square", "confidence", "second tilt [deg]"}


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_table_of_events_has_kind_and_end_of_a_mark(tmp_path, kind):
    data = {"label": "cloud", "end_ns": START_NS + 60 * 10**9 + 1_000}
    cloud = Event(EventKind.MARK, 0, START_NS, "over b05", data=data)
    lightning = Event(EventKind.MARK, 1, START_NS + 1, "lightning")
    with sealed_session(tmp_path / "field.h5", cloud, lightning) as session:
        path = next(path for path in TABLES[kind](session, tmp_path) if "events" in path.name)
    table = pd.read_csv(path, keep_default_na=False) if kind == "csv" else pd.read_parquet(path)
    marks = table[table["kind"] == "mark"]
    assert marks["label"].tolist() == ["cloud", ""]
    first, second = pd.to_datetime(marks["end"], utc=True)
    assert first == pd.Timestamp(data["end_ns"], tz="UTC")
    assert pd.isna(second)


def test_tiffs_say_themselves_what_a_count_means_and_when_they_were_taken(session, folder):
    export_tiffs(session, folder)
    times = (folder / "times.csv").rename(folder.parent / "times.csv")
    originals = list(session.samples("camera"))
    for imported in (read_stills(folder, None), read_stills(folder, Scale(0.01), times=times, zone=UTC)):
        frames = list(imported.samples)
        assert (imported.streams[0].scale, imported.streams[0].offset) == (0.01, 0.0)
        assert [frame.time_ns // 1000 for frame in frames] == [frame.time_ns // 1000 for frame in originals]
        assert [frame.quality for frame in frames] == [frame.quality for frame in originals]
        assert all(np.array_equal(a.counts, b.counts) for a, b in zip(frames, originals, strict=True))


def test_frames_as_tables_come_back_through_import(session, folder):
    *paths, times = export_frame_tables(session, folder)
    imported = read_stills(folder, None, unit="C", times=times)
    (info,), frames = imported.streams, list(imported.samples)
    assert len(paths) == len(frames) == session.count("camera")
    kelvin = np.array([frame_k(info, frame.counts, frame.metadata_rows) for frame in frames])
    assert kelvin == pytest.approx(session["camera"].kelvin(), abs=0.0051, nan_ok=True)
    with pytest.raises(ConfigError, check=at(paths[0], Argument("unit", "C"))):
        read_stills(folder, None, times=times)


@pytest.mark.parametrize(
    ("scale", "step"),
    [(0.01, 0.01), (1 / 64, 0.02), (0.04, 0.04), (0.1, 0.16)],  # 655.35, 1023.98, 2621.4 and 6553.5 K
)
def test_temperatures_beyond_the_scale_of_tiffs_are_not_clipped(tmp_path, folder, scale, step, caplog):
    """A pixel of 65535 counts: 16 bits of 0.01 K end at 655.35 K, of 0.02 K at 1310.7 K and so on."""
    info = replace(HEADER.streams[0], scale=scale)
    hot = sample(info, 1)
    hot.counts[3, 4] = 65_535
    with sealed_session(tmp_path / "a.h5", sample(info, 0), hot, streams=(info,)) as session:
        export_tiffs(session, folder)
        expected = session["camera"].kelvin()
    imported = read_stills(folder, None)
    kelvin = np.array([frame.counts for frame in imported.samples]) * imported.streams[0].scale
    assert imported.streams[0].scale == step
    assert kelvin[1, 3, 4] == pytest.approx(65_535 * scale, abs=step / 2)
    assert np.abs(kelvin - expected).max() <= 0.51 * step
    assert (f"{step:g} K" in caplog.text) == (step > 0.01)


def test_pixels_without_a_temperature_are_zero_and_never_the_hottest(tmp_path):
    """FLIR's law has no solution for counts below -O, here 5588."""
    info = replace(HEADER.streams[0], law="planck", scale=float("nan"), settings=PLANCK)
    frame = sample(info, 0)
    frame.counts[:], frame.counts[3, 4] = 18_000, 5000
    with sealed_session(tmp_path / "a.h5", frame, streams=(info,)) as session:
        path, _ = export_tiffs(session, tmp_path)
    counts = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert counts[3, 4] == 0
    assert 28_000 < counts[0, 0] < 31_000


def test_tiffs_are_read_by_other_programs_with_their_tags(session, tmp_path):
    """Pillow, which knows nothing of fieldkit; tag 42112 is what GDAL takes scale and offset from."""
    path = export_tiffs(session, tmp_path)[7]
    with Image.open(path) as opened:
        tags, counts = dict(opened.tag_v2), np.array(opened)
    assert np.array_equal(counts, picture(7, (24, 32)))
    assert json.loads(tags[270])["flags"] == ["shutter"]
    assert json.loads(tags[270])["time"].startswith("2016-11-24T")
    assert tags[306].startswith("2016:11:24 ")
    assert '<Item name="SCALE" sample="0" role="scale">0.01</Item>' in tags[42112]


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"time": 3}', "[" * 10_000, '{"time": "t", "flags": 1}'])
def test_descriptions_of_other_programs_are_no_tags_of_ours(tmp_path, text):
    path = tmp_path / "other.tiff"
    Image.fromarray(np.full((4, 4), 30_000, np.uint16)).save(path, description=text)
    assert [page.tags for page in read_pages(path)] == [None]
    with pytest.raises(ConfigError, check=at(path, Argument("kelvin_per_count", 0.01))):
        read_stills(path, None)


def test_frames_of_the_ht301_have_kelvin_in_every_reader(tmp_path):
    """Its law takes four words and five coefficients from the metadata rows of each frame."""
    info = replace(
        HEADER.streams[0], shape=(24, 256), law="ht301", scale=float("nan"), metadata_shape=(4, 256)
    )
    words = np.zeros((4, 256), "<u2")
    words[0, 1], words[1, 0], words[1, 1] = 8617, 5000, 2932
    words.reshape(-1)[259:269] = np.array([0.01, 8.0, 0.0, 0.0, 0.6], "<f4").view("<u2")
    corners = ((1.0, 1.0), (90.0, 1.0), (90.0, 20.0), (1.0, 20.0))
    frames = []
    for seq in range(12):
        rows = words.copy()
        rows[1, 1] += 5 * seq  # the shutter warms by half a kelvin from frame to frame
        counts = np.full((24, 256), 4900 + seq, "<u2")
        frames.append(sample(info, seq)._replace(counts=counts, metadata_rows=rows))
    bed = Region("bed", RegionKind.TARGET, corners)
    with sealed_session(tmp_path / "a.h5", *frames, streams=(info,), regions=(bed,)) as session:
        expected = [ht301(frame.counts, frame.metadata_rows, {}).mean() for frame in frames]
        series, kelvin = session["camera"].region_series(), session["camera"].kelvin()
        paths = export_tiffs(session, tmp_path)[:-1]
    assert 280.0 < min(expected) < max(expected) < 310.0
    assert np.ptp(expected) > 5.0
    assert kelvin.mean(axis=(1, 2)) == pytest.approx(expected, abs=1e-4)
    assert series.mean_k[:, 0] == pytest.approx(expected, abs=1e-4)
    written = [cv2.imread(str(path), cv2.IMREAD_UNCHANGED).mean() * 0.01 for path in paths]
    assert written == pytest.approx(expected, abs=0.01)


def test_a_spreadsheet_computes_nothing_that_somebody_typed(tmp_path):
    lux = replace(HEADER.streams[1], shape=(2,), channels=("=1+1", "right"))
    typed = ('=HYPERLINK("http://a.example")', "+1", "-2", "@SUM(A1)", "\tx", "5 = 5")
    entries = [Event(EventKind.MARK, 0, START_NS, text) for text in typed]
    reading = sample(lux, 0)._replace(values=(3.0, 1.0))
    with sealed_session(tmp_path / "field.h5", reading, *entries, streams=(lux,)) as session:
        paths = {path.stem.removeprefix("field-"): path for path in export_csv(session, tmp_path)}
    texts = pd.read_csv(paths["events"])["text"].tolist()
    assert [text[0] for text in texts] == ["'", "'", "'", "'", "'", "5"]
    assert texts[0] == '\'=HYPERLINK("http://a.example")'
    table = pd.read_csv(paths["lux"])
    assert list(table.columns[1:3]) == ["'=1+1 [lx]", "right [lx]"]
    assert table["'=1+1 [lx]"].tolist() == [3.0]


@pytest.mark.parametrize("sign", "=+-@\uff1d\uff0b\uff0d\uff20")
@pytest.mark.parametrize("before", ["", "   ", " \t ", *"\t\r\n\xa0\u3000\u2003\u200b\ufeff\x00\x1f"])
def test_blanks_before_a_sign_do_not_make_a_formula_of_a_cell(before, sign):
    assert as_text(f"{before}{sign}1+1") == f"'{before}{sign}1+1"


@pytest.mark.parametrize("text", ["b15", " b15", "5 = 5", "a\n=1", "", " ", "°C", "(=1)", "\u200bx=1"])
def test_other_cells_of_a_table_stay_as_they_are(text):
    assert as_text(text) == text


def test_tiffs_of_two_sessions_in_one_folder_come_back_through_import(sealed, tmp_path, folder):
    for name in ("a.h5", "b.h5", "a.h5"):
        with open_session(Path(shutil.copy(sealed, tmp_path / name))) as session:
            export_tiffs(session, folder, every=FRAMES // 2)
    assert len((folder / "times.csv").read_text().splitlines()) == 1 + 2 * 2
    assert len(list(read_stills(folder, Scale(0.01), times=folder / "times.csv", zone=UTC).samples)) == 4


@pytest.mark.parametrize("export", [export_tiffs, export_pngs, export_video])
def test_pictures_of_each_camera_have_files_of_their_own(two_cameras, tmp_path, export):
    first, second = (
        {path for path in export(two_cameras, tmp_path, stream=name, every=4) if path.suffix != ".csv"}
        for name in ("camera", "cam2")
    )
    assert not first & second
    assert all(path.exists() for path in first | second)


@pytest.mark.parametrize("export", [export_tiffs, export_pngs, export_video])
def test_camera_that_is_not_known_is_asked_for(two_cameras, tmp_path, export):
    with pytest.raises(SessionError, match="camera, cam2") as caught:
        export(two_cameras, tmp_path)
    assert steps(caught.value) == [Argument("stream")]
    with pytest.raises(SessionError, match="'lux'"):
        export(two_cameras, tmp_path, stream="lux")


def test_pictures_show_scale_and_regions(session, tmp_path):
    (path,) = export_pngs(session, tmp_path, every=FRAMES)
    image = cv2.imread(str(path))
    assert image.shape == (24 * 20 + BELOW_PX + 36, 640 + LEFT_PX, 3)
    first = HEADER.regions[0].points_px[0]
    x, y = (int((pixel + 0.5) * 20) for pixel in first)
    x += LEFT_PX
    assert image[y, x + 40].min() > 200  # the outline's upper edge
    assert image[y + 7, x + 4].max() < 20  # beside the name


def test_a_video_shows_each_frame_as_long_as_it_lasted_at_its_speed(session, tmp_path):
    times = [frame.time_ns for frame in session.samples("camera")]
    lasted_s = (times[FRAMES // 2] - times[0]) / 1e9
    # the first frame for 0.2 s at 25 pictures a second, the other once; without a speed each once
    for speed, count in ((lasted_s / 0.2, 6), (math.inf, 2)):
        (film,) = export_video(session, tmp_path, speed=speed, every=FRAMES // 2)
        reader = cv2.VideoCapture(str(film))
        assert int(reader.get(cv2.CAP_PROP_FRAME_COUNT)) == count
        reader.release()


def test_images_have_the_colours_of_the_palette_that_is_named(session, tmp_path):
    """White is hot: the left end of the scale is black, the right one white, and all is grey."""
    path = export_pngs(session, tmp_path, palette="white-hot", every=FRAMES)[0]
    bar = cv2.imread(str(path))[-30]
    assert (bar[0].tolist(), bar[-1].tolist()) == ([0] * 3, [255] * 3)
    assert (bar == bar[:, :1]).all()
    with pytest.raises(ConfigError, check=at(Argument("palette", "jet"))):
        export_pngs(session, tmp_path, palette="jet")


@pytest.mark.parametrize(
    ("name", "coldest", "hottest"),
    [
        ("inferno", (0, 0, 4), (252, 255, 164)),  # matplotlib's inferno.colors
        ("cividis", (0, 34, 78), (254, 232, 56)),  # matplotlib's cividis.colors
    ],
)
def test_a_palette_begins_and_ends_as_published(name, coldest, hottest):
    assert palette(name)[[0, -1]] == pytest.approx(np.array([coldest, hottest]), abs=1)


def test_only_frames_between_two_times_are_written_and_all_are_counted(session, tmp_path):
    frames, passed = list(session.samples("camera")), []
    between = frames[3].time_ns, frames[5].time_ns
    files = export_pngs(session, tmp_path, between_ns=between, on_frame=lambda: passed.append(1))
    assert [int(path.stem[-7:]) for path in files] == [frame.seq for frame in frames[3:6]]
    assert len(passed) == FRAMES


@pytest.mark.parametrize("engine", ["h5netcdf"])  # netcdf4: tests/e2e/test_ecosystem.py
def test_a_netcdf_file_holds_streams_and_tables_under_their_names(session, tmp_path, engine):
    (path,) = export_netcdf(session, tmp_path)
    with xr.open_datatree(path, engine=engine) as tree:
        assert set(tree.children) == {*session.streams, *session.tables}
        kelvin = tree["camera"]["brightness_temperature"]
        assert kelvin.sizes == {"time": FRAMES, "y": 24, "x": 32}
        assert kelvin.values == pytest.approx(session["camera"].kelvin(), abs=1e-9)
        assert tree["lux"]["illuminance"].values.tolist() == session.readings("lux").values[:, 0].tolist()
        for name in ("camera", "lux"):  # to the nanosecond
            assert tree[name]["time"].values.astype(np.int64).tolist() == session.times_ns(name).tolist()
        assert tree["events"]["time"].values.astype(np.int64).tolist() == [
            event.time_ns for event in session.events()
        ]
        assert tree.attrs["title"] == HEADER.title
        assert tree.attrs["session_id"] == session.session_id
        assert tree.attrs["site_latitude_deg"] == HEADER.site.latitude_deg


def test_netcdf_of_a_camera_of_another_law_has_kelvin(tmp_path):
    planck = replace(HEADER.streams[0], law="planck", scale=float("nan"), settings=PLANCK)
    recorded(tmp_path / "field.h5", replace(HEADER, streams=(planck,)), FRAMES)
    with open_session(tmp_path / "field.h5") as session:
        (path,) = export_netcdf(session, tmp_path)
        with xr.open_dataset(path, group="camera", engine="h5netcdf") as camera:
            assert "counts" not in camera
            assert camera["brightness_temperature"].dims == ("time", "y", "x")
            assert camera["brightness_temperature"].values == pytest.approx(
                session["camera"].kelvin(), abs=1e-4, nan_ok=True
            )


def test_netcdf_and_xarray_have_what_was_learnt(tmp_path):
    """In the second of two minutes."""
    second = MinuteRecord(START_NS + 60 * 10**9, (), learnt=replace(learnt(), chi_square=math.nan))
    with sealed_session(tmp_path / "field.h5", MinuteRecord(START_NS, ()), second) as session:
        export_netcdf(session, tmp_path)
    for suffix in (".nc", ".h5"):
        path = (tmp_path / "field").with_suffix(suffix)
        with xr.open_dataset(path, group="learnt", engine="h5netcdf") as found:
            assert found["value"].dims == ("time", "parameter")
            assert found["residual_k"].dims == ("time", "region")
            assert found["name"][0, :3].astype(str).values.tolist() == ["gain", "exchange", "thermal_inertia"]
            assert found["value"][0, 3] == learnt().parameters[3].value


SECRET = 424242.0


def _linked_scale(file: h5py.File, beside: Path) -> None:
    file["lux/humidity"] = h5py.ExternalLink(str(beside), "/secret")


def _stored_elsewhere(file: h5py.File, beside: Path) -> None:
    with h5py.File(beside) as other:
        place = other["secret"].id.get_offset()
    file.create_dataset("lux/humidity", (8,), "<f8", external=[(str(beside), place, 64)])


def _mapped_together(file: h5py.File, beside: Path) -> None:
    layout = h5py.VirtualLayout((8,), "<f8")
    layout[:] = h5py.VirtualSource(str(beside), "secret", (8,))
    file.create_virtual_dataset("lux/humidity", layout)


@pytest.mark.parametrize("lead_out", [_linked_scale, _stored_elsewhere, _mapped_together])
def test_numbers_of_another_file_never_come_along(sealed, tmp_path, lead_out):
    shutil.copy(sealed, tmp_path)
    with h5py.File(tmp_path / "beside.h5", "w", libver=LIBVER) as other:
        other["secret"] = np.full(8, SECRET)
    with h5py.File(tmp_path / "field.h5", "r+", libver=LIBVER, track_order=True) as file:
        lead_out(file, tmp_path / "beside.h5")
    out = tmp_path / "out"
    out.mkdir()
    with open_session(tmp_path / "field.h5") as session:
        with pytest.raises(SessionError, match=r"lux/humidity|points somewhere else"):
            export_netcdf(session, out)
        with pytest.raises(SessionError):
            session["lux"].to_xarray()
        export_csv(session, out)
    written = b"".join(path.read_bytes() for path in out.iterdir())
    assert np.float64(SECRET).tobytes() not in written
    assert str(int(SECRET)).encode() not in written


def test_netcdf_has_what_a_newer_version_adds(sealed, tmp_path):
    shutil.copy(sealed, tmp_path)
    with h5py.File(tmp_path / "field.h5", "r+", libver=LIBVER, track_order=True) as file:
        file["lux/humidity"] = np.full(5, 0.6)
    with open_session(tmp_path / "field.h5") as session:
        export_netcdf(session, tmp_path)
    with h5py.File(tmp_path / "field.nc") as copy:
        assert copy["lux/humidity"][:].tolist() == [0.6] * 5
