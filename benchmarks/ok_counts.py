"""How many slopes are ``ok``, by the present limit and by the one before, so that tables can be compared."""

from __future__ import annotations

from collections.abc import Iterable

from fieldkit.model.slope import CERTAIN, SlopeEstimate

OLD_HALF_WIDTH_DEG, OLD_SHARE = 1.5, 0.1
"""The limit until ``estimator.target_half_width_deg``: of the half-width, and as a share of the tilt."""


def is_ok_by_old_limit(slope: SlopeEstimate) -> bool:
    """Whether a certain slope is as narrow as the old limit asked for."""
    limit_deg = max(OLD_HALF_WIDTH_DEG, OLD_SHARE * slope.tilt_deg)
    return slope.state in CERTAIN and slope.tilt_half_width_deg <= limit_deg


def ok_words(slopes: Iterable[SlopeEstimate]) -> str:
    """``12 ok, 7 by the old limit``."""
    certain = [slope for slope in slopes if slope.state in CERTAIN]
    return f"{len(certain)} ok, {sum(map(is_ok_by_old_limit, certain))} by the old limit"
