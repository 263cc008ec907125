"""Sizes, lengths and counts that a file declares are compared with its bytes, before anything is made."""

import json
import shutil
import struct
import tracemalloc
from contextlib import contextmanager

import h5py
import numpy as np
import pytest

from fieldkit.model.errors import SessionError
from fieldkit.sessions import journal
from fieldkit.sessions.file_tree import LIBVER
from fieldkit.sessions.lock import journal_path
from fieldkit.sessions.log import Kind, LogReader, LogWriter
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.recovery import recover
from fieldkit.sessions.superblock import SIZE, lookup3
from fieldkit.sessions.writer import SessionWriter
from tests.harness.recording import CountedClock, header, sample

HEADER, FRAMES = header((24, 32)), 40
LARGE, WIDE = [4000, 4000], [60_000]  # within what an instrument may have, and not in these files


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """A sealed session, and the same one interrupted."""
    folder = tmp_path_factory.mktemp("recorded")
    for name in ("sealed", "cut"):
        writer = SessionWriter(folder / f"{name}.h5", HEADER, CountedClock())
        for seq in range(FRAMES):
            for info in HEADER.streams:
                writer.append(sample(info, seq))
        writer.close() if name == "sealed" else writer.abandon(at_once=False)
    return folder


@pytest.fixture
def folder(recordings, tmp_path):
    return shutil.copytree(recordings, tmp_path / "recorded")


@contextmanager
def little_memory(most=40_000_000):
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < most
    finally:
        tracemalloc.stop()


def declared(text, stream, shape):
    plain = json.loads(text)
    plain["streams"][stream]["shape"] = shape
    return json.dumps(plain)


def put_header(file, stream, shape):
    text = declared(file["config/header"][()], stream, shape).encode()
    del file["config/header"]
    file["config/header"] = np.array(text, h5py.string_dtype("utf-8", len(text)))


def frames_never_written(file):
    put_header(file, 0, LARGE)
    del file["camera/counts"]
    file.create_dataset("camera/counts", (FRAMES, *LARGE), "<u2", maxshape=(None, *LARGE), chunks=(8, 50, 80))


def never_made(file, paths):
    """Datasets that the file does not have, nor lists."""
    names = file["integrity/object"][:]
    del file["integrity/object"]
    rest = [b"none" if name.decode() in paths else name for name in names]
    file["integrity/object"] = np.array(rest, names.dtype)
    for path in paths:
        del file[path]


def values_never_made(file):
    put_header(file, 1, WIDE)
    never_made(file, ["lux/value"])


def corners_never_made(file):
    never_made(file, ["regions/points_px", "regions/points_m"])
    for name, column in [*file["regions"].items()]:
        if column.maxshape[0] is None:
            del file["regions"][name]
            file["regions"][name] = np.zeros((20_000, *column.shape[1:]), column.dtype)


def text_never_written(file):
    del file["config/header"]
    file.create_dataset("config/header", (), h5py.string_dtype("utf-8", 15_000_000))


def look_at_everything(path):
    with open_session(path) as session:
        list(session.samples())
        session.entries()
        session.sealed_objects()


@pytest.mark.parametrize(
    "harm", [frames_never_written, values_never_made, corners_never_made, text_never_written]
)
def test_sealed_session_that_declares_more_than_it_has(folder, harm):
    path = folder / "sealed.h5"
    with h5py.File(path, "r+", libver=LIBVER) as file:
        harm(file)
    with little_memory(), pytest.raises(SessionError):
        look_at_everything(path)


def test_interrupted_session_of_a_petabyte(folder):
    """The superblock says how long a file is; what it lost is read as zeros."""
    path = folder / "cut.h5"
    with h5py.File(path, "r+", libver=LIBVER) as file:
        del file["integrity/object"]
        file.create_dataset("integrity/object", (10**9,), "S64")
    head = bytearray(path.read_bytes()[:SIZE])
    head[11] = 1
    struct.pack_into("<Q", head, 28, 2**45)
    struct.pack_into("<I", head, 44, lookup3(bytes(head[:44])))
    with path.open("r+b") as file:
        file.write(head)
    shutil.rmtree(journal_path(path))
    with little_memory(), pytest.raises(SessionError):
        look_at_everything(path)


def rewrite_logs(path, change):
    """Let each log of a journal have been written with other payloads."""
    for log in journal_path(path).glob("*.log"):
        reader, copy = LogReader(log), log.with_name("copy")
        writer = LogWriter(copy, next(reader.heads()).session)
        for head in reader.heads():
            writer.append(Kind(head.kind), head.stream, head.counts, change(head.kind, reader.payload(head)))
        writer.close()
        reader.close()
        copy.replace(log)


@pytest.mark.parametrize("where", ["logs", "file", "both"])
@pytest.mark.parametrize(("stream", "shape"), [(0, LARGE), (1, WIDE), (1, [100_000_000])])
def test_interrupted_session_whose_headers_declare_other_sizes(folder, where, stream, shape):
    """The header that fits the samples is taken; without one there is an error."""
    path = folder / "cut.h5"

    def change(kind, payload):
        if kind != Kind.IDENTITY:
            return payload
        *facts, text = json.loads(payload)
        return json.dumps([*facts, declared(text, stream, shape)]).encode()

    if where != "file":
        rewrite_logs(path, change)
    if where != "logs":
        with h5py.File(path, "r+", libver=LIBVER) as file:
            put_header(file, stream, shape)
    with little_memory():
        if where == "both":
            with pytest.raises(SessionError):
                recover(path)
        else:
            assert recover(path).counts == dict.fromkeys(("camera", "lux", "thermometer"), FRAMES)


@pytest.mark.parametrize("place", [(0, 2**32 - 1), (2**63, 10), (0, 1)])
def test_chunks_that_are_not_where_the_journal_says(folder, place):
    path = folder / "cut.h5"

    def change(kind, payload):
        if kind != Kind.CHUNKS:
            return payload
        return journal.encode_chunks(
            [chunk._replace(offset=place[0], size=place[1]) for chunk in journal.decode_chunks(payload)]
        )

    rewrite_logs(path, change)
    with little_memory():
        assert recover(path).lost_samples == 0


@pytest.mark.parametrize("payload", [b"", b"\xff" * 9, b"\xff" * 70])
def test_record_that_ends_before_what_it_declares(folder, payload):
    rewrite_logs(folder / "cut.h5", lambda kind, whole: payload if kind == Kind.CHUNKS else whole)
    assert recover(folder / "cut.h5").lost_samples == 0


def test_count_beyond_any_journal_is_no_record(folder):
    part = journal_path(folder / "cut.h5") / "000001.log"
    reader = LogReader(part)
    last = list(reader.heads())[-1]
    payload = reader.payload(last)
    reader.close()
    writer = LogWriter(part.with_name("000002.log"), last.session)
    writer.append(Kind.SAMPLE, 0, (2**63 + 1, *last.counts[1:]), payload)
    writer.close()
    assert recover(folder / "cut.h5").lost_samples == 0
