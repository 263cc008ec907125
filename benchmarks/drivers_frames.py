"""One frame from bytes to kelvin: our decoders, with flags and region statistics, beside what people use now.

Both sides go in turn around a ring of frames that differ, more than a core's cache holds. The other side is
flirpy itself for its telemetry and its files, where it is installed; what its user then does is written as
a user writes it. No package reads the P2 Pro or the HT-301: their programs' steps are written anew here. The
other side gives neither flags nor statistics.
"""

from __future__ import annotations

import struct
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.result import Result, Row
from benchmarks.sides import compare
from fieldkit.drivers.cameras import boson, flir_file, ht301, p2pro, purethermal
from fieldkit.drivers.cameras.camera import DecodedFrame, kelvin
from fieldkit.drivers.decoding import Rejected
from fieldkit.model.arrays import SingleArray

FRAMES = 64
ROUNDS = 31
GIVES = f"{FRAMES} frames to float32 kelvin, flags and the mean of a region; theirs to float64 °C alone"
LEPTON = Row(
    "lepton", "Lepton 160x122, flirpy's telemetry and its user's conversion over ours", ">= 2", included=GIVES
)
BOSON = Row(
    "boson", "Boson 640x512, the conversion that flirpy's user writes over ours", ">= 2.5", included=GIVES
)
P2PRO = Row(
    "p2pro", "P2 Pro 256x384, a viewer's steps, written anew here, over ours", ">= 1.5", included=GIVES
)
HT301 = Row(
    "ht301", "HT-301 384x292, its library's steps, written anew here, over ours", ">= 3", included=GIVES
)
SEQ = Row("seq", f"SEQ 640x512, {FRAMES} frames, flirpy's `Seq` over ours", ">= 10",
          included="reading the file; ours with the mean of a region")  # fmt: skip
Work = Callable[[bytes], Any]


def _around(row: Row, ring: Sequence[bytes], ours: Work, theirs: Work) -> Result:
    """Each round takes both sides once around the ring; processor time."""

    def lap(work: Work) -> None:
        for data in ring:
            work(data)

    return compare(row, partial(lap, ours), partial(lap, theirs), ROUNDS, time.process_time)


class _Bed:
    """A bed in the middle of the frame, a ninth of each side."""

    def __init__(self, width: int, height: int) -> None:
        top, left = height // 3, width // 3
        self._box = slice(top, top + height // 9), slice(left, left + width // 9)
        self._pixels = (height // 9) * (width // 9)

    def mean_k(self, image: SingleArray) -> float:
        """Mean temperature of the bed; the extremes of the whole frame are beside its flags."""
        return cv2.sumElems(image[self._box])[0] / self._pixels


def _ours(decode: Callable[[bytes], DecodedFrame | Rejected], bed: _Bed, data: bytes) -> Any:
    decoded = decode(data)
    assert isinstance(decoded, DecodedFrame)
    image = kelvin(decoded)
    return image, decoded.quality, bed.mean_k(image)


def lepton_bytes(seed: int) -> bytes:
    """160x120 of a room at 22 °C, and its telemetry."""
    counts = 29515 + np.random.default_rng(seed).integers(-200, 1200, (120, 160))
    rows = np.zeros(320, "<u2")
    rows[[0, 1, 3, 20, 24, 26, 208, 209]] = 14, 60_000, 0x30, 27, 30015, 29815, 1, 1
    return counts.astype("<u2").tobytes() + rows.tobytes()


def _lepton() -> list[Result]:
    try:
        from flirpy.camera.lepton import Lepton
    except ImportError:
        return []
    ring = [lepton_bytes(seed) for seed in range(FRAMES)]
    camera = Lepton.__new__(Lepton)
    camera.conn = None  # no camera is opened; its destructor looks for one

    def theirs(data: bytes) -> Any:
        image = np.frombuffer(data, np.uint16).reshape(122, 160)
        camera.decode_telemetry(image)
        return image[:-2].astype(float) / 100 - 273.15

    ours = partial(_ours, purethermal.decode, _Bed(160, 120))
    return [_around(LEPTON, ring, ours, theirs)]


def boson_bytes(seed: int) -> bytes:
    """640x512 counts of 10 mK."""
    counts = 29515 + np.random.default_rng(seed).integers(-200, 1200, (512, 640))
    return counts.astype("<u2").tobytes()


def _boson() -> list[Result]:
    def theirs(data: bytes) -> Any:
        return np.frombuffer(data, np.uint16).reshape(512, 640) / 100 - 273.15

    ours = partial(_ours, partial(boson.decode, scale=0.01), _Bed(640, 512))
    return [_around(BOSON, [boson_bytes(seed) for seed in range(FRAMES)], ours, theirs)]


def p2pro_bytes(seed: int) -> bytes:
    """256x192 of grey picture above as many counts of 1/64 K."""
    grey = np.full((192, 256), 0x8020, "<u2")
    counts = 18890 + np.random.default_rng(seed).integers(-4, 5, (192, 256))
    return grey.tobytes() + counts.astype("<u2").tobytes()


def _p2pro() -> list[Result]:
    def theirs(data: bytes) -> Any:
        half = len(data) // 2
        colours = cv2.cvtColor(
            np.frombuffer(data[:half], np.uint8).reshape(192, 256, 2), cv2.COLOR_YUV2RGB_YUY2
        )
        words = np.frombuffer(data[half:], np.uint16).reshape(192, 256)
        return colours, words / 64 - 273.15

    ours = partial(_ours, p2pro.decode, _Bed(256, 192))
    return [_around(P2PRO, [p2pro_bytes(seed) for seed in range(FRAMES)], ours, theirs)]


def ht301_bytes(seed: int) -> bytes:
    """384x288 counts and rows with constants that give a room."""
    counts = 5800 + np.random.default_rng(seed).integers(0, 400, (288, 384))
    rows = bytearray(2 * 4 * 384)
    struct.pack_into("<HH", rows, 0, 7620, 7620)
    struct.pack_into("<HHH5f", rows, 2 * 3 * 384, 6000, 3032, 3032, 0.001, 1.0, 0.0, 1e-4, 0.018)
    return counts.astype("<u2").tobytes() + bytes(rows)


def _ht301() -> list[Result]:
    def theirs(data: bytes) -> Any:
        """Metadata, the whole table of the law with its object correction, and the frame through it."""
        image = np.frombuffer(data, "<u2").reshape(292, 384)
        meta = image[288:]
        fpa = 20.0 - (float(meta[0, 1]) - 7800.0) / 36.0
        words = meta[3]
        core = float(words[1]) / 10 - 273.15
        c1, c2, c3, c4, c5 = (
            float(words[3 + 2 * place : 5 + 2 * place].view("<f4")[0]) for place in range(5)
        )
        offset = int(words[0]) - int(390.0 - fpa * 7.05)
        gain, s, p = c3 * fpa**2 + c4 * fpa + c5, c1 * core**2 + c2 * core, c2 / (2 * c1)
        total = (((np.arange(16384.0) - offset) * gain + s) / c1 + p**2) ** 0.5 - p + 273.15
        table = ((total**4 - 0.02) * 1.0001) ** 0.25 - 273.15
        return table[image[:288]]

    ours = partial(_ours, ht301.decode, _Bed(384, 288))
    return [_around(HT301, [ht301_bytes(seed) for seed in range(FRAMES)], ours, theirs)]


def fff_bytes(seed: int) -> bytes:
    """A 640x512 FFF file with the constants of a Duo Pro R, little-endian throughout."""
    counts = 2690 + np.random.default_rng(seed).integers(0, 60, (512, 640))
    raw = struct.pack("<HHH", 2, 640, 512).ljust(32, b"\0") + counts.astype("<u2").tobytes()
    info = bytearray(0x470)
    struct.pack_into("<H", info, 0, 2)
    struct.pack_into("<7f", info, 0x20, 0.94, 50.0, 293.15, 293.15, 295.15, 1.0, 0.0)
    struct.pack_into("<f", info, 0x3C, 0.3)
    struct.pack_into("<3f", info, 0x58, 364058.0, 1428.0, 1.0)
    struct.pack_into("<5f", info, 0x70, 0.006569, 0.01262, -0.002276, -0.00667, 1.9)
    struct.pack_into("<if", info, 0x308, -228, 1.0)
    struct.pack_into("<II", info, 0x384, 1_541_416_483, 84)
    directory = struct.pack("<HHIIII", 1, 2, 100, 1, 128, len(raw)).ljust(32, b"\0")
    directory += struct.pack("<HHIIII", 0x20, 1, 100, 2, 128 + len(raw), len(info)).ljust(32, b"\0")
    header = b"FFF\0" + b"fieldkit".ljust(16, b"\0") + struct.pack("<III", 101, 64, 2)
    return header.ljust(64, b"\0") + directory + raw + bytes(info)


def _seq() -> list[Result]:
    """A recording of many frames, so that none is in the processor's cache already."""
    try:
        from flirpy.io.seq import Seq
    except ImportError:
        return []
    with tempfile.TemporaryDirectory() as folder:
        path, bed = Path(folder) / "field.seq", _Bed(640, 512)
        path.write_bytes(b"".join(fff_bytes(seed) for seed in range(FRAMES)))

        def ours() -> None:
            for decoded in flir_file.frames(path.read_bytes()):
                bed.mean_k(decoded.temperature_k())

        def theirs() -> None:
            for frame in Seq(str(path), height=512, width=640):
                frame.get_radiometric_image()

        return [compare(SEQ, ours, theirs)]


def run() -> list[Result]:
    return [row for family in (_lepton, _boson, _p2pro, _ht301, _seq) for row in family()]
