"""One frame from bytes to kelvin: our decoders, with flags and region statistics, beside what people use now.

The other side is written as its user writes it: flirpy itself where it is installed (its telemetry and its
files), else the same steps in plain numpy; the viewers for the P2 Pro and the HT-301 are no packages, so
their steps per frame are reproduced. They give neither flags nor statistics.
"""

from __future__ import annotations

import math
import struct
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.result import Result
from benchmarks.sides import compared
from fieldkit.drivers.cameras import boson, flir_file, ht301, p2pro, purethermal
from fieldkit.drivers.cameras.camera import DecodedFrame, kelvin
from fieldkit.drivers.decoding import Rejected

ROUNDS, REPEATS = 100, 300
FARTHER_ROUNDS = 5
FRAMES = 64
Work = Callable[[], Any]


def _pair_us(ours: Work, theirs: Work, rounds: int = ROUNDS) -> tuple[float, float]:
    """Best mean time of each in microseconds: many short turns, so that both meet the same quiet moments."""
    best = [math.inf, math.inf]
    for _ in range(REPEATS):
        for side, work in enumerate((ours, theirs)):
            started = time.perf_counter()
            for _ in range(rounds):
                work()
            best[side] = min(best[side], (time.perf_counter() - started) / rounds * 1e6)
    return best[0], best[1]


class _Bed:
    """A bed in the middle of the frame, a ninth of each side."""

    def __init__(self, width: int, height: int) -> None:
        top, left = height // 3, width // 3
        self._box = slice(top, top + height // 9), slice(left, left + width // 9)
        self._pixels = (height // 9) * (width // 9)

    def mean_k(self, image: NDArray[np.float32]) -> float:
        """Mean temperature of the bed; the extremes of the whole frame are beside its flags."""
        return cv2.sumElems(image[self._box])[0] / self._pixels


def _ours(data: bytes, decode: Callable[[bytes], DecodedFrame | Rejected], bed: _Bed) -> Any:
    decoded = decode(data)
    assert isinstance(decoded, DecodedFrame)
    image = kelvin(decoded)
    return image, decoded.quality, bed.mean_k(image)


def lepton_bytes() -> bytes:
    """160x120 of a room at 22 °C, and its telemetry."""
    counts = 29515 + np.random.default_rng(1).integers(-200, 1200, (120, 160))
    rows = np.zeros(320, "<u2")
    for word, value in (
        (0, 14),
        (1, 60_000),
        (3, 0x30),
        (20, 27),
        (24, 30015),
        (26, 29815),
        (208, 1),
        (209, 1),
    ):
        rows[word] = value
    return counts.astype("<u2").tobytes() + rows.tobytes()


def _lepton() -> list[Result]:
    data = lepton_bytes()
    try:
        from flirpy.camera.lepton import Lepton

        camera, how = Lepton.__new__(Lepton), "flirpy's telemetry and the user's conversion"
    except ImportError:
        camera, how = None, "the user's conversion, without telemetry"

    def theirs() -> Any:
        image = np.frombuffer(data, np.uint16).reshape(122, 160)
        if camera is not None:
            camera.decode_telemetry(image)
        return image[:-2].astype(float) / 100 - 273.15

    bed = _Bed(160, 120)
    us = _pair_us(partial(_ours, data, purethermal.decode, bed), theirs)
    counts = np.frombuffer(data, "<u2").reshape(122, 160)[:120]

    def least() -> Any:
        image = counts.astype(np.float32)
        image *= 0.01
        return image, cv2.minMaxLoc(counts), bed.mean_k(image)

    least_us = _pair_us(least, lambda: None)[0]
    note = "what is left of it without the telemetry, the flags and the parts they come in"
    return [
        *_rows("Lepton 160x122", us, ">= 2", data, how),
        Result("Lepton 160x122: conversion, extremes and a mean alone", least_us, "us", "", note),
    ]


def _boson() -> list[Result]:
    counts = 29515 + np.random.default_rng(2).integers(-200, 1200, (512, 640))
    data = counts.astype("<u2").tobytes()

    def theirs() -> Any:
        return np.frombuffer(data, np.uint16).reshape(512, 640) / 100 - 273.15

    us = _pair_us(partial(_ours, data, partial(boson.decode, scale=0.01), _Bed(640, 512)), theirs)
    return _rows("Boson 640x512", us, ">= 2.5", data, "the user's conversion of flirpy's frame")


def _p2pro() -> list[Result]:
    grey = np.full((192, 256), 0x8020, "<u2")
    counts = 18890 + np.random.default_rng(3).integers(-4, 5, (192, 256))
    data = grey.tobytes() + counts.astype("<u2").tobytes()

    def theirs() -> Any:
        half = len(data) // 2
        colours = cv2.cvtColor(
            np.frombuffer(data[:half], np.uint8).reshape(192, 256, 2), cv2.COLOR_YUV2RGB_YUY2
        )
        words = np.frombuffer(data[half:], np.uint16).reshape(192, 256)
        return colours, words / 64 - 273.15

    us = _pair_us(partial(_ours, data, p2pro.decode, _Bed(256, 192)), theirs)
    return _rows("P2 Pro 256x384", us, ">= 1.5", data, "a viewer's frame split and the user's conversion")


def ht301_bytes() -> bytes:
    """384x288 counts and rows with constants that give a room."""
    counts = 5800 + np.random.default_rng(4).integers(0, 400, (288, 384))
    rows = bytearray(2 * 4 * 384)
    struct.pack_into("<HH", rows, 0, 7620, 7620)
    struct.pack_into("<HHH5f", rows, 2 * 3 * 384, 6000, 3032, 3032, 0.001, 1.0, 0.0, 1e-4, 0.018)
    return counts.astype("<u2").tobytes() + bytes(rows)


def _ht301() -> list[Result]:
    data = ht301_bytes()

    def theirs() -> Any:
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

    us = _pair_us(partial(_ours, data, ht301.decode, _Bed(384, 288)), theirs, FARTHER_ROUNDS)
    return _rows(
        "HT-301 384x292", us, ">= 3", data, "the library's table for each frame and the user's look-up"
    )


def fff_bytes(seed: int = 5) -> bytes:
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

        return [
            compared(f"SEQ 640x512, {FRAMES} frames, over flirpy's Seq", ours, theirs, ">= 10",
                     "from the file; ours with the mean of a region"),
        ]  # fmt: skip


def _rows(name: str, us: tuple[float, float], must: str, data: bytes, how: str) -> list[Result]:
    ours_us, theirs_us = us
    copy_us = _pair_us(lambda: bytearray(data), lambda: None)[0]
    return [
        Result(f"{name}: theirs over ours", theirs_us / ours_us, "x", must, f"{theirs_us:.1f} us, {how}"),
        Result(f"{name}: a frame", ours_us, "us", "", "kelvin as float32, flags, statistics of a region"),
        Result(
            f"{name}: of it, a copy of the same bytes", 100 * copy_us / ours_us, "%", "", f"{copy_us:.1f} us"
        ),
    ]


def run() -> list[Result]:
    return [row for family in (_lepton, _boson, _p2pro, _ht301, _seq) for row in family()]
