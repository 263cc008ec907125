"""A sample that does not match its checksum carries the flag in every reader, whichever way it is read."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from fieldkit.samples import Frame, Quality, Reading
from fieldkit.sessions.reader import Session, open_session
from fieldkit.sessions.writer import SessionWriter
from tests.harness.recording import CountedClock, fill, header

HEADER = header((24, 32))
FRAMES, DEPTH = 30, 9
BAD = int(Quality.BAD_CRC)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("whole") / "field.h5"
    clock = CountedClock()
    writer = SessionWriter(path, HEADER, clock)
    fill(writer, FRAMES, clock)
    writer.close()
    return path.read_bytes()


@pytest.fixture
def damaged(recorded: bytes, tmp_path: Path) -> Callable[..., Session]:
    """The session after one change to its file; see `flip` and `spoil`."""

    def opened(*changes: Callable[[Path], None]) -> Session:
        path = tmp_path / "field.h5"
        path.write_bytes(recorded)
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


def spoil(name: str, brick: int) -> Callable[[Path], None]:
    """One bit in the middle of a compressed chunk: it cannot be read any more."""

    def change(path: Path) -> None:
        with h5py.File(path, "r") as file:
            place = file[name].id.get_chunk_info_by_coord((brick * DEPTH, 0, 0))
        with path.open("r+b") as raw:
            raw.seek(place.byte_offset + place.size // 2)
            byte = raw.read(1)[0]
            raw.seek(-1, 1)
            raw.write(bytes([byte ^ 4]))

    return change


EXPONENT = 8 * 6 + 4
"""The lowest bit of a double's exponent: the value becomes twice or half as large."""
MEDDLED = [("lux/value", 1, EXPONENT), ("lux/flags", 1, 3), ("lux/mono_ns", 1, 40), ("lux/raw", 1, 0)]


@pytest.mark.parametrize("change", MEDDLED, ids=lambda change: change[0])
def test_a_meddled_reading_is_flagged_as_sample_and_as_array(damaged: Callable[..., Session], change) -> None:
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


def test_an_unreadable_chunk_loses_only_its_own_frames(damaged: Callable[..., Session]) -> None:
    lost = list(range(DEPTH, 2 * DEPTH))
    with damaged(spoil("camera/counts", 1)) as session:
        reader = session.stream("camera")
        frames = [one for one in session.samples("camera") if isinstance(one, Frame)]
        assert np.flatnonzero(reader.flags() & BAD).tolist() == lost
        pictures = np.concatenate([part.counts for part in reader.pictures()])
    assert [frame.seq for frame in frames if frame.quality & Quality.BAD_CRC] == lost
    assert len(frames) == len(pictures) == FRAMES
    assert np.array_equal(pictures, [frame.counts for frame in frames])


def test_a_whole_session_has_no_damaged_sample(damaged: Callable[..., Session]) -> None:
    with damaged() as session:
        for name in session.streams:
            assert not (session.stream(name).flags() & BAD).any()
            assert not session.stream(name).damaged
        thermometer = session.stream("thermometer").readings(2, 5)
        samples = list(session.stream("thermometer").samples(2, 5))
    assert thermometer.values.shape == (3, 4)
    assert [tuple(row) for row in thermometer.values] == [one.values for one in samples]
    assert thermometer.time_ns.tolist() == [one.time_ns for one in samples]
