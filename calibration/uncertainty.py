"""Uncertainty budget after the GUM (JCGM 100): contributions and their combined uncertainty."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

COVERAGE_FACTOR = 2.0
"""Coverage factor k of expanded uncertainties, about 95 %."""


@dataclass(frozen=True, slots=True)
class Contribution:
    """One line of an uncertainty budget: its standard uncertainty, and the effect of that on the result.

    `uncertainty` is a standard uncertainty in `unit`; `effect` is the signed change of the result for it.
    Kind A is evaluated from the scatter of the data, kind B by other means (JCGM 100).
    """

    name: str
    uncertainty: float
    unit: str
    kind: Literal["A", "B"]
    effect: float


def combined_uncertainty(budget: Sequence[Contribution]) -> float:
    """Combined standard uncertainty: root sum of squares of independent effects, in their unit."""
    return math.hypot(*(line.effect for line in budget))


class Budgeted:
    """A result with an uncertainty `budget`."""

    __slots__ = ()
    budget: tuple[Contribution, ...]

    @property
    def standard_uncertainty(self) -> float:
        """Standard uncertainty, all contributions together."""
        return combined_uncertainty(self.budget)

    @property
    def expanded(self) -> float:
        """Expanded uncertainty, k = 2."""
        return COVERAGE_FACTOR * self.standard_uncertainty


def students_factor(freedom: int) -> float:
    """Factor for a standard deviation of few residuals, so that k = 2 covers 95 %: 7.0 for 1, 1.3 for 5.

    Student's t at `freedom` degrees of freedom, at least 1, for the probability within two standard
    deviations, over two (JCGM 100:2008, G.3 and table G.2).
    """
    from scipy.special import ndtr, stdtrit  # slow to import, and every configuration imports this file

    return float(stdtrit(freedom, ndtr(COVERAGE_FACTOR))) / COVERAGE_FACTOR


def largest(budget: Sequence[Contribution]) -> Contribution:
    """The contribution with the largest effect."""
    return max(budget, key=lambda line: abs(line.effect))


def effective_freedom(budget: Sequence[Contribution], freedom: int) -> float:
    """Effective degrees of freedom after Welch and Satterthwaite (JCGM 100:2008, G.4.1).

    `freedom` is that of the contributions of kind A together; those of kind B are taken as exactly known.
    Infinite without a contribution of kind A.
    """
    scatter = combined_uncertainty([line for line in budget if line.kind == "A"])
    return math.inf if scatter == 0.0 else freedom * (combined_uncertainty(budget) / scatter) ** 4
