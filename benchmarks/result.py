"""The one kind of row in which every benchmark reports, and its declaration."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType


@dataclass(frozen=True, slots=True)
class Row:
    """A row of the measure as a module declares it, before anything is measured.

    Those of ``docs/explanation/speed.md`` are these: title, goal and what is included must be the same there.

    Attributes
    ----------
    id
        A short name, of one row within its module.
    title
        What is measured, and against what.
    goal
        The original goal, never the reached value; empty where a row only explains another one.
    unit
        Of the value; "x" is a ratio of the two sides.
    included
        What the numbers include.
    """

    id: str
    title: str
    goal: str
    unit: str = "x"
    included: str = ""

    def result(self, value: float, note: str = "") -> Result:
        """The row with one number."""
        return Result(self.title, value, self.unit, self.goal, note, self.included, self.id)


@dataclass(frozen=True, slots=True)
class Sides:
    """Medians of both sides over the rounds of one run, and the least and the largest ratio of a round."""

    ours: float
    theirs: float
    unit: str
    least: float
    largest: float
    rounds: int


@dataclass(frozen=True, slots=True)
class Result:
    """A measured row: what, its value and unit, the original goal, and what it was held against.

    Attributes
    ----------
    included, id
        As of the `Row`.
    sides
        Both sides of a ratio; None for a number by itself.
    steal
        Share of the processors that the host took away meanwhile, in [0, 1]; None where it was not noted.
    """

    name: str
    value: float
    unit: str
    must: str
    note: str = ""
    included: str = ""
    id: str = ""
    sides: Sides | None = None
    steal: float | None = None


def module_rows(module: ModuleType) -> list[Row]:
    """The rows that a module declares, in its order."""
    return [value for value in vars(module).values() if isinstance(value, Row)]
