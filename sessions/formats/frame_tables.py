"""A frame as a table: rows of numbers alone, as programs of thermal cameras export temperatures."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from fieldkit.model.arrays import FloatArray
from fieldkit.model.errors import ConfigError
from fieldkit.sessions.formats.imported import refuse_large

SUFFIXES = (".csv", ".txt", ".asc")
_LEAST = 8
"""Rows and columns of the smallest array of pixels."""
_HEAD_BYTES, _MOST_BYTES = 200_000, 1 << 28
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?|nan", re.IGNORECASE)


def is_frame_table(path: Path) -> bool:
    """True if a table begins with rows of numbers that no header names and no time stamps."""
    if path.suffix.lower() not in SUFFIXES:
        return False
    with path.open("rb") as file:
        lines = file.read(_HEAD_BYTES).decode("utf-8-sig", "replace").splitlines()
    return next(_frames(lines), None) is not None


def read_frame_tables(path: Path) -> list[FloatArray]:
    """The frames of a file, (rows, cols), one behind the other; raises `ConfigError`."""
    refuse_large(path, _MOST_BYTES)
    frames = list(_frames(path.read_text("utf-8-sig", "replace").splitlines()))
    if len({frame.shape for frame in frames}) > 1:
        rows, cols = frames[-1].shape
        problem = f"its frames differ in size: frame {len(frames)} has {rows} x {cols} numbers"
        raise ConfigError(problem, place=path, fix="export the frame again")
    return frames


def _frames(lines: Iterable[str]) -> Iterator[FloatArray]:
    """Blocks of numbers in rows of equal length; a label before a row, as FLIR's ``Frame 2``, begins one."""
    block: list[list[str]] = []
    above: list[str] = []
    for line in (*lines, ""):
        cells = _cells(line)
        label, numbers = ("", cells) if all(map(_NUMBER.fullmatch, cells)) else (cells[0], cells[1:])
        is_row = bool(numbers) and all(map(_NUMBER.fullmatch, numbers))
        if block and (not is_row or label or len(numbers) != len(block[0])):
            if len(above) != len(block[0]) and (frame := _pixels(block)) is not None:
                yield frame
            block, above = [], []
        if is_row:
            block.append(numbers)
        else:
            above = cells


def _cells(line: str) -> list[str]:
    """The cells of a line, an empty one at its end not among them."""
    mark = next((mark for mark in ";\t," if mark in line), None)
    cells = [cell.strip() for cell in line.strip(" \r\n").rstrip(mark).split(mark)]
    return cells if mark == "," else [cell.replace(",", ".") for cell in cells]


def _pixels(block: list[list[str]]) -> FloatArray | None:
    """The numbers without those that only count rows and columns; None where they are none of a frame."""
    numbers = np.array(block, np.float64)
    if _counts(numbers[0]):
        numbers = numbers[1:]
    if len(numbers) and _counts(numbers[:, 0]):
        numbers = numbers[:, 1:]
    if min(numbers.shape) < _LEAST:
        return None
    steps = np.diff(numbers[:, 0])
    return None if steps[0] > 0.0 and np.ptp(steps) < 1e-6 else numbers  # times in equal steps


def _counts(numbers: FloatArray) -> bool:
    """True for 0, 1, 2 ... and 1, 2, 3 ..."""
    return bool(numbers[0] in (0.0, 1.0) and (np.diff(numbers) == 1.0).all() and numbers.size >= _LEAST)
