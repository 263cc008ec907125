"""P(tilt > limit) of one slope, from its likelihood region."""

from __future__ import annotations

import math

from fieldkit.estimation.distributions import normal_cdf
from fieldkit.model.confidence import misfit_drop
from fieldkit.model.slope import WITH_SLOPE, SlopeEstimate


def tilt_probability(estimate: SlopeEstimate, limit_deg: float) -> float:
    """Probability that a surface is steeper than a limit; NaN without a slope or without its region.

    The tilt is taken as normally distributed to either side of its estimate, with the standard deviation to
    which the likelihood region corresponds: of one angle with the learned model or where the azimuth was
    given, else of two. Where a
    second slope fits, its probability is not known, so both count the same, the second with the uncertainty
    of the first.
    """
    low, tilt, high = estimate.tilt_low_deg, estimate.tilt_deg, estimate.tilt_high_deg
    if estimate.state not in WITH_SLOPE or not math.isfinite(low + tilt + high):
        return math.nan
    is_of_tilt = estimate.model.startswith("learned") or estimate.azimuth_low_deg == estimate.azimuth_high_deg
    sds = math.sqrt(misfit_drop(estimate.confidence, 1 if is_of_tilt else 2))
    below, above = (tilt - low) / sds, (high - tilt) / sds
    if not math.isfinite(estimate.second_tilt_deg):
        return _steeper(tilt, below, above, limit_deg)
    # bounds of an unresolved slope may hold both branches: of each, the narrower side is its own
    sd = min(below, above)
    both = (tilt, estimate.second_tilt_deg)
    return sum(_steeper(angle, sd, sd, limit_deg) for angle in both) / len(both)


def _steeper(tilt_deg: float, below: float, above: float, limit_deg: float) -> float:
    """P(tilt > limit) of two half normals that meet at the tilt, with these standard deviations."""
    away = limit_deg - tilt_deg
    sd = above if away > 0.0 else below
    if sd <= 0.0:
        return 0.0 if away > 0.0 else 1.0
    weight = 2.0 * sd / (below + above)
    tail = weight * float(normal_cdf(-abs(away) / sd))
    return tail if away > 0.0 else 1.0 - tail
