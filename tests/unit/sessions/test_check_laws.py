"""What a camera's counts are in kelvin is judged by the camera's own law."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fieldkit.physics.camera_laws import ht301
from fieldkit.sessions.check import check
from fieldkit.sessions.writer import SessionWriter
from tests.harness.recording import CountedClock, header, sample

HEADER = header((24, 32))
CAMERA = HEADER.streams[0]
PLANCK = {"r1": 17096.453, "b": 1428.0, "f": 1.0, "o": -342.0, "r2": 0.046642166}
AT_300_K = 3509
"""Counts of a black body of 300 K by these constants: R1 / (R2 (exp(B/T) - F)) - O."""


def warned(path: Path, law: str, count: int, rows: np.ndarray, **settings: float) -> str:
    """Warnings on a camera of that law, all of whose pixels have that count."""
    width = rows.shape[1]
    camera = replace(
        CAMERA, law=law, scale=float("nan"), settings=settings, shape=(24, width), metadata_shape=rows.shape
    )
    clock = CountedClock()
    writer = SessionWriter(path, replace(HEADER, streams=(camera,)), clock)
    for seq in range(3):
        mono_ns = seq * 111_111_111
        frame = sample(camera, seq, mono_ns, clock.to_utc_ns(mono_ns))
        writer.append(frame._replace(counts=np.full(camera.shape, count, "<u2"), metadata_rows=rows))
    writer.close()
    return " | ".join(one.text for one in check(path) if one.what == "camera" and one.level == "warn")


def ht301_rows() -> np.ndarray:
    """The four rows below a picture of 384 columns: sensor at 25 °C, shutter at 30.05 °C."""
    words = bytearray(2 * 4 * 384)
    struct.pack_into("<HH", words, 0, 7620, 7620)
    struct.pack_into("<HHH5f", words, 2 * 3 * 384, 6000, 3032, 3032, 0.001, 1.0, 0.0, 1e-4, 0.018)
    return np.frombuffer(words, "<u2").reshape(4, 384)


AT_40_C = 6306
"""By the published law, (0.001 T^2 + T) / 0.0205 counts of it, from 5787 at the shutter's 30.05 °C on."""
NO_ROWS = np.zeros((1, 32), "<u2")


def test_planck_law_with_its_constants_gives_values(tmp_path: Path) -> None:
    assert warned(tmp_path / "a.h5", "planck", AT_300_K, NO_ROWS, **PLANCK) == ""
    assert "are implausible" in warned(tmp_path / "b.h5", "planck", 60_000, NO_ROWS, **PLANCK)


def test_law_that_takes_its_parameters_from_every_picture_gives_values(tmp_path: Path) -> None:
    rows = ht301_rows()
    assert ht301(np.array([AT_40_C], np.uint16), rows, {})[0] == pytest.approx(313.15, abs=0.02)
    assert warned(tmp_path / "a.h5", "ht301", AT_40_C, rows) == ""


@pytest.mark.parametrize("law", ["planck", "ht301", "cubic", "linear"])
def test_law_that_cannot_tell_is_found(tmp_path: Path, law: str) -> None:
    assert "the scale is not known" in warned(tmp_path / "a.h5", law, AT_300_K, NO_ROWS)
