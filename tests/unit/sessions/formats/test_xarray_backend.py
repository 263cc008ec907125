"""xarray opens sessions by itself, as it finds the backend by its entry point."""

from __future__ import annotations

import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

xr = pytest.importorskip("xarray")

from fieldkit.results.session import open_session  # noqa: E402
from fieldkit.sessions.writer import SessionWriter  # noqa: E402
from tests.harness.recording import CountedClock, fill, header  # noqa: E402


@pytest.fixture(scope="module")
def sealed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path, clock = tmp_path_factory.mktemp("sealed") / "field.h5", CountedClock()
    writer = SessionWriter(path, header((24, 32)), clock)
    fill(writer, 10, clock)
    writer.close()
    return path


@pytest.fixture
def path(sealed: Path, tmp_path: Path) -> Path:
    return Path(shutil.copy(sealed, tmp_path))


def test_xarray_finds_the_backend_and_reads_what_the_session_reads(path: Path) -> None:
    with xr.open_dataset(path, engine="fieldkit", group="camera") as dataset, open_session(path) as session:
        assert dataset.identical(session.to_xarray("camera"))
        np.testing.assert_array_equal(dataset["flags"], session.flags("camera"))
        np.testing.assert_allclose(dataset["brightness_temperature"], session.kelvin())
        assert session["lux"].to_xarray()["illuminance"].attrs["units"] == "lx"


def test_variables_can_be_dropped(path: Path) -> None:
    with xr.open_dataset(path, engine="fieldkit", group="camera", drop_variables="flags") as dataset:
        assert "flags" not in dataset


def test_without_a_group_the_streams_are_named(path: Path) -> None:
    with open_session(path) as session:
        names = ", ".join(session.streams)
    with pytest.raises(ValueError, match=names):
        xr.open_dataset(path, engine="fieldkit")


def test_other_files_are_left_to_other_backends(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = np.arange(3)
    (tmp_path / "text.h5").write_text("no HDF5")
    backend = xr.backends.list_engines()["fieldkit"]
    assert not backend.guess_can_open(tmp_path / "other.h5")
    assert not backend.guess_can_open(str(tmp_path / "text.h5"))
    assert not backend.guess_can_open(b"CDF")
