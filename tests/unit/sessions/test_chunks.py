"""Direct chunks must be exactly what HDF5's own filters make, or nobody else could read them."""

import zlib
from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import h5py
import numpy as np
import pytest

from fieldkit.model.device import StreamInfo
from fieldkit.sessions.chunks import FrameWriter, TableWriter, is_packed, pack, read_block, unpack
from fieldkit.sessions.file_tree import put_columns, put_frames
from fieldkit.sessions.formats.purethermal_files import read_purethermal
from fieldkit.sessions.guarded_file import GuardedDisk
from fieldkit.sessions.layout import Column, chunk_shape
from tests.shared_data import shared


def camera(rows: int, cols: int, rate_hz: float) -> StreamInfo:
    return StreamInfo("camera", "brightness_temperature", "K", (rows, cols), 0.01, rate_hz=rate_hz)


def test_the_hdf5_library_reads_the_blocks_of_a_large_camera(tmp_path):
    info = camera(512, 640, 30.0)
    frames = np.random.default_rng(2).integers(29000, 29100, (35, 512, 640)).astype("<u2")
    with h5py.File(tmp_path / "a.h5", "w") as file, ThreadPoolExecutor(2) as pool:
        dataset = put_frames(file, "counts", chunk_shape(info), info.shape, 65535)
        writer = FrameWriter(dataset, pool, defaultdict(int))
        for number, frame in enumerate(frames, 1):
            writer.put(frame)
            if writer.is_full or number == len(frames):
                writer.write()
        assert np.array_equal(dataset[:], frames)


def test_block_shapes_of_the_known_cameras():
    # The first and last are those the format description was measured with.
    assert chunk_shape(camera(120, 160, 9.0)) == (9, 60, 80)
    assert chunk_shape(camera(192, 256, 25.0)) == (25, 64, 64)
    assert chunk_shape(camera(512, 640, 30.0)) == (30, 64, 80)
    assert chunk_shape(camera(13, 521, 1.0)) == (8, 13, 521)
    bursts = {count: chunk_shape(replace(camera(120, 160, 9.0), burst_frames=count))[0] for count in (3, 100)}
    assert bursts == {3: 3, 100: 50}  # so that no burst waits in a chunk for the next


def test_chunk_unpacks_to_what_was_packed():
    chunk = np.random.default_rng(1).integers(0, 65536, (9, 60, 80)).astype("<u2")
    assert np.array_equal(unpack(pack(chunk), chunk.shape), chunk)
    with pytest.raises(ValueError, match="chunk"):
        unpack(pack(chunk)[:-20], chunk.shape)
    with pytest.raises(ValueError, match="chunk"):
        unpack(b"not zlib at all", chunk.shape)


def test_noise_and_a_quiet_picture_are_packed_as_small_as_zlib_does():
    rng = np.random.default_rng(1)
    noise = rng.normal(29_500, 5, (25, 64, 64)).round().astype("<u2")
    quiet = np.repeat(rng.normal(29_500, 5, (1, 64, 64)).round().astype("<u2"), 25, axis=0)
    for chunk in (noise, quiet):
        planes = chunk.view(np.uint8).reshape(-1, 2).T.tobytes()  # HDF5's shuffle filter
        assert len(pack(chunk)) <= len(zlib.compress(planes, 1))


def test_blocks_are_read_as_hdf5_reads_them(tmp_path):
    frames = np.random.default_rng(2).integers(0, 65536, (18, 120, 160)).astype("<u2")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        filters = {"shuffle": True, "compression": "gzip"}
        packed = file.create_dataset("packed", data=frames, chunks=(9, 60, 80), **filters)
        others = [
            file.create_dataset("plain", data=frames, chunks=(9, 60, 80)),
            file.create_dataset("summed", data=frames, chunks=(9, 60, 80), fletcher32=True, **filters),
            file.create_dataset("ragged", data=frames, chunks=(9, 50, 80), **filters),
            file.create_dataset("whole", data=frames),
        ]
        assert is_packed(packed)
        assert not any(is_packed(other) for other in others)
        assert np.array_equal(read_block(packed, 9), packed[9:18])
        packed.id.write_direct_chunk((9, 0, 0), frames[9:18, :60, :80].tobytes(), filter_mask=3)
    with h5py.File(tmp_path / "a.h5") as file:
        packed = file["packed"]
        assert np.array_equal(packed[:], frames)
        with pytest.raises(ValueError, match="/packed"):
            read_block(packed, 9)


def test_a_real_recording_is_packed_2_8_times_smaller(tmp_path):
    """A PureThermal's, see the README beside it; measured in the file, whole blocks alone."""
    source = shared("data/frames/purethermal3/thermal_20260512_151542.raw.y16.gz")
    frames = [sample.counts for sample in read_purethermal(source).samples]
    info = camera(120, 160, 9.0)
    with h5py.File(tmp_path / "a.h5", "w") as file, ThreadPoolExecutor(2) as pool:
        dataset = put_frames(file, "counts", chunk_shape(info), info.shape, 65535)
        writer, size = FrameWriter(dataset, pool, defaultdict(int)), 0
        for one in frames[: len(frames) // writer.depth * writer.depth]:
            writer.put(one)
            if writer.is_full:
                size += sum(chunk.size for chunk in writer.write())
        assert writer.length * 2 * 120 * 160 / size >= 2.8


def test_hdf5_reads_blocks_and_their_places_are_told(tmp_path):
    frames = np.random.default_rng(2).integers(29_000, 29_050, (20, 120, 160)).astype("<u2")
    path = tmp_path / "blocks.h5"
    path.touch()
    disk = GuardedDisk(path)
    with h5py.File(disk, "w", libver=("v110", "v110")) as file, ThreadPoolExecutor(2) as pool:
        dataset = file.create_dataset(
            "counts", (0, 120, 160), "<u2", maxshape=(None, 120, 160), chunks=(9, 60, 80), fillvalue=65535,
            shuffle=True, compression="gzip", compression_opts=1,
        )  # fmt: skip
        writer = FrameWriter(dataset, pool, disk.places)
        chunks = []
        for number, frame in enumerate(frames):
            writer.put(frame)
            if writer.is_full or number in (3, 19):  # 3: a block written before it is full, then again
                chunks += writer.write()
        assert disk.places == {chunks[-1].size: chunks[-1].offset}  # however many were written before
        file.flush()
        assert np.array_equal(dataset[:], frames)
        assert len(chunks) == 4 * 4
    data = path.read_bytes()
    for chunk in chunks[4:8]:
        block = unpack(data[chunk.offset : chunk.offset + chunk.size], (9, 60, 80))
        assert np.array_equal(block, frames[0:9, chunk.y : chunk.y + 60, chunk.x : chunk.x + 80])


def test_table_grows_in_all_columns_over_chunk_borders(tmp_path):
    columns = [Column("time", "<i8"), Column("value", "<f8", fill=np.nan), Column("text", "S16")]
    with h5py.File(tmp_path / "table.h5", "w", libver=("v110", "v110")) as file:
        put_columns(file, columns)
        table = TableWriter(file["/"], columns)
        for number in range(2500):
            table.append({"time": number, "value": number / 3, "text": f"é{number}".encode()})
            if number % 700 == 0:
                table.write()
                assert file["time"].shape == file["text"].shape == (number + 1,)
        table.write()
        assert np.array_equal(file["time"][:], np.arange(2500))
        assert np.array_equal(file["value"][:], np.arange(2500) / 3)
        assert file["text"][2499] == "é2499".encode()
