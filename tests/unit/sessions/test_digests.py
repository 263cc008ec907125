"""Everything that gives the numbers of a session their meaning is sealed, and `check` names what changed."""

import logging
import shutil
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from fieldkit.sessions.check import check
from fieldkit.sessions.file_tree import LIBVER
from fieldkit.sessions.finished_file import apply_time_map
from fieldkit.sessions.formats.imported import ImportedRecording
from fieldkit.sessions.formats.merged import merge
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.recovery import recover
from fieldkit.sessions.time_map import TimeStep
from tests.harness.faults import flip_byte, mark_unfinished
from tests.harness.recording import header, recorded, sample


@pytest.fixture(scope="module")
def sealed(tmp_path_factory):
    path = tmp_path_factory.mktemp("sealed") / "field.h5"
    recorded(path, header((24, 32)), 12)
    return path


@pytest.fixture
def path(sealed, tmp_path):
    shutil.copy(sealed, tmp_path)
    return tmp_path / sealed.name


def failed(path: Path) -> list[str]:
    """What `check` calls damaged."""
    return [one.what for one in check(path) if one.level == "fail"]


def flip(path: Path, dataset: str, within: int, bit: int) -> None:
    """Turn one bit of a value that lies at one place of the file."""
    with h5py.File(path) as file:
        place = file[dataset].id.get_offset() + within
    flip_byte(path, place, 1 << bit)


def header_place(path: Path, text: bytes) -> int:
    with h5py.File(path) as file:
        return int(file["config/header"][()].index(text))


def test_moved_site_is_named_and_said_when_the_session_is_opened(path, caplog):
    place = header_place(path, b"35.558675")
    flip(path, "config/header", place + 1, 2)  # 35 becomes 31 degrees
    assert failed(path) == ["config/header"]
    with caplog.at_level(logging.WARNING), open_session(path) as session:
        assert session.site.latitude_deg == 31.558675
    assert "config/header" in caplog.text


def test_other_scale_is_named(path):
    place = header_place(path, b'"scale": 0.01')
    flip(path, "config/header", place + len(b'"scale": 0.0'), 1)  # 0.01 becomes 0.03 K per count
    assert failed(path) == ["config/header"]


def test_each_changed_value_is_named(path):
    changed = {
        "entry/utc_minus_mono_ns", "entry/start_time", "config/session_toml", "learnt/region",
        "camera/y",
    }  # fmt: skip
    for dataset in changed:
        flip(path, dataset, 0, 0)
    assert changed - set(failed(path)) == set()


def test_changed_attribute_is_named(path):
    with h5py.File(path, "r+", libver=LIBVER) as file:
        file["camera/counts"].attrs["scale_factor"] = 0.03  # what xarray makes kelvin of
        file["entry/site"].attrs["latitude_deg"] = 31.0
    assert failed(path) == ["camera/counts", "entry/site"]


def test_exchanged_axes_are_named(path):
    with h5py.File(path, "r+", libver=LIBVER) as file:
        counts = file["camera/counts"]
        counts.dims[1].detach_scale(file["camera/y"])
        counts.dims[1].attach_scale(file["lux/byte"])
        file["lux/byte"].attrs["NAME"] = np.bytes_("z")
    assert "camera/counts" in failed(path)


def test_object_that_is_gone_or_was_added_is_named(path):
    with h5py.File(path, "r+", libver=LIBVER) as file:
        del file["entry/user/name"]
        file["camera/more"] = 1
    assert set(failed(path)) == {"entry/user", "entry/user/name", "camera"}


def test_digests_are_of_what_is_read_not_of_where_it_lies(path):
    before = path.read_bytes()
    with h5py.File(path, "r+", libver=LIBVER) as file:
        for name in ("time", "counts"):
            file["camera"][name].attrs["passing"] = "x" * 300
            del file["camera"][name].attrs["passing"]
        file["site_of_the_old_header"] = file["config/header"][()]
        del file["site_of_the_old_header"]
    assert path.read_bytes() != before
    assert failed(path) == []


def test_corrections_after_the_seal_leave_it_whole_and_are_under_checksums(path):
    apply_time_map(path, [TimeStep(0, 10**9, "gps")])
    apply_time_map(path, [TimeStep(0, 2 * 10**9, "gps again")])
    assert failed(path) == []
    with h5py.File(path) as file:
        place = file["time_map/add_ns"].id.get_chunk_info(0).byte_offset + 8 + 5
    flip_byte(path, place)  # eighteen minutes more
    assert any("/time_map" in finding.text for finding in check(path) if finding.level == "fail")


def test_recovered_and_merged_sessions_are_sealed_the_same_way(path, tmp_path):
    mark_unfinished(path)
    recover(path)
    assert failed(path) == []
    logger = replace(header().streams[1], name="logger")
    with open_session(path) as session:
        readings = [sample(logger, n, time_ns=session.start_ns + n) for n in range(3)]
        merge(session, ImportedRecording((logger,), readings), tmp_path / "m.h5", "log.csv")
    assert failed(tmp_path / "m.h5") == []


def test_file_without_its_digests_is_damaged(path):
    with h5py.File(path, "r+", libver=LIBVER) as file:
        del file["integrity/object_sha256"]
    assert failed(path) == ["file"]
