"""A sample that does not match its checksum carries the flag in every reader, whichever way it is read."""

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
import xarray as xr

from fieldkit.model.errors import IncompleteError, IntegrityError, SessionError
from fieldkit.model.next_step import Argument
from fieldkit.model.samples import Frame, Quality, Reading
from fieldkit.results.session import open_session
from fieldkit.sessions.analysis import minute_means
from fieldkit.sessions.formats.images_out import export_pngs, export_tiffs
from fieldkit.sessions.formats.netcdf_out import export_netcdf
from fieldkit.sessions.formats.tables_out import export_csv
from fieldkit.sessions.reader import SessionReader
from tests.harness.faults import flip_byte
from tests.harness.next_steps import steps
from tests.harness.recording import header, recorded

HEADER = header((24, 32))
FRAMES, DEPTH = 30, 9
BAD = int(Quality.BAD_CRC)


@pytest.fixture(scope="module")
def content(tmp_path_factory):
    path = tmp_path_factory.mktemp("whole") / "field.h5"
    recorded(path, HEADER, FRAMES)
    return path.read_bytes()


@pytest.fixture
def damaged(content, tmp_path):
    """The session after one change to its file; see `flip` and `spoil`."""

    def opened(*changes: Callable[[Path], None]) -> SessionReader:
        path = tmp_path / "field.h5"
        path.write_bytes(content)
        for change in changes:
            change(path)
        return open_session(path)

    return opened


def flip(name: str, row: int, bit: int) -> Callable[[Path], None]:
    """One bit of a number in an uncompressed column."""

    def change(path: Path) -> None:
        with h5py.File(path, "r+") as file:
            dataset = file[name]
            whole = dataset[:]
            whole[row : row + 1].view("u1").reshape(-1)[bit // 8] ^= np.uint8(1 << bit % 8)
            dataset[:] = whole

    return change


def spoil(name: str, block: int) -> Callable[[Path], None]:
    """One bit in the middle of a compressed chunk: it cannot be read any more."""

    def change(path: Path) -> None:
        with h5py.File(path, "r") as file:
            place = file[name].id.get_chunk_info_by_coord((block * DEPTH, 0, 0))
        flip_byte(path, place.byte_offset + place.size // 2, 4)

    return change


EXPONENT = 8 * 6 + 4
"""The lowest bit of a double's exponent: the value becomes twice or half as large."""
MEDDLED = [("lux/value", 1, EXPONENT), ("lux/flags", 1, 3), ("lux/mono_ns", 1, 40), ("lux/raw", 1, 0)]


@pytest.mark.parametrize("change", MEDDLED, ids=lambda change: change[0])
def test_a_meddled_reading_is_flagged_as_sample_and_as_array(damaged, change):
    with damaged(flip(*change)) as session:
        reader = session.stream("lux")
        samples = [one for one in session.samples("lux") if isinstance(one, Reading)]
        readings = reader.readings()
        assert np.flatnonzero(reader.flags() & BAD).tolist() == [1]
        assert reader.damaged == {1}
    assert np.flatnonzero(readings.flags & BAD).tolist() == [1]
    assert [one.seq for one in samples if one.quality & Quality.BAD_CRC] == [1]
    assert [one.quality for one in samples] == readings.flags.tolist()
    assert [one.values[0] for one in samples] == readings.values[:, 0].tolist()


def test_an_unreadable_chunk_loses_only_its_own_frames(damaged):
    lost = list(range(DEPTH, 2 * DEPTH))
    with damaged(spoil("camera/counts", 1)) as session:
        reader = session.stream("camera")
        frames = [one for one in session.samples("camera") if isinstance(one, Frame)]
        assert np.flatnonzero(reader.flags() & BAD).tolist() == lost
        pictures = np.concatenate([part.counts for part in reader.frame_blocks()])
    assert [frame.seq for frame in frames if frame.quality & Quality.BAD_CRC] == lost
    assert len(frames) == len(pictures) == FRAMES
    assert np.array_equal(pictures, [frame.counts for frame in frames])


def test_a_damaged_stamp_moves_no_other_sample(damaged):
    with damaged() as session:
        order = [(one.stream, one.seq) for one in session.samples()]
    with damaged(flip("lux/mono_ns", 2, 61)) as session:  # seventy years later
        others = [(one.stream, one.seq) for one in session.samples() if not one.quality & Quality.BAD_CRC]
    order.remove(("lux", 2))
    assert others == order


def test_a_whole_session_has_no_damaged_sample(damaged):
    with damaged() as session:
        for name in session.streams:
            assert not (session.stream(name).flags() & BAD).any()
            assert not session.stream(name).damaged
        thermometer = session.stream("thermometer").readings(2, 5)
        samples = list(session.stream("thermometer").samples(2, 5))
    assert thermometer.values.shape == (3, 4)
    assert [tuple(row) for row in thermometer.values] == [one.values for one in samples]
    assert thermometer.time_ns.tolist() == [one.time_ns for one in samples]


def test_kelvin_of_a_damaged_frame_is_refused_or_nan(damaged):
    with damaged(spoil("camera/counts", 1)) as session:
        with pytest.raises(IntegrityError, match="frame 9") as caught:
            session["camera"].kelvin()
        assert Argument("damaged", "nan") in steps(caught.value)
        kelvin = session["camera"].kelvin(damaged="nan")
        assert session["camera"].kelvin(0, DEPTH).shape == (DEPTH, 24, 32)
    bad = np.isnan(kelvin).all(axis=(1, 2))
    assert np.flatnonzero(bad).tolist() == list(range(DEPTH, 2 * DEPTH))
    assert np.isfinite(kelvin[~bad]).all()


@pytest.mark.parametrize("block", [0, 3])
def test_a_region_goes_on_behind_an_unreadable_chunk(damaged, block):
    with damaged() as session:
        whole = session["camera"].region_series()
    with damaged(spoil("camera/counts", block)) as session:
        series = session["camera"].region_series()
    lost = np.arange(FRAMES) // DEPTH == block
    assert ((series.flags & BAD) != 0).tolist() == lost.tolist()
    assert np.isnan(series.mean_k[lost]).all()
    assert np.array_equal(series.mean_k[~lost], whole.mean_k[~lost])
    assert np.array_equal(series.spread_k[~lost], whole.spread_k[~lost])


@pytest.mark.parametrize("column", ["flags", "mono_ns", "time", "fpa_temperature"])
def test_a_region_has_the_flag_of_a_frame_whose_stamps_are_meddled_with(damaged, column):
    with damaged() as session:
        assert session.columns_are_sealed("camera")
    with damaged(flip(f"camera/{column}", 5, 4)) as session:
        assert not session.columns_are_sealed("camera")
        series = session["camera"].region_series()
    assert np.flatnonzero(series.flags & BAD).tolist() == [5]


def test_tables_of_pandas_and_xarray_have_the_flag(damaged):
    with damaged(flip("lux/value", 1, EXPONENT), spoil("camera/counts", 1)) as session:
        assert np.flatnonzero(session["lux"].to_pandas()["flags"] & BAD).tolist() == [1]
        assert (session["camera"].to_pandas()["flags"] & BAD).astype(bool).sum() == DEPTH
        lux, camera = session["lux"].to_xarray(), session["camera"].to_xarray()
    with lux, camera:  # read when the session has long been closed
        assert np.flatnonzero(lux["flags"].values & BAD).tolist() == [1]
        assert (camera["flags"][DEPTH - 1 : DEPTH + 2].values & BAD).tolist() == [0, BAD, BAD]
        assert int(camera["flags"][-1]) & BAD == 0
        assert "bad_crc" in camera["flags"].attrs["flag_meanings"].split()


def test_light_is_not_averaged_over_a_meddled_reading(damaged):
    with damaged() as session:
        good = session.readings("lux").values[:, 0]
    with damaged(flip("lux/value", 1, EXPONENT)) as session:
        _, means = minute_means(session, "lux")
        assert session.damaged == {"lux": 1}
    assert means == pytest.approx([np.delete(good, [1, 7]).mean()])  # 7 is flagged by the recording


def test_tables_are_written_with_the_flag(damaged, tmp_path):
    with damaged(flip("lux/value", 1, EXPONENT), spoil("camera/counts", 1)) as session:
        paths = {path.stem.removeprefix("field-"): path for path in export_csv(session, tmp_path)}
        assert session.damaged == {"lux": 1, "camera": DEPTH}
    lux, regions = pd.read_csv(paths["lux"]), pd.read_csv(paths["camera-regions"])
    assert np.flatnonzero(lux["flags"] & BAD).tolist() == [1]
    bad = (regions["flags"] & BAD) != 0
    assert bad.sum() == 2 * DEPTH
    assert regions["temperature [K]"].isna().tolist() == bad.tolist()


def test_pictures_are_written_without_the_damaged_ones(damaged, tmp_path):
    with damaged(spoil("camera/counts", 1)) as session:
        names = {int(path.stem[-7:]) for path in export_tiffs(session, tmp_path) if path.suffix == ".tiff"}
        assert len(export_pngs(session, tmp_path)) == FRAMES - DEPTH
        assert session.damaged == {"camera": DEPTH}
    assert names == set(range(FRAMES)) - set(range(DEPTH, 2 * DEPTH))


def test_netcdf_has_the_flag_and_the_fill_value(damaged, tmp_path):
    with damaged(spoil("camera/counts", 1), flip("lux/value", 1, EXPONENT)) as session:
        export_netcdf(session, tmp_path)
        kelvin = session["camera"].kelvin(damaged="nan")
    with xr.open_dataset(tmp_path / "field.nc", group="camera", engine="h5netcdf") as camera:
        lost = (camera["flags"].values & BAD) != 0
        assert np.flatnonzero(lost).tolist() == list(range(DEPTH, 2 * DEPTH))
        assert np.isnan(camera["brightness_temperature"].values[lost]).any(axis=(1, 2)).all()
        assert camera["brightness_temperature"].values[~lost] == pytest.approx(kelvin[~lost], abs=1e-9)
    with xr.open_dataset(tmp_path / "field.nc", group="lux", engine="h5netcdf") as lux:
        assert np.flatnonzero(lux["flags"].values & BAD).tolist() == [1]


def remove_table(path: Path) -> None:
    with h5py.File(path, "r+") as file:
        del file["estimates"]


@pytest.mark.parametrize("export", [export_csv, export_netcdf])
def test_a_table_that_is_gone_does_not_stop_the_others(damaged, tmp_path, export):
    with damaged(remove_table) as session, pytest.raises(IncompleteError, match="not exported") as caught:
        export(session, tmp_path)
    if export is export_csv:
        written = {path.stem.removeprefix("field-") for path in caught.value.files}
    else:
        with h5py.File(*caught.value.files) as file:
            written = {*file}
    assert {"lux", "thermometer", "events"} <= written
    assert "estimates" not in written
    assert all(path.exists() for path in caught.value.files)


def spoil_group(name: str) -> Callable[[Path], None]:
    """One bit in the object header of a group: HDF5 opens it, and cannot read what is in it."""

    def change(path: Path) -> None:
        with h5py.File(path, "r") as file:
            place = h5py.h5o.get_info(file[name].id).addr
        flip_byte(path, place + 40, 4)

    return change


def test_a_damaged_seal_takes_nothing_from_the_samples(damaged):
    with damaged() as session:
        whole = session["camera"].region_series()
    with damaged(spoil_group("integrity")) as session:
        assert not session.columns_are_sealed("camera")
        assert np.array_equal(session["camera"].region_series().mean_k, whole.mean_k)


@pytest.mark.parametrize("name", ["regions", "camera", "lux"])
def test_a_damaged_group_is_explained(damaged, name):
    with pytest.raises(SessionError, match="is damaged"), damaged(spoil_group(name)) as session:
        session["camera"].region_series()


def test_values_leave_a_session_only_with_their_verified_flags():
    """The column alone does not say whether its numbers are those that were measured."""
    top = Path(__file__).resolve().parents[3]
    files = [path for room in ("fieldkit", "sessions") for path in (top / room).rglob("*.py")]
    assert len(files) > 150
    readers = {path.name for path in files if '.column("value"' in path.read_text(encoding="utf-8")}
    assert readers == {"stream_reader.py"}
