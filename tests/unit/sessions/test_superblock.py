"""Opening a file whose writer was killed; hash values from the comments of Jenkins' lookup3.c (driver5)."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from fieldkit.model.errors import SessionError
from fieldkit.sessions.stored import whole_rows
from fieldkit.sessions.superblock import MendedFile, is_clean, lookup3


def test_lookup3_of_published_examples():
    assert lookup3(b"") == 0xDEADBEEF
    assert lookup3(b"Four score and seven years ago") == 0x17770551


def unclosed_copy(tmp_path: Path) -> Path:
    """What a killed SWMR writer leaves: the file as it was after a flush."""
    path, copy = tmp_path / "open.h5", tmp_path / "crashed.h5"
    with h5py.File(path, "w", libver=("v110", "v110")) as file:
        data = file.create_dataset("a/numbers", (0,), "i8", maxshape=(None,), chunks=(64,))
        file.swmr_mode = True
        data.resize((500,))
        data[:] = np.arange(500)
        file.flush()
        copy.write_bytes(path.read_bytes())
    assert is_clean(path)
    return copy


def test_file_of_a_killed_writer_opens_without_being_changed(tmp_path):
    path = unclosed_copy(tmp_path)
    before = path.read_bytes()
    assert not is_clean(path)
    with pytest.raises(OSError, match="h5clear"):
        h5py.File(path, "r")
    with h5py.File(MendedFile(path), "r") as file:
        assert np.array_equal(file["a/numbers"][:], np.arange(500))
    assert path.read_bytes() == before


def test_file_that_lost_its_end_opens_as_far_as_it_goes(tmp_path):
    path = unclosed_copy(tmp_path)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    with h5py.File(MendedFile(path), "r") as file:
        numbers = file["a/numbers"][:]
        there = whole_rows(file["a/numbers"], len(data) // 2)
    assert 0 < len(there) < 500
    assert np.array_equal(numbers[there], there)
    assert not numbers[there[-1] + 2 :].any()  # zeros stand for what is gone


@pytest.mark.parametrize("data", [b"", b"no", b"PK\3\4" + bytes(100), b"\x89HDF\r\n\x1a\n" + bytes(60)])
def test_other_files_are_refused_by_name(tmp_path, data):
    path = tmp_path / "photo.h5"
    path.write_bytes(data)
    with pytest.raises(SessionError, match=r"photo\.h5"):
        is_clean(path)
