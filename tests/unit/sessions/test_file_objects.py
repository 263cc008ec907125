"""Sessions that are not files of this computer: file objects, and addresses in place of paths."""

import io
import shutil

import fsspec
import numpy as np
import pytest

import fieldkit
from fieldkit.model.errors import SessionError
from tests.harness.command_line import fieldkit as command
from tests.harness.recording import header, recorded
from tests.harness.two_sessions import copy_of_both


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    folder = copy_of_both(tmp_path_factory, tmp_path_factory.mktemp("objects"))
    return sorted((folder / "recordings").glob("*.h5"))[0]


@pytest.fixture
def in_memory(path):
    memory = fsspec.filesystem("memory")
    with path.open("rb") as source, memory.open("/field.h5", "wb") as target:
        shutil.copyfileobj(source, target)
    with memory.open("/field.h5", "rb") as file:
        yield file
    memory.rm("/field.h5")


def test_a_file_object_gives_the_same_samples_and_slopes(path, in_memory, tmp_path):
    with fieldkit.open_session(path) as session, fieldkit.open_session(in_memory) as remote:
        assert (remote.state, remote.name) == ("sealed", "field")
        assert np.array_equal(remote["camera"].kelvin(0, 3), session["camera"].kelvin(0, 3))
        assert remote.estimate(model="full").rows.tobytes() == session.estimate(model="full").rows.tobytes()
        (lux,) = (file for file in remote.export("csv", tmp_path).files if file.stem.endswith("lux"))
        assert lux.exists()
        for write in (remote.check, remote.report, lambda: remote.export("csv")):
            with pytest.raises(SessionError) as error:
                write()
            assert (error.value.place, bool(error.value.fix)) == (remote.path, True)
    assert not in_memory.closed


def test_a_file_object_that_its_writer_left_unfinished_is_interrupted(tmp_path):
    recorded(tmp_path / "a.h5", header((24, 32)), 5)
    data = bytearray((tmp_path / "a.h5").read_bytes())
    data[11] = 1  # "being written" in the superblock
    with fieldkit.open_session(io.BytesIO(data)) as session:
        assert session.count("camera") == 5


@pytest.mark.parametrize("data", [b"", b"no session", bytes(100)])
def test_what_is_no_session_is_refused(data):
    with pytest.raises(SessionError):
        fieldkit.open_session(io.BytesIO(data))


@pytest.mark.parametrize("address", ["s3://bucket/day.h5", "https://example.org/day.h5", "gs://b/day.h5"])
def test_an_address_is_named_as_such_with_the_next_step(address):
    with pytest.raises(SessionError) as error:
        fieldkit.open_session(address)
    assert "fsspec" in str(error.value.fix)
    shown = command("show", address)
    assert (shown.exit_code, "fsspec" in shown.stderr) == (3, True)
