"""Of two slopes that fit, the one that the prior believes: uniform in tilt, 1 / sin(tilt) per solid angle."""

from __future__ import annotations

import numpy as np
import pytest

from fieldkit.estimation.normal import Branches, Choice, Misfit, choose
from fieldkit.physics.facet import normal, tilt_azimuth

FLAT_DEG, STEEP_DEG = 10.0, 30.0
NO_MISFIT = Misfit(np.eye(3), np.zeros(3), np.zeros(()), np.asarray(20))


def chosen(first: tuple[float, float], second: tuple[float, float], limit_deg: float = 45.0) -> Choice:
    """Choice between two branches given as tilt and misfit, both towards the south."""
    branches = Branches(
        normal(first[0], 180.0), normal(second[0], 180.0), np.asarray(first[1]), np.asarray(second[1]),
        np.asarray(False),
    )  # fmt: skip
    return choose(NO_MISFIT, branches, limit_deg)


def tilt_of(choice: Choice) -> float:
    return float(tilt_azimuth(choice.best)[0])


@pytest.mark.parametrize(
    ("advantage", "preferred"),
    # the price of the steeper one is 2 ln(sin 30° / sin 10°) = 2.115
    [(0.0, FLAT_DEG), (1.5, FLAT_DEG), (2.05, FLAT_DEG), (2.2, STEEP_DEG), (6.0, STEEP_DEG)],
)
def test_a_steeper_slope_is_preferred_only_for_a_clearly_better_fit(advantage, preferred):
    found = chosen((STEEP_DEG, 5.0 - advantage), (FLAT_DEG, 5.0))
    assert tilt_of(found) == pytest.approx(preferred)
    other = STEEP_DEG if preferred == FLAT_DEG else FLAT_DEG
    assert float(tilt_azimuth(found.other)[0]) == pytest.approx(other)


def test_a_slope_beyond_the_limit_is_not_believed_however_well_it_fits():
    found = chosen((50.0, 0.0), (20.0, 30.0))
    assert tilt_of(found) == pytest.approx(20.0)
    assert np.isnan(found.other).all()
    assert tilt_of(chosen((45.0, 0.0), (20.0, 30.0))) == pytest.approx(45.0)
