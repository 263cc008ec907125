"""An uncertainty budget after the GUM: its lines, their sum, and which of them to work on first."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

COVERAGE_FACTOR = 2.0
"""k of every expanded uncertainty here, about 95 %."""


@dataclass(frozen=True, slots=True)
class Contribution:
    """One line of a budget: what is uncertain and by how much, and what that does to the result.

    `uncertainty` is a standard uncertainty in `unit`; `effect` is the change of the result with it, signed.
    Kind A is evaluated from the scatter of the data, kind B from elsewhere (JCGM 100).
    """

    name: str
    uncertainty: float
    unit: str
    kind: Literal["A", "B"]
    effect: float


def combined_uncertainty(budget: Sequence[Contribution]) -> float:
    """Standard uncertainty of the result: root of the sum of squares of independent effects."""
    return math.hypot(*(line.effect for line in budget))


def largest(budget: Sequence[Contribution]) -> Contribution:
    """The contribution to work on first."""
    return max(budget, key=lambda line: abs(line.effect))


def effective_freedom(budget: Sequence[Contribution], freedom: int) -> float:
    """Effective degrees of freedom (Welch and Satterthwaite, JCGM 100 G.4.1).

    `freedom` are those of the lines of kind A together; what is of kind B counts as known well.
    """
    scatter = combined_uncertainty([line for line in budget if line.kind == "A"])
    return math.inf if scatter == 0.0 else freedom * (combined_uncertainty(budget) / scatter) ** 4
