"""What a camera's counts are in kelvin is judged by the camera's own law."""

import struct
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import pytest

from fieldkit.physics.camera_laws import ht301
from fieldkit.sessions.check import check
from tests.harness.recording import header, sample, session_of

HEADER = header((24, 32))
CAMERA = HEADER.streams[0]
PLANCK = {"r1": 17096.453, "b": 1428.0, "f": 1.0, "o": -342.0, "r2": 0.046642166}
AT_300_K = 3509
"""Counts of a black body of 300 K by these constants: R1 / (R2 (exp(B/T) - F)) - O."""


class Showing(NamedTuple):
    """A camera by its law, all of whose pixels have one count."""

    law: str
    count: int
    rows: np.ndarray
    settings: Mapping[str, float] = MappingProxyType({})


def warned(path: Path, *cameras: Showing) -> list[str]:
    """Warnings on each of some cameras, recorded together."""
    infos = tuple(
        replace(
            CAMERA, name=f"camera{number}", law=one.law, scale=float("nan"), settings=dict(one.settings),
            shape=(24, one.rows.shape[1]), metadata_shape=one.rows.shape,
        )
        for number, one in enumerate(cameras)
    )  # fmt: skip
    frames = (
        sample(info, seq, seq * 111_111_111)._replace(
            counts=np.full(info.shape, one.count, "<u2"), metadata_rows=one.rows
        )
        for seq in range(3)
        for info, one in zip(infos, cameras, strict=True)
    )
    session_of(path, replace(HEADER, streams=infos), *frames)
    found = [one for one in check(path) if one.level == "warn"]
    return [" | ".join(one.text for one in found if one.what == info.name) for info in infos]


def ht301_rows() -> np.ndarray:
    """The four rows below a picture of 384 columns: sensor at 25 °C, shutter at 30.05 °C."""
    words = bytearray(2 * 4 * 384)
    struct.pack_into("<HH", words, 0, 7620, 7620)
    struct.pack_into("<HHH5f", words, 2 * 3 * 384, 6000, 3032, 3032, 0.001, 1.0, 0.0, 1e-4, 0.018)
    return np.frombuffer(words, "<u2").reshape(4, 384)


AT_40_C = 6306
"""By the published law, (0.001 T^2 + T) / 0.0205 counts of it, from 5787 at the shutter's 30.05 °C on."""
NO_ROWS = np.zeros((1, 32), "<u2")


def test_planck_law_with_its_constants_gives_values(tmp_path):
    counts = (AT_300_K, 60_000)
    usual, hot = warned(tmp_path / "a.h5", *(Showing("planck", one, NO_ROWS, PLANCK) for one in counts))
    assert usual == ""
    assert "are implausible" in hot


def test_law_that_takes_its_parameters_from_every_picture_gives_values(tmp_path):
    rows = ht301_rows()
    assert ht301(np.array([AT_40_C], np.uint16), rows, {})[0] == pytest.approx(313.15, abs=0.02)
    assert warned(tmp_path / "a.h5", Showing("ht301", AT_40_C, rows)) == [""]


def test_law_that_cannot_tell_is_found(tmp_path):
    laws = ("planck", "ht301", "cubic", "linear")
    found = warned(tmp_path / "a.h5", *(Showing(law, AT_300_K, NO_ROWS) for law in laws))
    assert [bool(one) for one in found] == [True] * len(laws)
