"""Parameters learnt in one session, as priors of another one of the same sand and light meter.

Exchange, gusts, sky and air are weather and stay with their session. Gain, thermal inertia and depth last;
between days they change a little, so that even a perfectly known session leaves the next one a doubt.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from fieldkit.estimation.distributions import normal_quantile
from fieldkit.estimation.learned.hypotheses import UNKNOWNS, hypotheses
from fieldkit.estimation.learned.prior_state import DAY_TO_DAY, gain_sd
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.confidence import interval_sds
from fieldkit.model.learnt import Learnt, LearntParameter

LEAST_LEARNT = 0.02
"""Information of a session over that of its prior, below which it taught nothing."""
_DEPTH = 2  # its place among the unknowns of a hypothesis
_QUANTILES = 400  # each stands for an equal share of the prior


@dataclass(frozen=True, slots=True)
class Carried:
    """Median of a parameter, in the unit of `LearntParameter`, and standard deviation of its logarithm."""

    value: float
    log_sd: float


def carry_over(
    settings: EstimatorSettings, sessions: Iterable[tuple[EstimatorSettings, Learnt]]
) -> dict[str, Carried]:
    """Priors for a further session of the same sand, from those recorded, by parameter.

    The parameter of each session is that of the campaign and a change from day to day. What a session adds is
    its posterior without its prior, so that a prior is not counted once for each session. `settings` are of
    the further session, without the others; `sessions` are settings with which each was learnt from, and what
    was learnt at its end.
    """
    start = _priors(settings)
    precision = {name: value.log_sd**-2 for name, value in start.items()}
    weighted = {name: math.log(prior.value) * precision[name] for name, prior in start.items()}
    for used, learnt in sessions:
        before = _priors(used)
        for parameter in learnt.parameters:
            name = parameter.name
            if name in before and (added := _likelihood(before[name], parameter)) is not None:
                centre, weight = added.value, 1.0 / (added.log_sd**2 + DAY_TO_DAY[name] ** 2)
                precision[name] += weight
                weighted[name] += weight * centre
    return {
        name: Carried(math.exp(weighted[name] / total), math.hypot(total**-0.5, DAY_TO_DAY[name]))
        for name, total in precision.items()
    }


def keys(parameters: Mapping[str, Carried], settings: EstimatorSettings) -> dict[str, float]:
    """Keys of ``fieldkit.toml`` that make it the prior; `settings` as of `carried`, for the heat capacity."""
    gain, inertia, depth = (parameters[name] for name in DAY_TO_DAY)
    return {
        "estimator.scale": gain.value,
        "estimator.scale_sd": gain.value * gain.log_sd,
        "prior.gain_sd": gain.value * gain.log_sd,
        "slab.conductivity_w_m_k": inertia.value**2 / settings.slab.heat_capacity_j_m3_k,
        "slab.conductivity_sd": 2.0 * inertia.log_sd,
        "prior.inertia_log_sd": inertia.log_sd,
        "slab.depth_m": depth.value / 100.0,
        "prior.depth_log_sd": depth.log_sd,
        "prior.deep_share": 0.0,
    }


def _priors(settings: EstimatorSettings) -> dict[str, Carried]:
    """Priors of what lasts; depth over sand with and without a bottom."""
    points = np.zeros((_QUANTILES, UNKNOWNS))
    points[:, _DEPTH] = normal_quantile((np.arange(_QUANTILES) + 0.5) / _QUANTILES)
    depths = np.log(100.0 * hypotheses(points, settings).depth_m)
    return {
        "gain": Carried(settings.scale, gain_sd(settings) / settings.scale),
        "thermal_inertia": Carried(settings.slab.thermal_inertia, settings.prior.inertia_log_sd),
        "depth": Carried(float(np.exp(depths.mean())), float(depths.std())),
    }


def _likelihood(before: Carried, after: LearntParameter) -> Carried | None:
    """Logarithm of the value, and its standard deviation, that a session's data alone would give."""
    log_sd = math.log(after.high / after.low) / (2.0 * interval_sds(after.confidence))
    prior, posterior = before.log_sd**-2, log_sd**-2
    added = posterior - prior
    if added < LEAST_LEARNT * prior:
        return None
    centre = (math.log(after.value) * posterior - math.log(before.value) * prior) / added
    return Carried(centre, added**-0.5)
