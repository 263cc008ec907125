"""Sums of an uncertainty budget, against worked examples of the guides."""

import math

import pytest

from fieldkit.calibration.uncertainty import (
    Contribution,
    combined_uncertainty,
    effective_freedom,
    largest,
    students_factor,
)


def line(effect: float, kind: str = "B") -> Contribution:
    return Contribution("x", abs(effect), "1", kind, effect)  # type: ignore[arg-type]


def test_effective_degrees_of_freedom_are_those_of_the_guides_example():
    """UKAS M3003, appendix B: 3.5 from 4 readings within a combined 5.7 has 21.1 degrees of freedom."""
    budget = [line(3.5, "A"), line(math.sqrt(5.7**2 - 3.5**2))]
    assert combined_uncertainty(budget) == pytest.approx(5.7)
    assert effective_freedom(budget, 3) == pytest.approx(21.1, abs=0.05)


def test_what_does_not_scatter_is_known_for_ever():
    assert effective_freedom([line(2.0), line(-1.0)], 5) == math.inf


def test_contributions_add_in_quadrature_and_the_largest_may_be_negative():
    """Gauge block of GUM H.1: 25, 9.7, 2.9 and 16.6 nm make 32 nm."""
    budget = [line(25.0), line(9.7, "A"), line(2.9), line(-16.6)]
    assert combined_uncertainty(budget) == pytest.approx(32.0, abs=0.5)
    assert largest([line(5.0), line(-16.6), line(9.7)]).effect == -16.6


@pytest.mark.parametrize(("freedom", "k"), [(1, 13.97), (2, 4.53), (5, 2.65), (10, 2.28), (50, 2.05)])
def test_students_factor_is_that_of_the_guide(freedom, k):
    """JCGM 100:2008, table G.2, 95.45 %."""
    assert 2.0 * students_factor(freedom) == pytest.approx(k, abs=0.006)
