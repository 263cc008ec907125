"""The measure of speed: what the page says is what a run measures, and a run says how it was measured."""

import re
from importlib import import_module
from pathlib import Path

import pytest

from benchmarks.__main__ import modules
from benchmarks.result import Row, module_rows
from benchmarks.sides import share, times_as_fast

PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "speed.md"
LINE = re.compile(r"^\| (.+?) \|(.*)\|(.*)\| (.+) \| `(\w+)\.([\w-]+)` \|$", re.MULTILINE)
ROW = Row("tenfold", "one over the other", ">= 2")


def rows_of_the_page():
    return {
        (module, name): (title, included.strip(), goal.strip())
        for title, included, goal, _, module, name in LINE.findall(PAGE.read_text(encoding="utf-8"))
    }


def declared_rows():
    return {
        (name, row.id): (row.title, row.included, f"{row.goal} {row.unit}".strip() if row.goal else "")
        for name in modules()
        for row in module_rows(import_module(f"benchmarks.{name}"))
    }


def test_the_page_shows_the_rows_that_benchmarks_declare_with_their_goals():
    assert rows_of_the_page() == declared_rows()


@pytest.mark.parametrize("name", sorted({module for module, _ in rows_of_the_page()}))
def test_every_declared_row_is_measured_by_its_module(name):
    module = import_module(f"benchmarks.{name}")
    source = Path(module.__file__).read_text(encoding="utf-8")
    for constant, value in vars(module).items():
        if isinstance(value, Row):
            assert len(re.findall(rf"\b{constant}\b", source)) > 1, f"{name}.{value.id} is never measured"


def test_a_ratio_is_the_median_of_its_rounds_with_both_medians_and_the_range():
    rounds = [(1.0, 2.0), (2.0, 20.0), (4.0, 12.0)]
    result = times_as_fast(ROW, rounds)
    assert result.value == 3.0
    sides = result.sides
    assert (sides.ours, sides.theirs, sides.least, sides.largest, sides.rounds) == (2.0, 12.0, 2.0, 10.0, 3)
    assert share(ROW, rounds).value == pytest.approx(1.0 / 3.0)
