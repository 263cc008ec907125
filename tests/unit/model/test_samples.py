"""Which samples may enter a result: one definition, for one sample and for columns of them."""

import ast
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from fieldkit.model.samples import UNUSABLE, Quality, is_showable, is_usable

TOP = Path(__file__).resolve().parents[3]
ROOMS = ("fieldkit", "drivers", "sessions", "calibration")
UNTRUE = ("STALE", "FROZEN", "DUPLICATE", "SHUTTER", "SATURATED", "OVERRANGE", "BAD_CRC", "NO_VALUE")


def test_held_void_and_damaged_samples_enter_no_result():
    for flag in Quality:
        assert is_usable(flag) == (flag.name not in UNTRUE), flag
    assert is_usable(Quality.GOOD)
    assert not is_usable(Quality.DROPPED_BEFORE | Quality.BAD_CRC)


@pytest.mark.parametrize("dtype", ["<u2", "<i8"])
def test_columns_of_flags_are_judged_like_single_ones(dtype):
    flags = np.arange(2**16).astype(dtype).reshape(256, 256)
    usable = is_usable(flags)
    assert usable.shape == flags.shape
    assert usable.dtype == np.bool_
    some = np.arange(0, 2**16, 97)
    assert usable.ravel()[some].tolist() == [is_usable(Quality(int(number))) for number in some]


def test_a_frame_at_the_end_of_its_scale_still_shows_where_the_beds_are():
    assert is_showable(Quality.SATURATED | Quality.NO_VALUE)
    for flag in (Quality.SHUTTER, Quality.FROZEN, Quality.DUPLICATE, Quality.BAD_CRC, Quality.STALE):
        assert not is_showable(flag), flag


def test_no_room_spells_its_own_mask_of_unusable_samples():
    files = [path for room in ROOMS for path in (TOP / room).rglob("*.py") if path.name != "samples.py"]
    assert len(files) > 200
    assert [f"{path.relative_to(TOP)}:{line}" for path in files for line in _own_masks(path)] == []


def _own_masks(path: Path) -> list[int]:
    """Lines of a module that join two or more of the flags that make a sample unusable."""
    text, names = path.read_text(encoding="utf-8"), {flag.name for flag in UNUSABLE}
    if not any(f".{name}" in text for name in names):  # most modules: parsing all takes two seconds
        return []
    nodes = ast.walk(ast.parse(text))
    return sorted({node.lineno for node in nodes if len(names.intersection(_joined(node))) > 1})


def _joined(node: ast.AST) -> Iterator[str]:
    """The flags written out in an expression of ``|``."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitOr):
        for side in (node.left, node.right):
            yield from [side.attr] if isinstance(side, ast.Attribute) else _joined(side)
