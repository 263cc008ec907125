"""Confidence of likelihood regions and intervals: its default, the quantiles that follow, and its words."""

from __future__ import annotations

import math
from functools import cache
from statistics import NormalDist

CONFIDENCE = 0.90
"""Probability with which a region or an interval should hold the truth, where no other is configured."""
LEAST_CONFIDENCE, MOST_CONFIDENCE = 0.5, 0.99
"""Between these the points by which the learned model represents what it knows resolve a region."""


_DECIMALS = 3
"""Of quantiles, as tables print them: the regions in recorded sessions were bounded by 4.605 and 2.706."""


@cache
def interval_sds(confidence: float) -> float:
    """Half the width of an interval of a normal distribution, in standard deviations; 1.645 at 0.90."""
    return round(_sds(confidence), _DECIMALS)


@cache
def misfit_drop(confidence: float, angles: int) -> float:
    """Misfit above the least that bounds a likelihood region, by its probability in (0, 1).

    The chi-square quantile with as many degrees of freedom as angles are estimated: 2 for tilt and azimuth, 1
    for the tilt along a known azimuth.
    """
    drop = -2.0 * math.log1p(-confidence) if angles == 2 else _sds(confidence) ** 2
    return round(drop, _DECIMALS)


def _sds(confidence: float) -> float:
    return NormalDist().inv_cdf(0.5 * (1.0 + confidence))


def percent(confidence: float) -> str:
    """A confidence in words: ``90 %``."""
    return f"{100.0 * confidence:.3g} %"
