"""A frame as rows of numbers, in the layouts of cameras' programs; a logger's table is none."""

import numpy as np
import pytest

from fieldkit.sessions.formats.frame_tables import is_frame_table, read_frame_tables

PIXELS = np.random.default_rng(0).normal(20.0, 1.0, (12, 16)).round(2)
COUNTS = range(16)


def lines(mark: str, decimal: str = ".", label=lambda row: [], end: str = "") -> str:
    """The pixels, `label` standing before each row."""
    numbers = [[f"{value:.2f}".replace(".", decimal) for value in row] for row in PIXELS]
    rows = [[*label(number), *row] for number, row in enumerate(numbers)]
    return "".join(mark.join(cells) + end + "\n" for cells in rows)


def flir(row: int) -> list[str]:
    return ["" if row else "Frame 1"]


def number(row: int) -> list[str]:
    return [str(row)]


FRAMES = {
    "commas": (lines(","), 1),
    "decimal commas": (lines(";", ","), 1),
    "tabs, a mark": ("\ufeff" + lines("\t"), 1),
    "blanks": (lines(" "), 1),
    "a separator at the end": (lines(";", end=";"), 1),
    "FLIR": ("File:;a.jpg\nEmissivity:;0,95\n\n" + lines(";", ",", flir), 1),
    "FLIR, several": (lines(";", ",", flir) + lines(";", ",", flir).replace("Frame 1", "Frame 2"), 2),
    "numbered": (";" + ";".join(map(str, COUNTS)) + "\n" + lines(";", label=number), 1),
    "numbered, named": ("Y\\X," + ",".join(map(str, COUNTS)) + "\n" + lines(",", label=number), 1),
    "several": (lines(",") + "\n" + lines(","), 2),
}
TABLES = {
    "named columns": ",".join(f"T{n}" for n in COUNTS) + "\n" + lines(","),
    "unix times": lines(",", label=lambda row: [str(1_718_000_000 + row)]),
    "times": lines(",", label=lambda row: [f"2026-05-01 10:00:{row:02}"]),
    "few columns": "\n".join("1.5,2.5,3.5" for _ in range(20)),
}


@pytest.mark.parametrize("kind", FRAMES)
def test_a_frame_is_read_in_every_layout(tmp_path, kind):
    text, count = FRAMES[kind]
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    assert is_frame_table(tmp_path / "a.csv")
    frames = read_frame_tables(tmp_path / "a.csv")
    assert [frame.tolist() for frame in frames] == count * [PIXELS.tolist()]


@pytest.mark.parametrize("kind", TABLES)
def test_a_table_over_time_is_no_frame(tmp_path, kind):
    (tmp_path / "a.csv").write_text(TABLES[kind])
    assert not is_frame_table(tmp_path / "a.csv")
