"""Results of learning from a session's data: parameters with prior and posterior, and the residuals left."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from fieldkit.model.confidence import CONFIDENCE, interval_sds


@dataclass(frozen=True, slots=True)
class LearntParameter:
    """One parameter of surface, air or sky: the prior, and what the data made of it.

    `name` is such as ``thermal_inertia``, `unit` as printed, "" for a ratio; the prior and `value` are
    medians with intervals that hold the truth with a probability of `confidence`. `share_of_prior` is
    posterior over prior standard deviation, in [0, 1]: 1 where the data said nothing.
    """

    name: str
    unit: str
    prior: float
    prior_low: float
    prior_high: float
    value: float
    low: float
    high: float
    share_of_prior: float
    confidence: float = CONFIDENCE

    @property
    def sd(self) -> float:
        """Standard uncertainty given the data, in `unit`, as of a normal distribution with this interval."""
        return (self.high - self.low) / (2.0 * interval_sds(self.confidence))


@dataclass(frozen=True, slots=True)
class Learnt:
    """Everything learnt up to one minute: the parameters that all regions share, in a fixed order, and
    residuals.

    `residual_k` is the root mean square of each region's one-minute-ahead prediction errors. Of the
    standardised ones `autocorrelation` is from one minute to the next, near 0 where the model explains the
    data, `chi_square` the mean square of all, near 1 where the stated noise holds.
    """

    parameters: tuple[LearntParameter, ...]
    residual_k: Mapping[str, float] = field(default_factory=dict)
    autocorrelation: Mapping[str, float] = field(default_factory=dict)
    chi_square: float = float("nan")

    def misfit(self, region: str) -> float:
        """How much too small stated variances are: ``c (1 + r) / (1 - r)``, mean square c, correlation r."""
        correlation = min(max(self.autocorrelation.get(region, 0.0), 0.0), 0.95)
        return self.chi_square * (1.0 + correlation) / (1.0 - correlation)
